"""Bounds of values and slopes over a set, by a tree that cuts it into pieces.

Each leaf of the tree has a method: ``p`` encloses what is asked on the piece; ``m`` first moves every coordinate in
which it provably rises or falls to its worse end; ``v`` does that too, and for the others takes their middle c and adds
the enclosed slope times (x - c).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

from flint import fmpq

from verification.checker.graph import Box, Graph
from verification.checker.interval import Known, Span, add, hull, mul, outward
from verification.checker.reading import exact, need, number, record, rows, text, whole, word

TINY = 2.0**-20
"""Share of a value that a mean value form may lose before its box is halved."""
LONGEST = 200_000
"""Cuts and pieces of a tree."""
HALVED = 12
"""How often a box is halved at most."""
SIDES = {"above": (True, True), "at least": (True, False), "below": (False, True), "at most": (False, False)}


class Coordinate(NamedTuple):
    """A coordinate of a set."""

    name: str
    unit: str
    span: Span
    whole: bool

    def __str__(self) -> str:
        if self.whole:
            return f"{self.name} in {{{self.span[0]:.0f}, ..., {self.span[1]:.0f}}}"
        return f"{self.name} in [{self.span[0]!r}, {self.span[1]!r}] {self.unit}".rstrip()


class Shown(NamedTuple):
    """A bound that holds: of what (``name``, row, column), its slope along what, which side, and the number."""

    of: tuple[str, int, int]
    by: str | None
    side: str
    bound: float


def ends(shown: Sequence[Shown | None], of: tuple[str, int, int], by: str | None) -> dict[str, fmpq]:
    """Return the ends ``low`` and ``high`` that bounds give a quantity, as far as there are some."""
    held = [one for one in shown if one and (one.of, one.by) == (of, by)]
    low = [exact(one.bound.hex()) for one in held if SIDES[one.side][0]]
    high = [exact(one.bound.hex()) for one in held if not SIDES[one.side][0]]
    return ({"low": max(low)} if low else {}) | ({"high": min(high)} if high else {})


def read_set(given: object, graph: Graph) -> list[Coordinate]:
    """Return a set that names the coordinates of a graph in their order; none is empty."""
    found = []
    for one, label in zip(rows(given, len(graph.coordinates)), graph.coordinates, strict=True):
        name, unit, low, high, is_whole = record(one, "name", "unit", "low", "high", "whole")
        span = number(low), number(high)
        need(name == label, f"a set must name the coordinates of its graph, {label!r} here, got {name!r:.40}")
        need(span[0] <= span[1], f"a set must not be empty, {name} has {span}")
        need(type(is_whole) is bool, "a coordinate must say whether it is whole")
        need(
            not is_whole or all(end.is_integer() and abs(end) < 2**53 for end in span),
            f"{name} must have whole ends below 2^53, got {span}",
        )
        found.append(Coordinate(name, word(unit), span, is_whole))
    return found


Decided = dict[int, int | None]
"""Which branches of choices are taken on all of a box, by node."""


class Piece(NamedTuple):
    """What is known of a quantity on a box."""

    ends: Known
    box: list[Span]
    """The box, with coordinates in which the quantity is monotone moved to their worse ends."""
    decided: Decided
    turning: int | None
    """Of the others that over which the mean value form loses most; None: next to nothing is lost."""


class Quantity:
    """A value or a slope of a graph, and what is asked of it."""

    def __init__(self, graph: Graph, node: int, along: int | None, wholes: Sequence[int] = ()) -> None:
        self.graph, self.node, self.along = graph, node, along
        self.goal = node if along is None else graph.slope(node, along)
        self._plain = graph.plan({node, self.goal})
        self._again = graph.plan({self.goal})
        self._steep: dict[int, int] | None = None
        self._full = self._plain
        self._wholes = frozenset(wholes)

    def on(self, box: Box, method: str, *, low: bool) -> Known:
        """Return an interval whose low (or high) end bounds the quantity on a box, or None where it has none."""
        taken: dict[int, int | None] = {}
        if method == "p":
            values = self.graph.enclose(self._plain, box, taken)
            return None if values[self.node] is None else values[self.goal]
        return self._reduced(box, {}, method, low).ends

    def _reduced(self, box: Box, decided: Decided, method: str, low: bool) -> Piece:
        """Look at a box, which is part of one on which some choices are decided."""
        self._sloped()
        taken = dict(decided)
        values = self.graph.enclose(self._full, box, taken)
        reduced, moved = list(box), list(box)
        kept: Decided = {k: branch for k, branch in taken.items() if branch is not None}
        if values[self.node] is None or values[self.goal] is None:
            return Piece(None, reduced, kept, None)
        change: Known = (0.0, 0.0)
        turning, most = None, 0.0
        for i, node in (self._steep or {}).items():
            (start, end), span = box[i], values[node]
            if start == end or span is None:
                continue
            if span[0] >= 0 or span[1] <= 0:
                worse = start if (span[0] >= 0) == low else end
                reduced[i] = moved[i] = (worse, worse)
            elif method == "v":
                rises, falls = span[1] > -3 * span[0], -span[0] > 3 * span[1]
                near, far = (start, end) if low else (end, start)
                at = near if rises else far if falls else min(max(start / 2 + end / 2, start), end)
                moved[i] = (at, at)
                off = outward(start - at, end - at)
                by = None if off is None else mul(span, off)
                change = None if change is None or by is None else add(change, by)
                if by is not None and max(-by[0] if low else by[1], 0.0) > most:
                    turning, most = i, -by[0] if low else by[1]
        value = self.graph.enclose(self._again, moved, dict(kept))[self.goal]
        plain, found = values[self.goal], None if value is None or change is None else add(value, change)
        if value is None or found is None or plain is None:
            return Piece(plain, reduced, kept, None)
        ends = max(found[0], plain[0]), min(found[1], plain[1])
        return Piece(ends, reduced, kept, turning if most > TINY * max(abs(value[0]), abs(value[1])) else None)

    def tight(self, box: Box, *, low: bool) -> Known:
        """Return the end of a value on a box as :meth:`on` does, halving what is not monotone where it is worst."""
        pieces = [self._reduced(box, {}, "v", low)]
        for _ in range(HALVED):
            worst = min(pieces, key=lambda one: _end(one.ends, low))
            if (i := worst.turning) is None:
                break
            pieces.remove(worst)
            start, end = worst.box[i]
            cut = self._turn(worst.box, i)
            for half in ((start, cut), (cut, end)):
                part = [*worst.box[:i], half, *worst.box[i + 1 :]]
                pieces.append(self._reduced(part, worst.decided, "v", low))
        return hull(*(one.ends for one in pieces))

    def _turn(self, box: list[Span], i: int) -> float:
        """Return where the slope along a coordinate may change its sign: by the secant of its ends, else the middle."""
        (start, end), node = box[i], (self._steep or {})[i]
        ends = [self.graph.enclose(self._full, [*box[:i], (x, x), *box[i + 1 :]], {})[node] for x in (start, end)]
        a, b = (0.0 if one is None else one[0] / 2 + one[1] / 2 for one in ends)
        at = start + (end - start) * (a / (a - b)) if a * b < 0 else start / 2 + end / 2
        return at if start <= at <= end else start

    def _sloped(self) -> None:
        if self._steep is None:
            self._steep = {i: self.graph.slope(self.goal, i) for i in sorted(self.graph.depends[self.goal])}
            self._full = self.graph.plan({self.node, self.goal, *self._steep.values()})

    def continuous(self, box: Box) -> bool:
        """Tell whether the value exists and is continuous on a box; of a slope: the derivative does and is.

        A slope is a derivative where no kink of the value along the coordinate meets the box: whichever of two
        arguments is larger must be so with room to spare.
        """
        self._sloped()
        taken: dict[int, int | None] = {}
        values = self.graph.enclose(self._full, box, taken)
        if values[self.node] is None or values[self.goal] is None:
            return False
        if any(values[slope] is None for i, slope in (self._steep or {}).items() if i not in self._wholes):
            return False
        return self.along is None or not any(self._kinks(k, values) for k, *_ in self._again.steps)

    def _kinks(self, k: int, values: dict[int, Known]) -> bool:
        op, *args = self.graph.nodes[k]
        if op not in ("pick", "pick!"):
            return False
        a, b = (values[arg] for arg in args[:2])
        return a is None or b is None or not (a[0] > b[1] or a[1] < b[0])


def _end(span: Known, low: bool) -> float:
    """Return what ranks pieces: the worst end first, what is not known before all."""
    return -math.inf if span is None else span[0] if low else -span[1]


def keeps(span: Known, side: str, bound: float) -> bool:
    """Tell whether what is in an interval keeps a bound."""
    low, strict = SIDES[side]
    if span is None:
        return False
    return (span[0] > bound if strict else span[0] >= bound) if low else span[1] < bound if strict else span[1] <= bound


def walk(tree: Any, coordinates: Sequence[Coordinate], leaf: Callable[[Box, str], bool]) -> int:
    """Walk a tree that is given in preorder, looking at every leaf; return how many there are."""
    stack, leaves = [tuple(one.span for one in coordinates)], 0
    need(len(rows(tree)) <= LONGEST, f"a tree must have at most {LONGEST} parts")
    for token in tree:
        need(stack, "the tree goes on behind its end")
        piece = stack.pop()
        if isinstance(token, str):
            need(token in ("p", "m", "v"), f"a leaf must have the method p, m or v, got {token!r:.20}")
            need(leaf(piece, token), f"what is claimed is not shown on the piece {piece} by the method {token}")
            leaves += 1
            continue
        i, at = rows(token, 2)
        i, at = whole(i, 0, len(piece) - 1), number(at)
        low, high = piece[i]
        need(low <= at <= high, f"a piece must be cut within its ends, {low} to {high}, got {at}")
        after = at
        if coordinates[i].whole:
            need(at.is_integer() and at < high, f"whole numbers must be cut at one of them below {high}, got {at}")
            after = at + 1
        stack += [(*piece[:i], (after, high), *piece[i + 1 :]), (*piece[:i], (low, at), *piece[i + 1 :])]
    need(not stack, "the tree must cover the set")
    return leaves


def check(statement: object, proof: object, graph: Graph) -> tuple[str, list[Shown | None]]:
    """Check bounds; return the sentence and what is shown, None where that is continuity."""
    given, claims = record(statement, "set", "claims")
    trees = rows(record(proof, "trees")[0], len(rows(claims)))
    need(claims, "there must be a claim")
    box = read_set(given, graph)
    wholes = [i for i, one in enumerate(box) if one.whole]
    found, said = list[Shown | None](), []
    for claim, tree in zip(claims, trees, strict=True):
        (name, row, column), by, side, bound = record(claim, "of", "by", "is", "bound")
        of = (text(name), whole(row, 0, 10**6), whole(column, 0, 10**6))
        need(of in graph.outputs, f"the graph must have what is spoken of, got {of}")
        need(by is None or by in graph.coordinates, f"slopes must be along a coordinate, got {by!r:.40}")
        along = None if by is None else graph.coordinates.index(by)
        need(along is None or along not in wholes, f"there is no slope along whole numbers, got {by!r:.40}")
        quantity = Quantity(graph, graph.outputs[of], along, wholes)
        what = f"{of[0]}[{of[1]},{of[2]}]"
        what = what if by is None else f"d {what} / d {by}"
        need(isinstance(side, str), "a claim must say what it says")
        kind, everywhere = side.removesuffix(" everywhere"), side.endswith(" everywhere")
        need(
            kind in SIDES or (kind == "continuous" and bound is None),
            f"a bound must be {', '.join(SIDES)}, got {kind!r:.40}",
        )
        if everywhere:
            alone = (kind == "continuous" and by is None) or graph.depends[quantity.goal] <= set(wholes)
            need(alone and graph.everywhere(quantity.node, wholes), f"{what} is not seen to be {kind} everywhere")
        if kind != "continuous":
            walk(tree, box, partial(_keeps, quantity, kind, number(bound)))
        elif not everywhere or by is not None:
            walk(tree, box, partial(_continuous, quantity))
        of_all = ", for all numbers that are not whole" if everywhere else ""
        said.append(f"{what} {'exists and is continuous' if bound is None else f'is {kind} {number(bound)!r}'}{of_all}")
        found.append(None if bound is None else Shown(of, by, kind, number(bound)))
    return f"For all {', '.join(map(str, box))}: {'; '.join(said)}.", found


def _continuous(quantity: Quantity, piece: Box, method: str) -> bool:
    return quantity.continuous(piece)


def _keeps(quantity: Quantity, side: str, edge: float, piece: Box, method: str) -> bool:
    return keeps(quantity.on(piece, method, low=SIDES[side][0]), side, edge)
