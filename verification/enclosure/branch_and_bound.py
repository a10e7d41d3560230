"""Branch and bound on boxes: the smallest value of one scalar.

Every box is enclosed as it stands. Where the gradient can be enclosed too, it sharpens the result in two ways: a
coordinate in which the Function is monotone is held at its better end, and the mean-value form
``f(c) + G (x - c)`` is intersected with the plain enclosure.

Both stand on ``f(x) - f(c) = integral of g(c + t (x - c)) (x - c) dt`` with g the gradient, which holds along every
segment of a box on which the enclosed gradient is finite; `slopes` says why kinks do no harm and jumps are shut out.

What depends on whole numbers alone is read from a table (`whole`). A box of the search is then a box of real
coordinates with a set of cases: its readings lie between their least and largest in the set, and where one of them is
to be split the set is. A point has one case.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from verification.enclosure import outward
from verification.enclosure.guards import Value
from verification.enclosure.interval import evaluate, reason
from verification.enclosure.outward import Array, Mask, Span
from verification.enclosure.rewriting import Rewritten
from verification.enclosure.slopes import gradient
from verification.enclosure.whole import Places, Sets, Table

_BATCH = 256  # boxes split at a time: enough to spread the cost of Python, few enough to stay best-first
_SHARE = 4  # of so many boxes that are left one is split at a time, or a few where there are few
_FEW = 16
_PARTS = 4096  # parts of the first partition by cases
_SINGLE = 64  # cases that are not put together
_LOSS = 0.01  # of the gap that is to be closed, which may be lost by putting cases together


@dataclass(frozen=True, kw_only=True)
class Scalar:
    """One scalar, the sign that turns its supremum into an infimum, and whether to use its gradient."""

    graph: Rewritten
    node: int
    sign: int
    sloped: bool

    def spans(self, lower: Array, upper: Array) -> tuple[Span, Mask, dict[int, Value]]:
        """Enclose the scalar, signed, on many boxes, and say where that failed."""
        values = evaluate(self.graph, lower, upper, [self.node])
        n = lower.shape[1]
        span, fault = values[self.node]
        signed = span if self.sign > 0 else outward.neg(span)
        failed = np.zeros(n, dtype=bool) if fault is None else np.broadcast_to(fault >= 0, n)
        return Span(np.broadcast_to(signed.lo, n), np.broadcast_to(signed.hi, n)), failed, values


@dataclass(frozen=True, kw_only=True)
class Search:
    """Outcome of one minimisation."""

    lower: float
    best: tuple[float, float]
    where: Array | None
    used: int
    trouble: str | None


def _slope_spans(scalar: Scalar, values: dict[int, Value], shape: tuple[int, int], failed: Mask) -> tuple[Span, Mask]:
    """Enclose the signed gradient, one row a coordinate, and say on which boxes it may be used."""
    slopes = gradient(scalar.graph, scalar.node, values, shape)
    usable = ~failed & np.all(np.isfinite(slopes.lo) & np.isfinite(slopes.hi), axis=0)
    return slopes if scalar.sign > 0 else outward.neg(slopes), usable


def _lower_bounds(
    scalar: Scalar, sets: Sets, lower: Array, upper: Array, held: Places, scale: Array
) -> tuple[Array, Array, Span, Places]:
    """Bound the scalar from below on many boxes, each with a set of cases.

    Returns
    -------
    tuple
        Lower bounds; a point in every box, the value there; the coordinate to split along.
    """
    n, first = lower.shape[1], sets.table.first
    span, failed, values = scalar.spans(lower, upper)
    bounds = np.where(failed, -np.inf, span.lo)
    ends_low, ends_high = lower, upper
    weight = (upper - lower) / scale[:, None]  # zero where the scalar does not depend on the coordinate
    weight[first:] = sets.weights(held)
    cases = sets.some(held)
    use = np.zeros(n, dtype=bool)
    if scalar.sloped:
        slopes, use = _slope_spans(scalar, values, lower.shape, failed)
        rising, falling = use & (slopes.lo >= 0), use & (slopes.hi <= 0)
        ends_high = np.where(rising, lower, upper)
        ends_low = np.where(falling & ~rising, upper, lower)
        steepness = np.maximum(np.abs(slopes.lo), np.abs(slopes.hi)) * (ends_high - ends_low)
        if sets.table.readings:
            # a reading in which the scalar is monotone cannot be held at its better end: others differ in that case
            most = np.maximum(np.abs(slopes.lo), np.abs(slopes.hi))[first:] * (upper - lower)[first:]
            steepness[first:] = np.where(sets.divisible(held), np.nan_to_num(most, nan=0.0), 0.0)
            rows = steepness[first:].argmax(axis=0)
            columns = np.arange(n)
            rises, falls = rising[first:][rows, columns], falling[first:][rows, columns]
            cases = np.where(rises | falls, sets.least(held, rows, falls & ~rises), cases)
        weight = np.where(use & (steepness.max(axis=0, initial=0.0) > 0), steepness, weight)
    middle = np.clip(ends_low + (ends_high / 2 - ends_low / 2), ends_low, ends_high)[:first]
    points = sets.table.at(middle, cases)
    if use.any():
        both, both_failed, _ = scalar.spans(np.hstack([ends_low, points[0]]), np.hstack([ends_high, points[1]]))
        reduced, at = Span(both.lo[:n], both.hi[:n]), Span(both.lo[n:], both.hi[n:])
        at_failed = both_failed[n:]
        change = Span(np.zeros(n), np.zeros(n))
        for i in range(lower.shape[0]):
            step = outward.sub(Span(ends_low[i], ends_high[i]), Span(points[0][i], points[1][i]))
            change = outward.add(change, outward.mul(Span(slopes.lo[i], slopes.hi[i]), step))
        mean = outward.add(at, change).lo
        sharper = np.maximum(reduced.lo, np.where(at_failed | np.isnan(mean), -np.inf, mean))
        bounds = np.where(use, np.maximum(bounds, sharper), bounds)
    else:
        at, at_failed, _ = scalar.spans(*points)
    known = Span(np.where(at_failed, -np.inf, at.lo), np.where(at_failed, np.inf, at.hi))
    along = weight.argmax(axis=0) if len(scale) else np.zeros(n, dtype=np.int64)
    return bounds, points[0][:first], known, along


def minimise(
    scalar: Scalar, table: Table, lower: Array, upper: Array, budget: int, settled: Callable[[float, float], bool]
) -> Search:
    """Split the boxes of smallest lower bound that need it until the question is settled or the budget is spent."""
    sets = Sets(table)
    matters = scalar.graph.coordinates((scalar.node,), lower.size) & (upper > lower)
    scale = np.concatenate([np.where(matters, upper - lower, np.inf), sets.scale])
    start = _Start(best=(-np.inf, np.inf), where=None, held=np.array([sets.all]), least=-np.inf)
    with np.errstate(all="ignore"):
        if table.cases > 1:
            start = _by_case(scalar, sets, lower, upper, scale)
        best, where, held = start.best, start.where, start.held
        low, high = sets.columns(lower, upper, held)
        bounds, points, at, along = _lower_bounds(scalar, sets, low, high, held, scale)
        bounds = np.maximum(bounds, start.least)
    used, closed, stuck = 1, np.inf, 0
    trouble: str | None = None
    while True:
        pick = int(at.hi.argmin())
        if at.hi[pick] < best[1]:
            best, where = (float(at.lo[pick]), float(at.hi[pick])), points[:, pick].copy()
        useless = bounds > best[1]  # no point of such a box can be the smallest
        closed = min(closed, float(bounds[useless].min(initial=np.inf)))
        low, high, bounds, along = low[:, ~useless], high[:, ~useless], bounds[~useless], along[~useless]
        held = held[~useless]
        smallest = min(closed, float(bounds.min(initial=np.inf)))
        if settled(smallest, best[1]):
            break
        if not bounds.size or settled(float(bounds.min()), best[1]):
            trouble = f"{stuck} boxes cannot be split any further in double precision"
            break
        if used + 2 > budget:
            trouble = f"the budget of {budget} boxes for one entry and side is spent"
            break
        count = min(_BATCH, bounds.size, max(_FEW, bounds.size // _SHARE), (budget - used) // 2)
        chosen = unsettled(bounds, np.argpartition(bounds, count - 1)[:count], best[1], settled)
        new_low, new_high, new_held, splittable = halved(
            sets, low[:, chosen], high[:, chosen], held[chosen], along[chosen]
        )
        stuck += int(np.sum(~splittable))
        closed = min(closed, float(bounds[chosen[~splittable]].min(initial=np.inf)))
        parents = np.tile(bounds[chosen[splittable]], 2)
        low, high = np.delete(low, chosen, axis=1), np.delete(high, chosen, axis=1)
        bounds, along, held = np.delete(bounds, chosen), np.delete(along, chosen), np.delete(held, chosen)
        if not new_low.shape[1]:
            points, at = np.zeros((table.first, 1)), Span(np.array([-np.inf]), np.array([np.inf]))
            continue
        with np.errstate(all="ignore"):
            fresh, points, at, new_along = _lower_bounds(scalar, sets, new_low, new_high, new_held, scale)
        used += new_low.shape[1]
        low, high, held = np.hstack([low, new_low]), np.hstack([high, new_high]), np.concatenate([held, new_held])
        bounds, along = np.concatenate([bounds, np.maximum(fresh, parents)]), np.concatenate([along, new_along])
    if trouble is not None and smallest == -np.inf:
        trouble += _why(scalar, low, high, bounds)
    return Search(lower=smallest, best=best, where=where, used=used, trouble=trouble)


def unsettled(bounds: Array, chosen: Places, best: float, settled: Callable[[float, float], bool]) -> Places:
    """Return which of the boxes that were chosen, of smallest bounds, are to be split.

    A box that would settle the question if there were no others improves no answer. One whose bound lies nearer to the
    best value than to the smallest bound may yet prove useless, when a better value is found: it waits.
    """
    half = best / 2 + float(bounds[chosen].min()) / 2
    near = bounds[chosen] <= half if np.isfinite(half) else np.ones(chosen.size, dtype=bool)
    return np.array([i for i in chosen[near] if not settled(float(bounds[i]), best)], dtype=np.int64)


class _Start(NamedTuple):
    """What is known before anything is split: the best point, what may be left out, and sets of the other cases."""

    best: tuple[float, float]
    where: Array | None
    held: Places
    least: float
    """What bounds all the sets from below."""


def _by_case(scalar: Scalar, sets: Sets, lower: Array, upper: Array, scale: Array) -> _Start:
    """Enclose every case on the whole box of real coordinates, and put those together that lose nothing by it.

    It is a first partition and no part of a budget: real coordinates would be split no less afterwards.
    """
    single = sets.single()
    bounds, points, at, _ = _lower_bounds(scalar, sets, *sets.columns(lower, upper, single), single, scale)
    pick = int(at.hi.argmin())
    best = float(at.lo[pick]), float(at.hi[pick])
    where = points[:, pick].copy() if best[1] < np.inf else None
    useful = bounds <= best[1]  # the smallest value is in none of the others
    known = np.isfinite(bounds)
    groups = [np.flatnonzero(useful & those) for those in (known, ~known)]
    least = float(bounds[useful].min())
    if np.sum(useful) <= _SINGLE:
        return _Start(best, where, np.flatnonzero(useful), least)
    room = _LOSS * (best[1] - float(bounds[groups[0]].min(initial=np.inf)))
    level = float(bounds[groups[0]].min(initial=np.inf)) - (room if np.isfinite(room) else 0.0)

    def loses(held: Places) -> Mask:
        found, *_ = _lower_bounds(scalar, sets, *sets.columns(lower, upper, held), held, scale)
        return np.asarray(found < level)

    held = np.array([sets.of(members) for members in groups if members.size])
    return _Start(best, where, parted(sets, held, loses), least)


def parted(sets: Sets, held: Places, loses: Callable[[Places], Mask]) -> Places:
    """Split sets of cases as long as they lose something by being together, and there are few."""
    done, lost = [], held
    while lost.size:
        lost, kept = (lost[mask] for mask in _apart(loses(lost) & sets.divisible(lost)))
        done.append(kept)
        if sum(map(len, done)) + 2 * lost.size > _PARTS:
            return np.concatenate([*done, lost])
        weights = sets.weights(lost).argmax(axis=0)
        lost = np.array([half for k, row in zip(lost, weights, strict=True) for half in sets.split(int(k), int(row))],
                        dtype=np.int64)  # fmt: skip
    return np.concatenate(done)


def _apart(mask: Mask) -> tuple[Mask, Mask]:
    return mask, ~mask


def halved(sets: Sets, low: Array, high: Array, held: Places, along: Places) -> tuple[Array, Array, Places, Mask]:
    """Return both halves of boxes, first halves first, and say of which there are any.

    Each is halved along one of its coordinates; along a reading its set of cases is split by it.
    """
    first, columns = sets.table.first, np.arange(along.size)
    ends = low[along, columns], high[along, columns]
    middle = np.clip(ends[0] / 2 + ends[1] / 2, *ends)
    tabulated = along >= first
    splittable = np.where(tabulated, sets.divisible(held), (middle > ends[0]) & (middle < ends[1]))
    left_high, right_low = high.copy(), low.copy()
    left_high[along, columns] = right_low[along, columns] = middle
    new_low, new_high = np.hstack([low, right_low]), np.hstack([left_high, high])
    new_held = np.tile(held, 2)
    parted = np.flatnonzero(tabulated & splittable)
    if parted.size:
        halves = np.array([sets.split(int(held[i]), int(along[i]) - first) for i in parted])
        for side, start in enumerate((0, along.size)):
            new_held[parted + start] = halves[:, side]
            new_low[:first, parted + start], new_high[:first, parted + start] = (
                low[:first, parted],
                high[:first, parted],
            )
            new_low[first:, parted + start], new_high[first:, parted + start] = sets.ends(halves[:, side])
    kept = np.tile(splittable, 2)
    return new_low[:, kept], new_high[:, kept], new_held[kept], splittable


def _why(scalar: Scalar, low: Array, high: Array, bounds: Array) -> str:
    """Return what stands in the way on the box about which least is known."""
    if not bounds.size:
        return ""
    k = int(bounds.argmin())
    _, _, values = scalar.spans(low[:, k : k + 1], high[:, k : k + 1])
    fault = values[scalar.node].fault
    if fault is None or fault[0] < 0:
        return "; the output is unbounded as far as is known"
    return f"; {reason(scalar.graph, values, int(fault[0]))}"
