"""Robust self-triggered model predictive control."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import cached_property
from typing import ClassVar, NamedTuple, Self

from numpy.typing import ArrayLike

from models.quantity import InvalidValue, count, declared, given, part, quantity, switch
from workbench.contracts.law import Channels, Decision, Law, Seen, Task
from workbench.predictive.condensed import CondensedQP, Plan, condense
from workbench.predictive.decision import Following, Move, without_plan
from workbench.predictive.design import Design, made_ready, seeing, tubed
from workbench.predictive.quadratic_program import Infeasible
from workbench.predictive.tube import Tube
from workbench.predictive.view import TELLS, Riding, View, begun, decided, sight

COST_TOLERANCE = 1e-9
"""By how much J^M may exceed J^1 and still count as no larger: rounding, a share of `WarmQP.cost_size`."""


class Selection(NamedTuple):
    """The plan chosen, the samples M* to hold its first input, and the quadratic programs it took."""

    plan: Plan
    M: int
    qps: int


@declared
class RSMPC(Law[tuple[()], Riding]):
    """Self-triggered tube MPC: hold the input as long as a held plan costs no more than one decided anew.

    Without a tube of its own it designs one for its task, from the nominal model: see `Design`.

    Raises
    ------
    InvalidValue
        If N or beta is out of range, or not even M = 1 can be offered.

    Source: Liu et al. 2022, doi 10.16383/j.aas.c200039, (25)-(29). Deviations: du_i = 0 for 0 < i < M is a constraint
    ((26) omits it), the terminal set stands at M+N, M = 0 is left out, (27) decides which M are offered.
    """

    source: ClassVar[str] = "Liu, Xun, Gao & Yin 2022, (25)-(29)"

    channels: ClassVar[Channels] = Channels(outputs=None)
    told: ClassVar[tuple[str, ...]] = ("reference", "limits", "model", "state", "delay")
    tells = TELLS
    solves_per_sample: ClassVar[int] = 1

    tube: Tube | None = given(default=None, doc="gain, weights and sets; None: designed for the task")
    view: View | None = given(default=None, doc="how the tube's model sees the plant; None: designed for the task")
    N: int = count(default=10, doc="horizon in samples; the input is held for 1 ... N-1 samples", least=2)
    beta: float = quantity(
        default=1.5,
        unit="1",
        doc="how much of the optimal decrease may be given up for holding",
        least=1,
        structural=True,
    )
    tolerance: float = quantity(
        default=COST_TOLERANCE,
        unit="1",
        doc="tolerance of the comparison of costs, see cost_size",
        least=0,
        structural=True,
    )
    contained: bool = switch(
        default=True,
        doc="whether (27) as printed decides which M are offered; otherwise every M without an empty set is, "
        "which is enough for feasibility: holds are then longer and errors larger",
    )
    feedback: bool = switch(
        default=False,
        doc="whether without a feasible plan the tube's feedback acts on what is seen; otherwise the last plan is "
        "followed. A law that designs its tube has the feedback",
    )
    design: Design = part(default=Design(), doc="how tube and view are designed where there are none")

    def check(self) -> None:
        """Raise InvalidValue where not even a hold of one sample can be offered."""
        if self.tube is not None and 1 not in self.offered:
            raise InvalidValue(f"holding for a single sample is impossible: {self.refused[1]}; make W smaller")

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
    def refused(self) -> Mapping[int, str]:
        """The M of 1 ... N-1 that are never offered, each with the reason; (27)."""
        return self.sets.held_conflicts(self.N, contained=self.contained)

    @property
    def offered(self) -> tuple[int, ...]:
        """The M that may be chosen, ascending."""
        return tuple(M for M in range(1, self.N) if M not in self.refused)

    def problem(self, M: int) -> CondensedQP:
        """(25) and (26) for a hold of M samples, condensed; built once."""
        if M not in self.offered:
            why = f" ({self.refused[M]})" if M in self.refused else ""
            raise InvalidValue(f"M must be one of {self.offered}, got {M}{why}")
        built = self._problems
        if M not in built:
            tube, N = self.sets, self.N
            held, after = range(M), range(M, M + N)
            # (25): the held part counts 1/beta, of its increments only du_0 exists
            built[M] = condense(
                A=tube.plant.A,
                b=tube.plant.b,
                state_weights=[tube.Q / self.beta for _ in held] + [tube.Q for _ in after],
                input_weights=[tube.R / self.beta for _ in held] + [tube.R for _ in after],
                P=tube.P,
                bounds=[*(tube.held_stage_bounds(M, i) for i in range(M + N)), tube.held_terminal_bounds(M, N)],
                free=(0, *after),
            )
        return built[M]

    @cached_property
    def _problems(self) -> dict[int, CondensedQP]:
        return {}

    @property
    def deciding(self) -> CondensedQP:
        """The problem that must be feasible whenever the law decides."""
        return self.problem(1)

    def plan(self, e: ArrayLike, M: int) -> Plan | Infeasible:
        """The optimal plan from e that holds its first input for M samples, or why there is none."""
        return self.problem(M).solve(self.sets.plant.require_state(e))

    def select(self, e: ArrayLike) -> Selection | Infeasible:
        """M*, the largest M with J^M <= J^1, and its plan; (29). M is scanned downward and the first hit taken."""
        once = self.plan(e, 1)
        if isinstance(once, Infeasible):
            return once
        qps, slack = 1, self.tolerance * self.problem(1).program.cost_size
        for M in reversed(self.offered):
            if M == 1:
                break
            held = self.plan(e, M)
            qps += 1
            if not isinstance(held, Infeasible) and held.J <= once.J + slack:
                return Selection(plan=held, M=M, qps=qps)
        return Selection(plan=once, M=1, qps=qps)

    def move(self, following: Following, e: ArrayLike) -> tuple[Move, Following]:
        """The increment du(k) and the plan to follow on; see `Following`.

        The error e(k) = z(k) - x_s(k+l), shape (n,), is looked at only when a decision is due.

        Raises
        ------
        InvalidValue
            If e is not finite when it is looked at.
        """
        K, A_cl = self.sets.K, self.sets.A_cl
        if following.wait > 0 and following.plan is not None:
            plan = following.plan
            held = Move(du=float(plan.du[0]), M=following.wait, J=plan.J, qps=0, infeasible="")
            return held, Following(plan=plan.advanced(K, A_cl), wait=following.wait - 1)
        choice = self.select(e)
        reason = ""
        if isinstance(choice, Infeasible):
            reason = choice.reason
            if self.feedback:
                return without_plan(e, K, reason)
            if following.plan is None:
                return without_plan(e, K, f"{reason}; no earlier plan")
            choice = Selection(plan=following.plan, M=1, qps=1)
        move = Move(du=float(choice.plan.du[0]), M=choice.M, J=choice.plan.J, qps=choice.qps, infeasible=reason)
        return move, Following(plan=choice.plan.advanced(K, A_cl), wait=choice.M - 1)

    def decide(self, memory: tuple[()], state: Riding, seen: Seen) -> tuple[Decision, Riding]:
        """Return the input for what is seen, and the acting state for the next sample."""
        view = seeing(self.view)
        move, following = self.move(state.following, sight(self.sets.plant, view, state, seen).predicted)
        return decided(view, state, seen, move, following)
