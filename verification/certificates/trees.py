"""Trees of splits that show a bound: sought with the checker's own arithmetic, so that what is found is accepted."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from verification.checker.bounds import SIDES, Coordinate, Quantity, keeps
from verification.checker.graph import Box
from verification.checker.interval import Span
from workbench.contracts.certificate import Json

MOST = 20_000
"""Pieces that a tree may be sought through."""
KINK = 2.0**-12
"""Share of a set below which a piece is not cut for a slope that does not exist: a kink stays in one piece."""
METHODS = ("v", "m", "p")
Leaf = Callable[[Box], str | None]
"""Returns the method by which what is claimed is shown on a piece, or None."""


def bounded(quantity: Quantity, side: str, bound: float) -> Leaf:
    """Return what looks at a piece for a bound."""
    low = SIDES[side][0]

    def leaf(piece: Box) -> str | None:
        return next((one for one in METHODS if keeps(quantity.on(piece, one, low=low), side, bound)), None)

    return leaf


def continuous(quantity: Quantity) -> Leaf:
    """Return what looks at a piece for continuity."""
    return lambda piece: "p" if quantity.continuous(piece) else None


def tree(quantity: Quantity, box: Sequence[Coordinate], leaf: Leaf, most: int = MOST) -> list[Json] | None:
    """Return the tree in preorder, or None where none was found within ``most`` pieces.

    A piece that is not shown is cut in its middle, along the coordinate over which what is asked varies most.
    """
    found: list[Json] = []
    stack: list[tuple[Span, ...]] = [tuple(one.span for one in box)]
    for _ in range(most):
        if not stack:
            return found
        piece = stack.pop()
        method = leaf(piece)
        if method is not None:
            found.append(method)
            continue
        cut = _cut(quantity, box, piece)
        if cut is None:
            return None
        i, at, after = cut
        found.append([i, at.hex()])
        low, high = piece[i]
        stack += [(*piece[:i], (after, high), *piece[i + 1 :]), (*piece[:i], (low, at), *piece[i + 1 :])]
    return None


def _cut(quantity: Quantity, box: Sequence[Coordinate], piece: Sequence[Span]) -> tuple[int, float, float] | None:
    """Return along which coordinate to cut a piece, where its lower part ends and where the upper one begins."""
    if (kink := _kink(quantity, box, piece)) is not None:
        return kink
    best, most = None, -1.0
    graph, goal = quantity.graph, quantity.goal
    steep = {i: graph.slope(goal, i) for i in sorted(graph.depends[goal] | graph.depends[quantity.node])}
    values = graph.enclose(graph.plan(steep.values()), piece, {})
    for i, node in steep.items():
        low, high = piece[i]
        middle = low / 2 + high / 2
        if box[i].whole:
            middle = float(math.floor(middle))
        if not (low <= middle < high) or (not box[i].whole and not low < middle):
            continue
        share = (high - low) / (box[i].span[1] - box[i].span[0])
        span = values[node]
        weight = math.inf if span is None else max(-span[0], span[1], 0.0) * (high - low)
        if math.isinf(weight):
            rank = share * 1e300 if share > KINK else share * 1e-9
        else:
            rank = weight + share * 1e-9
        if rank > most:
            best, most = (i, middle, middle + 1 if box[i].whole else middle), rank
    return best


def _kink(quantity: Quantity, box: Sequence[Coordinate], piece: Sequence[Span]) -> tuple[int, float, float] | None:
    """Return where to cut a piece at the very place of a kink in it, where that is one number of one coordinate.

    Where two arguments meet is sought by the secant of their ends: of a kink that is a line's it is exact.
    """
    graph = quantity.graph
    plan = graph.plan([quantity.goal])
    values = graph.enclose(plan, piece, {})
    for _, _, op, first, _, args in plan.steps:
        if not op.startswith("pick"):
            continue
        second = args[1]
        along = graph.depends[first] | graph.depends[second]
        if len(along) != 1:
            continue
        (i,) = along
        a, b, (low, high) = values[first], values[second], piece[i]
        if box[i].whole or a is None or b is None or a[0] >= b[1] or b[0] >= a[1]:
            continue
        ends = [graph.enclose(plan, [*piece[:i], (x, x), *piece[i + 1 :]], {}) for x in (low, high)]
        apart = [_middle(one[first]) - _middle(one[second]) for one in ends]
        if apart[0] * apart[1] < 0:
            at = low + (high - low) * (apart[0] / (apart[0] - apart[1]))
            for near in (at, math.nextafter(at, -math.inf), math.nextafter(at, math.inf), round(at, 12)):
                there = graph.enclose(plan, [*piece[:i], (near, near), *piece[i + 1 :]], {})
                if there[first] == there[second] and low < near < high:
                    return i, near, near
    return None


def _middle(span: Span | None) -> float:
    return 0.0 if span is None else span[0] / 2 + span[1] / 2
