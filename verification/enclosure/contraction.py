"""What is left of boxes where a condition holds: coordinates and quantities narrowed backwards through the condition.

A condition is taken apart into literals: comparisons that hold or do not. From each the ends of what it compares
are cut, then the ends of what that is made of, down to the coordinates (HC4-revise: Benhamou,
Goualard, Granvilliers and Puget 1999). An alternative (`or`, |x| > c) gives a part for each case. Parts are closed:
they hold every point of the box at which the condition holds and the limits of such points, be it strict or not.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from verification.enclosure import outward, outward_logic
from verification.enclosure.outward import Array, Mask, Span
from verification.enclosure.rewriting import MEET, Rewritten
from workbench.graph.operations import BOOLEAN, COMPARISONS, CONSTANT, INPUT

MOST_PARTS = 4
"""Alternatives of a condition that are taken apart; one with more narrows nothing."""
Held = Mapping[int, Span]
"""Ends that are known of quantities, by node."""


class Literal(NamedTuple):
    """A comparison that holds or does not, or the sign of a quantity: 1 for x >= 0, -1 for x <= 0, 0 for x = 0."""

    node: int
    holds: bool | None = None
    sign: int = 0


Conjunction = tuple[Literal, ...]


def cases(graph: Rewritten, condition: int, holds: bool) -> tuple[Conjunction, ...]:
    """Return alternatives, each of literals that all hold, of which one holds wherever the condition does (or not)."""
    found = _cases(graph, condition, holds)
    return found if len(found) <= MOST_PARTS else ((),)


def _cases(graph: Rewritten, condition: int, holds: bool) -> tuple[Conjunction, ...]:
    op, args = graph.nodes[condition].op, graph.nodes[condition].args
    if op == "not":
        return _cases(graph, args[0], not holds)
    if op in ("and", "or"):
        first, second = (cases(graph, arg, holds) for arg in args)
        if holds == (op == "or"):
            return first + second
        return tuple(a + b for a in first for b in second)
    if op in ("lt", "le"):
        own = Literal(condition, holds)
        large = args[1] if holds else args[0]
        if graph.nodes[large].op in ("fabs", "sq"):
            inner = graph.nodes[large].args[0]
            return (own, Literal(inner, sign=1)), (own, Literal(inner, sign=-1))
        return ((own,),)
    if op in COMPARISONS:
        return ((Literal(condition, holds),),) if holds == (op == "eq") else ((),)
    if op == "if_else_zero" and holds:
        return tuple(a + b for a in cases(graph, args[0], True) for b in cases(graph, args[1], True))
    return ((),) if holds or op == "if_else_zero" else ((Literal(condition),),)


def narrows(graph: Rewritten, alternatives: tuple[Conjunction, ...], target: int) -> bool:
    """Say whether literals tell anything about what a node depends on."""
    told = graph.ancestors(tuple({one.node for case in alternatives for one in case}))
    needed = set(graph.ancestors((target,)))
    return all(alternatives) and any(k in needed for k in told if graph.nodes[k].op != CONSTANT)


class Parts(NamedTuple):
    """What is left of boxes, several parts of one box being columns of their own."""

    lower: Array
    upper: Array
    held: Held
    owner: NDArray[np.int64]
    """Which box each part is of; a box without a part has no point at which the conditions hold."""


def _limits(node: str, holds: bool, a: Span, b: Span) -> tuple[Span, Span]:
    """Return what a comparison leaves of what it compares."""
    if node in ("eq", "ne"):
        both = outward.meet(a, b)
        return both, both
    if holds:
        return Span(a.lo, np.minimum(a.hi, b.hi)), Span(np.maximum(b.lo, a.lo), b.hi)
    return Span(np.maximum(a.lo, b.lo), a.hi), Span(b.lo, np.minimum(b.hi, a.hi))


def contract(
    graph: Rewritten, values: Mapping[int, Span], case: Conjunction, count: int, wanted: Iterable[int] = ()
) -> tuple[Held, Mask]:
    """Return narrower ends of quantities where literals hold, and say on which of so many boxes there may be a point.

    ``values`` encloses what the literals depend on. Ends that would be empty are left as they are. Of differences of
    two quantities that are compared, where they are ``wanted``, the sign is known.
    """
    with np.errstate(all="ignore"):
        known, alive = _contract(graph, values, case, count)
    return {**known, **_differences(graph, case, wanted)}, alive


def _differences(graph: Rewritten, case: Conjunction, wanted: Iterable[int]) -> Held:
    """Return the signs of differences x - y, of those that are wanted, where x and y are compared."""
    signs: dict[tuple[int, ...], tuple[float, float]] = {}
    for literal in case:
        node = graph.nodes[literal.node]
        if literal.holds is not None and node.op in ("lt", "le"):
            small, large = node.args if literal.holds else node.args[::-1]
            signs[large, small], signs[small, large] = (0.0, np.inf), (-np.inf, 0.0)
    if not signs:
        return {}
    found = {
        k: signs[graph.nodes[k].args] for k in wanted if graph.nodes[k].op == "sub" and graph.nodes[k].args in signs
    }
    return {k: Span(np.array([low]), np.array([high])) for k, (low, high) in found.items()}


def _contract(
    graph: Rewritten, values: Mapping[int, Span], case: Conjunction, count: int
) -> tuple[dict[int, Span], Mask]:
    known: dict[int, Span] = {}
    alive = np.ones(count, dtype=bool)

    def cut(k: int, span: Span) -> None:
        nonlocal alive
        before = known.get(k, values[k])
        low = np.broadcast_to(np.fmax(before.lo, span.lo), count)  # an end that is no number says nothing
        high = np.broadcast_to(np.fmin(before.hi, span.hi), count)
        good = low <= high
        alive = alive & good
        known[k] = Span(np.where(good, low, before.lo), np.where(good, high, before.hi))

    for literal in case:
        node = graph.nodes[literal.node]
        if literal.holds is None:
            low, high = (-np.inf if literal.sign < 0 else 0.0), (np.inf if literal.sign > 0 else 0.0)
            cut(literal.node, Span(np.array([low]), np.array([high])))
            continue
        sides = [known.get(arg, values[arg]) for arg in node.args]
        for arg, span in zip(node.args, _limits(node.op, literal.holds, *sides), strict=True):
            cut(arg, span)
    for k in reversed(graph.ancestors(tuple(known))):
        node = graph.nodes[k]
        if k not in known:
            continue
        rule = _BACKWARDS.get(node.op)
        if rule is not None and node.op not in BOOLEAN:
            for arg, span in zip(node.args, rule(known[k], *(known.get(a, values[a]) for a in node.args)), strict=True):
                cut(arg, span)
    return known, alive


def gathered(
    graph: Rewritten, lower: Array, upper: Array, held: Held, found: Sequence[tuple[Held, Mask]], wanted: frozenset[int]
) -> Parts:
    """Return the parts of boxes of which narrower ends are known, case by case; only ends that are wanted are kept."""
    count = lower.shape[1]
    lows, highs, owners, ends = [], [], [], []
    for known, alive in found:
        low, high = lower.copy(), upper.copy()
        for k, span in known.items():
            node = graph.nodes[k]
            if node.op == INPUT:
                i = node.coordinate
                finite = np.isfinite(lower[i]) & np.isfinite(upper[i])  # others have no value, which stays so
                low[i] = np.where(finite, np.maximum(lower[i], span.lo), lower[i])
                high[i] = np.where(finite, np.minimum(upper[i], span.hi), upper[i])
        columns = np.flatnonzero(alive)
        lows.append(low[:, columns])
        highs.append(high[:, columns])
        owners.append(columns)
        ends.append({k: span for k, span in known.items() if k in wanted and graph.nodes[k].op != INPUT})
    names = set(held).union(*ends)
    line = Span(np.full(count, -np.inf), np.full(count, np.inf))
    together: dict[int, Span] = {}
    for k in names:
        pieces = [outward.meet(own.get(k, line), held.get(k, line)) for own in ends]
        together[k] = Span(*(np.concatenate([np.broadcast_to(piece[side], count)[columns]
                                             for piece, columns in zip(pieces, owners, strict=True)])
                             for side in (0, 1)))  # fmt: skip
    return Parts(np.hstack(lows), np.hstack(highs), together, np.concatenate(owners))


# ------------------------------------------------------------------ operations backwards


def _unless(bad: Mask, span: Span) -> Span:
    return Span(np.where(bad, -np.inf, span.lo), np.where(bad, np.inf, span.hi))


def _over(a: Span, b: Span) -> Span:
    span, bad = outward.div(a, b)
    return _unless(bad, span)


def _sized(low: Array, high: Array, a: Span) -> Span:
    """Return what is left of a quantity whose size lies between two ends."""
    return Span(np.where(a.lo >= 0, low, -high), np.where(a.hi <= 0, -low, high))


def _square(f: Span, a: Span) -> tuple[Span]:
    roots, _ = outward.sqrt(Span(np.maximum(f.lo, 0.0), np.maximum(f.hi, 0.0)))
    return (_sized(roots.lo, roots.hi, a),)


def _smaller(f: Span, a: Span, b: Span) -> tuple[Span, Span]:
    first, second = (np.where(other.lo > f.hi, f.hi, np.inf) for other in (b, a))
    return Span(f.lo, first), Span(f.lo, second)


def _larger(f: Span, a: Span, b: Span) -> tuple[Span, Span]:
    first, second = (np.where(other.hi < f.lo, f.lo, -np.inf) for other in (b, a))
    return Span(first, f.hi), Span(second, f.hi)


def _undone(inverse: Callable[[Span], tuple[Span, Mask]]) -> Callable[..., tuple[Span]]:  # of a value and an argument
    """Return the rule of an increasing operation with an increasing inverse, which is asked at the two ends."""

    def rule(f: Span, a: Span) -> tuple[Span]:
        low, bad_low = inverse(Span(f.lo, f.lo))
        high, bad_high = inverse(Span(f.hi, f.hi))
        unknown = [bad | ~np.isfinite(end) for bad, end in ((bad_low, f.lo), (bad_high, f.hi))]
        return (Span(np.where(unknown[0], -np.inf, low.lo), np.where(unknown[1], np.inf, high.hi)),)

    return rule


def _everywhere(function: Callable[[Span], Span]) -> Callable[[Span], tuple[Span, Mask]]:
    return lambda a: (function(a), np.zeros(a.lo.shape, dtype=bool))


def _root(f: Span, a: Span) -> tuple[Span]:
    return (outward.square(Span(np.maximum(f.lo, 0.0), np.maximum(f.hi, 0.0))),)


def _power(f: Span, x: Span, y: Span) -> tuple[Span, Span]:
    """Narrow a positive base under a positive exponent that is one number."""
    fits = (x.lo >= 0) & (y.lo == y.hi) & (y.lo > 0) & (f.lo >= 0)
    exponent = Span(np.where(fits, y.lo, 1.0), np.where(fits, y.lo, 1.0))
    value = Span(np.where(fits, f.lo, 1.0), np.where(fits & np.isfinite(f.hi), f.hi, 1.0))
    root, bad = outward.power(value, outward.div(outward.point(1.0), exponent)[0])
    known = _unless(bad | ~fits, root)
    return Span(known.lo, np.where(np.isfinite(f.hi), known.hi, np.inf)), outward.full(y.lo)


_UNIT = outward.point(1.0)
# operations have one argument, or two
_BACKWARDS: Mapping[str, Callable[..., tuple[Span, ...]]] = {
    "add": lambda f, a, b: (outward.sub(f, b), outward.sub(f, a)),
    "sub": lambda f, a, b: (outward.add(f, b), outward.sub(a, f)),
    "mul": lambda f, a, b: (_over(f, b), _over(f, a)),
    "div": lambda f, a, b: (outward.mul(f, b), _over(a, f)),
    "inv": lambda f, a: (_over(_UNIT, f),),
    "neg": lambda f, a: (outward.neg(f),),
    "twice": lambda f, a: (outward.div(f, outward.point(2.0))[0],),
    "sq": _square,
    "fabs": lambda f, a: (_sized(np.maximum(f.lo, 0.0), f.hi, a),),
    "sqrt": _root,
    "pow": _power,
    "exp": _undone(outward.log),
    "log": _undone(_everywhere(outward.exp)),
    "expm1": _undone(outward.log1p),
    "log1p": _undone(_everywhere(outward.expm1)),
    "sinh": _undone(_everywhere(outward.asinh)),
    "asinh": _undone(_everywhere(outward.sinh)),
    "tanh": _undone(outward.atanh),
    "atanh": _undone(_everywhere(outward.tanh)),
    "erf": _undone(outward.erfinv),
    "erfinv": _undone(_everywhere(outward.erf)),
    "floor": lambda f, a: (Span(np.ceil(f.lo), outward.add(Span(np.floor(f.hi), np.floor(f.hi)), _UNIT).hi),),
    "ceil": lambda f, a: (Span(outward.sub(Span(np.ceil(f.lo), np.ceil(f.lo)), _UNIT).lo, np.floor(f.hi)),),
    "fmin": _smaller,
    "fmax": _larger,
    MEET: lambda f, a, b: (f, f),
}
"""What is left of the arguments where a value is known: (value, *arguments) -> ends of each argument."""


def undecided(condition: Span) -> Mask:
    """Say on which boxes a condition may hold and may not."""
    holds = outward_logic.truth(condition)
    return np.asarray(holds.lo != holds.hi)
