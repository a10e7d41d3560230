"""Tube MPC that compensates a disturbance: known beforehand (ideal) or estimated from the last sample (offset-free)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from models.array import Array
from models.quantity import count, declared, given
from workbench.contracts.law import Channels, Decision, Law, Seen, Task
from workbench.predictive.condensed import CondensedQP, Plan, tube_problem
from workbench.predictive.decision import Following, Move, planned_anew
from workbench.predictive.design import seeing
from workbench.predictive.disturbance_model import DisturbanceModel
from workbench.predictive.quadratic_program import Infeasible
from workbench.predictive.tube import Tube
from workbench.predictive.view import TELLS, Riding, Sight, View, begun, decided, sight

Forecast = Callable[[Seen, Sight], ArrayLike]
"""Gives what is known of d(k) ... d(k+l): shape (l+1,), or one number for all."""


@declared
class CompensatedMPC(Law[tuple[()], Riding]):
    """Tube MPC whose cost is taken about the rest under a disturbance d, known or estimated.

    The bounds still see the prediction without disturbance, so whatever is said of d, feasibility is kept exactly as
    without compensation; only what the plan strives for changes. With a constant and correct d the error tends to zero.

    For the ideal law of (10)-(12), which assumes that nothing else disturbs the plant, make the tube from a plant whose
    W is the origin.

    Source: Liu et al. 2022, doi 10.16383/j.aas.c200039, (10)-(12) for the known disturbance, which the paper only calls
    "fed forward"; the estimate is not the paper's.
    """

    source: ClassVar[str] = "Liu, Xun, Gao & Yin 2022, (10)-(12); the estimate: ours"
    channels: ClassVar[Channels] = Channels(outputs=None)
    told: ClassVar[tuple[str, ...]] = ("reference", "limits", "model", "state", "delay")
    tells = TELLS
    solves_per_sample: ClassVar[int] = 1

    tube: Tube = given(doc="gain, weights and sets")
    model: DisturbanceModel = given(doc="direction of the disturbance")
    view: View | None = given(default=None, doc="how the tube's model sees the plant")
    forecast: Forecast | None = given(
        default=None, doc="what is known of the disturbance ahead; None: it is estimated from the last sample"
    )
    N: int = count(doc="horizon in samples", least=2)

    def start(self, task: Task) -> tuple[()]:
        """Return no memory: it does not learn."""
        return ()

    def ready(self, memory: tuple[()]) -> Riding:
        """Return the acting state before the first sample: no plan, nothing estimated."""
        return begun(self.tube.plant, seeing(self.view))

    @cached_property
    def problem(self) -> CondensedQP:
        """(11) and (14), condensed; built once."""
        return tube_problem(self.tube, self.N)

    def plan(self, e: ArrayLike, d: ArrayLike) -> Plan | Infeasible:
        """The plan from e(k) = z(k) - x_s(k+l), shape (n,), given d(k) ... d(k+l), shape (l+1,), or why none is."""
        return self.problem.solve(self.tube.plant.require_state(e), cost_error=self.model.centered(e, d))

    def move(self, following: Following, e: ArrayLike, d: ArrayLike) -> tuple[Move, Following]:
        """The increment du(k) and the plan to follow on.

        Parameters
        ----------
        following
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
        return planned_anew(following, answer, e, self.tube.K, self.tube.A_cl)

    def decide(self, memory: tuple[()], state: Riding, seen: Seen) -> tuple[Decision, Riding]:
        """Return the input for what is seen, and the acting state for the next sample."""
        view = seeing(self.view)
        now = sight(self.tube.plant, view, state, seen)
        move, following = self.move(state.following, now.predicted, self._disturbance(state, seen, now))
        acted = float(now.pending[0]) if now.pending.size else move.du
        decision, riding = decided(view, state, seen, move, following)
        return decision, riding._replace(error=now.error, acted=acted)

    def _disturbance(self, state: Riding, seen: Seen, now: Sight) -> ArrayLike:
        """Return what is known of the disturbance: the forecast, or the estimate from the last sample."""
        if self.forecast is not None:
            return self.forecast(seen, now)
        before: Array | None = state.error
        return 0.0 if before is None else self.model.estimate(before, state.acted, now.error)
