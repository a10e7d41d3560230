"""Linear programs by HiGHS at its tightest tolerance, with an answer that says what became of them."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from scipy.optimize import linprog

from workbench.sets.array import Array

SOLVER_TOLERANCE = 1e-10
"""Primal and dual feasibility: HiGHS' own default of 1e-7 is looser than what sets are compared with."""


class LPAnswer(NamedTuple):
    """What a linear program came to."""

    status: Literal["optimal", "infeasible", "unbounded", "failed"]
    x: Array
    """A minimiser, NaN unless optimal."""
    value: float
    """The least cost: inf if infeasible, -inf if unbounded, NaN if the solver failed."""
    prices: Array
    """What each row of G costs, non-negative, shape (m,); NaN unless optimal."""


def minimise(c: Array, G: Array, g: Array, *, equal: tuple[Array, Array] | None = None) -> LPAnswer:
    """Min c'x subject to G x <= g, and to M x = r for equal = (M, r).

    Parameters
    ----------
    c
        Shape (p,).
    G, g
        Shapes (m, p) and (m,).
    equal
        M, shape (q, p), and r, shape (q,).
    """
    M, r = equal if equal is not None else (None, None)
    answer = linprog(
        c,
        A_ub=G,
        b_ub=g,
        A_eq=M,
        b_eq=r,
        bounds=(None, None),
        options={
            "primal_feasibility_tolerance": SOLVER_TOLERANCE,
            "dual_feasibility_tolerance": SOLVER_TOLERANCE,
        },
    )
    nothing, no_price = np.full(len(c), np.nan), np.full(len(g), np.nan)
    if answer.status == 0:
        prices = np.abs(np.asarray(answer.ineqlin.marginals, dtype=np.float64))
        return LPAnswer("optimal", np.asarray(answer.x, dtype=np.float64), float(answer.fun or 0.0), prices)
    if answer.status == 2:
        return LPAnswer("infeasible", nothing, np.inf, no_price)
    if answer.status == 3:
        return LPAnswer("unbounded", nothing, -np.inf, no_price)
    return LPAnswer("failed", nothing, np.nan, no_price)
