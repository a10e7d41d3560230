"""The minimum of a strictly convex quadratic over a box, in a fixed number of operations: for laws that are folded."""

from __future__ import annotations

from functools import reduce
from typing import Any

import casadi as ca

HALVINGS = 3
"""How often a step that leaves the box is halved in search of a lower cost."""


def minimum(H: Any, g: Any, low: Any, high: Any, start: Any, rounds: int) -> tuple[Any, Any]:
    """Return the u in [low, high] that minimises u'Hu/2 + g'u, and the largest step that a further sweep begins with.

    H is positive definite, (n, n); g and ``start`` (n,) or (n, 1); low < high are the same for all and may be infinite.
    A round is a projected Gauss-Seidel sweep, then Newton's step with the variables held that push against a limit,
    projected, then one with all held that stand at a limit; a step is taken if it lowers the cost. So no round lowers
    it less than a sweep, which converges from anywhere, and when the face is the optimum's the step is exact.

    Source: Bertsekas, Projected Newton methods, SIAM J. Control Optim. 20(2), 1982; the rounds: ours.
    """
    n = H.shape[0]
    rows = [[H[i, j] for j in range(n)] for i in range(n)]
    slopes, at = [g[i] for i in range(n)], [_cut(start[i], low, high) for i in range(n)]
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


def _stepped(H: Any, g: Any, low: Any, high: Any, at: list[Any], *, pushed: bool) -> list[Any]:
    """Return the point after Newton's step of the free variables, where it lowers the cost; ``pushed``: see above."""
    q = _slope(H, g, at)
    below, above = [u <= low for u in at], [u >= high for u in at]
    if pushed:
        below = [ca.logic_and(held, slope > 0) for held, slope in zip(below, q, strict=True)]
        above = [ca.logic_and(held, slope < 0) for held, slope in zip(above, q, strict=True)]
    free = [1 - ca.logic_or(one, other) for one, other in zip(below, above, strict=True)]
    p = _newton(H, q, free)
    shares: list[Any] = [1]
    if pushed:
        room = [_room(u, step, low, high) for u, step in zip(at, p, strict=True)]
        shares += [reduce(ca.fmin, [1, *room]), *(0.5**halving for halving in range(1, HALVINGS + 1))]
    best, lowest = at, 0
    for share in shares:
        there = [_cut(u + share * step, low, high) for u, step in zip(at, p, strict=True)]
        moved = [new - old for new, old in zip(there, at, strict=True)]
        change = _dot(moved, [slope + _dot(row, moved) / 2 for slope, row in zip(q, H, strict=True)])
        lower = change < lowest  # computed from the step, so that it has its sign also where costs round to the same
        best = [ca.if_else(lower, new, old) for new, old in zip(there, best, strict=True)]
        lowest = ca.if_else(lower, change, lowest)
    return best


def _newton(H: Any, q: list[Any], free: list[Any]) -> list[Any]:
    """Return p with H_ff p_f = -q_f for the free variables (1) and 0 for the held ones (0), by LDL' of the masked H."""
    n = len(q)
    L: list[list[Any]] = [[0] * n for _ in range(n)]
    D: list[Any] = []
    p: list[Any] = []
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


def _room(u: Any, step: Any, low: Any, high: Any) -> Any:
    """Return the share of a step at which it meets a limit; 1 where it moves nothing."""
    there = ca.if_else(step > 0, high, low)
    return ca.if_else(step == 0, 1, (there - u) / step)


def _slope(H: Any, g: Any, at: list[Any]) -> list[Any]:
    return [first + _dot(row, at) for first, row in zip(g, H, strict=True)]


def _dot(one: Any, other: Any) -> Any:
    return sum(a * b for a, b in zip(one, other, strict=True))


def _cut(value: Any, low: Any, high: Any) -> Any:
    return ca.fmax(ca.fmin(value, high), low)
