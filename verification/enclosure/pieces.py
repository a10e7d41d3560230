"""What a graph is along one of its quantities, where that is straight pieces: exact, in rational numbers.

A node is *in pieces* along a quantity if it is made of that quantity and of numbers alone, by sums, multiples,
comparisons, choices, sizes and extremes. Between two breakpoints it is then a straight line, and at a breakpoint a
number; each is known as a rational number.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from math import isfinite

from workbench.graph import Graph
from workbench.graph.operations import COMPARISONS, CONSTANT

MOST_PIECES = 400
_ZERO, _ONE = Fraction(0), Fraction(1)


class NotStraight(ValueError):
    """Why a node is not in pieces."""


@dataclass(frozen=True, kw_only=True)
class Line:
    """A straight line: ``slope`` times the quantity, and ``level`` more.

    Parameters
    ----------
    slope, level
        The line.
    steep
        The sum of the magnitudes of all slopes that it was added up from.
    aside
        The sum of the magnitudes of what these slopes multiply besides the quantity: 0.3 of g (t - 0.3), times g.
    """

    slope: Fraction = _ZERO
    level: Fraction = _ZERO
    steep: Fraction = _ZERO
    aside: Fraction = _ZERO

    def at(self, t: Fraction) -> Fraction:
        """Return its value where the quantity is t."""
        return self.slope * t + self.level

    def times(self, factor: Fraction) -> Line:
        """Return the line times a number."""
        size = abs(factor)
        return Line(
            slope=factor * self.slope, level=factor * self.level, steep=size * self.steep, aside=size * self.aside
        )

    def plus(self, other: Line) -> Line:
        """Return the sum of two lines. A number that is added to the quantity itself is what its slope multiplies."""
        aside = self.aside + other.aside
        for one, number in ((self, other), (other, self)):
            if abs(one.slope) == 1 and not one.level and not number.steep:
                aside += abs(number.level)
        return Line(
            slope=self.slope + other.slope,
            level=self.level + other.level,
            steep=self.steep + other.steep,
            aside=aside,
        )


@dataclass(frozen=True, kw_only=True)
class Pieces:
    """Straight lines between breakpoints, and a value at each of them.

    Parameters
    ----------
    points
        The breakpoints, rising.
    lines
        One more than there are breakpoints.
    values
        One for each breakpoint.
    """

    points: tuple[Fraction, ...] = ()
    lines: tuple[Line, ...]
    values: tuple[Fraction, ...] = ()

    def parts(self, points: Sequence[Fraction]) -> tuple[list[Line], list[Fraction]]:
        """Return the lines between other points, among which are its own, and the values at them."""
        lines, values, piece = [self.lines[0]], [], 0
        for point in points:
            if piece < len(self.points) and self.points[piece] == point:
                values.append(self.values[piece])
                piece += 1
            else:
                values.append(self.lines[piece].at(point))
            lines.append(self.lines[piece])
        return lines, values


def straight(line: Line) -> Pieces:
    """Return one line without breakpoints."""
    return Pieces(lines=(line,))


def _joined(points: Sequence[Fraction], lines: Sequence[Line], values: Sequence[Fraction]) -> Pieces:
    """Return pieces without breakpoints at which nothing changes."""
    kept_points: list[Fraction] = []
    kept_lines, kept_values = [lines[0]], []
    for point, line, value in zip(points, lines[1:], values, strict=True):
        if line == kept_lines[-1] and line.at(point) == value:
            continue
        kept_points.append(point)
        kept_lines.append(line)
        kept_values.append(value)
    if len(kept_lines) > MOST_PIECES:
        raise NotStraight(f"more than {MOST_PIECES} pieces")
    return Pieces(points=tuple(kept_points), lines=tuple(kept_lines), values=tuple(kept_values))


def _roots(line: Line, low: Fraction | None, high: Fraction | None) -> Iterator[Fraction]:
    """Give where a line is zero between two ends, of which None is none."""
    if line.slope:
        root = -line.level / line.slope
        if (low is None or low < root) and (high is None or root < high):
            yield root


def _together(
    operands: Sequence[Pieces],
    line: Callable[..., Line],
    value: Callable[..., Fraction],
    levels: Callable[..., tuple[Line, ...]] | None = None,
) -> Pieces:
    """Return an operation on pieces, which breaks where one of them does, or where one of its levels is zero."""
    points = sorted({point for one in operands for point in one.points})
    if levels is not None:
        ends: list[Fraction | None] = [None, *points, None]
        within = zip(pairwise(ends), *(one.parts(points)[0] for one in operands), strict=True)
        roots = [root for (low, high), *pieces in within for one in levels(*pieces) for root in _roots(one, low, high)]
        points = sorted({*points, *roots})
    lines, values = zip(*(one.parts(points) for one in operands), strict=True)
    inside = [_inside(points, i) for i in range(len(points) + 1)]
    made = [line(at, *pieces) for at, *pieces in zip(inside, *lines, strict=True)]
    return _joined(points, made, [value(*here) for here in zip(*values, strict=True)])


def _inside(points: Sequence[Fraction], i: int) -> Fraction:
    """Return a number within a piece."""
    if not points:
        return _ZERO
    if i == 0:
        return points[0] - 1
    return points[-1] + 1 if i == len(points) else (points[i - 1] + points[i]) / 2


def _number(value: Fraction | bool) -> Line:
    return Line(level=Fraction(value))


def _difference(a: Line, b: Line) -> Line:
    return a.plus(b.times(-_ONE))


def _product(t: Fraction, a: Line, b: Line) -> Line:
    if a.slope and b.slope:
        raise NotStraight("a product of two lines")
    if not a.slope and not b.slope:
        # a number times a number: what slopes went into either stays known
        return Line(
            level=a.level * b.level,
            steep=abs(b.level) * a.steep + abs(a.level) * b.steep,
            aside=abs(b.level) * a.aside + abs(a.level) * b.aside,
        )
    return a.times(b.level) if a.slope else b.times(a.level)


def _quotient(t: Fraction, a: Line, b: Line) -> Line:
    if b.slope or not b.level:
        raise NotStraight("a quotient by more than a number")
    return a.times(1 / b.level)


def _over(a: Fraction, b: Fraction) -> Fraction:
    if not b:
        raise NotStraight("a quotient by zero")
    return a / b


def _sign(x: Fraction) -> Fraction:
    return Fraction((x > 0) - (x < 0))


def _compared(holds: Callable[[Fraction, Fraction], bool]) -> Callable[..., Pieces]:
    return lambda a, b: _together(
        (a, b),
        lambda t, p, q: _number(holds(p.at(t), q.at(t))),
        lambda x, y: Fraction(holds(x, y)),
        lambda p, q: (_difference(p, q),),
    )


def _chosen(first: Callable[[Fraction, Fraction], bool]) -> Callable[..., Pieces]:
    return lambda a, b: _together(
        (a, b),
        lambda t, p, q: p if first(p.at(t), q.at(t)) else q,
        lambda x, y: x if first(x, y) else y,
        lambda p, q: (_difference(p, q),),
    )


def _truths(combined: Callable[..., bool]) -> Callable[..., Pieces]:
    return lambda *operands: _together(
        operands,
        lambda t, *lines: _number(combined(*(bool(one.at(t)) for one in lines))),
        lambda *values: Fraction(combined(*map(bool, values))),
        lambda *lines: lines,
    )


def _gated(condition: Pieces, value: Pieces) -> Pieces:
    return _together(
        (condition, value),
        lambda t, c, p: p if c.at(t) else Line(),
        lambda c, x: x if c else _ZERO,
        lambda c, p: (c,),
    )


_OPERATIONS: Mapping[str, Callable[..., Pieces]] = {
    "assign": lambda a: a,
    "add": lambda a, b: _together((a, b), lambda t, p, q: p.plus(q), lambda x, y: x + y),
    "sub": lambda a, b: _together((a, b), lambda t, p, q: _difference(p, q), lambda x, y: x - y),
    "neg": lambda a: _together((a,), lambda t, p: p.times(-_ONE), lambda x: -x),
    "twice": lambda a: _together((a,), lambda t, p: p.times(Fraction(2)), lambda x: 2 * x),
    "mul": lambda a, b: _together((a, b), _product, lambda x, y: x * y),
    "div": lambda a, b: _together((a, b), _quotient, _over),
    "fabs": lambda a: _together((a,), lambda t, p: p if p.at(t) >= 0 else p.times(-_ONE), abs, lambda p: (p,)),
    "sign": lambda a: _together((a,), lambda t, p: _number(_sign(p.at(t))), _sign, lambda p: (p,)),
    "fmin": _chosen(lambda x, y: x <= y),
    "fmax": _chosen(lambda x, y: x >= y),
    "lt": _compared(lambda x, y: x < y),
    "le": _compared(lambda x, y: x <= y),
    "eq": _compared(lambda x, y: x == y),
    "ne": _compared(lambda x, y: x != y),
    "not": _truths(lambda a: not a),
    "and": _truths(lambda a, b: a and b),
    "or": _truths(lambda a, b: a or b),
    "if_else_zero": _gated,
}  # fmt: skip


def quantities(graph: Graph) -> tuple[int, ...]:
    """Return the nodes that are compared with numbers: along these a graph may be in pieces."""
    found: dict[int, None] = {}
    for node in graph.nodes:
        if node.op in COMPARISONS:
            number = [graph.nodes[arg].op == CONSTANT for arg in node.args]
            if number[0] != number[1]:
                found[node.args[number.index(False)]] = None
    return tuple(found)


def along(graph: Graph, quantity: int) -> dict[int, Pieces]:
    """Return the nodes that are in pieces along a node, without numbers, which are so along any."""
    known: dict[int, Pieces] = {quantity: straight(Line(slope=_ONE, steep=_ONE))}
    numbers = {k: straight(_number(Fraction(n.value))) for k, n in enumerate(graph.nodes)
               if n.op == CONSTANT and isfinite(n.value)}  # fmt: skip
    for k, node in enumerate(graph.nodes):
        operands = [known.get(arg, numbers.get(arg)) for arg in node.args]
        held = [one for one in operands if one is not None]
        moving = any(arg in known for arg in node.args)
        if k == quantity or not moving or len(held) < len(operands) or node.op not in _OPERATIONS:
            continue
        try:
            known[k] = _OPERATIONS[node.op](*held)
        except NotStraight:
            continue
    return known
