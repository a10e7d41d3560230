"""Tracking MPC on a linear model with an estimated disturbance, its quadratic program solved inside the fold."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import ClassVar, NamedTuple, Self

import casadi as ca

from models.expression import Expression, Number
from models.plant import Signal, signals
from models.quantity import InvalidValue, count, declared, quantity
from workbench.contracts.law import Law, Task, Trial
from workbench.controllers.parts.box_program import minimum
from workbench.controllers.parts.rows import zeros
from workbench.controllers.parts.scales import scales


class Memory(NamedTuple):
    """The references of the samples to come, (horizon, N), the sampling time, and limits in units of ``input_unit``."""

    ahead: Expression
    sampling_time: Expression
    lower: Number
    upper: Number
    rate: Number


class Acting(NamedTuple):
    """Last input and output, the estimated disturbance, the last plan, and how far that was from the optimum."""

    u: Expression
    y: Expression
    d: Expression
    plan: Expression
    residual: Expression


@declared
class TrackingMPC(Law[Memory, Acting]):
    """Minimise sum (r - y)^2 + weight sum (change of u)^2 over a horizon, u constant in blocks between its limits.

    The model is y(k+1) = a y(k) + b u(k) + d, with d the last model error, low-pass filtered, so that tracking has
    no offset. The box-constrained quadratic program is solved in ``sweeps`` rounds from the last plan, shifted: each is
    a projected Gauss-Seidel sweep, which converges from anywhere, then two of Newton's steps on the face where it ends,
    exact once that face is the optimum's (:mod:`workbench.controllers.parts.box_program`). Of 11 000 random programs
    with 5 blocks none needed more than 5 rounds to be exact to rounding, of 800 with 20 blocks none more than 8.
    ``residual``, which the law tells, is the largest step that a further sweep would begin with, relative to
    ``input_unit``. The limits are those of the plant, tightened by the law's own. A rate limit is known to the
    estimator only: the plan is cut to it at the sample.
    """

    source: ClassVar[str] = "ours, after Rawlings, Mayne & Diehl, Model Predictive Control, 2017, 1.5"
    told: ClassVar[tuple[str, ...]] = ("reference", "limits")
    tells: ClassVar[tuple[Signal, ...]] = signals(residual=("1", "step left by the QP's solution"))
    solves_per_sample: ClassVar[int] = 1

    a: float = quantity(default=1.0, unit="1", doc="dy(k+1)/dy(k) of the model")
    b: float = quantity(default=1.0, unit="output/input unit", doc="dy(k+1)/du(k) of the model")
    weight: float = quantity(default=0.1, unit="(output/input unit)^2", doc="weight on changes of u", above=0)
    smoothing: float = quantity(default=0.3, unit="1", doc="share of a new model error in d", above=0, most=1)
    horizon: int = count(default=20, unit="samples", doc="samples that are looked ahead", least=1, most=200)
    blocks: int = count(default=5, doc="blocks of constant input in the horizon", least=1, most=20)
    sweeps: int = count(default=6, doc="rounds of a sample's QP, each a sweep and two steps", least=1, most=500)
    input_unit: float = quantity(default=1.0, unit="plant's input", doc="the unit that the law gives u in", above=0)
    lower: float | None = quantity(
        default=None, unit="plant's input", doc="least input", optional=True, structural=True
    )
    upper: float | None = quantity(
        default=None, unit="plant's input", doc="largest input", optional=True, structural=True
    )
    rate: float | None = quantity(
        default=None, unit="plant's input/s", doc="largest rate of change", above=0, optional=True, structural=True
    )

    def check(self) -> None:
        """Raise InvalidValue where there are more blocks than samples, or limits cross."""
        if self.blocks > self.horizon:
            raise InvalidValue(f"blocks must not exceed the horizon of {self.horizon} samples, got {self.blocks}")
        if self.lower is not None and self.upper is not None and self.lower >= self.upper:
            raise InvalidValue(f"lower must lie below upper, got {self.lower!r} and {self.upper!r}")

    def start(self, task: Task) -> Memory:
        """Return the references ahead of every sample, the last one held."""
        n, r = task.samples, task.reference[0, :]
        rows = []
        for j in range(1, self.horizon + 1):
            known = r[:, min(j, n) : n + 1]
            rows.append(ca.horzcat(known, ca.repmat(r[:, n], 1, n - known.shape[1])))
        limits = task.limits.tightened(self.lower, self.upper, self.rate).scaled(self.input_unit)
        return Memory(ca.vertcat(*rows), task.sampling_time, *limits)

    def ready(self, memory: Memory) -> Acting:
        """Return the state before the first sample: everything 0."""
        return Acting(zeros(), zeros(), zeros(), zeros(self.blocks), zeros())

    def act(
        self, memory_k: Memory, state: Acting, r: Expression, r_next: Expression, y: Expression
    ) -> tuple[Expression, Acting]:
        """Return the first input of the plan and the state after a sample."""
        y = y[0]
        error = y - self.a * state.y - self.b * state.u
        d = state.d + self.smoothing * (error - state.d)
        free, gains = self._predicted(y, d)
        H, g = self._program(free - memory_k.ahead, gains, state.u)
        first = ca.vertcat(state.plan[1:], state.plan[-1])
        plan, residual = minimum(H, g, memory_k.lower, memory_k.upper, first, self.sweeps)
        u = plan[0]
        most = memory_k.rate * memory_k.sampling_time
        u = ca.if_else(most < math.inf, state.u + ca.fmin(ca.fmax(u - state.u, -most), most), u)
        return u * self.input_unit, Acting(u, y, d, plan, residual)

    def tell(self, memory: Memory, trial: Trial[Acting]) -> tuple[Expression]:
        """Return how far each plan was from the optimum."""
        return (trial.state.residual,)

    def _predicted(self, y: Expression, d: Expression) -> tuple[Expression, Expression]:
        """Return the outputs ahead without input, (horizon,), and what each block adds, (horizon, blocks)."""
        free, added = [], []
        row: list[Number] = [0] * self.blocks
        for j in range(self.horizon):
            y = self.a * y + d
            row = [self.a * value for value in row]
            block = j * self.blocks // self.horizon
            row[block] = row[block] + self.b
            free.append(y)
            added.append(ca.horzcat(*row))
        return ca.vertcat(*free), ca.vertcat(*added)

    def _program(self, error: Expression, gains: Expression, u: Expression) -> tuple[Expression, Expression]:
        """Return Hessian and gradient at 0 of half the cost."""
        M = self.blocks
        change = ca.DM.eye(M) - ca.vertcat(ca.DM.zeros(1, M), ca.DM.eye(M)[: M - 1, :])
        H = gains.T @ gains + self.weight * (change.T @ change)
        first = ca.vertcat(1, ca.DM.zeros(M - 1))
        return H, gains.T @ error - self.weight * u * first

    def ranges(self, task: Task) -> Mapping[str, tuple[float, float]]:
        """Return the weight, about the square of the model's slope, and the smoothing to tune."""
        return {"weight": (1e-3 * self.b**2, 1e4 * self.b**2), "smoothing": (0.01, 1.0)}

    def scaled_for(self, task: Task) -> Self:
        """Return the law with the plant's own slopes, in the input that changes the output by one unit a second."""
        scale = scales(task)
        unit = abs(scale.rate)
        b = unit / scale.step
        return dataclasses.replace(self, a=scale.decay, b=b, input_unit=unit, weight=b**2)
