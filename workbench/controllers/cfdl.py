"""CFDL-MFAILC: model-free adaptive ILC for trials of one fixed length, Jiao & Hou (2025), (11)-(13)."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

from models.expression import Expression
from models.quantity import declared
from workbench.contracts.law import LearnedSignal, Task, Trial
from workbench.controllers.parts.ppd_estimator import Parameters
from workbench.controllers.parts.rows import constant_row, first_plan, known, zeros


class Memory(NamedTuple):
    """Plan and estimate of the trial to come, and what the last trial left; rows of N or N + 1 columns."""

    u: Expression
    phi: Expression
    u_before: Expression
    y_before: Expression
    trials: Expression


@declared
class CFDL(Parameters[Memory]):
    """CFDL-MFAILC (doi 10.7641/CTA.2024.30465). Defined for trials of the full length only: it refuses others.

    Ours: the law computes in units of ``force_unit``; phi(k,1), not published, defaults to sqrt(lam).
    """

    source: ClassVar[str] = "Jiao & Hou 2025, (11)-(13)"
    told: ClassVar[tuple[str, ...]] = ("reference", "plan")
    learns_on: ClassVar[LearnedSignal | None] = "output"

    def refusal(self, task: Task) -> str | None:
        """Return the refusal of trial lengths that vary."""
        if not task.varying_lengths:
            return None
        return (
            "cfdl needs fixed trial lengths, and these vary: "
            "set trial_length.law=fixed, or use icfdl, which is made for varying ones"
        )

    def start(self, task: Task) -> Memory:
        """Return the initial plan and phi0; no trial is known yet."""
        n = task.samples
        u = first_plan(task, self.initial_input, self.force_unit)
        return Memory(u, constant_row(self.first_estimate(), n), u, zeros(1, n + 1), zeros())

    def act(
        self, memory_k: Memory, state: tuple[()], r: Expression, r_next: Expression, y: Expression
    ) -> tuple[Expression, tuple[()]]:
        """Return the planned input in newtons."""
        return memory_k.u * self.force_unit, state

    def learn(self, memory: Memory, trial: Trial[tuple[()]]) -> Memory:
        """Return plan and estimate for the next trial; trial 2 is planned with phi0, having no differences."""
        du = memory.u - memory.u_before
        xi = known(memory.trials > 0, trial.y[1:] - memory.y_before[1:] - memory.phi * du)
        phi = self.update(memory.phi, du, xi)  # (12)
        u = memory.u + self.rho * phi / (self.lam + phi**2) * trial.e[1:]  # (11)
        return Memory(u, phi, memory.u, trial.y, memory.trials + 1)

    def ppd_estimate(self, memory: Memory) -> Expression:
        """Return phi in output units per newton."""
        return memory.phi / self.force_unit
