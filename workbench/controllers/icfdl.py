"""iCFDL-MFAILC: model-free adaptive ILC for trials of varying length, Jiao & Hou (2025), (13)-(15)."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import casadi as ca

from models.expression import Expression
from models.quantity import declared
from workbench.contracts.law import LearnedSignal, Task, Trial
from workbench.controllers.parts.ppd_estimator import Parameters
from workbench.controllers.parts.rows import constant_row, first_plan, known, missing, zeros


class Memory(NamedTuple):
    """Plan and estimate of the trial to come, and what the last trial left; rows of N or N + 1 columns."""

    u: Expression
    phi: Expression
    u_before: Expression
    y_before: Expression
    reached_before: Expression


@declared
class ICFDL(Parameters[Memory]):
    """Improved CFDL-MFAILC (doi 10.7641/CTA.2024.30465).

    Deviations, where the paper is silent: the innovation xi* needs the outputs of two trials, so the estimate is
    held where one of them did not reach k+1; the law computes in units of ``force_unit``, because lam, mu and eps
    are absolute; phi(k,1) is not published and defaults to sqrt(lam), where the gain is largest.
    """

    source: ClassVar[str] = "Jiao & Hou 2025, (13)-(15)"
    told: ClassVar[tuple[str, ...]] = ("reference", "plan")
    learns_on: ClassVar[LearnedSignal | None] = "output"

    def start(self, task: Task) -> Memory:
        """Return the initial plan and phi0; no trial is known yet."""
        n = task.samples
        u = first_plan(task, self.initial_input, self.force_unit)
        return Memory(u, constant_row(self.first_estimate(), n), u, missing(1, n + 1), zeros(1, n + 1))

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
        xi = known(both, trial.y[1:] - memory.y_before[1:] - memory.phi * du)  # xi*
        phi = self.update(memory.phi, du, xi)  # (15)
        e_next = known(reached, trial.e[1:])  # e*(k+1, i-1)
        u = memory.u + self.rho * phi / (self.lam + phi**2) * e_next  # (14)
        return Memory(u, phi, memory.u, trial.y, trial.reached)

    def ppd_estimate(self, memory: Memory) -> Expression:
        """Return phi in output units per newton."""
        return memory.phi / self.force_unit
