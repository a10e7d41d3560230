"""By how much a predictive law moves the input at one sample, and the plan it rides on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from workbench.predictive.condensed import Plan
from workbench.predictive.quadratic_program import Infeasible
from workbench.sets.array import Array


class Move(NamedTuple):
    """The increment of the input for this sample and how it came about."""

    du: float
    M: int
    """Samples for which the law means to hold the input from here on, this one included; 1 if it decides anew."""
    J: float
    """Cost of the plan followed: of the optimum if it was made now."""
    qps: int
    """Quadratic programs solved at this sample."""
    infeasible: str
    """Why no plan could be made, or empty. The law then follows the last, or the feedback if there is none."""


class Following(NamedTuple):
    """Memory of a predictive law: the plan made last, its past cut off, and the samples until the next is due."""

    plan: Plan | None
    wait: int


def without_plan(e: ArrayLike, K: Array, reason: str) -> tuple[Move, Following]:
    """What a law does that has no plan to follow: the tube's feedback, du = K e, until one can be made.

    `e` has shape (n,) and is finite, `K` shape (n,). The bounds may be broken meanwhile, as the reason tells.
    """
    du = float(K @ np.asarray(e, dtype=np.float64))
    return Move(du=du, M=1, J=np.nan, qps=1, infeasible=f"{reason}, feedback acts"), start()


def planned_anew(
    memory: Following, answer: Plan | Infeasible, e: ArrayLike, K: Array, A_cl: Array
) -> tuple[Move, Following]:
    """What a law does that plans at every sample: follow the new plan, or the last where none could be made.

    `K` and `A_cl` continue a plan by its feedback; `e` is used where there never was one, see `without_plan`.
    """
    reason = answer.reason if isinstance(answer, Infeasible) else ""
    plan = memory.plan if isinstance(answer, Infeasible) else answer
    if plan is None:
        return without_plan(e, K, f"{reason}; no earlier plan")
    move = Move(du=float(plan.du[0]), M=1, J=plan.J, qps=1, infeasible=reason)
    return move, Following(plan=plan.advanced(K, A_cl), wait=0)


def start() -> Following:
    """The memory before the first sample: no plan, one due at once."""
    return Following(plan=None, wait=0)
