"""BP-FIPID: the fuzzy immune PID whose p1, p2 a network trains on line; Chu, Yu, Lin, Yuan & Jiang."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import casadi as ca
import numpy as np

from models.plant import Signal
from models.quantity import InvalidValue, choice, count, declared, quantity, table
from workbench.contracts.law import Law, Task, Trial
from workbench.controllers.parts import immune

INPUTS, OUTPUTS = 4, 2


class Memory(NamedTuple):
    """What is added at each sample, (1, N), and the weights at the beginning of a trial, row by row."""

    added: Any
    W2: Any
    W3: Any


class Acting(NamedTuple):
    """The last inputs, errors and output, the gain's parts, the weights and their last changes, row by row."""

    u: Any
    u_1: Any
    e: Any
    e_1: Any
    y: Any
    p1: Any
    p2: Any
    f: Any
    W2: Any
    W3: Any
    W2_change: Any
    W3_change: Any


@declared
class BPFIPID(Law):
    """FIPID with p1, p2 from a network (4 inputs, tanh nodes, 2 outputs) that learns by back-propagation.

    Deviations, where the paper is silent or lost: the sign of the finite difference (y(k) - y(k-1))/(u(k) - u(k-1))
    stands for dy(k+1)/du(k), being 0 where either does not change; the hidden layer's gradient uses W3 before its
    update; units as in FIPID. Weights come from ``weight_seed`` (W2 then W3, uniform) unless W2 and W3 are given.
    With beta = 0 the weights stay frozen at their start. A later trial begins with the same weights.
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
    weight_seed: int = count(default=0, doc="seed of the weights")
    W2: tuple[float, ...] | None = table(
        default=None, unit="1", doc="hidden weights, hidden x 4, row by row; null draws them", optional=True
    )
    W3: tuple[float, ...] | None = table(
        default=None, unit="1", doc="output weights, 2 x hidden, row by row; null draws them", optional=True
    )
    f: str = choice(default="rules", options=immune.STIMULI, doc="fuzzy rules, or their smooth stand-in")
    input_unit: float = quantity(default=1.0, unit="plant's input", doc="the unit that the law gives u in", above=0)
    output_unit: float = quantity(default=1.0, unit="plant's output", doc="the unit that the law takes e in", above=0)

    def check(self) -> None:
        """Raise InvalidValue for weights of the wrong shape."""
        for name, rows, columns in (("W2", self.hidden, INPUTS), ("W3", OUTPUTS, self.hidden)):
            given = getattr(self, name)
            if given is not None and len(given) != rows * columns:
                raise InvalidValue(
                    f"{name} must hold {rows} x {columns} = {rows * columns} weights, row by row; got {len(given)}"
                )

    def weights(self) -> tuple[Any, Any]:
        """Return W2 (hidden x 4) and W3 (2 x hidden) at the start, as arrays."""
        rng = np.random.default_rng(self.weight_seed)
        W2 = rng.uniform(-self.spread, self.spread, (self.hidden, INPUTS))
        W3 = rng.uniform(-self.spread, self.spread, (OUTPUTS, self.hidden))
        return (
            W2 if self.W2 is None else np.reshape(self.W2, W2.shape),
            W3 if self.W3 is None else np.reshape(self.W3, W3.shape),
        )

    def start(self, task: Task) -> Memory:
        """Return the memory of a run in which nothing is added, with the weights at their start."""
        W2, W3 = self.weights()
        return Memory(ca.DM.zeros(1, task.samples), ca.DM(W2.ravel()), ca.DM(W3.ravel()))

    def ready(self, memory: Memory) -> Acting:
        """Return the state before the first sample: everything 0 but the weights (the paper's step 1)."""
        still = (ca.DM.zeros(self.hidden * INPUTS), ca.DM.zeros(OUTPUTS * self.hidden))
        return Acting(0, 0, 0, 0, 0, 0, 0, 0, memory.W2, memory.W3, *still)

    def tell(self, memory: Memory, trial: Trial) -> Any:
        """Return what the gain of every sample was made of: rows p1, p2, f."""
        return trial.state.p1, trial.state.p2, trial.state.f

    def act(self, memory_k: Memory, state: Acting, r: Any, r_next: Any, y: Any) -> tuple[Any, Acting]:
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


def _matrix(column: Any, rows: int, columns: int) -> Any:
    """Return a column that holds a matrix row by row as that matrix."""
    return ca.reshape(column, columns, rows).T


def _row_by_row(matrix: Any) -> Any:
    """Return a matrix as a column, row by row."""
    return ca.vec(matrix.T)
