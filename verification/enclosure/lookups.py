"""Lookup tables on many boxes at once: their values and derivatives, rounded outwards, and where they break off.

A table is contracted axis by axis. On a piece of an axis its value is a polynomial; that of a straight piece takes its
extremes at the ends, and that of a spline lies between the coefficients of the polynomial on the part of the piece
that the box meets (its polar form at the ends of that part, Ramshaw 1989). Where a table is linear the outermost
pieces go on beyond the grid; a spline is zero beyond its knots.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from verification.enclosure import outward
from verification.enclosure.outward import Array, Mask, Span
from workbench.graph.operations import Kind
from workbench.graph.table import Lookup, Table
from workbench.graph.table import differentiated as _exact_derivative

_ONE = outward.point(1.0)


class Break(NamedTuple):
    """Where a lookup is not infinitely differentiable along one of its axes."""

    axis: int
    point: float
    kind: Kind
    inside: str
    """On which sides of the point the lookup goes on to its value there: ``both``, ``above`` or ``below``."""


def unreadable(table: Table) -> str:
    """Return why a table cannot be enclosed, or an empty text."""
    for points, degree, search in zip(table.grid, table.degrees, table.search, strict=True):
        if not np.isfinite(points).all():
            return f"the table {table.name} has points that are not finite"
        inner = points if table.kind == "linear" else points[degree : len(points) - degree]
        if table.kind == "linear" and any(a == b for a, b in pairwise(points)):
            return f"the table {table.name} has a point twice"
        if table.kind == "bspline" and (len({*points[: degree + 1]}) > 1 or len({*points[-degree - 1 :]}) > 1):
            return f"the spline {table.name} does not have its first and its last knot degree + 1 times"
        if search == 1 and not _even(inner):
            return f"the table {table.name} is searched by division, and its points are not evenly spaced as doubles"
    if not np.isfinite([*table.values, *table.spread]).all():
        return f"the table {table.name} has values that are not finite"
    return ""


def _even(points: Sequence[float]) -> bool:
    exact = [Fraction(point) for point in points]
    return all(2 * b == a + c for a, b, c in zip(exact, exact[1:], exact[2:], strict=False))


class _Numbers(NamedTuple):
    """What a lookup reads: knots or points and degree by axis, and ends of the values, (first axis, ..., 1)."""

    grid: tuple[tuple[float, ...], ...]
    degrees: tuple[int, ...]
    values: Span


@lru_cache(maxsize=256)
def _numbers(table: Table, lookup: Lookup) -> _Numbers:
    """Return the numbers of a lookup; a spline's derivatives are a spline of lower degree, computed in rationals."""
    orders = lookup.orders if table.kind == "bspline" else (0,) * table.dimensions
    derivative = _exact_derivative(table, orders, Fraction)
    grid = tuple(tuple(map(float, points)) for points in derivative.grid)
    degrees = tuple(degree - order for degree, order in zip(table.degrees, orders, strict=True))
    sizes = [
        len(points) - (degree + 1 if table.kind == "bspline" else 0)
        for points, degree in zip(grid, degrees, strict=True)
    ]
    own = derivative.values[lookup.output :: table.outputs]
    spread = map(Fraction, table.spread[lookup.output :: table.outputs] or (0.0,) * len(own))
    around = [(_around(entry - off)[0], _around(entry + off)[1]) for entry, off in zip(own, spread, strict=True)]
    ends = np.array(around, dtype=np.float64).T
    low, high = (end.reshape((*sizes[::-1], 1)) for end in ends)
    axes = (*reversed(range(len(sizes))), len(sizes))
    return _Numbers(grid, degrees, Span(low.transpose(axes), high.transpose(axes)))


def _around(exact: Fraction) -> tuple[float, float]:
    """Return doubles at or next to a rational, below and above."""
    near = float(exact)
    if Fraction(near) == exact:
        return near, near
    near_below, near_above = float(np.nextafter(near, -np.inf)), float(np.nextafter(near, np.inf))
    return (near_below, near) if Fraction(near) > exact else (near, near_above)


def enclosed(table: Table, lookup: Lookup, arguments: Sequence[Span]) -> Span:
    """Enclose a lookup on many boxes."""
    arguments = [Span(*np.broadcast_arrays(*one)) for one in arguments]
    count = max(one.lo.size for one in arguments)
    steep = table.kind == "linear" and any(order > 1 for order in lookup.orders)
    if steep or any(order > degree for order, degree in zip(lookup.orders, table.degrees, strict=True)):
        return outward.point(0.0)
    numbers = _numbers(table, lookup)
    values = Span(*(np.broadcast_to(end, (*end.shape[:-1], count)) for end in numbers.values))
    for axis, (argument, points) in enumerate(zip(arguments, numbers.grid, strict=True)):
        low, high = (np.broadcast_to(end, count) for end in argument)
        if table.kind == "bspline":
            values = _spline(points, numbers.degrees[axis], values, low, high)
        elif lookup.orders[axis]:
            values = _steps(points, values, low, high)
        else:
            values = _straight(points, values, low, high)
    return values


def _taken(values: Span, place: int) -> Span:
    return Span(values.lo[place], values.hi[place])


class _Hull:
    """Grows around what is found on pieces of an axis, for those boxes that meet the piece."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.lo, self.hi = np.full(shape, np.inf), np.full(shape, -np.inf)

    def add(self, span: Span, met: Mask) -> None:
        self.lo = np.where(met, np.minimum(self.lo, span.lo), self.lo)
        self.hi = np.where(met, np.maximum(self.hi, span.hi), self.hi)

    def span(self) -> Span:
        return Span(self.lo, self.hi)


def _pieces(points: Sequence[float], low: Array, high: Array) -> list[tuple[int, Array, Array, Mask]]:
    """Return the straight pieces that some box meets: place, what the boxes cut out of it, and which meet it.

    A piece holds its left end and not its right one; the first and the last have no outer end.
    """
    found = []
    for i, (left, right) in enumerate(pairwise(points)):
        first, last = i == 0, i == len(points) - 2
        met = (first | (high >= left)) & (last | (low < right))
        if met.any():
            start = low if first else np.maximum(low, left)
            stop = high if last else np.minimum(high, right)
            found.append((i, np.where(met, start, left), np.where(met, stop, left), met))
    return found


def _straight(points: Sequence[float], values: Span, low: Array, high: Array) -> Span:
    """Interpolate along the first axis: a straight piece takes its extremes at the ends of what is cut out of it."""
    hull = _Hull(values.lo.shape[1:])
    for i, start, stop, met in _pieces(points, low, high):
        before, after = _taken(values, i), _taken(values, i + 1)
        for end in (start, stop):
            hull.add(_blend(before, after, points[i], points[i + 1], end), met)
    return hull.span()


def _blend(before: Span, after: Span, left: float, right: float, at: Array) -> Span:
    """Enclose the straight line through two values at a place; within the piece it lies between the two."""
    width = outward.sub(outward.point(right), outward.point(left))
    share, _ = outward.div(outward.sub(Span(at, at), outward.point(left)), width)
    rest, _ = outward.div(outward.sub(outward.point(right), Span(at, at)), width)
    line = outward.add(outward.mul(rest, before), outward.mul(share, after))
    around = outward.hull(before, after)
    inside = (left <= at) & (at <= right)
    held = Span(np.where(inside, outward.meet(line, around).lo, line.lo),
                np.where(inside, outward.meet(line, around).hi, line.hi))  # fmt: skip
    for place, known in ((left, before), (right, after)):
        held = Span(np.where(at == place, known.lo, held.lo), np.where(at == place, known.hi, held.hi))
    return held


def _steps(points: Sequence[float], values: Span, low: Array, high: Array) -> Span:
    """Return the slopes of the straight pieces along the first axis that are met."""
    hull = _Hull(values.lo.shape[1:])
    for i, _, _, met in _pieces(points, low, high):
        width = outward.sub(outward.point(points[i + 1]), outward.point(points[i]))
        rise, _ = outward.div(outward.sub(_taken(values, i + 1), _taken(values, i)), width)
        hull.add(rise, met)
    return hull.span()


def _spline(knots: Sequence[float], degree: int, values: Span, low: Array, high: Array) -> Span:
    """Contract the first axis of a spline; zero where a box leaves the knots."""
    hull = _Hull(values.lo.shape[1:])
    hull.add(outward.point(0.0), (low < knots[0]) | (high > knots[-1]))
    for i in range(degree, len(knots) - degree - 1):
        left, right = knots[i], knots[i + 1]
        met = (high >= left) & (low <= right) & (left < right)
        if met.any():
            start, stop = (np.where(met, np.clip(end, left, right), left) for end in (low, high))
            for ends in range(degree + 1):
                hull.add(_polar(knots, degree, i, values, [start] * (degree - ends) + [stop] * ends), met)
    return hull.span()


def _polar(knots: Sequence[float], degree: int, piece: int, values: Span, at: list[Array]) -> Span:
    """Enclose the polar form of a piece at points within it: weights of its coefficients are never negative."""
    row = [_taken(values, piece - degree + j) for j in range(degree + 1)]
    for level, place in enumerate(at, start=1):
        fresh = []
        for j in range(degree - level + 1):
            left, right = knots[piece - degree + level + j], knots[piece + 1 + j]
            fresh.append(_blend(row[j], row[j + 1], left, right, place))
        row = fresh
    return row[0]


# ------------------------------------------------------------------ where lookups are not smooth


@lru_cache(maxsize=1024)
def breaks(table: Table, lookup: Lookup) -> tuple[Break, ...]:
    """Return where a lookup is not infinitely differentiable; points that two equal pieces share are left out."""
    found: list[Break] = []
    if table.kind == "linear" and any(order > 1 for order in lookup.orders):
        return ()  # the second derivative of straight pieces is zero
    for axis, order in enumerate(lookup.orders):
        if table.kind == "bspline" and order > table.degrees[axis]:
            return ()
        points = table.grid[axis]
        for point, continuous in table.breakpoints(axis):
            if table.kind == "linear" and _collinear(table, lookup.output, axis, points.index(point)):
                continue
            inside = "above" if point == points[0] else "below" if point == points[-1] else "both"
            kind: Kind = "kink" if continuous >= order else "jump"
            found.append(Break(axis, point, kind, inside))
    return tuple(found)


def _collinear(table: Table, output: int, axis: int, place: int) -> bool:
    """Say whether a linear table has the same slope on both sides of a point, on every line along the axis."""
    values = np.array(table.values).reshape((*table.sizes[::-1], table.outputs))[..., output].T
    lines = np.moveaxis(values, axis, 0).reshape(table.sizes[axis], -1)
    x = [Fraction(table.grid[axis][place + step]) for step in (-1, 0, 1)]
    for column in lines[place - 1 : place + 2].T.tolist():
        y = [Fraction(entry) for entry in column]
        if (y[1] - y[0]) * (x[2] - x[1]) != (y[2] - y[1]) * (x[1] - x[0]):
            return False
    return True


def jumps(table: Table, lookup: Lookup, arguments: Sequence[Span]) -> Mask:
    """Say on which boxes a lookup may break off."""
    found = np.zeros(1, dtype=bool)
    for axis, point, kind, inside in breaks(table, lookup):
        if kind == "jump":
            low, high = arguments[axis]
            below = low < point if inside == "above" else low <= point
            above = high > point if inside == "below" else high >= point
            found = found | (below & above)
    return np.asarray(found)
