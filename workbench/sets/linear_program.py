"""Linear programs by HiGHS: scaled before, checked after, with an answer that says what became of them."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, linprog

from workbench.sets.array import Array
from workbench.sets.balance import balanced

SOLVER_TOLERANCE = 1e-10
"""Primal and dual feasibility of the scaled program, whose largest coefficients and offset are near one.

HiGHS' own default of 1e-7 is looser than what sets are compared with.
"""

CHECK_TOLERANCE = 1e-9
"""How far an answer may miss the optimality conditions, relative to the terms that cancel in each."""

SMALL = 2.0**-10
"""An answer nowhere larger than this, beside offsets of one, is asked for again with offsets of its own size."""

RESCALINGS = 4
"""How often that is done at most."""

ATTEMPTS: tuple[tuple[Literal["highs", "highs-ipm"], bool], ...] = (
    ("highs", True),
    ("highs", False),
    ("highs-ipm", False),
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
        Shapes (m, p) and (m,). A row of zeros holds or not by the sign of its g alone.
    equal
        M, shape (q, p), and r, shape (q,).
    """
    M, r = equal if equal is not None else (np.zeros((0, len(c))), np.zeros(0))
    says_nothing = ~np.any(G, axis=1)
    if says_nothing.any() or not np.any(M, axis=1).all():
        return _without_idle_rows(c, (G, g), (M, r), says_nothing)
    matrix, offsets = np.vstack([G, M]), np.concatenate([g, r])
    scales = balanced(matrix, beside=offsets, faint=c)
    scaled = scales.rows[:, None] * matrix * scales.columns
    cost = scales.columns * c
    worth = _power_near(float(np.abs(cost).max(initial=0.0)))
    room = scales.rows * offsets
    sizes = np.abs(room[room != 0])
    size = _power_near(float(np.partition(sizes, sizes.size // 2)[sizes.size // 2]) if sizes.size else 1.0)
    for _ in range(RESCALINGS):
        answer = _believed(cost / worth, scaled, room / size, len(g))
        reach = float(np.abs(answer.x).max(initial=0.0))  # NaN where there is no answer
        if not reach < SMALL:
            break
        # the rows in the way are much narrower than most: once more, with those of the size of one
        near = reach * size if reach > 0 else float(sizes.min(initial=np.inf))
        if not near < SMALL * size:
            break
        size = _power_near(near)
    if answer.status != "optimal":
        return answer._replace(prices=answer.prices[: len(g)])
    return LPAnswer(
        "optimal",
        size * scales.columns * answer.x,
        size * worth * answer.value,
        np.maximum(answer.prices[: len(g)], 0.0) * worth * scales.rows[: len(g)],
    )


def _believed(cost: Array, matrix: Array, room: Array, rows: int) -> LPAnswer:
    """The first answer to the scaled program that passes, with the prices of all rows."""
    for attempt in ATTEMPTS:
        answer = _solved(cost, matrix, room, rows, *attempt)
        if answer.status == 0:
            prices = -np.concatenate([answer.ineqlin.marginals, answer.eqlin.marginals])
            if _holds(cost, matrix, room, rows, answer.x, prices):
                return LPAnswer("optimal", np.asarray(answer.x, dtype=np.float64), float(cost @ answer.x), prices)
        if answer.status == 2:
            return _without("infeasible", np.inf, len(cost), len(room))
        if answer.status == 3:
            return _without("unbounded", -np.inf, len(cost), len(room))
    return _without("failed", np.nan, len(cost), len(room))


def _without_idle_rows(
    c: Array, less: tuple[Array, Array], equal: tuple[Array, Array], idle: NDArray[np.bool_]
) -> LPAnswer:
    """The answer where rows are zero: they hold, or nothing does."""
    (G, g), (M, r) = less, equal
    same = ~np.any(M, axis=1)
    if np.any(g[idle] < 0) or np.any(r[same] != 0):
        return _without("infeasible", np.inf, len(c), len(g))
    answer = minimise(c, G[~idle], g[~idle], equal=(M[~same], r[~same]))
    prices = np.full(len(g), 0.0 if answer.status == "optimal" else np.nan)
    prices[~idle] = answer.prices
    return answer._replace(prices=prices)


def _solved(
    cost: Array, matrix: Array, room: Array, rows: int, method: Literal["highs", "highs-ipm"], presolve: bool
) -> OptimizeResult:
    return linprog(
        cost,
        A_ub=matrix[:rows],
        b_ub=room[:rows],
        A_eq=matrix[rows:] if len(matrix) > rows else None,
        b_eq=room[rows:] if len(matrix) > rows else None,
        bounds=(None, None),
        method=method,
        options={
            "presolve": presolve,
            "primal_feasibility_tolerance": SOLVER_TOLERANCE,
            "dual_feasibility_tolerance": SOLVER_TOLERANCE,
        },
    )


def _holds(cost: Array, matrix: Array, room: Array, rows: int, x: Array, prices: Array) -> bool:
    """Whether x and the prices meet feasibility, stationarity, sign and duality of the scaled program."""
    size, reach = np.abs(matrix), max(SMALL, float(np.abs(x).max(initial=0.0)))
    beyond = matrix @ x - room
    beyond[rows:] = np.abs(beyond[rows:])
    pull = cost + prices @ matrix
    weight = np.abs(cost) + np.abs(prices) @ size
    gap = float(cost @ x + prices @ room)
    return bool(
        np.all(beyond <= CHECK_TOLERANCE * np.maximum(reach, size @ np.abs(x)))
        and np.all(np.abs(pull) <= CHECK_TOLERANCE * np.maximum(1.0, weight))
        and np.all(prices[:rows] >= -CHECK_TOLERANCE * max(1.0, float(np.abs(prices).max(initial=0.0))))
        and abs(gap) <= CHECK_TOLERANCE * max(reach, float(np.abs(cost) @ np.abs(x) + np.abs(prices) @ np.abs(room)))
    )


def _power_near(value: float) -> float:
    """The power of two just above a value, 1 for zero."""
    return float(2.0 ** np.ceil(np.log2(value))) if value > 0 else 1.0


def _without(status: Literal["infeasible", "unbounded", "failed"], value: float, inputs: int, rows: int) -> LPAnswer:
    return LPAnswer(status, np.full(inputs, np.nan), value, np.full(rows, np.nan))
