"""How far a Function's value in doubles may lie from its value in real numbers, for all arguments in a box.

Every operation adds what it rounds and passes on what its arguments were off, by its slopes. Slopes are taken on the
box as it stands and results are doubled, since arguments that are off may leave the box by as little.
"""

from __future__ import annotations

import numpy as np

from models.array import Array
from verification.enclosure import outward
from verification.enclosure.box import Box
from verification.enclosure.face import Enclosed
from verification.enclosure.interval import TOTAL, evaluate
from verification.enclosure.outward import Span
from verification.enclosure.outward_logic import truth
from verification.enclosure.rewriting import COVER, MEET, SELECT, rewritten
from verification.enclosure.slopes import partials
from workbench.graph.operations import BOOLEAN, CONSTANT, INPUT, LOOKUP

_EXACT = frozenset({"neg", "twice", "fabs", "fmin", "fmax", "sign", "floor", "ceil", "fmod",
                    "if_else_zero", "copysign", "assign", SELECT, COVER, MEET, *BOOLEAN})  # fmt: skip
_HALF_A_PLACE = frozenset({"add", "sub", "mul", "div", "inv", "sq", "sqrt"})
_BREAKING = frozenset({*BOOLEAN, "floor", "ceil", "sign", "fmod", "remainder"})
HALF, LIBRARY = 2.0**-53, 2.0**-50
"""What arithmetic, and what a mathematical library, rounds at most, of the result."""
SPARE = 2.0
"""Factor for the second order, and for instructions that were put together."""


def rounding(function: Enclosed, box: Box) -> dict[str, Array]:
    """Return by how much each output may be off, shaped like it; infinite where that is not known, as at a jump."""
    graph = rewritten(function)
    if isinstance(graph, str):
        raise ValueError(f"expected a Function that has a graph, got one without: {graph}")
    lower, upper = box.coordinates(function)
    values = evaluate(graph, lower[:, None], upper[:, None], graph.targets())
    off: dict[int, float] = {}
    for k in graph.ancestors(graph.targets()):
        node, span = graph.nodes[k], values[k].span
        size = float(np.max(np.abs([span.lo, span.hi])))
        if node.op in (INPUT, CONSTANT):
            off[k] = 0.0
            continue
        arguments = [values[arg].span for arg in node.args]
        passed = 0.0
        for arg, slope in zip(node.args, _slopes(node.op, span, arguments), strict=True):
            if slope is None:  # a branch that does not count
                continue
            steep = float(np.max(np.abs([slope.lo, slope.hi])))
            if off[arg]:
                passed += steep * off[arg] if np.isfinite(off[arg]) else np.inf
        own = 0.0 if node.op in _EXACT else (HALF if node.op in _HALF_A_PLACE else LIBRARY) * size
        loose = any(off[arg] for arg in node.args)
        broken = node.op in _BREAKING and loose and not _decided(node.op, arguments, [off[a] for a in node.args])
        off[k] = np.inf if broken or node.op == LOOKUP else passed + own  # of a table's own rounding nothing is known
    found: dict[str, Array] = {}
    for name, entries in graph.outputs.items():
        found[name] = np.zeros(graph.shapes[name])
        for entry in entries:
            found[name][entry.row, entry.column] = SPARE * off[entry.node]
    return found


def _decided(op: str, arguments: list[Span], off: list[float]) -> bool:
    """Say whether an operation that jumps has one value though its arguments are off."""
    if op not in TOTAL:
        return False
    wide = [Span(outward.down(a.lo - SPARE * one), outward.up(a.hi + SPARE * one))
            for a, one in zip(arguments, off, strict=True)]  # fmt: skip
    found = TOTAL[op](*wide)
    return bool(np.all(found.lo == found.hi))


def _slopes(op: str, value: Span, arguments: list[Span]) -> tuple[Span | None, ...]:
    """Return the slopes by the arguments; a choice passes on what those of its branches are off that may count."""
    one, none = Span(np.ones(1), np.ones(1)), Span(np.zeros(1), np.zeros(1))
    if op in ("if_else_zero", SELECT):
        holds = truth(arguments[0])
        counts = (bool(np.any(holds.hi == 1)), bool(np.any(holds.lo == 0)))
        return (none, *(one if may else None for may in counts[: len(arguments) - 1]))
    if op == MEET:
        return none, one
    with np.errstate(all="ignore"):
        return partials(op, value, *arguments)
