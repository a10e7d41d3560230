"""The minimum of a strictly convex quadratic over a box, in a fixed number of operations: for laws that are folded."""

from __future__ import annotations

from functools import reduce

import casadi as ca

from models.expression import Expression, Number

Row = list[Number]

HALVINGS = 3
"""How often a step that leaves the box is halved in search of a lower cost."""


def minimum(
    H: Expression, g: Expression, low: Number, high: Number, start: Expression, rounds: int
) -> tuple[Expression, Expression]:
    """Return the u in [low, high] that minimises u'Hu/2 + g'u, and the largest step that a further sweep begins with.

    H is positive definite, (n, n); g and ``start`` (n,) or (n, 1); low < high are the same for all and may be infinite.
    A round is a projected Gauss-Seidel sweep, then Newton's step with the variables held that push against a limit,
    projected, then one with all held that stand at a limit; a step is taken if it lowers the cost. So no round lowers
    it less than a sweep, which converges from anywhere, and when the face is the optimum's the step is exact.

    Source: Bertsekas, Projected Newton methods, SIAM J. Control Optim. 20(2), 1982; the rounds: ours.
    """
    n = H.shape[0]
    rows: list[Row] = [[H[i, j] for j in range(n)] for i in range(n)]
    slopes: Row = [g[i] for i in range(n)]
    at: Row = [_cut(start[i], low, high) for i in range(n)]
    for _ in range(rounds):
        for i in range(n):
            at[i] = _cut(at[i] - (slopes[i] + _dot(rows[i], at)) / rows[i][i], low, high)
        at = _stepped(rows, slopes, low, high, at, pushed=True)
        at = _stepped(rows, slopes, low, high, at, pushed=False)
    steps = [
        _cut(u - q / rows[i][i], low, high) - u
        for i, (u, q) in enumerate(zip(at, _slope(rows, slopes, at), strict=True))
    ]
    return ca.vertcat(*at), reduce(ca.fmax, [ca.fabs(step) for step in steps])


def _stepped(H: list[Row], g: Row, low: Number, high: Number, at: Row, *, pushed: bool) -> Row:
    """Return the point after Newton's step of the free variables, where it lowers the cost; ``pushed``: see above."""
    q = _slope(H, g, at)
    below, above = [u <= low for u in at], [u >= high for u in at]
    if pushed:
        below = [ca.logic_and(held, slope > 0) for held, slope in zip(below, q, strict=True)]
        above = [ca.logic_and(held, slope < 0) for held, slope in zip(above, q, strict=True)]
    free: Row = [1 - ca.logic_or(one, other) for one, other in zip(below, above, strict=True)]
    p = _newton(H, q, free)
    shares: Row = [1]
    if pushed:
        room = [_room(u, step, low, high) for u, step in zip(at, p, strict=True)]
        shares += [reduce(ca.fmin, [1, *room]), *(0.5**halving for halving in range(1, HALVINGS + 1))]
    best: Row = at
    lowest: Number = 0
    for share in shares:
        there = [_cut(u + share * step, low, high) for u, step in zip(at, p, strict=True)]
        moved = [new - old for new, old in zip(there, at, strict=True)]
        change = _dot(moved, [slope + _dot(row, moved) / 2 for slope, row in zip(q, H, strict=True)])
        lower = change < lowest  # computed from the step, so that it has its sign also where costs round to the same
        best = [ca.if_else(lower, new, old) for new, old in zip(there, best, strict=True)]
        lowest = ca.if_else(lower, change, lowest)
    return best


def _newton(H: list[Row], q: Row, free: Row) -> Row:
    """Return p with H_ff p_f = -q_f for the free variables (1) and 0 for the held ones (0), by LDL' of the masked H."""
    n = len(q)
    L: list[Row] = [[0] * n for _ in range(n)]
    D: Row = []
    p: Row = []
    for i in range(n):
        for j in range(i):
            value = free[i] * free[j] * H[i][j] - sum(L[i][k] * D[k] * L[j][k] for k in range(j))
            L[i][j] = value / D[j]
        D.append(free[i] * H[i][i] + (1 - free[i]) - sum(L[i][k] ** 2 * D[k] for k in range(i)))
        p.append(-free[i] * q[i] - sum(L[i][k] * p[k] for k in range(i)))
    p = [value / pivot for value, pivot in zip(p, D, strict=True)]
    for i in reversed(range(n)):
        p[i] = p[i] - sum(L[k][i] * p[k] for k in range(i + 1, n))
    return p


def _room(u: Number, step: Number, low: Number, high: Number) -> Number:
    """Return the share of a step at which it meets a limit; 1 where it moves nothing."""
    there = ca.if_else(step > 0, high, low)
    return ca.if_else(step == 0, 1, (there - u) / step)


def _slope(H: list[Row], g: Row, at: Row) -> Row:
    return [first + _dot(row, at) for first, row in zip(g, H, strict=True)]


def _dot(one: Row, other: Row) -> Number:
    return sum(a * b for a, b in zip(one, other, strict=True))


def _cut(value: Number, low: Number, high: Number) -> Number:
    return ca.fmax(ca.fmin(value, high), low)
