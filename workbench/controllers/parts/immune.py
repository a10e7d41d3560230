"""What the fuzzy immune PID laws share: the stimulus f(u, du) and the incremental PID bracket.

Chu, Yu, Lin, Yuan & Jiang: lymphocyte B sees the helper's stimulus minus the suppressor's, p1 - p2 f.
"""

from __future__ import annotations

from functools import cache

import casadi as ca

from models.expression import Expression, Number, as_expression
from models.plant import signals
from models.quantity import InvalidValue
from workbench.contracts.law import Task
from workbench.controllers.parts.fuzzy import Rule, Rules, s_shaped, triangle, z_shaped
from workbench.controllers.parts.rows import zeros

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
ADDED = "what an operator adds to the input at each sample, N numbers; it stays in the integrated u; empty: nothing"


def misfit(added: tuple[float, ...], task: Task) -> str | None:
    """Return the refusal of additions that are neither none nor one a sample."""
    if len(added) in (0, task.samples):
        return None
    return f"added must hold N = {task.samples} numbers, one a sample, or none; got {len(added)}"


def additions(added: tuple[float, ...], task: Task, unit: Number) -> Expression:
    """Return what is added at each sample, (1, N), in the law's unit; raise InvalidValue for another number."""
    if refused := misfit(added, task):
        raise InvalidValue(refused)
    return as_expression(ca.DM(added).T) / unit if added else zeros(1, task.samples)


def stimulus(kind: str, u: Expression, du: Expression) -> Expression:
    """Return f(u, du) in [-1, 1]: by the rules and the mean of maxima, or their smooth stand-in.

    The mean of maxima jumps (at du = 0, among others); the smooth form -(tanh 2u + tanh 2du)/2 is ours.
    """
    if kind == "smooth":
        return -0.5 * (ca.tanh(2 * u) + ca.tanh(2 * du))
    return _rules()(u, du)


@cache
def _rules() -> ca.Function:
    """Return the rules as a Function of u and du: they are many operations, written once and copied from then on."""
    u, du = ca.SX.sym("u"), ca.SX.sym("du")
    return ca.Function("rules", [u, du], [RULES.mean_of_maxima(u=u, du=du)])


def bracket(e: Expression, e_1: Expression, e_2: Expression, ki: Number, kd: Number) -> Expression:
    """Return De + ki' e + kd' D2e, the increment before its gain, from the last three errors."""
    return (e - e_1) + ki * e + kd * (e - 2 * e_1 + e_2)
