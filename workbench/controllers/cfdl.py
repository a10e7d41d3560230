"""CFDL-MFAILC: model-free adaptive ILC for trials of one fixed length, Jiao & Hou (2025), (11)-(13)."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import casadi as ca

from models.quantity import InvalidValue, declared, quantity
from workbench import ppd_estimator
from workbench.controller import Task, Trial, constant_row, known


class Memory(NamedTuple):
    """Plan and estimate of the trial to come, and what the last trial left; rows of N or N + 1 columns."""

    u: Any
    phi: Any
    u_before: Any
    y_before: Any
    trials: Any


@declared
class CFDL:
    """CFDL-MFAILC (doi 10.7641/CTA.2024.30465). Defined for trials of the full length only: it refuses others.

    Ours: the law computes in units of ``force_unit``; phi(k,1), not published, defaults to sqrt(lam).
    """

    source: ClassVar[str] = "Jiao & Hou 2025, (11)-(13)"

    eta: float = quantity(default=1.0, unit="1", doc="step of the estimator", above=0, most=1)
    rho: float = quantity(default=0.245, unit="1", doc="step of the input", above=0, most=1)
    lam: float = quantity(default=5e-5, unit="(output/force unit)^2", doc="weight on input changes", above=0)
    mu: float = quantity(default=0.1, unit="(force unit)^2", doc="weight on estimate changes", above=0)
    eps: float = quantity(default=1e-5, unit="force unit", doc="reset threshold of estimate and input change", above=0)
    phi0: float | None = quantity(
        default=None, unit="output/force unit", doc="phi(k,1); null takes sqrt(lam)", optional=True
    )
    force_unit: float = quantity(default=100.0, unit="N", doc="the unit that the law computes forces in", above=0)
    initial_input: float = quantity(default=1500.0, unit="N", doc="input of the first trial")

    def check(self) -> None:
        """Raise InvalidValue where phi0 is zero: its sign is the assumed control direction."""
        if isinstance(self.phi0, float) and self.phi0 == 0:
            raise InvalidValue("phi0 must not be 0 (its sign is the control direction), got 0.0")

    def refusal(self, study: Any) -> str | None:
        """Return the refusal of trial lengths that vary."""
        if study.trial_length.law == "fixed":
            return None
        return (
            f"cfdl needs fixed trial lengths, got {study.trial_length.law}: "
            "set trial_length.law=fixed, or use icfdl, which is made for varying ones"
        )

    def start(self, task: Task) -> Memory:
        """Return the initial plan and phi0; no trial is known yet."""
        n = task.samples
        u = constant_row(self.initial_input / self.force_unit, n)
        return Memory(u, constant_row(self._first(), n), u, ca.DM.zeros(1, n + 1), ca.DM(0))

    def act(self, memory_k: Memory, state: Any, r: Any, r_next: Any, y: Any) -> tuple[Any, Any]:
        """Return the planned input in newtons."""
        return memory_k.u * self.force_unit, state

    def learn(self, memory: Memory, trial: Trial) -> Memory:
        """Return plan and estimate for the next trial; trial 2 is planned with phi0, having no differences."""
        du = memory.u - memory.u_before
        xi = known(memory.trials > 0, trial.y[1:] - memory.y_before[1:] - memory.phi * du)
        phi = ppd_estimator.update(memory.phi, self._first(), du, xi, eta=self.eta, mu=self.mu, eps=self.eps)  # (12)
        u = memory.u + self.rho * phi / (self.lam + phi**2) * trial.e[1:]  # (11)
        return Memory(u, phi, memory.u, trial.y, memory.trials + 1)

    def ppd_estimate(self, memory: Memory) -> Any:
        """Return phi in output units per newton."""
        return memory.phi / self.force_unit

    def _first(self) -> Any:
        return ca.sqrt(self.lam) if self.phi0 is None else self.phi0
