"""What the fuzzy immune PID laws share: the stimulus f(u, du) and the incremental PID bracket.

Chu, Yu, Lin, Yuan & Jiang: lymphocyte B sees the helper's stimulus minus the suppressor's, p1 - p2 f.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from models.plant import signals
from workbench.controllers.parts.fuzzy import Rule, Rules, s_shaped, triangle, z_shaped

_SIGN = {"N": z_shaped(-1, 1), "P": s_shaped(-1, 1)}

RULES = Rules(
    inputs={"u": _SIGN, "du": _SIGN},
    output={"N": z_shaped(-1, 0), "Z": triangle(-1, 0, 1), "P": s_shaped(0, 1)},
    rules=(
        Rule({"u": "P", "du": "P"}, "N"),
        Rule({"u": "P", "du": "N"}, "Z"),
        Rule({"u": "N", "du": "P"}, "Z"),
        Rule({"u": "N", "du": "N"}, "P"),
    ),
)
"""The paper's four rules: the more, and the more growing, the input, the more it is suppressed."""

TOLD = signals(p1=("1", "promoting factor p1"), p2=("1", "suppressing factor p2"), f=("1", "stimulus f(u, du)"))
"""What the laws tell of every sample."""

STIMULI = ("rules", "smooth")


def stimulus(kind: str, u: Any, du: Any) -> Any:
    """Return f(u, du) in [-1, 1]: by the rules and the mean of maxima, or their smooth stand-in.

    The mean of maxima jumps (at du = 0, among others); the smooth form -(tanh 2u + tanh 2du)/2 is ours.
    """
    if kind == "smooth":
        return -0.5 * (ca.tanh(2 * u) + ca.tanh(2 * du))
    return RULES.mean_of_maxima(u=u, du=du)


def bracket(e: Any, e_1: Any, e_2: Any, ki: Any, kd: Any) -> Any:
    """Return De + ki' e + kd' D2e, the increment before its gain, from the last three errors."""
    return (e - e_1) + ki * e + kd * (e - 2 * e_1 + e_2)
