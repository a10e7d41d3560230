"""Robust (tube) model predictive control."""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import ClassVar, Self

from numpy.typing import ArrayLike

from models.quantity import count, declared, given, part, switch
from workbench.contracts.law import Channels, Decision, Law, Seen, Task
from workbench.predictive.condensed import CondensedQP, Plan, tube_problem
from workbench.predictive.decision import Following, Move, planned_anew, without_plan
from workbench.predictive.design import Design, made_ready, seeing, tubed
from workbench.predictive.quadratic_program import Infeasible
from workbench.predictive.tube import Tube
from workbench.predictive.view import TELLS, Riding, View, begun, decided, sight


@declared
class RMPC(Law[tuple[()], Riding]):
    """Tube MPC: at each sample, plan N increments under the bounds tightened by the tube and apply the first.

    Without a tube of its own it designs one for its task, from the nominal model: see `Design`.

    Source: Liu et al. 2022, doi 10.16383/j.aas.c200039, (11) with the constraints (14), as corrected in `Tube`.
    Deviation: with no feasible plan the law follows the last one, continued by its feedback, and says so.
    """

    source: ClassVar[str] = "Liu, Xun, Gao & Yin 2022, (11), (14)"
    channels: ClassVar[Channels] = Channels(outputs=None)
    told: ClassVar[tuple[str, ...]] = ("reference", "limits", "model", "state", "delay")
    tells = TELLS
    solves_per_sample: ClassVar[int] = 1

    tube: Tube | None = given(default=None, doc="gain, weights and sets; None: designed for the task")
    view: View | None = given(default=None, doc="how the tube's model sees the plant; None: designed for the task")
    N: int = count(default=10, doc="horizon in samples", least=2)
    feedback: bool = switch(
        default=False,
        doc="whether without a feasible plan the tube's feedback acts on what is seen; otherwise the last plan is "
        "followed. A law that designs its tube has the feedback",
    )
    design: Design = part(default=Design(), doc="how tube and view are designed where there are none")

    def ready_for(self, task: Task) -> Self:
        """Return the law with a tube and a view. Raises InvalidValue where none can be designed."""
        tube, view = made_ready(self.tube, self.view, self.design, task)
        return self if tube is self.tube else dataclasses.replace(self, tube=tube, view=view, feedback=True)

    def refusal(self, task: Task) -> str | None:
        """Return why no tube can be designed for the task, or None."""
        return None if self.tube is not None else self.design.refusal(type(self).__name__, task)

    def start(self, task: Task) -> tuple[()]:
        """Return no memory: it does not learn."""
        return ()

    def ready(self, memory: tuple[()]) -> Riding:
        """Return the acting state before the first sample: no plan."""
        return begun(self.sets.plant, seeing(self.view))

    @property
    def sets(self) -> Tube:
        """The tube. Raises InvalidValue where it was not designed yet."""
        return tubed(self.tube)

    @cached_property
    def problem(self) -> CondensedQP:
        """(11) and (14), condensed; built once."""
        return tube_problem(self.sets, self.N)

    @property
    def deciding(self) -> CondensedQP:
        """The problem that must be feasible whenever the law decides."""
        return self.problem

    def plan(self, e: ArrayLike) -> Plan | Infeasible:
        """The optimal plan from e(k) = z(k) - x_s(k+l), shape (n,), or why there is none."""
        return self.problem.solve(self.sets.plant.require_state(e))

    def move(self, following: Following, e: ArrayLike) -> tuple[Move, Following]:
        """The increment du(k) for the error e(k) = z(k) - x_s(k+l), shape (n,), and the plan to follow on.

        Raises
        ------
        InvalidValue
            If e is not finite.
        """
        answer = self.plan(e)
        if self.feedback and isinstance(answer, Infeasible):
            return without_plan(e, self.sets.K, answer.reason)
        return planned_anew(following, answer, e, self.sets.K, self.sets.A_cl)

    def decide(self, memory: tuple[()], state: Riding, seen: Seen) -> tuple[Decision, Riding]:
        """Return the input for what is seen, and the acting state for the next sample."""
        view = seeing(self.view)
        move, following = self.move(state.following, sight(self.sets.plant, view, state, seen).predicted)
        return decided(view, state, seen, move, following)
