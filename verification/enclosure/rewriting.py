"""The instructions of a CasADi Function as a graph in which every node is one real quantity.

CasADi reuses work slots; here each distinct quantity gets one node, and equal quantities share it. That makes
correlations visible which interval arithmetic would otherwise lose:

* ``x * x`` is a square, ``x * x**2`` a cube, ``x - x`` zero;
* CasADi writes ``if_else(c, a, b)`` as ``(c ? a : 0) + (!c ? b : 0)`` and differentiates ``fmax(a, b)`` to
  ``(b <= a) / ((b <= a) + (a <= b))``. Sums of terms under complementary conditions become a `SELECT` node, and
  the sum of two comparisons of which one always holds becomes a `COVER` node.

Every rewriting is an identity of real numbers.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

SELECT = -1  # arguments: condition, value if it holds, value if not
COVER = -2  # arguments: two comparisons of which at least one holds; their sum
MEET = -3  # arguments: a rewritten quantity, the same as it stands in the Function

NAMES = {getattr(ca, name): name[3:].lower() for name in dir(ca) if name.startswith("OP_")}
COMPARISONS = frozenset({ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE})
BOOLEAN = COMPARISONS | {ca.OP_NOT, ca.OP_AND, ca.OP_OR}
_DEEP = 5  # how far down a term its condition is looked for


class Node(NamedTuple):
    """One quantity: an operation on earlier nodes, a constant, or a coordinate of the box."""

    op: int
    args: tuple[int, ...] = ()
    value: float = 0.0
    coordinate: int = -1
    instruction: int = -1


class Entry(NamedTuple):
    """One structural nonzero of an output."""

    row: int
    column: int
    node: int


@dataclass(frozen=True, kw_only=True)
class Graph:
    """Nodes in an order in which arguments come first.

    Parameters
    ----------
    nodes
        The quantities.
    outputs
        Structural nonzeros of every output, by name.
    shapes
        Shape of every output, by name.
    expressions
        The symbolic expression of every instruction of the Function.
    """

    nodes: tuple[Node, ...]
    outputs: dict[str, tuple[Entry, ...]]
    shapes: dict[str, tuple[int, int]]
    expressions: tuple[ca.SX, ...]

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

    def with_constant(self, value: float) -> tuple["Graph", int]:
        """Return the graph with one more node, a constant, and the place of that node."""
        node = Node(ca.OP_CONST, value=value)
        return replace(self, nodes=(*self.nodes, node)), len(self.nodes)

    def describe(self, node: int, limit: int = 80) -> str:
        """Return the expression of a node as text, cut to a length."""
        index = self.nodes[node].instruction
        text = str(self.expressions[index]) if index >= 0 else "a combined term"
        return text if len(text) <= limit else text[: limit - 3] + "..."


def expanded(function: ca.Function) -> ca.Function | str:
    """Return the Function as scalar instructions, or a sentence saying why it has none."""
    if function.is_a("SXFunction"):
        return function
    try:
        return function.expand()
    except (RuntimeError, NotImplementedError) as error:
        lines = [line for line in str(error).splitlines() if line.strip()]
        return f"{function.name()} has no form of scalar instructions: {lines[-1].strip() if lines else error}"


def graph_of(function: ca.Function) -> Graph | str:
    """Return the graph of a Function, or a sentence saying why it has none."""
    scalar = expanded(function)
    return scalar if isinstance(scalar, str) else _Builder().build(scalar)


class _Builder:
    """Grows the list of nodes; a key that is already known returns the node it stands for."""

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self.known: dict[tuple[object, ...], int] = {}
        self.instruction = -1

    def build(self, function: ca.Function) -> Graph:
        """Walk the instructions once."""
        offsets = np.cumsum([0, *(function.nnz_in(i) for i in range(function.n_in()))]).tolist()
        results: list[dict[int, int]] = [{} for _ in range(function.n_out())]
        slots: dict[int, int] = {}
        for index in range(function.n_instructions()):
            self.instruction, op = index, function.instruction_id(index)
            out = function.instruction_output(index)
            if op == ca.OP_OUTPUT:
                results[out[0]][out[1]] = slots[function.instruction_input(index)[0]]
            elif op == ca.OP_INPUT:
                which, nonzero = function.instruction_input(index)
                slots[out[0]] = self.node(op, coordinate=offsets[which] + nonzero)
            elif op == ca.OP_CONST:
                slots[out[0]] = self.constant(function.instruction_constant(index))
            elif len(out) != 1:
                for slot in out:
                    slots[slot] = self.node(op, value=float(index * 1000 + slot))
            else:
                slots[out[0]] = self.operate(op, tuple(slots[k] for k in function.instruction_input(index)))
        names = function.name_out()
        triplets = [list(zip(*function.sparsity_out(i).get_triplet(), strict=True)) for i in range(len(names))]
        return Graph(
            nodes=tuple(self.nodes),
            outputs={
                name: tuple(Entry(row, column, results[i][k]) for k, (row, column) in enumerate(triplets[i]))
                for i, name in enumerate(names)
            },
            shapes={name: function.size_out(i) for i, name in enumerate(names)},
            expressions=tuple(function.instructions_sx().nz[k] for k in range(function.n_instructions())),
        )

    def node(self, op: int, args: tuple[int, ...] = (), value: float = 0.0, coordinate: int = -1) -> int:
        """Return the node of an operation, made now if it is new."""
        key = (op, args, float(value).hex(), coordinate)
        if key not in self.known:
            self.known[key] = len(self.nodes)
            self.nodes.append(Node(op, args, value, coordinate, self.instruction))
        return self.known[key]

    def constant(self, value: float) -> int:
        """Return the node of a constant."""
        return self.node(ca.OP_CONST, value=float(value))

    def operate(self, op: int, args: tuple[int, ...]) -> int:
        """Return the node of an operation, in the form that keeps most of its correlations."""
        if op in (ca.OP_ASSIGN, ca.OP_LIFT):
            return args[0]
        if op in (ca.OP_MUL, ca.OP_SQ):
            return self.product(args[0], args[-1])
        if op == ca.OP_CONSTPOW:
            op = ca.OP_POW
        if op == ca.OP_ADD:
            return self.sum(*args)
        if op == ca.OP_SUB and args[0] != args[1] and self.guard(args[1]) is not None:
            return self.sum(args[0], self.node(ca.OP_NEG, (args[1],)))
        return self.node(op, args)

    def product(self, a: int, b: int) -> int:
        """Return the node of a product, which is a power where both factors are powers of one quantity."""
        (base, m), (other, n) = self.power(a), self.power(b)
        if base != other:
            return self.node(ca.OP_MUL, (min(a, b), max(a, b)))
        return self.node(ca.OP_SQ, (base,)) if m + n == 2 else self.node(ca.OP_POW, (base, self.constant(m + n)))

    def power(self, k: int) -> tuple[int, int]:
        """Return a node as base and positive integer exponent."""
        node = self.nodes[k]
        if node.op == ca.OP_SQ:
            return node.args[0], 2
        if node.op == ca.OP_POW:
            exponent = self.nodes[node.args[1]]
            if exponent.op == ca.OP_CONST and exponent.value.is_integer() and exponent.value > 0:
                return node.args[0], int(exponent.value)
        return k, 1

    def sum(self, p: int, q: int) -> int:
        """Return the node of a sum, merging terms under complementary conditions."""
        if p == q:
            return self.node(ca.OP_TWICE, (p,))
        for first, second in ((p, q), (q, p)):
            merged = self.merge(first, second)
            if merged is not None:
                return merged
            inner = self.nodes[first]
            if inner.op == ca.OP_ADD:
                for kept, term in (inner.args, inner.args[::-1]):
                    merged = self.merge(term, second)
                    if merged is not None:
                        return self.sum(kept, merged)
        return self.node(ca.OP_ADD, (min(p, q), max(p, q)))

    def merge(self, p: int, q: int) -> int | None:
        """Return one node for two terms of which exactly one counts, if that is what they are."""
        if self.covers(p, q):
            return self.node(COVER, (p, q))
        first = self.guard(p)
        second = self.guard(q) if first else None
        if first is None or second is None or not self.opposite(first[0], second[0]):
            return None
        plain = self.node(ca.OP_ADD, (min(p, q), max(p, q)))
        return self.node(MEET, (self.node(SELECT, (first[0], first[1], second[1])), plain))

    def guard(self, k: int, depth: int = _DEEP) -> tuple[int, int] | None:
        """Return ``(condition, value)`` if the node is the value under the condition and zero otherwise."""
        node = self.nodes[k]
        if node.op in BOOLEAN:
            return k, self.constant(1.0)
        if node.op == ca.OP_IF_ELSE_ZERO:
            return node.args[0], node.args[1]
        if depth == 0 or node.op not in (ca.OP_NEG, ca.OP_TWICE, ca.OP_MUL, ca.OP_DIV, SELECT, MEET):
            return None
        if node.op == MEET:
            return self.guard(node.args[0], depth - 1)
        if node.op == SELECT:
            yes, no = self.guard(node.args[1], depth - 1), self.guard(node.args[2], depth - 1)
            if yes is None or no is None or yes[0] != no[0]:
                return None
            return yes[0], self.node(SELECT, (node.args[0], yes[1], no[1]))
        for place in range(2 if node.op == ca.OP_MUL else 1):
            found = self.guard(node.args[place], depth - 1)
            if found is not None:
                condition, value = found
                if node.op == ca.OP_MUL:
                    other = node.args[1 - place]
                    return condition, other if self.is_one(value) else self.product(value, other)
                return condition, self.node(node.op, (value, *node.args[1:]))
        return None

    def is_one(self, k: int) -> bool:
        """Say whether a node is the constant one."""
        return self.nodes[k].op == ca.OP_CONST and self.nodes[k].value == 1.0

    def opposite(self, c: int, d: int) -> bool:
        """Say whether exactly one of two conditions holds at every point."""
        first, second = self.nodes[c], self.nodes[d]
        if (second.op == ca.OP_NOT and second.args[0] == c) or (first.op == ca.OP_NOT and first.args[0] == d):
            return True
        pair = {first.op, second.op}
        if pair == {ca.OP_LT, ca.OP_LE}:
            return first.args == second.args[::-1]
        return pair == {ca.OP_EQ, ca.OP_NE} and set(first.args) == set(second.args)

    def covers(self, c: int, d: int) -> bool:
        """Say whether two comparisons are ``a <= b`` and ``b <= a``."""
        first, second = self.nodes[c], self.nodes[d]
        return first.op == second.op == ca.OP_LE and first.args == second.args[::-1]
