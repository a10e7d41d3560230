"""Linear programs by HiGHS: scaled before, checked after, with an answer that says what became of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.optimize import OptimizeResult, linprog

from workbench.sets.array import Array
from workbench.sets.balance import balanced

SOLVER_TOLERANCE = 1e-10
"""Primal and dual feasibility of the scaled program, whose largest coefficients and offset are near one.

HiGHS' own default of 1e-7 is looser than what sets are compared with.
"""

CHECK_TOLERANCE = 1e-9
"""How far an answer may miss the optimality conditions, relative to the terms that cancel in each."""

ATTEMPTS: tuple[Mapping[str, Any], ...] = (
    {"method": "highs", "presolve": True},
    {"method": "highs", "presolve": False},
    {"method": "highs-ipm", "presolve": False},
)
"""One after the other until an answer passes: HiGHS' presolve may leave open whether it saw no point or no end."""


class SolverFailed(ArithmeticError):
    """A linear program that must have an answer got none: nothing about the set may be concluded."""


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

    The answer does not depend on units: rows, columns, offsets and cost are brought to the size of one by powers of
    two, and "optimal" is said only if the optimality conditions of the scaled program hold.

    Parameters
    ----------
    c
        Shape (p,).
    G, g
        Shapes (m, p) and (m,).
    equal
        M, shape (q, p), and r, shape (q,).
    """
    M, r = equal if equal is not None else (np.zeros((0, len(c))), np.zeros(0))
    matrix, offsets = np.vstack([G, M]), np.concatenate([g, r])
    scales = balanced(matrix, beside=offsets, faint=c)
    scaled = scales.rows[:, None] * matrix * scales.columns
    room = scales.rows * offsets
    size = _power_near(room)
    cost = scales.columns * c
    worth = _power_near(cost)
    room, cost = room / size, cost / worth
    for attempt in ATTEMPTS:
        answer = _solved(cost, scaled, room, len(g), attempt)
        if answer.status == 0:
            prices = -np.concatenate([answer.ineqlin.marginals, answer.eqlin.marginals])
            if not _holds(cost, scaled, room, len(g), answer.x, prices):
                continue
            x = size * scales.columns * answer.x
            told = np.maximum(prices[: len(g)], 0.0) * worth * scales.rows[: len(g)]
            return LPAnswer("optimal", x, size * worth * float(cost @ answer.x), told)
        if answer.status == 2:
            return _without("infeasible", np.inf, len(c), len(g))
        if answer.status == 3:
            return _without("unbounded", -np.inf, len(c), len(g))
    return _without("failed", np.nan, len(c), len(g))


def _solved(cost: Array, matrix: Array, room: Array, rows: int, attempt: Mapping[str, Any]) -> OptimizeResult:
    return linprog(
        cost,
        A_ub=matrix[:rows],
        b_ub=room[:rows],
        A_eq=matrix[rows:] if len(matrix) > rows else None,
        b_eq=room[rows:] if len(matrix) > rows else None,
        bounds=(None, None),
        method=attempt["method"],
        options={
            "presolve": attempt["presolve"],
            "primal_feasibility_tolerance": SOLVER_TOLERANCE,
            "dual_feasibility_tolerance": SOLVER_TOLERANCE,
        },
    )


def _holds(cost: Array, matrix: Array, room: Array, rows: int, x: Array, prices: Array) -> bool:
    """Whether x and the prices meet feasibility, stationarity, sign and duality of the scaled program."""
    size = np.abs(matrix)
    beyond = matrix @ x - room
    beyond[rows:] = np.abs(beyond[rows:])
    pull = cost + prices @ matrix
    weight = np.abs(cost) + np.abs(prices) @ size
    gap = float(cost @ x + prices @ room)
    return bool(
        np.all(beyond <= CHECK_TOLERANCE * np.maximum(1.0, size @ np.abs(x)))
        and np.all(np.abs(pull) <= CHECK_TOLERANCE * np.maximum(1.0, weight))
        and np.all(prices[:rows] >= -CHECK_TOLERANCE * max(1.0, float(np.abs(prices).max(initial=0.0))))
        and abs(gap) <= CHECK_TOLERANCE * max(1.0, float(np.abs(cost) @ np.abs(x) + np.abs(prices) @ np.abs(room)))
    )


def _power_near(values: Array) -> float:
    """The power of two just above the largest entry, 1 where all are zero."""
    largest = float(np.abs(values).max(initial=0.0))
    return float(2.0 ** np.ceil(np.log2(largest))) if largest > 0 else 1.0


def _without(status: Literal["infeasible", "unbounded", "failed"], value: float, inputs: int, rows: int) -> LPAnswer:
    return LPAnswer(status, np.full(inputs, np.nan), value, np.full(rows, np.nan))
