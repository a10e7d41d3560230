"""Row sums of the lifted plant over a whole box: rigorous, by intervals and a recursion in the sample.

With |dx(k+1)/dx(k)| <= A and |dx(k+1)/du(k)| <= B elementwise over the box, the sum over earlier inputs of
|dx(k)/du(j)| weight^(k-j) is at most R(k), R(k+1) = weight (A R(k) + B), R(0) = 0. Every float is rounded up.
By the mean value theorem the sums bound differences of any two trials from one initial state, as long as they, and
the trajectories of the inputs between theirs, stay in the box.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import casadi as ca
import numpy as np

from models.plant import Plant
from verification.enclosure.bounds import bound
from verification.enclosure.box import Box

BUDGET = 600  # boxes an entry


@dataclasses.dataclass(frozen=True, kw_only=True)
class SlopeBounds:
    """Rigorous bounds over a box, of a plant whose relative degree is 1; magnitudes rounded up.

    ``reason`` says why something could not be bounded (its bound is then infinite), else None.
    """

    a: Any
    """|dx(k+1)/dx(k)|, (nx, nx)."""
    b: Any
    """|dx(k+1)/du(k)|, (nx,)."""
    c: Any
    """|ds(k+1)/dx(k)| of the learned signal s at the sample before its input acts, (nx,)."""
    gain_low: float
    """Smallest ds(k+1)/du(k)."""
    gain_high: float
    """Largest ds(k+1)/du(k)."""
    reason: str | None


def slope_bounds(plant: Plant, box: Box, *, increment: bool = False, budget: int = BUDGET) -> SlopeBounds:
    """Bound the slopes of a plant over a box (names x, u, w, k), for the output or its increment as signal."""
    at = plant.symbols()
    x_next = plant.next_state(**at)
    signal = plant.measured(x_next)[0]
    if increment:
        signal = signal - plant.measured(at["x"])[0]
    nx = len(plant.states)
    reasons: list[str] = []

    def ends(expression: Any) -> tuple[float, float]:
        expression = ca.densify(ca.simplify(expression))
        if expression.is_constant():
            value = float(expression)
            return value, value
        one = ca.Function("slope", list(at.values()), [expression], list(at), ["slope"])
        found = bound(one, box, budget=budget, tolerance=1e-3 * 1e-6)
        if not np.isfinite([found.lower, found.upper]).all():
            reasons.append(found.reason or "no bound found")
        return found.lower, found.upper

    def magnitude(expression: Any) -> float:
        low, high = ends(expression)
        return max(abs(low), abs(high))

    slopes = ca.jacobian(x_next, at["x"]), ca.jacobian(x_next, at["u"][0]), ca.jacobian(signal, at["x"])
    a = np.array([[magnitude(slopes[0][i, j]) for j in range(nx)] for i in range(nx)])
    b = np.array([magnitude(slopes[1][i]) for i in range(nx)])
    c = np.array([magnitude(slopes[2][0, j]) for j in range(nx)])
    low, high = ends(ca.jacobian(signal, at["u"][0]))
    return SlopeBounds(a=a, b=b, c=c, gain_low=low, gain_high=high, reason=reasons[0] if reasons else None)


def off_diagonal(slopes: SlopeBounds, samples: int, weight: float = 1.0) -> Any:
    """Return bounds of sum over j < k of |ds(k+1)/du(j)| weight^(k-j), for k = 0..samples-1."""
    if slopes.reason:
        return np.full(samples, np.inf)
    rows = np.zeros(samples)
    reach = np.zeros(slopes.b.size)
    for k in range(1, samples):
        reach = _up(weight * _up(_product(slopes.a, reach) + slopes.b))
        rows[k] = _product(slopes.c[None, :], reach)[0]
        if not np.isfinite(rows[k]):
            rows[k:] = np.inf
            break
    return rows


def _up(value: Any) -> Any:
    return np.nextafter(value, np.inf)


def _product(matrix: Any, vector: Any) -> Any:
    """Return a bound from above of a product of what is not negative."""
    result = np.zeros(matrix.shape[0])
    for j in range(vector.size):
        result = _up(result + _up(matrix[:, j] * vector[j]))
    return result
