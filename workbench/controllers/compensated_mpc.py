"""Tube MPC that compensates a disturbance: known beforehand (ideal) or estimated from the last sample (offset-free)."""

from __future__ import annotations

from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from models.quantity import count, declared, given
from workbench.predictive.condensed import CondensedQP, Plan, tube_problem
from workbench.predictive.decision import Decision, Following, planned_anew
from workbench.predictive.disturbance_model import DisturbanceModel
from workbench.predictive.quadratic_program import Infeasible
from workbench.predictive.tube import Tube


@declared
class CompensatedMPC:
    """Tube MPC whose cost is taken about the rest under a disturbance d, known or estimated.

    The bounds still see the prediction without disturbance, so whatever is said of d, feasibility is kept exactly as
    without compensation; only what the plan strives for changes. With a constant and correct d the error tends to zero.

    For the ideal law of (10)-(12), which assumes that nothing else disturbs the plant, make the tube from a plant whose
    W is the origin.

    Source: Liu et al. 2022, doi 10.16383/j.aas.c200039, (10)-(12) for the known disturbance, which the paper only calls
    "fed forward"; the estimate is not the paper's.
    """

    source: ClassVar[str] = "Liu, Xun, Gao & Yin 2022, (10)-(12); the estimate: ours"

    tube: Tube = given(doc="gain, weights and sets")
    model: DisturbanceModel = given(doc="direction of the disturbance")
    N: int = count(doc="horizon in samples", least=2)

    @cached_property
    def problem(self) -> CondensedQP:
        """(11) and (14), condensed; built once."""
        return tube_problem(self.tube, self.N)

    def plan(self, e: ArrayLike, d: ArrayLike) -> Plan | Infeasible:
        """The plan from e(k) = z(k) - x_s(k+l), shape (n,), given d(k) ... d(k+l), shape (l+1,), or why none is."""
        return self.problem.solve(self.tube.plant.require_state(e), cost_error=self.model.centered(e, d))

    def act(self, memory: Following, e: ArrayLike, d: ArrayLike) -> tuple[Decision, Following]:
        """The increment du(k) and the memory for the next sample.

        Parameters
        ----------
        memory
            The plan made last, see `Following`.
        e
            e(k) = z(k) - x_s(k+l), predicted without disturbance, shape (n,).
        d
            What is known or estimated of d(k) ... d(k+l): shape (l+1,), or one number for all.

        Raises
        ------
        InvalidValue
            If e or d is not finite.
        """
        answer = self.plan(e, np.broadcast_to(np.asarray(d, dtype=np.float64), (self.tube.plant.delay + 1,)))
        return planned_anew(memory, answer, e, self.tube.K, self.tube.A_cl)
