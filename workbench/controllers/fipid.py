"""FIPID: the fuzzy immune PID of Chu, Yu, Lin, Yuan & Jiang."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import casadi as ca

from models.plant import Signal
from models.quantity import choice, declared, quantity
from workbench.contracts.law import Law, Task, Trial
from workbench.controllers.parts import immune


class Memory(NamedTuple):
    """What an operator adds to the law at each sample, (1, N), in input units; it stays in the integrated u."""

    added: Any


class Acting(NamedTuple):
    """The last two inputs and errors, and what the last sample's gain was made of."""

    u: Any
    u_1: Any
    e: Any
    e_1: Any
    p1: Any
    p2: Any
    f: Any


@declared
class FIPID(Law):
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

    def start(self, task: Task) -> Memory:
        """Return the memory of a run in which nothing is added."""
        return Memory(ca.DM.zeros(1, task.samples))

    def ready(self, memory: Memory) -> Acting:
        """Return the state before the first sample: everything 0 (the paper's step 1)."""
        return Acting(0, 0, 0, 0, self.K, self.K * self.eta, 0)

    def tell(self, memory: Memory, trial: Trial) -> Any:
        """Return what the gain of every sample was made of: rows p1, p2, f."""
        return trial.state.p1, trial.state.p2, trial.state.f

    def act(self, memory_k: Memory, state: Acting, r: Any, r_next: Any, y: Any) -> tuple[Any, Acting]:
        """Return the input and the state after a sample."""
        e = (r - y) / self.output_unit
        f = immune.stimulus(self.f, state.u, state.u - state.u_1)
        p1, p2 = self.K, self.K * self.eta
        u = state.u + (p1 - p2 * f) * immune.bracket(e, state.e, state.e_1, self.ki, self.kd)  # the feedback law
        u = u + memory_k.added
        return u * self.input_unit, Acting(u, state.u, e, state.e, p1, p2, f)
