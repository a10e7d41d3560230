"""Between which values an expression stays wherever it exists: one sweep of intervals, whatever its inputs are."""

from __future__ import annotations

import casadi as ca
import numpy as np

from verification.enclosure import outward, outward_logic
from verification.enclosure.interval import PARTIAL, TOTAL
from verification.enclosure.outward import Span
from workbench.graph import Graph, read
from workbench.graph.operations import CONSTANT, INPUT


def values_of(function: ca.Function) -> tuple[float, float]:
    """Return ends between which every entry of a Function's only output lies wherever it exists, rounded outwards.

    The inputs may be any numbers at all. What may not exist (a quotient whose divisor may be zero) may be any number,
    since wherever the whole exists it is one. Infinite ends where nothing is known.
    """
    graph = read(function)
    spans: list[Span] = []
    with np.errstate(all="ignore"):
        for place in range(len(graph.nodes)):
            span = _span(graph, place, spans)
            unknown = np.isnan(span.lo) | np.isnan(span.hi)
            spans.append(Span(np.where(unknown, -np.inf, span.lo), np.where(unknown, np.inf, span.hi)))
    (result,) = graph.outputs
    found = [spans[entry.node] for entry in result.entries]
    if len(found) < result.shape[0] * result.shape[1]:  # an entry without a node is zero
        found.append(outward.point(0.0))
    return min(float(one.lo[0]) for one in found), max(float(one.hi[0]) for one in found)


def _span(graph: Graph, place: int, spans: list[Span]) -> Span:
    node = graph.nodes[place]
    arguments = [spans[arg] for arg in node.args]
    whole = outward.full(np.zeros(1))
    if node.op == CONSTANT:
        return outward.point(node.value) if np.isfinite(node.value) else whole
    if node.op == "assign":
        return arguments[0]
    if node.op == "add" and (choice := _choice(graph, *node.args)) is not None:
        condition, if_it_holds, if_not = (spans[arg] for arg in choice)
        return outward_logic.select(condition, if_it_holds, if_not)
    if node.op in TOTAL:
        return TOTAL[node.op](*arguments)
    if node.op == INPUT or node.op not in PARTIAL:
        return whole
    span, bad = PARTIAL[node.op][0](*arguments)
    return Span(np.where(bad, whole.lo, span.lo), np.where(bad, whole.hi, span.hi))


def _choice(graph: Graph, first: int, second: int) -> tuple[int, int, int] | None:
    """Return condition and both values of a sum of which one summand is gated by a condition, one by its opposite."""
    for one, other in ((first, second), (second, first)):
        a, b = graph.nodes[one], graph.nodes[other]
        if a.op == b.op == "if_else_zero":
            opposite = graph.nodes[b.args[0]]
            if opposite.op == "not" and _same(graph, opposite.args[0], a.args[0]):
                return a.args[0], a.args[1], b.args[1]
    return None


def _same(graph: Graph, one: int, other: int) -> bool:
    """Tell whether two nodes are one operation on the same nodes."""
    return one == other or (graph.nodes[one] == graph.nodes[other] and graph.nodes[one].op != INPUT)
