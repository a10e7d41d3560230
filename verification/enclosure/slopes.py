"""Enclosures of gradients: the chain rule backwards through a graph that was enclosed on boxes.

The derivatives are not taken from CasADi, because its symbolic ones fold constants in rounded arithmetic, write
``erf`` with a rounded factor, and hold on one side only where a condition is a number. Here every local derivative
is an interval that holds the true one.

A local derivative may be wanted at a kink. Along a segment, ``fabs``, ``fmin`` or ``fmax`` meet their kink only at
points that do not count in an integral, or on stretches where the two sides have one slope; so any interval that
holds the slopes of the sides in reach will do. Across a jump there is no such interval: the whole line is returned,
which says "not usable".
"""

from collections.abc import Callable, Mapping

import numpy as np
from flint import arb, ctx

from verification.enclosure import outward, outward_logic
from verification.enclosure.guards import Value
from verification.enclosure.lookups import enclosed, jumps, unreadable
from verification.enclosure.outward import Array, Mask, Span
from verification.enclosure.rewriting import COVER, MEET, Rewritten
from workbench.graph.operations import BOOLEAN, CONSTANT, INPUT, LOOKUP

_ONE, _ZERO = outward.point(1.0), outward.point(0.0)


def _around(ball: Callable[[], arb]) -> Span:
    """Return the floats around a constant."""
    with ctx.workprec(outward.PRECISION):
        low, high = outward.floats_around(ball())
    return Span(np.array([low]), np.array([high]))


_TWO_BY_ROOT_PI = _around(lambda: 2 / arb.pi().sqrt())
_ROOT_PI_BY_TWO = _around(lambda: arb.pi().sqrt() / 2)


def _unless(bad: Mask, span: Span) -> Span:
    """Return the whole line where something failed."""
    return Span(np.where(bad, -np.inf, span.lo), np.where(bad, np.inf, span.hi))


def _over(a: Span, b: Span) -> Span:
    span, bad = outward.div(a, b)
    return _unless(bad, span)


def _root(a: Span) -> Span:
    span, bad = outward.sqrt(a)
    return _unless(bad, span)


def _one_less_square(a: Span) -> Span:
    return outward.sub(_ONE, outward.square(a))


def _one_more_square(a: Span) -> Span:
    return outward.add(_ONE, outward.square(a))


def _atan2(f: Span, y: Span, x: Span) -> tuple[Span, Span]:
    square, cut = outward.add(outward.square(x), outward.square(y)), outward.has_zero(y) & (x.lo <= 0)
    return _unless(cut, _over(x, square)), _unless(cut, _over(outward.neg(y), square))


def _power(f: Span, x: Span, y: Span) -> tuple[Span, Span]:
    lower, bad = outward.power(x, outward.sub(y, _ONE))
    by_base = _unless(bad, outward.mul(y, lower))
    if np.all(y.lo == y.hi):
        return by_base, _ZERO  # the exponent does not change over the box
    logarithm, bad = outward.log(x)
    return by_base, _unless(bad, outward.mul(f, logarithm))


def _step(f: Span, *arguments: Span) -> tuple[Span, ...]:
    """Return no slope where the result is decided."""
    return (_unless(np.asarray(f.lo != f.hi), Span(np.zeros_like(f.lo), np.zeros_like(f.hi))),) * len(arguments)


def _gate(f: Span, c: Span, x: Span) -> tuple[Span, Span]:
    holds = outward_logic.truth(c)
    undecided = np.asarray(holds.lo != holds.hi)
    return _unless(undecided, Span(np.zeros_like(holds.lo), np.zeros_like(holds.lo))), _unless(undecided, holds)


def _sign(a: Span) -> Span:
    return Span(np.sign(a.lo), np.sign(a.hi))


def _copysign(f: Span, x: Span, y: Span) -> tuple[Span, Span]:
    jump = outward.has_zero(y)
    return _unless(jump, outward.mul(_sign(x), _sign(y))), _unless(jump, _ZERO)


def _left_over(rounded: Callable[[Array], Array]) -> Callable[[Span, Span, Span], tuple[Span, Span]]:
    """Return the slopes of what division leaves: one, and minus the whole quotient where that is one number."""

    def slopes(f: Span, x: Span, y: Span) -> tuple[Span, Span]:
        quotient, bad = outward.div(x, y)
        low, high = rounded(quotient.lo), rounded(quotient.hi)
        jump = bad | ~(low == high)
        return _unless(jump, _ONE), _unless(jump, Span(-high, -low))

    return slopes


def _smaller(f: Span, a: Span, b: Span) -> tuple[Span, Span]:
    return outward_logic.less(a, b), outward_logic.less(b, a)


def _unknown(f: Span, *arguments: Span) -> tuple[Span, ...]:
    return (outward.full(np.zeros(1)),) * len(arguments)


def _lookup(graph: Rewritten, k: int, arguments: list[Span]) -> tuple[Span, ...]:
    """Enclose the slopes of a table: on both sides of a kink, and none where it breaks off."""
    table, lookup = graph.table_of(k), graph.lookup_of(k)
    if unreadable(table):
        return _unknown(arguments[0], *arguments)
    broken = jumps(table, lookup, arguments)
    slopes = []
    for axis in range(len(arguments)):
        orders = tuple(order + (i == axis) for i, order in enumerate(lookup.orders))
        slopes.append(_unless(broken, enclosed(table, lookup._replace(orders=orders), arguments)))
    return tuple(slopes)


Partials = Callable[..., tuple[Span, ...]]  # operations have one argument, or two

_PARTIALS: Mapping[str, Partials] = {
    "add": lambda f, a, b: (_ONE, _ONE),
    "sub": lambda f, a, b: (_ONE, outward.neg(_ONE)),
    "mul": lambda f, a, b: (b, a),
    "div": lambda f, a, b: (_over(_ONE, b), outward.neg(_over(f, b))),
    "inv": lambda f, a: (outward.neg(outward.square(f)),),
    "neg": lambda f, a: (outward.neg(_ONE),),
    "twice": lambda f, a: (outward.twice(_ONE),),
    "sq": lambda f, a: (outward.twice(a),),
    "sqrt": lambda f, a: (_over(_ONE, outward.twice(f)),),
    "exp": lambda f, a: (f,),
    "expm1": lambda f, a: (outward.exp(a),),
    "log": lambda f, a: (_over(_ONE, a),),
    "log1p": lambda f, a: (_over(_ONE, outward.add(_ONE, a)),),
    "sin": lambda f, a: (outward.cos(a),),
    "cos": lambda f, a: (outward.neg(outward.sin(a)),),
    "tan": lambda f, a: (_one_more_square(f),),
    "asin": lambda f, a: (_over(_ONE, _root(_one_less_square(a))),),
    "acos": lambda f, a: (outward.neg(_over(_ONE, _root(_one_less_square(a)))),),
    "atan": lambda f, a: (_over(_ONE, _one_more_square(a)),),
    "atan2": _atan2,
    "sinh": lambda f, a: (outward.cosh(a),),
    "cosh": lambda f, a: (outward.sinh(a),),
    "tanh": lambda f, a: (_one_less_square(f),),
    "asinh": lambda f, a: (_over(_ONE, _root(_one_more_square(a))),),
    "acosh": lambda f, a: (_over(_ONE, _root(outward.sub(outward.square(a), _ONE))),),
    "atanh": lambda f, a: (_over(_ONE, _one_less_square(a)),),
    "erf": lambda f, a: (outward.mul(_TWO_BY_ROOT_PI, outward.exp(outward.neg(outward.square(a)))),),
    "erfinv": lambda f, a: (outward.mul(_ROOT_PI_BY_TWO, outward.exp(outward.square(f))),),
    "hypot": lambda f, a, b: (_over(a, f), _over(b, f)),
    "pow": _power,
    "fabs": lambda f, a: (_sign(a),),
    "fmin": _smaller,
    "fmax": lambda f, a, b: _smaller(f, b, a),
    "copysign": _copysign,
    "fmod": _left_over(np.trunc),
    "remainder": _left_over(np.rint),
    "if_else_zero": _gate,
    COVER: lambda f, a, b: (_ONE, _ONE),
    MEET: lambda f, a, b: (_ZERO, _ONE),  # the rewritten quantity is the same one again
    **dict.fromkeys((*BOOLEAN, "sign", "floor", "ceil"), _step),
}


def partials(op: str, value: Span, *arguments: Span) -> tuple[Span, ...]:
    """Enclose the slopes of an operation by its arguments; the whole line where nothing is known."""
    return tuple(_known(one) for one in _PARTIALS.get(op, _unknown)(value, *arguments))


def gradient(graph: Rewritten, node: int, values: Mapping[int, Value], shape: tuple[int, int]) -> Span:
    """Enclose the gradient of a node on boxes.

    Parameters
    ----------
    graph, node
        What to differentiate.
    values
        The enclosures of the node and all that it depends on.
    shape
        Number of coordinates, number of boxes.

    Returns
    -------
    Span
        One row a coordinate, one column a box. An infinite end says that nothing is known there: the slope is
        unbounded, something jumps, or an operation has no rule.
    """
    with np.errstate(all="ignore"):
        return _chain(graph, node, values, Span(np.zeros(shape), np.zeros(shape)))


def _chain(graph: Rewritten, node: int, values: Mapping[int, Value], result: Span) -> Span:
    """Walk backwards from the node, adding up what reaches every coordinate."""
    through: dict[int, Span] = {node: _ONE}
    for k in reversed(graph.ancestors((node,), rewritten=False)):
        op, args = graph.nodes[k].op, graph.nodes[k].args
        so_far = through.pop(k, None)
        if so_far is None:
            continue
        if op == INPUT:
            result.lo[graph.nodes[k].coordinate], result.hi[graph.nodes[k].coordinate] = so_far
        if not args:
            continue
        spans = [values[a].span for a in args]
        found = _lookup(graph, k, spans) if op == LOOKUP else _PARTIALS.get(op, _unknown)(values[k].span, *spans)
        for argument, partial in zip(args, found, strict=True):
            if graph.nodes[argument].op == CONSTANT or (op == MEET and argument == args[0]):
                continue
            term = _known(outward.mul(so_far, _known(partial)))
            before = through.get(argument)
            through[argument] = term if before is None else _known(outward.add(before, term))
    return result


def _known(a: Span) -> Span:
    low: Array = np.where(np.isnan(a.lo), -np.inf, a.lo)
    return Span(low, np.where(np.isnan(a.hi), np.inf, a.hi))
