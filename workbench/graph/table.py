"""Lookup tables: multilinear ones and B-splines, their values and derivatives, in any arithmetic of numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise, product
from math import isfinite, prod
from typing import Generic, Literal, NamedTuple, TypeVar

T = TypeVar("T", float, Fraction)
_MOST = 2.0**62  # quotients beyond have no whole part in 64 bits


class Lookup(NamedTuple):
    """What is read of a table: one of its outputs, differentiated so often along each axis."""

    table: int
    output: int
    orders: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class Table:
    """Numbers on a grid.

    A linear table takes the grid's points; beyond them the outermost pieces go on. A B-spline takes knots, and is
    zero beyond them.

    Parameters
    ----------
    name
        Name of the Function that it was read from.
    kind
        ``linear`` or ``bspline``.
    grid
        Points or knots of every axis, ascending.
    values
        Values at the points, or the spline's coefficients: the output runs fastest, then the first axis.
    outputs
        Number of outputs.
    degrees
        Degree along every axis, 1 for a linear table.
    search
        How an interval is found on every axis: 0 from the left, 1 by division (equal spacing), 2 by halving.
    spread
        How far each value of a linear table may lie from the one that stands, where what it was read from is not
        exact; empty: nowhere.

    Raises
    ------
    ValueError
        Where the numbers do not fit together.
    """

    name: str
    kind: Literal["linear", "bspline"]
    grid: tuple[tuple[float, ...], ...]
    values: tuple[float, ...]
    outputs: int
    degrees: tuple[int, ...]
    search: tuple[int, ...]
    spread: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        axes = len(self.grid)
        if self.kind not in ("linear", "bspline") or not axes or not len(self.degrees) == len(self.search) == axes:
            raise ValueError(f"table {self.name} must be linear or a bspline with degree and search for every axis")
        if any(not a <= b for points in self.grid for a, b in pairwise(points)):
            raise ValueError(f"table {self.name} must have ascending points on every axis")
        least = [2 if self.kind == "linear" else 2 * degree + 2 for degree in self.degrees]
        if any(len(points) < count for points, count in zip(self.grid, least, strict=True)):
            raise ValueError(f"table {self.name} must have at least {least} points on its axes")
        if len(self.values) != self.outputs * prod(self.sizes):
            raise ValueError(
                f"table {self.name} must have {self.outputs} x {list(self.sizes)} values, got {len(self.values)}"
            )
        if self.spread and (self.kind != "linear" or len(self.spread) != len(self.values) or not min(self.spread) >= 0):
            raise ValueError(f"table {self.name} must be linear to have a spread, 0 or more for each of its values")

    @property
    def dimensions(self) -> int:
        """The number of axes."""
        return len(self.grid)

    @property
    def sizes(self) -> tuple[int, ...]:
        """The number of values along every axis."""
        if self.kind == "linear":
            return tuple(map(len, self.grid))
        return tuple(len(knots) - degree - 1 for knots, degree in zip(self.grid, self.degrees, strict=True))

    def breakpoints(self, axis: int) -> tuple[tuple[float, int], ...]:
        """Return where an axis is not smooth: points, and how many derivatives are continuous there (-1: none)."""
        points = self.grid[axis]
        if self.kind == "linear":
            return tuple((point, 0) for point in points[1:-1])
        degree = self.degrees[axis]
        inner = [(knot, degree - points.count(knot)) for knot in dict.fromkeys(points)]
        return tuple((knot, max(order, -1) if points[0] < knot < points[-1] else -1) for knot, order in inner)


def value(table: Table, lookup: Lookup, point: Sequence[T], number: Callable[[float], T]) -> T:
    """Return a table's value, or derivative, at a point, in the order of operations that CasADi has.

    ``number`` makes a number of the arithmetic from a double.
    """
    if table.kind == "linear":
        return _linear(table, lookup, point, number)
    derived: Derived[T] = differentiated(table, lookup.orders, number)
    degrees = tuple(degree - order for degree, order in zip(table.degrees, lookup.orders, strict=True))
    if any(degree < 0 for degree in degrees):
        return number(0.0)
    return _spline(*derived, degrees, table, lookup.output, point, number)


def _interval(x: T, grid: Sequence[T], search: int) -> int:
    """Return the index of the interval that holds x, the outermost one beyond the grid."""
    last = len(grid) - 2
    if search == 1:
        first, span = grid[0], grid[-1] - grid[0]
        if isinstance(x, float) and not isfinite(x):
            return 0
        turns = (x - first) * (last + 1) / span
        return min(max(int(turns), 0), last) if -_MOST < turns < _MOST else 0
    if search == 2:
        if len(grid) < 2 or x < grid[1]:
            return 0
        if x > grid[-1]:
            return last
        start, stop = 0, last + 1
        while True:
            pivot = (stop + start) // 2
            if x < grid[pivot]:
                if pivot == stop:
                    return pivot
                stop = pivot
            elif pivot == start:
                return pivot
            else:
                start = pivot
    for index in range(last):
        if x < grid[index + 1]:
            return index
    return last


def _linear(table: Table, lookup: Lookup, point: Sequence[T], number: Callable[[float], T]) -> T:
    if any(order > 1 for order in lookup.orders):
        return number(0.0)
    indices, weights = [], []
    for x, doubles, search, order in zip(point, table.grid, table.search, lookup.orders, strict=True):
        grid = [number(entry) for entry in doubles]
        at = _interval(x, grid, search)
        width = grid[at + 1] - grid[at]
        share = (x - grid[at]) / width
        one = number(1.0)
        weights.append((-one / width, one / width) if order else (one - share, share))
        indices.append(at)
    result = number(0.0)
    for corner in product((0, 1), repeat=len(indices)):
        corner = corner[::-1]  # the first axis runs fastest
        factor, offset, stride = number(1.0), lookup.output, table.outputs
        for axis, side in enumerate(corner):
            factor = factor * weights[axis][side]
            offset += (indices[axis] + side) * stride
            stride *= table.sizes[axis]
        result = result + factor * number(table.values[offset])
    return result


class Derived(NamedTuple, Generic[T]):
    """Knots, by axis, and coefficients of a spline's derivative; of no derivative, those of the table."""

    grid: tuple[tuple[T, ...], ...]
    values: tuple[T, ...]


@lru_cache(maxsize=256)
def differentiated(table: Table, orders: tuple[int, ...], number: Callable[[float], T]) -> Derived[T]:
    """Return knots and coefficients of a spline's derivative, computed in the arithmetic at hand."""
    grid = [tuple(number(knot) for knot in knots) for knots in table.grid]
    values = [number(entry) for entry in table.values]
    sizes = list(table.sizes)
    for axis, order in enumerate(orders):
        for done in range(min(order, table.degrees[axis])):
            degree, knots = table.degrees[axis] - done, grid[axis]
            stride = table.outputs * prod(sizes[:axis])
            block = stride * sizes[axis]
            fresh: list[T] = []
            for start in range(0, len(values), block):
                for i in range(sizes[axis] - 1):
                    width = knots[i + degree + 1] - knots[i + 1]
                    for j in range(stride):
                        low = values[start + i * stride + j]
                        high = values[start + (i + 1) * stride + j]
                        fresh.append(number(float(degree)) * (high - low) / width if width else number(0.0))
            values, grid[axis] = fresh, knots[1:-1]
            sizes[axis] -= 1
    return Derived(tuple(grid), tuple(values))


def _spline(
    grid: Sequence[Sequence[T]],
    values: Sequence[T],
    degrees: Sequence[int],
    table: Table,
    output: int,
    point: Sequence[T],
    number: Callable[[float], T],
) -> T:
    weights, starts, strides = [], [], [table.outputs]
    for x, knots, degree, search in zip(point, grid, degrees, table.search, strict=True):
        count = len(knots) - degree - 1
        at = _interval(x, knots[degree : len(knots) - degree], search)
        start = min(at, count - degree - 1)
        basis = [number(0.0)] * (2 * degree + 1)
        if knots[0] <= x <= knots[-1]:
            if x == knots[1]:
                basis[: degree + 1] = [number(1.0)] * (degree + 1)
            elif x == knots[-1]:
                basis[degree] = number(1.0)
            elif knots[at + degree] == x and knots[at + degree - 1] < x:
                basis[degree - 1] = number(1.0)
            else:
                basis[degree] = number(1.0)
        _de_boor(x, knots[start : start + 2 * degree + 2], degree, basis, number)
        weights.append(basis[: degree + 1])
        starts.append(start)
        strides.append(strides[-1] * count)
    return _contracted(values, weights, starts, strides, output, number)


def _de_boor(x: T, knots: Sequence[T], degree: int, basis: list[T], number: Callable[[float], T]) -> None:
    """Raise basis functions of degree zero to a degree, in place."""
    for d in range(1, degree + 1):
        for i in range(2 * degree + 1 - d):
            raised = number(0.0)
            bottom = knots[i + d] - knots[i]
            if bottom:
                raised = (x - knots[i]) * basis[i] / bottom
            bottom = knots[i + d + 1] - knots[i + 1]
            if bottom:
                raised = raised + (knots[i + d + 1] - x) * basis[i + 1] / bottom
            basis[i] = raised


def _contracted(
    values: Sequence[T],
    weights: Sequence[Sequence[T]],
    starts: Sequence[int],
    strides: Sequence[int],
    output: int,
    number: Callable[[float], T],
) -> T:
    """Return the sum of the coefficients weighted along every axis; the first axis runs fastest."""
    result = number(0.0)
    for corner in product(*(range(len(own)) for own in reversed(weights))):
        weight, place = number(1.0), output
        for axis, i in zip(reversed(range(len(weights))), corner, strict=True):
            weight = weight * weights[axis][i]
            place += (starts[axis] + i) * strides[axis]
        result = result + weight * values[place]
    return result
