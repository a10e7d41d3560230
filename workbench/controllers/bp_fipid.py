"""BP-FIPID: the fuzzy immune PID whose p1, p2 a network trains on line; Chu, Yu, Lin, Yuan & Jiang."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import ClassVar, NamedTuple, Self

import casadi as ca
import numpy as np

from models.array import Array
from models.expression import Expression, as_expression
from models.plant import Signal
from models.quantity import InvalidValue, choice, count, declared, quantity, table
from workbench.contracts.law import Law, PIDAction, Task, Trial
from workbench.controllers.parts import immune
from workbench.controllers.parts.immune_gain import gain
from workbench.controllers.parts.rows import zeros
from workbench.controllers.parts.scales import PUBLISHED, scales

INPUTS, OUTPUTS = 4, 2


class Memory(NamedTuple):
    """What is added at each sample, (1, N), in the law's unit, and the weights of a trial's beginning, row by row."""

    added: Expression
    W2: Expression
    W3: Expression


class Acting(NamedTuple):
    """The last inputs, errors and output, the gain's parts, the weights and their last changes, row by row."""

    u: Expression
    u_1: Expression
    e: Expression
    e_1: Expression
    y: Expression
    p1: Expression
    p2: Expression
    f: Expression
    W2: Expression
    W3: Expression
    W2_change: Expression
    W3_change: Expression


@declared
class BPFIPID(Law[Memory, Acting]):
    """FIPID with p1, p2 from a network (4 inputs, tanh nodes, 2 outputs) that learns by back-propagation.

    Deviations, where the paper is silent or lost: the sign of the finite difference (y(k) - y(k-1))/(u(k) - u(k-1))
    stands for dy(k+1)/du(k), being 0 where either does not change; the hidden layer's gradient uses W3 before its
    update; units as in FIPID. Weights are drawn from the study's seed plus ``weight_seed`` (W2 then W3, uniform)
    unless given. With beta = 0 the weights stay frozen at their start. A later trial begins with the same weights.
    """

    source: ClassVar[str] = "Chu, Yu, Lin, Yuan & Jiang (undated copy), BP-FIPID, steps 1-6"
    tells: ClassVar[tuple[Signal, ...]] = immune.TOLD

    ki: float = quantity(default=0.3, unit="1", doc="integral coefficient ki'", least=0)
    kd: float = quantity(default=0.3, unit="1", doc="derivative coefficient kd'", least=0)
    alpha: float = quantity(default=0.001, unit="1", doc="inertia of the weights' changes", least=0, below=1)
    beta: float = quantity(default=0.001, unit="1", doc="learning rate; 0 freezes the weights", least=0)
    hidden: int = count(default=5, doc="nodes of the hidden layer", least=1)
    spread: float = quantity(
        default=0.5, unit="1", doc="weights start uniformly in [-spread, spread]", above=0, structural=True
    )
    weight_seed: int = count(default=0, doc="added to the study's seed, of which the weights are drawn")
    W2: tuple[float, ...] | None = table(
        default=None, unit="1", doc="hidden weights, hidden x 4, row by row; null draws them", optional=True
    )
    W3: tuple[float, ...] | None = table(
        default=None, unit="1", doc="output weights, 2 x hidden, row by row; null draws them", optional=True
    )
    f: str = choice(default="rules", options=immune.STIMULI, doc="fuzzy rules, or their smooth stand-in")
    input_unit: float = quantity(default=1.0, unit="plant's input", doc="the unit that the law gives u in", above=0)
    output_unit: float = quantity(default=1.0, unit="plant's output", doc="the unit that the law takes e in", above=0)
    added: tuple[float, ...] = table(default=(), unit="plant's input", doc=immune.ADDED)

    def check(self) -> None:
        """Raise InvalidValue for weights of the wrong shape."""
        for name, given, rows, columns in (
            ("W2", self.W2, self.hidden, INPUTS),
            ("W3", self.W3, OUTPUTS, self.hidden),
        ):
            if given is not None and len(given) != rows * columns:
                raise InvalidValue(
                    f"{name} must hold {rows} x {columns} = {rows * columns} weights, row by row; got {len(given)}"
                )

    def refusal(self, task: Task) -> str | None:
        """Return the refusal of additions that are not one a sample."""
        return immune.misfit(self.added, task)

    def weights(self, seed: int = 0) -> tuple[Array, Array]:
        """Return W2 (hidden x 4) and W3 (2 x hidden) at the start of a study of a seed, as arrays."""
        rng = np.random.default_rng(self.weight_seed + seed)
        W2 = rng.uniform(-self.spread, self.spread, (self.hidden, INPUTS))
        W3 = rng.uniform(-self.spread, self.spread, (OUTPUTS, self.hidden))
        return (
            W2 if self.W2 is None else np.array(self.W2).reshape(W2.shape),
            W3 if self.W3 is None else np.array(self.W3).reshape(W3.shape),
        )

    def chance(self, seed: int) -> Sequence[float]:
        """Return the weights of a study of a seed, W2 then W3, row by row; nothing where both are given."""
        if self.W2 is not None and self.W3 is not None:
            return ()
        return tuple(float(weight) for matrix in self.weights(seed) for weight in matrix.ravel())

    def start(self, task: Task) -> Memory:
        """Return what is added at each sample, and the weights at their start: those that were drawn, if any were."""
        drawn = task.chance
        if not drawn.numel():
            drawn = as_expression(ca.DM(np.concatenate([matrix.ravel() for matrix in self.weights()])))
        first = self.hidden * INPUTS
        return Memory(immune.additions(self.added, task, self.input_unit), drawn[:first], drawn[first:])

    def ready(self, memory: Memory) -> Acting:
        """Return the state before the first sample: everything 0 but the weights (the paper's step 1)."""
        o, changes = zeros(), (zeros(self.hidden * INPUTS), zeros(OUTPUTS * self.hidden))
        return Acting(o, o, o, o, o, o, o, o, memory.W2, memory.W3, *changes)

    def act(
        self, memory_k: Memory, state: Acting, r: Expression, r_next: Expression, y: Expression
    ) -> tuple[Expression, Acting]:
        """Return the input, and the state with the weights that were learned at this sample."""
        r, y = r / self.output_unit, y / self.output_unit
        e = r - y
        W2, W3 = _matrix(state.W2, self.hidden, INPUTS), _matrix(state.W3, OUTPUTS, self.hidden)
        x = ca.vertcat(r, y, e, 1)  # input layer
        o = ca.tanh(W2 @ x)  # hidden layer
        p = (1 + ca.tanh(W3 @ o)) / 2  # output layer: p1, p2
        f = immune.stimulus(self.f, state.u, state.u - state.u_1)
        change = immune.bracket(e, state.e, state.e_1, self.ki, self.kd)
        u = state.u + (p[0] - p[1] * f) * change + memory_k.added  # the feedback law, step 4
        direction = ca.sign((y - state.y) * (u - state.u))  # for dy(k+1)/du(k)
        delta3 = e * direction * ca.vertcat(change, -f * change) * 2 * p * (1 - p)  # output layer's gradient
        delta2 = (1 - o**2) * (W3.T @ delta3)  # hidden layer's gradient
        dW3 = self.alpha * state.W3_change + self.beta * _row_by_row(delta3 @ o.T)  # learning of W3, step 5
        dW2 = self.alpha * state.W2_change + self.beta * _row_by_row(delta2 @ x.T)  # learning of W2
        return u * self.input_unit, Acting(
            u, state.u, e, state.e, y, p[0], p[1], f, state.W2 + dW2, state.W3 + dW3, dW2, dW3
        )

    def tell(self, memory: Memory, trial: Trial[Acting]) -> tuple[Expression, ...]:
        """Return what the gain of every sample was made of: rows p1, p2, f."""
        return trial.state.p1, trial.state.p2, trial.state.f

    def ranges(self, task: Task) -> Mapping[str, tuple[float, float]]:
        """Return the numbers to tune, the unit about the input that changes the output by one unit a second."""
        unit = abs(scales(task).rate) * self.output_unit
        return {
            "input_unit": (0.05 * unit, 50 * unit),
            "ki": (1e-3, 1.0),
            "kd": (1e-3, 3.0),
            "beta": (1e-5, 0.1),
        }

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


def _matrix(column: Expression, rows: int, columns: int) -> Expression:
    """Return a column that holds a matrix row by row as that matrix."""
    return ca.reshape(column, columns, rows).T


def _row_by_row(matrix: Expression) -> Expression:
    """Return a matrix as a column, row by row."""
    return ca.vec(matrix.T)
