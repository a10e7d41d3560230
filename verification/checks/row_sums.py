"""Row sums of the lifted plant over a whole box: rigorous, by intervals and a recursion in the sample.

With |dx(k+1)/dx(k)| <= A and |dx(k+1)/du(k)| <= B elementwise over the box, the sum over earlier inputs of
|dx(k)/du(j)| weight^(k-j) is at most R(k), R(k+1) = weight (A R(k) + B), R(0) = 0. Every float is rounded up.
By the mean value theorem the sums bound differences of any two trials from one initial state, as long as they, and
the trajectories of the inputs between theirs, stay in the box.
"""

from __future__ import annotations

import dataclasses

import casadi as ca
import numpy as np

from models.array import Array
from models.plant import Plant
from verification.checks.slope import slope
from verification.enclosure.bounds import Attained, Bounds, bound
from verification.enclosure.box import Box
from verification.enclosure.smoothness import continuous_on
from workbench.graph import Unreadable, read

BUDGET = 600  # boxes an entry


@dataclasses.dataclass(frozen=True, kw_only=True)
class SlopeBounds:
    """Rigorous bounds over a box, of a plant whose relative degree is 1; magnitudes rounded up.

    They bound differences only because the plant was shown to be continuous on the box: it may have kinks there,
    but no jump, pole or end of a domain.

    ``reason`` says why something could not be bounded (its bound is then infinite), else None.
    """

    a: Array
    """|dx(k+1)/dx(k)|, (nx, nx)."""
    b: Array
    """|dx(k+1)/du(k)|, (nx,)."""
    c: Array
    """|ds(k+1)/dx(k)| of the learned signal s at the sample before its input acts, (nx,)."""
    gain_low: float
    """Smallest ds(k+1)/du(k)."""
    gain_high: float
    """Largest ds(k+1)/du(k)."""
    steepest: Attained | None
    """A point of the box and what ds(k+1)/du(k) is there: the largest magnitude that was found."""
    reason: str | None


def slope_bounds(plant: Plant, box: Box, *, increment: bool = False, budget: int = BUDGET) -> SlopeBounds:
    """Bound the slopes of a plant over a box (names x, u, w, k), for the output or its increment as signal."""
    at = plant.symbols()
    x_next = plant.next_state(**at)
    signal = plant.measured(x_next)[0]
    if increment:
        signal = signal - plant.measured(at["x"])[0]
    nx = len(plant.states)
    step = ca.Function("step", list(at.values()), [x_next, signal], list(at), ["x_next", "signal"])
    try:
        graph = read(step)
    except Unreadable as error:
        return _unbounded(nx, str(error))
    continuous = continuous_on(graph, box)
    if not continuous.proved:
        return _unbounded(
            nx, f"the plant is not shown to be continuous, so slopes bound no difference: {continuous.reason}"
        )
    reasons: list[str] = []

    def ends(of: str, by: str, row: int, column: int) -> Bounds:
        found = bound(slope(graph, of, by, row, column), box, budget=budget, tolerance=1e-3 * 1e-6)
        if not np.isfinite([found.lower, found.upper]).all():
            reasons.append(found.reason or "no bound found")
        return found

    def magnitude(of: str, by: str, row: int, column: int) -> float:
        found = ends(of, by, row, column)
        return max(abs(found.lower), abs(found.upper))

    a = np.array([[magnitude("x_next", "x", i, j) for j in range(nx)] for i in range(nx)])
    b = np.array([magnitude("x_next", "u", i, 0) for i in range(nx)])
    c = np.array([magnitude("signal", "x", 0, j) for j in range(nx)])
    gain = ends("signal", "u", 0, 0)
    steepest = [one for one in (gain.attained_min, gain.attained_max) if one is not None]
    steepest.sort(key=lambda one: -max(one.lower, -one.upper))
    return SlopeBounds(
        a=a,
        b=b,
        c=c,
        gain_low=gain.lower,
        gain_high=gain.upper,
        steepest=steepest[0] if steepest else None,
        reason=reasons[0] if reasons else None,
    )


def _unbounded(states: int, reason: str) -> SlopeBounds:
    whole, row = np.full((states, states), np.inf), np.full(states, np.inf)
    return SlopeBounds(a=whole, b=row, c=row, gain_low=-np.inf, gain_high=np.inf, steepest=None, reason=reason)


def off_diagonal(slopes: SlopeBounds, samples: int, weight: float = 1.0) -> Array:
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


def _up(value: Array) -> Array:
    return np.nextafter(value, np.inf)


def _product(matrix: Array, vector: Array) -> Array:
    """Return a bound from above of a product of what is not negative."""
    result = np.zeros(matrix.shape[0])
    for j in range(vector.size):
        result = _up(result + _up(matrix[:, j] * vector[j]))
    return result
