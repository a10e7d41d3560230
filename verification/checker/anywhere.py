"""Ranges of what a graph gives whatever its coordinates are: one sweep of intervals whose ends may be infinite."""

from __future__ import annotations

import math
from collections.abc import Iterable

from flint import fmpq

from verification.checker.graph import Graph
from verification.checker.interval import INF, RULES, STEPS, Known, Span, hull, magnitude
from verification.checker.reading import exact, need, number, record, text

WHOLE = (-INF, INF)
VALUES: dict[str, Span] = {
    **dict.fromkeys(STEPS - {"sign", "floor", "ceil"}, (0.0, 1.0)), **dict.fromkeys(("exp", "sq", "sqrt"), (0.0, INF)),
    **dict.fromkeys(("sign", "sin", "cos", "tanh", "erf"), (-1.0, 1.0)), "cosh": (1.0, INF), "expm1": (-1.0, INF)
}  # fmt: skip
"""Where an operation's value lies if nothing is known of its arguments."""


def ranges(graph: Graph, nodes: Iterable[int]) -> dict[int, Span]:
    """Return ends between which nodes lie wherever they exist, with those of all that they are made of."""
    found: dict[int, Span] = {}
    for k in graph.ancestors(nodes):
        op, *args = graph.nodes[k]
        if op == "const":
            found[k] = (args[0], args[0])
        elif op in ("sel", "gate"):
            found[k] = hull(*(found[one] for one in args[1:]), *([(0.0, 0.0)] if op == "gate" else [])) or WHOLE
        else:
            found[k] = _of(op, [found[one] for one in args] if op != "input" else []) or VALUES.get(op, WHOLE)
    return found


def _of(op: str, spans: list[Span]) -> Known:
    if op in RULES and all(math.isfinite(end) for span in spans for end in span):
        return RULES[op](*spans)
    if op == "fabs":
        return magnitude(spans[0])
    if op == "sub":
        spans = [spans[0], (-spans[1][1], -spans[1][0])]
    if op in ("add", "sub"):
        return math.nextafter(spans[0][0] + spans[1][0], -INF), math.nextafter(spans[0][1] + spans[1][1], INF)
    if op == "div" and spans[1][0] > 0 and all(math.isfinite(end) for end in spans[0]):
        four = [a / b for a in spans[0] for b in spans[1]]
        return math.nextafter(min(four), -INF), math.nextafter(max(four), INF)
    return None


def check(statement: object, graph: Graph) -> tuple[str, dict[str, fmpq]]:
    """Check that every entry of an output lies between two ends wherever it exists; return these too."""
    says, of, low, high = record(statement, "says", "of", "low", "high")
    nodes = [node for (name, _, _), node in graph.outputs.items() if name == of]
    need(nodes, f"the graph must have what is spoken of, got {of!r:.40}")
    found, ends = ranges(graph, nodes), (number(low), number(high))
    need(all(ends[0] <= found[k][0] and found[k][1] <= ends[1] for k in nodes), f"{of} must lie between its ends")
    said = f"whatever the coordinates, each of {len(nodes)} entries of {of} lies in {list(ends)} where it exists"
    return f"{text(says)} ({said}.)", {"low": exact(low), "high": exact(high)}
