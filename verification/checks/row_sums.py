"""Row sums of the lifted plant over a whole box: rigorous, by intervals and a recursion in the sample.

With |dx(k+1)/dx(k)| <= A and |dx(k+1)/du(k)| <= B elementwise over the box, the sum over earlier inputs of
|dx(k)/du(j)| weight^(k-j) is at most R(k), R(k+1) = weight (A R(k) + B), R(0) = 0. Every float is rounded up.
By the mean value theorem, applied to one step after another along the segments between two trials' points, the sums
bound differences of any two trials from one initial state as long as both stay in the box, which is convex.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from models.array import Array
from models.plant import Plant
from verification.checks.delayed import delayed_box, delayed_graph
from verification.checks.slope import slope
from verification.enclosure.bounds import Attained, Bounds, bound
from verification.enclosure.box import Box
from verification.enclosure.smoothness import continuous_on
from verification.enclosure.tables import told
from workbench.graph import Graph, Unreadable

BUDGET = 600  # boxes an entry


@dataclasses.dataclass(frozen=True, kw_only=True)
class GainBounds:
    """Rigorous bounds over a box of the slope by the input, d the plant's relative degree.

    They bound differences only because the plant was shown to be continuous along u, state and all else held: it may
    have kinks there, but no jump, pole or end of a domain. It may jump with its state.
    """

    gain_low: float
    """Smallest ds(k+d)/du(k)."""
    gain_high: float
    """Largest ds(k+d)/du(k)."""
    steepest: Attained | None = None
    """A point of the box and what ds(k+d)/du(k) is there: the largest magnitude that was found."""
    gain_reason: str | None
    """Why the ends of ds(k+d)/du(k) are not known, else None."""
    told: str = ""
    """What the plant's tables stand for, in words to go on with."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class SlopeBounds(GainBounds):
    """The same, and bounds of the slopes by the states; magnitudes rounded up.

    They ask the plant to be continuous in its states too; where it is not they are infinite.
    """

    a: Array
    """|dx(k+1)/dx(k)|, (nx, nx)."""
    b: Array
    """|dx(k+1)/du(k)|, (nx,)."""
    c: Array
    """|ds(k+d)/dx(k)| of the learned signal s at the sample before its input acts, (nx,)."""
    reason: str | None
    """Why something could not be bounded (its bound is then infinite), else None."""


def gain_bounds(
    plant: Plant, box: Box, *, degree: int = 1, increment: bool = False, budget: int = BUDGET
) -> GainBounds:
    """Bound the slope by the input over a box (names x, u, w, k), of the output or its increment as signal."""
    try:
        graph = delayed_graph(plant, degree, increment=increment)
    except Unreadable as error:
        return _no_gain(str(error))
    box = delayed_box(box, degree)
    along = continuous_on(graph, box)
    if not along.proved:
        along = continuous_on(graph.only("y"), box, along=("u",))
    if not along.proved:
        return _no_gain(f"the plant is not shown to be continuous, so slopes bound no difference: {along.reason}")
    gain = _bounded(graph, box, "y", "u", 0, 0, budget)
    steepest = [one for one in (gain.attained_min, gain.attained_max) if one is not None]
    steepest.sort(key=lambda one: -max(one.lower, -one.upper))
    return GainBounds(
        gain_low=gain.lower,
        gain_high=gain.upper,
        steepest=steepest[0] if steepest else None,
        gain_reason=_trouble(gain),
        told=told(graph),
    )


def slope_bounds(
    plant: Plant,
    box: Box,
    *,
    degree: int = 1,
    increment: bool = False,
    budget: int = BUDGET,
    gain: GainBounds | None = None,
) -> SlopeBounds:
    """Bound the slopes of a plant over a box, those of the state too.

    ``gain`` are the bounds of the slope by the input over the same box where they are known: each other entry costs
    as much again.
    """
    nx = len(plant.states)
    known = gain or gain_bounds(plant, box, degree=degree, increment=increment, budget=budget)
    a, b, c, reason = np.full((nx, nx), np.inf), np.full(nx, np.inf), np.full(nx, np.inf), known.gain_reason
    if reason is None:
        graph, box = delayed_graph(plant, degree, increment=increment), delayed_box(box, degree)
        continuous = continuous_on(graph, box)
        if not continuous.proved:
            reason = f"the plant is not shown to be continuous, so slopes bound no difference: {continuous.reason}"
    if reason is None:
        reasons: list[str | None] = []

        def magnitude(of: str, by: str, row: int, column: int) -> float:
            found = _bounded(graph, box, of, by, row, column, budget)
            reasons.append(_trouble(found))
            return max(abs(found.lower), abs(found.upper))

        a = np.array([[magnitude("x_next", "x", i, j) for j in range(nx)] for i in range(nx)])
        b = np.array([magnitude("x_next", "u", i, 0) for i in range(nx)])
        c = np.array([magnitude("y", "x", 0, j) for j in range(nx)])
        reason = next((one for one in reasons if one), None)
    return SlopeBounds(
        gain_low=known.gain_low,
        gain_high=known.gain_high,
        steepest=known.steepest,
        gain_reason=known.gain_reason,
        told=known.told,
        a=a,
        b=b,
        c=c,
        reason=reason,
    )


def _bounded(graph: Graph, box: Box, of: str, by: str, row: int, column: int, budget: int) -> Bounds:
    return bound(slope(graph, of, by, row, column), box, budget=budget, tolerance=1e-3 * 1e-6)


def _trouble(found: Bounds) -> str | None:
    return None if np.isfinite([found.lower, found.upper]).all() else found.reason or "no bound found"


def _no_gain(reason: str) -> GainBounds:
    return GainBounds(gain_low=-np.inf, gain_high=np.inf, gain_reason=reason)


def off_diagonal(slopes: SlopeBounds, samples: int, weight: float = 1.0) -> Array:
    """Return bounds of sum over j < k of |ds(k+d)/du(j)| weight^(k-j), for k = 0..samples-1."""
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


def state_reach(slopes: SlopeBounds, moved: Array, samples: int) -> Array:
    """Return bounds of differences of the state at k = 0..samples, (nx, samples + 1).

    ``moved`` is by how much each step moves the next state besides, (nx,) or (nx, samples).
    """
    rows = np.full((slopes.b.size, samples + 1), np.inf)
    by = np.broadcast_to(moved.reshape(slopes.b.size, -1), (slopes.b.size, samples))
    reach = np.zeros(slopes.b.size)
    for k in range(samples + 1 if not slopes.reason else 0):
        rows[:, k] = reach
        if k < samples:
            reach = _up(_product(slopes.a, reach) + by[:, k])
    return rows


def carried_rounding(slopes: SlopeBounds, samples: int, state: Array, signal: float) -> Array:
    """Return what rounding may add to differences of the signal at k + d, k = 0..samples-1.

    ``state`` (nx,) is what one step rounds, ``signal`` what the signal itself does: both are carried as noise through
    the same recursion as the inputs are.
    """
    reach = state_reach(slopes, state, samples)
    return np.array([_product(slopes.c[None, :], reach[:, k])[0] + signal for k in range(samples)])


def _up(value: Array) -> Array:
    return np.nextafter(value, np.inf)


def _product(matrix: Array, vector: Array) -> Array:
    """Return a bound from above of a product of what is not negative."""
    result = np.zeros(matrix.shape[0])
    for j in range(vector.size):
        result = _up(result + _up(matrix[:, j] * vector[j]))
    return result
