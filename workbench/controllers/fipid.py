"""FIPID: the fuzzy immune PID of Chu, Yu, Lin, Yuan & Jiang."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import ClassVar, NamedTuple, Self

from models.expression import Expression
from models.plant import Signal
from models.quantity import choice, declared, quantity, table
from workbench.contracts.law import Law, PIDAction, Task, Trial
from workbench.controllers.parts import immune
from workbench.controllers.parts.immune_gain import gain
from workbench.controllers.parts.rows import column, zeros
from workbench.controllers.parts.scales import PUBLISHED, scales


class Memory(NamedTuple):
    """What an operator adds to the law at each sample, (1, N), in its units; it stays in the integrated u."""

    added: Expression


class Acting(NamedTuple):
    """The last two inputs and errors, and what the last sample's gain was made of."""

    u: Expression
    u_1: Expression
    e: Expression
    e_1: Expression
    p1: Expression
    p2: Expression
    f: Expression


@declared
class FIPID(Law[Memory, Acting]):
    """u(k) = u(k-1) + (p1 - p2 f)(De + ki' e + kd' D2e), p1 = K, p2 = K eta, f = f(u(k-1), Du(k-1)).

    Ours: the memberships and the mean of maxima over 101 points, which the paper names without numbers; the choice
    ``f = smooth``; units that the law computes in, so that it can drive plants of another scale.
    """

    source: ClassVar[str] = "Chu, Yu, Lin, Yuan & Jiang (undated copy), FIPID on the plant (12)"
    tells: ClassVar[tuple[Signal, ...]] = immune.TOLD

    K: float = quantity(default=0.3, unit="input unit/output unit", doc="speed of reaction, p1", least=0)
    eta: float = quantity(default=0.8, unit="1", doc="stabilising effect: p2 = K eta", least=0)
    ki: float = quantity(default=0.3, unit="1", doc="integral coefficient ki'", least=0)
    kd: float = quantity(default=0.3, unit="1", doc="derivative coefficient kd'", least=0)
    f: str = choice(default="rules", options=immune.STIMULI, doc="fuzzy rules, or their smooth stand-in")
    input_unit: float = quantity(default=1.0, unit="plant's input", doc="the unit that the law gives u in", above=0)
    output_unit: float = quantity(default=1.0, unit="plant's output", doc="the unit that the law takes e in", above=0)
    added: tuple[float, ...] = table(default=(), unit="plant's input", doc=immune.ADDED)

    def refusal(self, task: Task) -> str | None:
        """Return the refusal of additions that are not one a sample."""
        return immune.misfit(self.added, task)

    def start(self, task: Task) -> Memory:
        """Return what is added at each sample."""
        return Memory(immune.additions(self.added, task, self.input_unit))

    def ready(self, memory: Memory) -> Acting:
        """Return the state before the first sample: everything 0 (the paper's step 1)."""
        still = zeros()
        return Acting(still, still, still, still, column(self.K), column(self.K * self.eta), still)

    def act(
        self, memory_k: Memory, state: Acting, r: Expression, r_next: Expression, y: Expression
    ) -> tuple[Expression, Acting]:
        """Return the input and the state after a sample."""
        e = (r - y) / self.output_unit
        f = immune.stimulus(self.f, state.u, state.u - state.u_1)
        p1, p2 = self.K, self.K * self.eta
        u = state.u + (p1 - p2 * f) * immune.bracket(e, state.e, state.e_1, self.ki, self.kd)  # the feedback law
        u = u + memory_k.added
        return u * self.input_unit, Acting(u, state.u, e, state.e, column(p1), column(p2), f)

    def tell(self, memory: Memory, trial: Trial[Acting]) -> tuple[Expression, ...]:
        """Return what the gain of every sample was made of: rows p1, p2, f."""
        return trial.state.p1, trial.state.p2, trial.state.f

    def ranges(self, task: Task) -> Mapping[str, tuple[float, float]]:
        """Return the numbers to tune, K about the input that changes the output by one unit a second."""
        unit = abs(scales(task).rate) * self.output_unit / self.input_unit
        return {"K": (0.01 * unit, 30.0 * unit), "eta": (0.01, 1.0), "ki": (1e-3, 1.0), "kd": (1e-3, 3.0)}

    def scaled_for(self, task: Task) -> Self:
        """Return the law in units in which references are as large as those that it was published with."""
        scale = scales(task)
        output = scale.largest / PUBLISHED
        return dataclasses.replace(self, input_unit=abs(scale.rate) * output, output_unit=output)

    @property
    def pid(self) -> PIDAction:
        """The bracket behind its gain p1 - p2 f."""
        unit = self.input_unit / self.output_unit
        return PIDAction("incremental", 1.0, self.ki, self.kd, unit, gain, self.f)
