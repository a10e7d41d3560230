"""A graph in which every node is one real quantity: what is equal shares a node.

That makes correlations visible which interval arithmetic would otherwise lose:

* ``x * x`` is a square, ``x * x**2`` a cube, ``x - x`` zero;
* CasADi writes ``if_else(c, a, b)`` as ``(c ? a : 0) + (!c ? b : 0)`` and differentiates ``fmax(a, b)`` to
  ``(b <= a) / ((b <= a) + (a <= b))``. Sums of terms under complementary conditions become a `SELECT` node, and
  the sum of two comparisons of which one always holds becomes a `COVER` node;
* ``sin(x) / x`` is a mean of the slopes of the sine between zero and x, as are other operations that are zero at zero.

Every rewriting is an identity of real numbers, not of doubles.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from workbench.graph import Entry, Graph, Lookup, Table, Unreadable, read
from workbench.graph.operations import BOOLEAN, CONSTANT, INPUT, LOOKUP

SELECT = "select"  # arguments: condition, value if it holds, value if not
COVER = "cover"  # arguments: two comparisons of which at least one holds; their sum
MEET = "meet"  # arguments: a rewritten quantity, the same as it stands in the graph
CHORD = "mean slope of "
CHORDS = ("sin", "tan", "asin", "atan", "sinh", "tanh", "asinh", "atanh", "erf", "erfinv", "expm1", "log1p")
"""Operations that are zero at zero: divided by its argument one is its mean slope from zero to there."""
_DEEP = 5  # how far down a term its condition is looked for


class Quantity(NamedTuple):
    """One quantity: an operation on earlier ones, a constant, or a coordinate of the box."""

    op: str
    args: tuple[int, ...] = ()
    value: float = 0.0
    """The number of a constant; which of the graph's lookups a lookup is."""
    coordinate: int = -1
    origin: int = -1
    """The node of the graph that it was first met at; -1 where only a rewriting brought it in."""


@dataclass(frozen=True, kw_only=True)
class Rewritten:
    """Quantities in an order in which arguments come first.

    Parameters
    ----------
    nodes
        The quantities.
    outputs
        Structural nonzeros of every output, by name.
    shapes
        Shape of every output, by name.
    graph
        The graph as it was read.
    """

    nodes: tuple[Quantity, ...]
    outputs: dict[str, tuple[Entry, ...]]
    shapes: dict[str, tuple[int, int]]
    graph: Graph

    def targets(self) -> tuple[int, ...]:
        """Return the nodes of all outputs."""
        return tuple(entry.node for entries in self.outputs.values() for entry in entries)

    def coordinates(self, targets: tuple[int, ...], count: int) -> NDArray[np.bool_]:
        """Say of each of so many coordinates whether the targets depend on it."""
        return np.isin(np.arange(count), [self.nodes[k].coordinate for k in self.ancestors(targets)])

    def ancestors(self, targets: tuple[int, ...], rewritten: bool = True) -> tuple[int, ...]:
        """Return the targets and everything they depend on, in order, on demand without rewritten quantities."""
        needed, stack = set(targets), list(targets)
        while stack:
            node = self.nodes[stack.pop()]
            args = node.args if rewritten or node.op != MEET else node.args[1:]
            fresh = [k for k in args if k not in needed]
            needed.update(fresh)
            stack.extend(fresh)
        return tuple(sorted(needed))

    def lookup_of(self, k: int) -> Lookup:
        """Return what a lookup reads."""
        return self.graph.lookups[int(self.nodes[k].value)]

    def table_of(self, k: int) -> Table:
        """Return the table that a lookup reads."""
        return self.graph.tables[self.lookup_of(k).table]

    def with_constant(self, value: float) -> tuple[Rewritten, int]:
        """Return the graph with one more node, a constant, and the place of that node."""
        return replace(self, nodes=(*self.nodes, Quantity(CONSTANT, value=value))), len(self.nodes)

    def describe(self, node: int, limit: int = 80) -> str:
        """Return the expression of a node as text, cut to a length."""
        origin = self.nodes[node].origin
        return self.graph.describe(origin, limit) if origin >= 0 else "a combined term"


def rewritten(function: ca.Function | Graph) -> Rewritten | str:
    """Return a Function in quantities, or a sentence saying why it has no graph."""
    if isinstance(function, Graph):
        return Rewriter().rewrite(function)
    try:
        return Rewriter().rewrite(read(function))
    except Unreadable as error:
        return str(error)


class Rewriter:
    """Grows the list of nodes; a key that is already known returns the node it stands for."""

    def __init__(self) -> None:
        self.nodes: list[Quantity] = []
        self.known: dict[tuple[object, ...], int] = {}
        self.origin = -1

    def rewrite(self, graph: Graph) -> Rewritten:
        """Walk the graph's nodes once."""
        places: list[int] = []
        for self.origin, node in enumerate(graph.nodes):
            if node.op == INPUT:
                places.append(self.node(node.op, coordinate=node.which))
            elif node.op == CONSTANT:
                places.append(self.constant(node.value))
            elif node.op == LOOKUP:
                places.append(self.node(node.op, tuple(places[arg] for arg in node.args), value=float(node.which)))
            else:
                places.append(self.operate(node.op, tuple(places[arg] for arg in node.args)))
        return Rewritten(
            nodes=tuple(self.nodes),
            outputs={
                result.name: tuple(entry._replace(node=places[entry.node]) for entry in result.entries)
                for result in graph.outputs
            },
            shapes={result.name: result.shape for result in graph.outputs},
            graph=graph,
        )

    def node(self, op: str, args: tuple[int, ...] = (), value: float = 0.0, coordinate: int = -1) -> int:
        """Return the node of a quantity, made now if it is new."""
        key = (op, args, float(value).hex(), coordinate)
        if key not in self.known:
            self.known[key] = len(self.nodes)
            self.nodes.append(Quantity(op, args, value, coordinate, self.origin))
        return self.known[key]

    def constant(self, value: float) -> int:
        """Return the node of a constant."""
        return self.node(CONSTANT, value=float(value))

    def operate(self, op: str, args: tuple[int, ...]) -> int:
        """Return the node of an operation, in the form that keeps most of its correlations."""
        if op == "assign":
            return args[0]
        if op in ("mul", "sq"):
            return self.product(args[0], args[-1])
        if op == "constpow":
            op = "pow"
        if op == "add":
            return self.sum(*args)
        if op == "div":
            return self.quotient(*args)
        if op == "sub" and args[0] != args[1] and self.guard(args[1]) is not None:
            return self.sum(args[0], self.node("neg", (args[1],)))
        return self.node(op, args)

    def quotient(self, a: int, b: int) -> int:
        """Return the node of a quotient, next to the mean slope that it is: of sin(b) / b, or of sin(c b) / b."""
        plain, top = self.node("div", (a, b)), self.nodes[a]
        if top.op not in CHORDS:
            return plain
        inner = top.args[0]
        chord = self.node(CHORD + top.op, (inner,))
        if inner == b:
            return self.node(MEET, (chord, plain))
        factor = self.nodes[inner]
        if factor.op == "mul" and b in factor.args:
            other = factor.args[1 - factor.args.index(b)]
            if self.nodes[other].op == CONSTANT:
                return self.node(MEET, (self.node("mul", (min(other, chord), max(other, chord))), plain))
        return plain

    def product(self, a: int, b: int) -> int:
        """Return the node of a product, which is a power where both factors are powers of one quantity."""
        (base, m), (other, n) = self.power(a), self.power(b)
        if base != other:
            return self.node("mul", (min(a, b), max(a, b)))
        return self.node("sq", (base,)) if m + n == 2 else self.node("pow", (base, self.constant(m + n)))

    def power(self, k: int) -> tuple[int, int]:
        """Return a node as base and positive integer exponent."""
        node = self.nodes[k]
        if node.op == "sq":
            return node.args[0], 2
        if node.op == "pow":
            exponent = self.nodes[node.args[1]]
            if exponent.op == CONSTANT and exponent.value.is_integer() and exponent.value > 0:
                return node.args[0], int(exponent.value)
        return k, 1

    def sum(self, p: int, q: int) -> int:
        """Return the node of a sum, merging terms under complementary conditions."""
        if p == q:
            return self.node("twice", (p,))
        for first, second in ((p, q), (q, p)):
            merged = self.merge(first, second)
            if merged is not None:
                return merged
            inner = self.nodes[first]
            if inner.op == "add":
                for kept, term in (inner.args, inner.args[::-1]):
                    merged = self.merge(term, second)
                    if merged is not None:
                        return self.sum(kept, merged)
        return self.node("add", (min(p, q), max(p, q)))

    def merge(self, p: int, q: int) -> int | None:
        """Return one node for two terms of which exactly one counts, if that is what they are."""
        if self.covers(p, q):
            return self.node(COVER, (p, q))
        first = self.guard(p)
        second = self.guard(q) if first else None
        if first is None or second is None or not self.opposite(first[0], second[0]):
            return None
        plain = self.node("add", (min(p, q), max(p, q)))
        return self.node(MEET, (self.node(SELECT, (first[0], first[1], second[1])), plain))

    def guard(self, k: int, depth: int = _DEEP) -> tuple[int, int] | None:
        """Return ``(condition, value)`` if the node is the value under the condition and zero otherwise."""
        node = self.nodes[k]
        if node.op in BOOLEAN:
            return k, self.constant(1.0)
        if node.op == "if_else_zero":
            return node.args[0], node.args[1]
        if depth == 0 or node.op not in ("neg", "twice", "mul", "div", SELECT, MEET):
            return None
        if node.op == MEET:
            return self.guard(node.args[0], depth - 1)
        if node.op == SELECT:
            yes, no = self.guard(node.args[1], depth - 1), self.guard(node.args[2], depth - 1)
            if yes is None or no is None or yes[0] != no[0]:
                return None
            return yes[0], self.node(SELECT, (node.args[0], yes[1], no[1]))
        for place in range(2 if node.op == "mul" else 1):
            found = self.guard(node.args[place], depth - 1)
            if found is not None:
                condition, value = found
                if node.op == "mul":
                    other = node.args[1 - place]
                    return condition, other if self.is_one(value) else self.product(value, other)
                return condition, self.node(node.op, (value, *node.args[1:]))
        return None

    def is_one(self, k: int) -> bool:
        """Say whether a node is the constant one."""
        return self.nodes[k].op == CONSTANT and self.nodes[k].value == 1.0

    def opposite(self, c: int, d: int) -> bool:
        """Say whether exactly one of two conditions holds at every point."""
        first, second = self.nodes[c], self.nodes[d]
        if (second.op == "not" and second.args[0] == c) or (first.op == "not" and first.args[0] == d):
            return True
        pair = {first.op, second.op}
        if pair == {"lt", "le"}:
            return first.args == second.args[::-1]
        return pair == {"eq", "ne"} and set(first.args) == set(second.args)

    def covers(self, c: int, d: int) -> bool:
        """Say whether two comparisons are ``a <= b`` and ``b <= a``."""
        first, second = self.nodes[c], self.nodes[d]
        return first.op == second.op == "le" and first.args == second.args[::-1]
