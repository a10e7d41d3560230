"""MFAILC on the speed increment: a repair of iCFDL-MFAILC whose convergence can be proved."""

from __future__ import annotations

import dataclasses
from typing import ClassVar, NamedTuple, Self

import casadi as ca

from models.expression import Expression
from models.quantity import InvalidValue, declared, quantity, table
from workbench.contracts.law import LearnedSignal, Task, Trial
from workbench.controllers.parts import zero_phase
from workbench.controllers.parts.ppd_estimator import Parameters, scaled
from workbench.controllers.parts.rows import constant_row, first_plan, known, missing, zeros


class Memory(NamedTuple):
    """Plan and estimate of the trial to come, and what the last trial left; rows of N or N + 1 columns."""

    u: Expression
    phi: Expression
    u_before: Expression
    y_before: Expression
    reached_before: Expression
    sampling_time: Expression


@declared
class Increment(Parameters[Memory]):
    """The law (13)-(15) of Jiao & Hou (2025) on z(k+1) = y(k+1) - y(k) in place of y(k+1). Ours.

    The lifted operator from inputs to increments is nearly diagonal where the plant is nearly an integrator, so
    the error contracts for every phi > 0 (the claims ``increment_monotone`` and ``increment_weighted`` say where).
    ``phi_range`` holds the estimate between two ends, so that the learning gain has a least value and the claim
    ``learning_curve`` can bound how fast it learns. Measurement noise biases the estimate towards 1/l, above 4 phi:
    without ends phi runs away and learning stalls, unless a large mu (1e4 for a speed noise of 0.05 km/h) keeps it
    out. Increments also amplify noise in the plan: ``q_cutoff_hz`` passes it through a zero-phase low-pass filter.
    """

    source: ClassVar[str] = "ours, after Jiao & Hou 2025, (13)-(15)"
    told: ClassVar[tuple[str, ...]] = ("reference", "plan")
    learns_on: ClassVar[LearnedSignal | None] = "increment"

    force_unit: float = quantity(default=10_000.0, unit="N", doc="the unit that the law computes forces in", above=0)
    phi_range: tuple[float, float] | None = table(
        default=None,
        unit="output/force unit",
        doc="ends that the estimate is held between; null takes phi(k,1)/3 and 3 phi(k,1)",
        optional=True,
    )
    q_cutoff_hz: float | None = quantity(
        default=None,
        unit="Hz",
        doc="cutoff of the zero-phase low-pass filter on the plan; null: none",
        above=0,
        optional=True,
        structural=True,
    )

    def check(self) -> None:
        """Raise InvalidValue unless phi_range is a range of one sign that holds the first estimate."""
        super().check()
        if self.phi_range is None:
            return
        if len(self.phi_range) != 2 or not self.phi_range[0] < self.phi_range[1]:
            raise InvalidValue(f"phi_range must be two numbers, the smaller first, got {list(self.phi_range)}")
        low, high = self.phi_range
        first = self.first_estimate()
        if low <= 0 <= high:
            raise InvalidValue(f"phi_range must not hold 0, for phi keeps its sign, got [{low:g}, {high:g}]")
        if isinstance(first, float) and not low <= first <= high:
            raise InvalidValue(f"phi_range must hold phi(k,1) = {first:g}, got [{low:g}, {high:g}]")

    def estimates(self) -> tuple[float, float]:
        """Return phi_range, or phi(k,1)/3 and 3 phi(k,1)."""
        if self.phi_range is not None:
            return self.phi_range
        first = self.first_estimate()
        ends = first / 3, 3 * first
        return (min(ends), max(ends)) if isinstance(first, float) else (ca.fmin(*ends), ca.fmax(*ends))

    @property
    def filters_plan(self) -> bool:
        """Whether there is a cutoff."""
        return self.q_cutoff_hz is not None

    def refusal(self, task: Task) -> str | None:
        """Return the refusal of a filter that the sampling time does not admit."""
        limit = 0.5 / float(task.sampling_time)
        if self.q_cutoff_hz is not None and self.q_cutoff_hz >= limit:
            return f"q_cutoff_hz must lie below half the sampling frequency, {limit:g} Hz, got {self.q_cutoff_hz:g}"
        return None

    def start(self, task: Task) -> Memory:
        """Return the initial plan and phi0; no trial is known yet."""
        n = task.samples
        u, phi = first_plan(task, self.initial_input, self.force_unit), constant_row(self.first_estimate(), n)
        return Memory(u, phi, u, missing(1, n + 1), zeros(1, n + 1), task.sampling_time)

    def act(
        self, memory_k: Memory, state: tuple[()], r: Expression, r_next: Expression, y: Expression
    ) -> tuple[Expression, tuple[()]]:
        """Return the planned input in newtons."""
        return memory_k.u * self.force_unit, state

    def learn(self, memory: Memory, trial: Trial[tuple[()]]) -> Memory:
        """Return plan and estimate for the next trial; trial 2 is planned with phi0, having no differences."""
        reached = trial.reached[1:]
        both = ca.logic_and(reached, memory.reached_before[1:])
        du = memory.u - memory.u_before
        dz = _increment(trial.y) - _increment(memory.y_before)
        xi = known(both, dz - memory.phi * du)
        phi = self.update(memory.phi, du, xi)  # (15)
        least, most = self.estimates()
        phi = ca.fmin(ca.fmax(phi, least), most)
        e_next = known(reached, _increment(trial.e))
        u = memory.u + self.rho * phi / (self.lam + phi**2) * e_next  # (14)
        if self.q_cutoff_hz is not None:
            u = zero_phase.low_pass(u, self.q_cutoff_hz, memory.sampling_time)
        return Memory(u, phi, memory.u, trial.y, trial.reached, memory.sampling_time)

    def ppd_estimate(self, memory: Memory) -> Expression:
        """Return phi in output units per newton."""
        return memory.phi / self.force_unit

    def scaled_for(self, task: Task) -> Self:
        """Return the law as every law with an estimate is scaled, its plan filtered at a tenth of the sampling rate."""
        return dataclasses.replace(scaled(self, task), q_cutoff_hz=0.1 / float(task.sampling_time))


def _increment(row: Expression) -> Expression:
    return row[1:] - row[:-1]
