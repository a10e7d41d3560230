"""MFAILC on the speed increment: a repair of iCFDL-MFAILC whose convergence can be proved."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import casadi as ca

from models.quantity import InvalidValue, declared, quantity
from workbench import ppd_estimator, zero_phase
from workbench.controller import Task, Trial, constant_row, known


class Memory(NamedTuple):
    """Plan and estimate of the trial to come, and what the last trial left; rows of N or N + 1 columns."""

    u: Any
    phi: Any
    u_before: Any
    y_before: Any
    reached_before: Any
    sampling_time: Any


@declared
class Increment:
    """The law (13)-(15) of Jiao & Hou (2025) on z(k+1) = y(k+1) - y(k) in place of y(k+1). Ours.

    The lifted operator from inputs to increments is nearly diagonal where the plant is nearly an integrator, so
    the error contracts for every phi > 0 (the claims ``increment_monotone`` and ``increment_weighted`` say where).
    Increments amplify measurement noise: ``q_cutoff_hz`` passes the plan through a zero-phase low-pass filter.
    """

    source: ClassVar[str] = "ours, after Jiao & Hou 2025, (13)-(15)"
    learns_increment: ClassVar[bool] = True

    eta: float = quantity(default=1.0, unit="1", doc="step of the estimator", above=0, most=1)
    rho: float = quantity(default=0.245, unit="1", doc="step of the input", above=0, most=1)
    lam: float = quantity(default=5e-5, unit="(output/force unit)^2", doc="weight on input changes", above=0)
    mu: float = quantity(default=0.1, unit="(force unit)^2", doc="weight on estimate changes", above=0)
    eps: float = quantity(default=1e-5, unit="force unit", doc="reset threshold of estimate and input change", above=0)
    phi0: float | None = quantity(
        default=None, unit="output/force unit", doc="phi(k,1); null takes sqrt(lam)", optional=True
    )
    force_unit: float = quantity(default=10_000.0, unit="N", doc="the unit that the law computes forces in", above=0)
    initial_input: float = quantity(default=1500.0, unit="N", doc="input of the first trial")
    q_cutoff_hz: float | None = quantity(
        default=None,
        unit="Hz",
        doc="cutoff of the zero-phase low-pass filter on the plan; null: none",
        above=0,
        optional=True,
        structural=True,
    )

    def check(self) -> None:
        """Raise InvalidValue where phi0 is zero: its sign is the assumed control direction."""
        if isinstance(self.phi0, float) and self.phi0 == 0:
            raise InvalidValue("phi0 must not be 0 (its sign is the control direction), got 0.0")

    def refusal(self, study: Any) -> str | None:
        """Return the refusal of a filter that the sampling time does not admit."""
        limit = 0.5 / float(study.plant.sampling_time)
        if self.q_cutoff_hz is not None and self.q_cutoff_hz >= limit:
            return f"q_cutoff_hz must lie below half the sampling frequency, {limit:g} Hz, got {self.q_cutoff_hz:g}"
        return None

    def start(self, task: Task) -> Memory:
        """Return the initial plan and phi0; no trial is known yet."""
        n = task.samples
        u = constant_row(self.initial_input / self.force_unit, n)
        nothing = ca.DM.nan(1, n + 1), ca.DM.zeros(1, n + 1)
        return Memory(u, constant_row(self._first(), n), u, *nothing, task.sampling_time)

    def act(self, memory_k: Memory, state: Any, r: Any, r_next: Any, y: Any) -> tuple[Any, Any]:
        """Return the planned input in newtons."""
        return memory_k.u * self.force_unit, state

    def learn(self, memory: Memory, trial: Trial) -> Memory:
        """Return plan and estimate for the next trial; trial 2 is planned with phi0, having no differences."""
        reached = trial.reached[1:]
        both = ca.logic_and(reached, memory.reached_before[1:])
        du = memory.u - memory.u_before
        dz = _increment(trial.y) - _increment(memory.y_before)
        xi = known(both, dz - memory.phi * du)
        phi = ppd_estimator.update(memory.phi, self._first(), du, xi, eta=self.eta, mu=self.mu, eps=self.eps)  # (15)
        e_next = known(reached, _increment(trial.e))
        u = memory.u + self.rho * phi / (self.lam + phi**2) * e_next  # (14)
        if self.q_cutoff_hz is not None:
            u = zero_phase.low_pass(u, self.q_cutoff_hz, memory.sampling_time)
        return Memory(u, phi, memory.u, trial.y, trial.reached, memory.sampling_time)

    def ppd_estimate(self, memory: Memory) -> Any:
        """Return phi in output units per newton."""
        return memory.phi / self.force_unit

    def _first(self) -> Any:
        return ca.sqrt(self.lam) if self.phi0 is None else self.phi0


def _increment(row: Any) -> Any:
    return row[1:] - row[:-1]
