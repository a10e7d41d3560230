"""Exact derivatives of a graph, as a graph: the chain rule backwards, with no number computed on the way.

CasADi computes with constants while it differentiates, in rounded arithmetic. Here a derivative is made of
operations on the graph's own constants, so that every arithmetic gets it as exactly as that arithmetic can.

At a kink the derivative is the mean of both sides for ``fmin`` and ``fmax``, zero for ``fabs`` and the right-hand
one for a table; across a jump it is what it is beside the jump. Where a guard does not let a branch count, the slope
of the branch does not count either, though it may have no value there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from workbench.graph.build import Builder
from workbench.graph.graph import Entry, Graph, Result
from workbench.graph.operations import CONSTANT, INPUT, LOOKUP, OPERATIONS

Slopes = tuple[int | None, ...]
"""A node for the slope by every argument, None where it is zero."""


def jacobian(graph: Graph, of: str, by: str) -> Graph:
    """Return the derivative of an output by an input as a graph with the same inputs.

    Its output ``d{of}_d{by}`` has a row for every element of the output and a column for every element of the
    input, both column after column, as CasADi's ``jacobian`` does. Raises ValueError for an unknown name.
    """
    result = graph.output(of)
    ports = [port.name for port in graph.inputs]
    if by not in ports:
        raise ValueError(f"{graph.name} has inputs {ports}, got {by!r}")
    port = graph.inputs[ports.index(by)]
    start = sum(len(earlier.places) for earlier in graph.inputs[: ports.index(by)])
    columns = {start + i: column * port.shape[0] + row for i, (row, column) in enumerate(port.places)}
    build = Builder(graph)
    entries = []
    for entry in result.entries:
        row = entry.column * result.shape[0] + entry.row
        for coordinate, slope in gradient(build, entry.node).items():
            if coordinate in columns:
                entries.append(Entry(row, columns[coordinate], slope))
    shape = (result.shape[0] * result.shape[1], port.shape[0] * port.shape[1])
    ordered = tuple(sorted(entries, key=lambda entry: (entry.column, entry.row)))
    name = f"d{of}_d{by}"
    return build.built((Result(name, shape, ordered),), f"{graph.name}_{name}")


def gradient(build: Builder, target: int) -> dict[int, int]:
    """Return the node of the slope of a node by every coordinate that it depends on, made in the builder."""
    one = build.constant(1.0)
    places = build.graph.ancestors([target]) if target < len(build.graph.nodes) else range(target + 1)
    through: dict[int, int] = {target: one}
    result: dict[int, int] = {}

    def reach(place: int, slope: int) -> None:
        known = through.get(place)
        through[place] = slope if known is None else _plus(build, known, slope)

    for place in reversed(places):
        so_far = through.pop(place, None)
        if so_far is None:
            continue
        node = build.nodes[place]
        if node.op == INPUT:
            known = result.get(node.which)
            result[node.which] = so_far if known is None else _plus(build, known, so_far)
        elif node.op == "if_else_zero":
            reach(node.args[1], build.operation("if_else_zero", node.args[0], so_far))
        elif node.op == LOOKUP:
            lookup = build.lookups[node.which]
            for axis, arg in enumerate(node.args):
                orders = tuple(order + (i == axis) for i, order in enumerate(lookup.orders))
                reach(arg, _times(build, so_far, build.lookup(lookup._replace(orders=orders), *node.args)))
        elif node.op != CONSTANT and build.nodes[place].args:
            for arg, slope in zip(node.args, _SLOPES[node.op](build, place, *node.args), strict=True):
                if slope is not None and build.nodes[arg].op != CONSTANT:
                    reach(arg, _times(build, so_far, slope))
    return result


def _times(build: Builder, a: int, b: int) -> int:
    """Return the node of a product; what a guard shuts out of its first factor stays behind the guard."""
    if build.nodes[a].op == "if_else_zero":
        condition, inner = build.nodes[a].args
        return build.operation("if_else_zero", condition, _times(build, inner, b))
    one = build.constant(1.0)
    return b if a == one else a if b == one else build.operation("mul", a, b)


def _plus(build: Builder, a: int, b: int) -> int:
    """Return the node of a sum; what one guard shuts out of both terms stays behind it."""
    first, second = build.nodes[a], build.nodes[b]
    if first.op == second.op == "if_else_zero" and first.args[0] == second.args[0]:
        return build.operation("if_else_zero", first.args[0], _plus(build, first.args[1], second.args[1]))
    return build.operation("add", a, b)


# operations take different numbers of arguments
def _number(value: float) -> Callable[..., Slopes]:
    return lambda b, f, *args: (b.constant(value),) * len(args)


def _no_slope(b: Builder, f: int, *args: int) -> Slopes:
    return (None,) * len(args)


def _pi(b: Builder) -> int:
    """Return the node of pi, which no double is: the arc cosine of -1."""
    return b.operation("acos", b.constant(-1.0))


def _one_less_square(b: Builder, x: int) -> int:
    return b.operation("sub", b.constant(1.0), b.operation("sq", x))


def _one_more_square(b: Builder, x: int) -> int:
    return b.operation("add", b.constant(1.0), b.operation("sq", x))


def _over_root(b: Builder, x: int) -> int:
    return b.operation("inv", b.operation("sqrt", x))


def _quotient(b: Builder, f: int, x: int, y: int) -> Slopes:
    return b.operation("inv", y), b.operation("neg", b.operation("div", f, y))


def _power(b: Builder, f: int, x: int, y: int) -> Slopes:
    lower = b.operation("pow", x, b.operation("sub", y, b.constant(1.0)))
    by_base = b.operation("mul", y, lower)
    if b.nodes[y].op == CONSTANT:
        return by_base, None
    return by_base, b.operation("mul", f, b.operation("log", x))


def _atan2(b: Builder, f: int, y: int, x: int) -> Slopes:
    square = b.operation("add", b.operation("sq", x), b.operation("sq", y))
    return b.operation("div", x, square), b.operation("neg", b.operation("div", y, square))


def _erf(b: Builder, f: int, x: int) -> Slopes:
    bell = b.operation("exp", b.operation("neg", b.operation("sq", x)))
    return (b.operation("mul", b.operation("div", b.constant(2.0), b.operation("sqrt", _pi(b))), bell),)


def _erfinv(b: Builder, f: int, x: int) -> Slopes:
    half = b.operation("div", b.operation("sqrt", _pi(b)), b.constant(2.0))
    return (b.operation("mul", half, b.operation("exp", b.operation("sq", f))),)


def _hypot(b: Builder, f: int, x: int, y: int) -> Slopes:
    return b.operation("div", x, f), b.operation("div", y, f)


def _modulo(b: Builder, f: int, x: int, y: int) -> Slopes:
    return b.constant(1.0), b.operation("div", b.operation("sub", f, x), y)


def _copysign(b: Builder, f: int, x: int, y: int) -> Slopes:
    return b.operation("mul", b.operation("sign", x), b.operation("copysign", b.constant(1.0), y)), None


# operations take different numbers of arguments
def _extreme(first: str) -> Callable[..., Slopes]:
    """Return the slopes of the smaller or larger of two: of both, where they are equal, half each."""

    def slopes(b: Builder, f: int, x: int, y: int) -> Slopes:
        pair = (x, y) if first == "fmin" else (y, x)
        below, above = b.operation("le", *pair), b.operation("le", *pair[::-1])
        both = b.operation("add", below, above)
        return b.operation("div", below, both), b.operation("div", above, both)

    return slopes


# operations take different numbers of arguments
_SLOPES: Mapping[str, Callable[..., Slopes]] = MappingProxyType(
    {
        "assign": _number(1.0),
        "add": _number(1.0),
        "sub": lambda b, f, x, y: (b.constant(1.0), b.constant(-1.0)),
        "mul": lambda b, f, x, y: (y, x),
        "div": _quotient,
        "neg": _number(-1.0),
        "inv": lambda b, f, x: (b.operation("neg", b.operation("sq", f)),),
        "twice": _number(2.0),
        "sq": lambda b, f, x: (b.operation("twice", x),),
        "sqrt": lambda b, f, x: (b.operation("inv", b.operation("twice", f)),),
        "pow": _power,
        "constpow": _power,
        "exp": lambda b, f, x: (f,),
        "expm1": lambda b, f, x: (b.operation("exp", x),),
        "log": lambda b, f, x: (b.operation("inv", x),),
        "log1p": lambda b, f, x: (b.operation("inv", b.operation("add", b.constant(1.0), x)),),
        "sin": lambda b, f, x: (b.operation("cos", x),),
        "cos": lambda b, f, x: (b.operation("neg", b.operation("sin", x)),),
        "tan": lambda b, f, x: (_one_more_square(b, f),),
        "asin": lambda b, f, x: (_over_root(b, _one_less_square(b, x)),),
        "acos": lambda b, f, x: (b.operation("neg", _over_root(b, _one_less_square(b, x))),),
        "atan": lambda b, f, x: (b.operation("inv", _one_more_square(b, x)),),
        "atan2": _atan2,
        "sinh": lambda b, f, x: (b.operation("cosh", x),),
        "cosh": lambda b, f, x: (b.operation("sinh", x),),
        "tanh": lambda b, f, x: (_one_less_square(b, f),),
        "asinh": lambda b, f, x: (_over_root(b, _one_more_square(b, x)),),
        "acosh": lambda b, f, x: (_over_root(b, b.operation("sub", b.operation("sq", x), b.constant(1.0))),),
        "atanh": lambda b, f, x: (b.operation("inv", _one_less_square(b, x)),),
        "erf": _erf,
        "erfinv": _erfinv,
        "hypot": _hypot,
        "fabs": lambda b, f, x: (b.operation("sign", x),),
        "sign": _no_slope,
        "floor": _no_slope,
        "ceil": _no_slope,
        "fmod": _modulo,
        "remainder": _modulo,
        "copysign": _copysign,
        "fmin": _extreme("fmin"),
        "fmax": _extreme("fmax"),
        **dict.fromkeys(("lt", "le", "eq", "ne", "not", "and", "or"), _no_slope),
    }
)
"""Slopes by every argument: (builder, the node itself, *arguments) -> nodes. ``if_else_zero`` has its own way."""
assert set(_SLOPES) | {"if_else_zero"} == set(OPERATIONS), "every operation has a derivative"
