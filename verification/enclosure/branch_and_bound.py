"""Branch and bound on boxes: the smallest value of one scalar.

Every box is enclosed as it stands. Where the gradient can be enclosed too, it sharpens the result in two ways: a
coordinate in which the Function is monotone is held at its better end, and the mean-value form
``f(c) + G (x - c)`` is intersected with the plain enclosure.

Both stand on ``f(x) - f(c) = integral of g(c + t (x - c)) (x - c) dt`` with g the gradient, which holds along every
segment of a box on which the enclosed gradient is finite; `slopes` says why kinks do no harm and jumps are shut out.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from verification.enclosure import outward
from verification.enclosure.interval import Value, evaluate, reason
from verification.enclosure.outward import Array, Mask, Span
from verification.enclosure.rewriting import Rewritten
from verification.enclosure.slopes import gradient

_BATCH = 256  # boxes split at a time: enough to spread the cost of Python, few enough to stay best-first


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


def _lower_bounds(scalar: Scalar, lower: Array, upper: Array, scale: Array) -> tuple[Array, Array, Span, Array]:
    """Bound the scalar from below on many boxes.

    Returns
    -------
    tuple
        Lower bounds; a point in every box, the value there; the coordinate to split along.
    """
    n = lower.shape[1]
    span, failed, values = scalar.spans(lower, upper)
    bounds = np.where(failed, -np.inf, span.lo)
    ends_low, ends_high = lower, upper
    weight = (upper - lower) / scale[:, None]  # zero where the scalar does not depend on the coordinate
    use = np.zeros(n, dtype=bool)
    if scalar.sloped:
        slopes, use = _slope_spans(scalar, values, lower.shape, failed)
        rising, falling = use & (slopes.lo >= 0), use & (slopes.hi <= 0)
        ends_high = np.where(rising, lower, upper)
        ends_low = np.where(falling & ~rising, upper, lower)
        steepness = np.maximum(np.abs(slopes.lo), np.abs(slopes.hi)) * (ends_high - ends_low)
        weight = np.where(use & (steepness.max(axis=0, initial=0.0) > 0), steepness, weight)
    middle = np.clip(ends_low + (ends_high / 2 - ends_low / 2), ends_low, ends_high)
    if use.any():
        both, both_failed, _ = scalar.spans(np.hstack([ends_low, middle]), np.hstack([ends_high, middle]))
        reduced, at = Span(both.lo[:n], both.hi[:n]), Span(both.lo[n:], both.hi[n:])
        at_failed = both_failed[n:]
        change = Span(np.zeros(n), np.zeros(n))
        for i in range(lower.shape[0]):
            step = outward.sub(Span(ends_low[i], ends_high[i]), Span(middle[i], middle[i]))
            change = outward.add(change, outward.mul(Span(slopes.lo[i], slopes.hi[i]), step))
        mean = outward.add(at, change).lo
        sharper = np.maximum(reduced.lo, np.where(at_failed | np.isnan(mean), -np.inf, mean))
        bounds = np.where(use, np.maximum(bounds, sharper), bounds)
    else:
        at, at_failed, _ = scalar.spans(middle, middle)
    known = Span(np.where(at_failed, -np.inf, at.lo), np.where(at_failed, np.inf, at.hi))
    return bounds, middle, known, weight.argmax(axis=0) if len(scale) else np.zeros(n, dtype=np.int64)


def minimise(
    scalar: Scalar, lower: Array, upper: Array, budget: int, settled: Callable[[float, float], bool]
) -> Search:
    """Split the boxes of smallest lower bound until the question is settled or the budget is spent."""
    matters = scalar.graph.coordinates((scalar.node,), lower.size) & (upper > lower)
    scale = np.where(matters, upper - lower, np.inf)
    low, high = lower[:, None], upper[:, None]
    with np.errstate(all="ignore"):
        bounds, points, at, along = _lower_bounds(scalar, low, high, scale)
    used, closed, stuck = 1, np.inf, 0
    best, where = (-np.inf, np.inf), None
    trouble: str | None = None
    while True:
        pick = int(at.hi.argmin())
        if at.hi[pick] < best[1]:
            best, where = (float(at.lo[pick]), float(at.hi[pick])), points[:, pick].copy()
        useless = bounds > best[1]  # no point of such a box can be the smallest
        closed = min(closed, float(bounds[useless].min(initial=np.inf)))
        low, high, bounds, along = low[:, ~useless], high[:, ~useless], bounds[~useless], along[~useless]
        smallest = min(closed, float(bounds.min(initial=np.inf)))
        if settled(smallest, best[1]):
            break
        if not bounds.size:
            trouble = f"{stuck} boxes cannot be split any further in double precision"
            break
        if used + 2 > budget:
            trouble = f"the budget of {budget} boxes for one entry and side is spent"
            break
        count = min(_BATCH, bounds.size, (budget - used) // 2)
        chosen = np.argpartition(bounds, count - 1)[:count]
        middle, columns = low[along[chosen], chosen], np.arange(count)
        middle = np.clip(middle / 2 + high[along[chosen], chosen] / 2, middle, high[along[chosen], chosen])
        splittable = (middle > low[along[chosen], chosen]) & (middle < high[along[chosen], chosen])
        stuck += int(np.sum(~splittable))
        closed = min(closed, float(bounds[chosen[~splittable]].min(initial=np.inf)))
        left_high, right_low = high[:, chosen].copy(), low[:, chosen].copy()
        left_high[along[chosen], columns] = right_low[along[chosen], columns] = middle
        new_low = np.hstack([low[:, chosen], right_low])[:, np.tile(splittable, 2)]
        new_high = np.hstack([left_high, high[:, chosen]])[:, np.tile(splittable, 2)]
        parents = np.tile(bounds[chosen], 2)[np.tile(splittable, 2)]
        low, high = np.delete(low, chosen, axis=1), np.delete(high, chosen, axis=1)
        bounds, along = np.delete(bounds, chosen), np.delete(along, chosen)
        if not new_low.shape[1]:
            points, at = np.zeros((len(scale), 1)), Span(np.array([-np.inf]), np.array([np.inf]))
            continue
        with np.errstate(all="ignore"):
            fresh, points, at, new_along = _lower_bounds(scalar, new_low, new_high, scale)
        used += new_low.shape[1]
        low, high = np.hstack([low, new_low]), np.hstack([high, new_high])
        bounds, along = np.concatenate([bounds, np.maximum(fresh, parents)]), np.concatenate([along, new_along])
    if trouble is not None and smallest == -np.inf:
        trouble += _why(scalar, low, high, bounds)
    return Search(lower=smallest, best=best, where=where, used=used, trouble=trouble)


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
