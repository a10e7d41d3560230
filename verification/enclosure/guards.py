"""Guards: a branch counts where its condition holds only, so it is enclosed on what is left of a box there.

`if_else(x > 0, sqrt(x), 0)` on [-1, 2] needs the root on [0, 2]. Where a condition is decided nothing is done.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from verification.enclosure import outward_logic
from verification.enclosure.contraction import Held, Parts, cases, contract, gathered, narrows, undecided
from verification.enclosure.outward import Array, Mask, Span
from verification.enclosure.rewriting import MEET, SELECT, Rewritten

GUARDS = ("if_else_zero", SELECT)
DEPTH = 3
"""How many guards within one another narrow their branches."""
EFFORT = 24
"""How many nodes may be evaluated for branches, times the nodes that are evaluated anyway."""
_SPREAD = 8  # parts of a box, in the mean, beyond which no further condition is taken into account


class Value(NamedTuple):
    """A node on every box: its span, and the node at which evaluation failed (-1: nowhere, None: nowhere at all)."""

    span: Span
    fault: NDArray[np.int64] | None


Evaluate = Callable[..., dict[int, Value]]  # of a graph, ends of boxes, targets, what is held, and what may be spent
Condition = tuple[int, bool]
"""A node, and whether it holds."""


class Work:
    """What may still be spent on branches: a number of nodes, and a depth."""

    def __init__(self, nodes: int, depth: int = DEPTH) -> None:
        self.left, self.depth = nodes, depth

    def within(self) -> Work:
        """Return the work that is left inside of a branch, and take it away."""
        inner = Work(self.left, self.depth - 1)
        self.left = 0
        return inner

    def back(self, inner: Work) -> None:
        """Take back what a branch has left."""
        self.left = inner.left


def restricted(
    graph: Rewritten,
    lower: Array,
    upper: Array,
    conditions: Iterable[Condition],
    evaluate: Evaluate,
    held: Held | None = None,
    wanted: frozenset[int] = frozenset(),
) -> Parts:
    """Return what is left of boxes where conditions hold; of the quantities that are wanted, narrower ends are kept."""
    parts = Parts(lower, upper, held or {}, np.arange(lower.shape[1]))
    for condition, holds in conditions:
        count = parts.lower.shape[1]
        if not count:
            break
        alternatives = cases(graph, condition, holds)
        literals = tuple({one.node for case in alternatives for one in case})
        values = evaluate(graph, parts.lower, parts.upper, (condition, *literals), parts.held)
        known = outward_logic.truth(values[condition].span)
        fault = values[condition].fault
        possible = np.broadcast_to((known.hi == 1) if holds else (known.lo == 0), count)
        if fault is not None:
            possible = possible | (fault >= 0)
        if len(alternatives) * count > _SPREAD * max(lower.shape[1], 1):
            alternatives = ((),)
        spans = {k: value.span for k, value in values.items()}
        found = [contract(graph, spans, case, count, wanted) for case in alternatives]
        found = [(ends, alive & possible) for ends, alive in found]
        fresh = gathered(graph, parts.lower, parts.upper, parts.held, found, wanted)
        parts = fresh._replace(owner=parts.owner[fresh.owner])
    return parts


class Branches:
    """Branches that were enclosed under their conditions, for the boxes of one evaluation."""

    def __init__(self, graph: Rewritten, lower: Array, upper: Array, held: Held, evaluate: Evaluate) -> None:
        self.graph, self.lower, self.upper, self.held, self.evaluate = graph, lower, upper, held, evaluate
        self._known: dict[tuple[object, ...], tuple[Value, Mask]] = {}

    def arguments(self, k: int, values: Mapping[int, Value], work: Work) -> list[Value]:
        """Return the arguments of a guard: its branches as they are where the condition lets them count."""
        args = self.graph.nodes[k].args
        found = [values[arg] for arg in args]
        count = self.lower.shape[1]
        condition = found[0]
        open_ = np.broadcast_to(undecided(condition.span), count)
        if condition.fault is not None:
            open_ = open_ & (condition.fault < 0)
        columns = np.flatnonzero(open_)
        if not columns.size or work.depth <= 0:
            return found
        truth = outward_logic.truth(condition.span)
        surely, possibly = (np.array(np.broadcast_to(end, count)) for end in truth)
        for place, holds in ((1, True), (2, False))[: len(args) - 1]:
            answer = self._branch(args[0], holds, args[place], columns, work)
            if answer is None:
                continue
            value, met = answer
            found[place] = _replaced(found[place], value, columns, count)
            if holds:
                possibly[columns] = np.where(met, possibly[columns], 0.0)
            else:
                surely[columns] = np.where(met, surely[columns], 1.0)
        found[0] = Value(Span(np.minimum(surely, possibly), possibly), condition.fault)
        return found

    def _branch(
        self, condition: int, holds: bool, branch: int, columns: NDArray[np.int64], work: Work
    ) -> tuple[Value, Mask] | None:
        """Enclose a branch where its condition holds, and say on which boxes that may be; None if nothing is gained."""
        graph = self.graph
        key = (*_named(graph, condition, holds), branch)
        if key in self._known:
            return self._known[key]
        needed = graph.ancestors((branch,))
        if work.left < len(needed) or not narrows(graph, cases(graph, condition, holds), branch):
            return None
        work.left -= len(needed)
        own = {k: Span(*(np.broadcast_to(end, self.lower.shape[1])[columns] for end in span))
               for k, span in self.held.items()}  # fmt: skip
        low, high = self.lower[:, columns], self.upper[:, columns]
        parts = restricted(graph, low, high, [(condition, holds)], self.evaluate, own, frozenset(needed))
        inner = work.within()
        found = self.evaluate(graph, parts.lower, parts.upper, (branch,), parts.held, inner)[branch]
        work.back(inner)
        self._known[key] = collected(found, parts, columns.size)
        return self._known[key]


def collected(value: Value, parts: Parts, count: int) -> tuple[Value, Mask]:
    """Return what holds a quantity on all parts of each box, and which boxes have a part."""
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    fault = np.full(count, -1, dtype=np.int64)
    met = np.zeros(count, dtype=bool)
    met[parts.owner] = True
    width = parts.owner.size
    np.minimum.at(low, parts.owner, np.broadcast_to(value.span.lo, width))
    np.maximum.at(high, parts.owner, np.broadcast_to(value.span.hi, width))
    if value.fault is not None:
        np.maximum.at(fault, parts.owner, np.broadcast_to(value.fault, width))
    return Value(Span(np.where(met, low, 0.0), np.where(met, high, 0.0)), fault if (fault >= 0).any() else None), met


def _replaced(plain: Value, value: Value, columns: NDArray[np.int64], count: int) -> Value:
    """Return a branch as it is under its condition on some boxes."""
    low, high = (np.array(np.broadcast_to(end, count)) for end in plain.span)
    low[columns], high[columns] = value.span
    if plain.fault is None and value.fault is None:
        return Value(Span(low, high), None)
    fault = np.array(np.broadcast_to(-1 if plain.fault is None else plain.fault, count))
    fault[columns] = -1 if value.fault is None else value.fault
    return Value(Span(low, high), fault)


def _named(graph: Rewritten, condition: int, holds: bool) -> tuple[object, ...]:
    """Return what conditions share that are one: a negation with what it negates, x <= y with not y < x."""
    op, args = graph.nodes[condition].op, graph.nodes[condition].args
    if op == "not":
        return _named(graph, args[0], not holds)
    return ("lt", args[::-1], not holds) if op == "le" else (op, args, holds, condition if not args else -1)


def conditions_of(graph: Rewritten, targets: Iterable[int]) -> dict[int, frozenset[Condition]]:
    """Return under which conditions every node counts: those that stand before it on every way to a target."""
    found: dict[int, frozenset[Condition]] = {}
    wanted = tuple(targets)
    for k in wanted:
        found[k] = frozenset()
    for k in reversed(graph.ancestors(wanted, rewritten=False)):
        node = graph.nodes[k]
        for place, arg in enumerate(node.args if node.op != MEET else node.args[1:]):
            own = found[k]
            if node.op in GUARDS and place:
                own = own | {(node.args[0], place == 1)}
            found[arg] = found[arg] & own if arg in found else own
    return found
