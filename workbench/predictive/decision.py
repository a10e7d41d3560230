"""What a predictive law decides at one sample, and the plan it rides on."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from workbench.predictive.condensed import Plan
from workbench.sets.array import Array


class Decision(NamedTuple):
    """The increment for this sample and how it came about."""

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


def without_plan(e: ArrayLike, K: Array, reason: str, qps: int) -> tuple[Decision, Following]:
    """What a law does that has no plan and never had one: the tube's feedback, du = K e, until one can be made.

    `e` has shape (n,) and is finite, `K` shape (n,). The bounds may be broken meanwhile, as the reason tells.
    """
    du = float(K @ np.asarray(e, dtype=np.float64))
    return Decision(du=du, M=1, J=np.nan, qps=qps, infeasible=f"{reason}; no earlier plan, feedback acts"), start()


def start() -> Following:
    """The memory before the first sample: no plan, one due at once."""
    return Following(plan=None, wait=0)
