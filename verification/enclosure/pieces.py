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


LineOf = Callable[[Fraction, Sequence[Line]], Line]
"""Of a number within a piece, and of the operands' lines there."""
NumberOf = Callable[[Sequence[Fraction]], Fraction]
LevelsOf = Callable[[Sequence[Line]], Sequence[Line]]
Operation = Callable[[Sequence[Pieces]], Pieces]


def _apart(lines: Sequence[Line]) -> Sequence[Line]:
    """Return what is zero where one of the lines is."""
    return lines


def _together(line: LineOf, value: NumberOf, levels: LevelsOf | None = None) -> Operation:
    """Return an operation on pieces, which breaks where one of them does, or where one of its levels is zero."""

    def operation(operands: Sequence[Pieces]) -> Pieces:
        points = sorted({point for one in operands for point in one.points})
        if levels is not None:
            ends: list[Fraction | None] = [None, *points, None]
            within = zip(pairwise(ends), *(one.parts(points)[0] for one in operands), strict=True)
            found = [root for (low, high), *here in within for one in levels(here) for root in _roots(one, low, high)]
            points = sorted({*points, *found})
        lines, values = zip(*(one.parts(points) for one in operands), strict=True)
        inside = [_inside(points, i) for i in range(len(points) + 1)]
        made = [line(at, here) for at, *here in zip(inside, *lines, strict=True)]
        return _joined(points, made, [value(here) for here in zip(*values, strict=True)])

    return operation


def _inside(points: Sequence[Fraction], i: int) -> Fraction:
    """Return a number within a piece."""
    if not points:
        return _ZERO
    if i == 0:
        return points[0] - 1
    return points[-1] + 1 if i == len(points) else (points[i - 1] + points[i]) / 2


def _number(value: Fraction | bool) -> Line:
    return Line(level=Fraction(value))


def _difference(pieces: Sequence[Line]) -> Line:
    return pieces[0].plus(pieces[1].times(-_ONE))


def _difference_alone(pieces: Sequence[Line]) -> Sequence[Line]:
    return (_difference(pieces),)


def _product(t: Fraction, pieces: Sequence[Line]) -> Line:
    a, b = pieces
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


def _quotient(t: Fraction, pieces: Sequence[Line]) -> Line:
    a, b = pieces
    if b.slope or not b.level:
        raise NotStraight("a quotient by more than a number")
    return a.times(1 / b.level)


def _over(values: Sequence[Fraction]) -> Fraction:
    if not values[1]:
        raise NotStraight("a quotient by zero")
    return values[0] / values[1]


def _sign(values: Sequence[Fraction]) -> Fraction:
    return Fraction((values[0] > 0) - (values[0] < 0))


def _times(factor: int) -> Operation:
    return _together(lambda t, p: p[0].times(Fraction(factor)), lambda x: factor * x[0])


def _compared(holds: Callable[[Fraction, Fraction], bool]) -> Operation:
    return _together(
        lambda t, p: _number(holds(p[0].at(t), p[1].at(t))), lambda x: Fraction(holds(x[0], x[1])), _difference_alone
    )


def _chosen(first: Callable[[Fraction, Fraction], bool]) -> Operation:
    return _together(
        lambda t, p: p[0] if first(p[0].at(t), p[1].at(t)) else p[1],
        lambda x: x[0] if first(x[0], x[1]) else x[1],
        _difference_alone,
    )


def _truths(combined: Callable[[Sequence[bool]], bool]) -> Operation:
    return _together(
        lambda t, p: _number(combined([bool(one.at(t)) for one in p])),
        lambda x: Fraction(combined([bool(one) for one in x])),
        _apart,
    )


_OPERATIONS: Mapping[str, Operation] = {
    "assign": lambda operands: operands[0],
    "add": _together(lambda t, p: p[0].plus(p[1]), lambda x: x[0] + x[1]),
    "sub": _together(lambda t, p: _difference(p), lambda x: x[0] - x[1]),
    "neg": _times(-1),
    "twice": _times(2),
    "mul": _together(_product, lambda x: x[0] * x[1]),
    "div": _together(_quotient, _over),
    "fabs": _together(lambda t, p: p[0].times(_sign([p[0].at(t)]) or _ONE), lambda x: abs(x[0]), _apart),
    "sign": _together(lambda t, p: _number(_sign([p[0].at(t)])), _sign, _apart),
    "fmin": _chosen(lambda x, y: x <= y),
    "fmax": _chosen(lambda x, y: x >= y),
    "lt": _compared(lambda x, y: x < y),
    "le": _compared(lambda x, y: x <= y),
    "eq": _compared(lambda x, y: x == y),
    "ne": _compared(lambda x, y: x != y),
    "not": _truths(lambda held: not held[0]),
    "and": _truths(all),
    "or": _truths(any),
    "if_else_zero": _together(
        lambda t, p: p[1] if p[0].at(t) else Line(), lambda x: x[1] if x[0] else _ZERO, lambda p: p[:1]
    ),
}


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
            known[k] = _OPERATIONS[node.op](held)
        except NotStraight:
            continue
    return known
