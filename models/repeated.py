"""Equations that are applied many times over, such as the fine steps of a sample: written once and copied."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca

from models.expression import Expression


def repeated(advance: Callable[[Expression], Expression], column: Expression, times: int) -> Expression:
    """Return a column after ``times`` applications of a function that gives the next column from one.

    The function is asked once, for symbols, and CasADi copies what it gave: the graph is that of a plain loop, for
    which Python would write down every operation of every application. What is no SX goes through the loop.
    """
    if times < 2 or type(column) is not ca.SX:
        for _ in range(times):
            column = advance(column)
        return column
    here = ca.SX.sym("here", column.shape[0])
    after = advance(here)
    free = ca.vertcat(*ca.Function("once", [here], [after], {"allow_free": True}).free_sx())
    once = ca.Function("once", [here, free], [after])
    for _ in range(times):
        column = once(column, free)
    return column
