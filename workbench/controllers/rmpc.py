"""Robust (tube) model predictive control."""

from __future__ import annotations

from functools import cached_property
from typing import ClassVar

from numpy.typing import ArrayLike

from models.quantity import count, declared, given
from workbench.predictive.condensed import CondensedQP, Plan, tube_problem
from workbench.predictive.decision import Decision, Following, planned_anew
from workbench.predictive.quadratic_program import Infeasible
from workbench.predictive.tube import Tube


@declared
class RMPC:
    """Tube MPC: at each sample, plan N increments under the bounds tightened by the tube and apply the first.

    Source: Liu et al. 2022, doi 10.16383/j.aas.c200039, (11) with the constraints (14), as corrected in `Tube`.
    Deviation: with no feasible plan the law follows the last one, continued by its feedback, and says so.
    """

    source: ClassVar[str] = "Liu, Xun, Gao & Yin 2022, (11), (14)"

    tube: Tube = given(doc="gain, weights and sets")
    N: int = count(doc="horizon in samples", least=2)

    @cached_property
    def problem(self) -> CondensedQP:
        """(11) and (14), condensed; built once."""
        return tube_problem(self.tube, self.N)

    def plan(self, e: ArrayLike) -> Plan | Infeasible:
        """The optimal plan from e(k) = z(k) - x_s(k+l), shape (n,), or why there is none."""
        return self.problem.solve(self.tube.plant.require_state(e))

    def act(self, memory: Following, e: ArrayLike) -> tuple[Decision, Following]:
        """The increment du(k) for the error e(k) = z(k) - x_s(k+l), shape (n,), and the memory for the next sample.

        Raises
        ------
        InvalidValue
            If e is not finite.
        """
        return planned_anew(memory, self.plan(e), e, self.tube.K, self.tube.A_cl)
