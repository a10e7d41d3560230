"""Rigorous enclosures of CasADi Functions on boxes.

An enclosure holds for the Function read as a formula over the real numbers, its constants being the doubles that
stand in it. A value that CasADi computes in floating point may differ from that by its own rounding errors.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from verification.enclosure import outward, outward_logic, remainders
from verification.enclosure.box import Box
from verification.enclosure.contraction import Held
from verification.enclosure.face import Enclosed, face
from verification.enclosure.guards import EFFORT, GUARDS, Branches, Value, Work
from verification.enclosure.lookups import enclosed, unreadable
from verification.enclosure.outward import Array, Mask, Span
from verification.enclosure.rewriting import CHORD, CHORDS, COVER, MEET, SELECT, Rewritten, rewritten
from verification.enclosure.slopes import partials
from workbench.graph.operations import CONSTANT, INPUT, LOOKUP

Faults = NDArray[np.int64]


def _mean_slope(op: str) -> Callable[[Span], Span]:
    """Return what encloses op(x) / x for an operation that is zero at zero: by the mean value theorem it is a slope."""

    def rule(a: Span) -> Span:
        around = outward.hull(a, outward.point(0.0))
        value, bad = PARTIAL[op][0](around) if op in PARTIAL else (TOTAL[op](around), np.zeros(1, dtype=bool))
        (slope,) = partials(op, value, around)
        return Span(np.where(bad, -np.inf, slope.lo), np.where(bad, np.inf, slope.hi))

    return rule


# operations of one argument, and of two
TOTAL: Mapping[str, Callable[..., Span]] = {
    "add": outward.add,
    "sub": outward.sub,
    "mul": outward.mul,
    "neg": outward.neg,
    "twice": outward.twice,
    "sq": outward.square,
    "exp": outward.exp,
    "expm1": outward.expm1,
    "sin": outward.sin,
    "cos": outward.cos,
    "atan": outward.atan,
    "atan2": outward.atan2,
    "sinh": outward.sinh,
    "cosh": outward.cosh,
    "tanh": outward.tanh,
    "asinh": outward.asinh,
    "erf": outward.erf,
    "hypot": outward.hypot,
    "fabs": outward.magnitude,
    "sign": lambda a: Span(np.sign(a.lo), np.sign(a.hi)),
    "floor": lambda a: Span(np.floor(a.lo), np.floor(a.hi)),
    "ceil": lambda a: Span(np.ceil(a.lo), np.ceil(a.hi)),
    "fmin": lambda a, b: Span(np.minimum(a.lo, b.lo), np.minimum(a.hi, b.hi)),
    "fmax": lambda a, b: Span(np.maximum(a.lo, b.lo), np.maximum(a.hi, b.hi)),
    "copysign": outward.copysign,
    "lt": outward_logic.less,
    "le": outward_logic.less_equal,
    "eq": outward_logic.equal,
    "ne": lambda a, b: outward_logic.negation(outward_logic.equal(a, b)),
    "not": outward_logic.negation,
    "and": lambda a, b: _both(outward_logic.truth(a), outward_logic.truth(b), np.minimum),
    "or": lambda a, b: _both(outward_logic.truth(a), outward_logic.truth(b), np.maximum),
    "if_else_zero": outward_logic.gate,
    SELECT: outward_logic.select,
    COVER: lambda a, b: Span(np.maximum(a.lo + b.lo, 1.0), a.hi + b.hi),
    MEET: outward.meet,
    **{CHORD + op: _mean_slope(op) for op in CHORDS},
}
"""Operations that exist for every argument."""

PARTIAL: Mapping[str, tuple[Callable[..., tuple[Span, Mask]], str]] = {
    "div": (outward.div, "the divisor may be zero"),
    "inv": (lambda a: outward.div(outward.point(1.0), a), "the divisor may be zero"),
    "sqrt": (outward.sqrt, "the argument may be negative"),
    "log": (outward.log, "the argument may be zero or negative"),
    "log1p": (outward.log1p, "the argument may reach -1"),
    "tan": (outward.tan, "the argument may reach a pole"),
    "asin": (outward.asin, "the argument may leave [-1, 1]"),
    "acos": (outward.acos, "the argument may leave [-1, 1]"),
    "acosh": (outward.acosh, "the argument may fall below 1"),
    "atanh": (outward.atanh, "the argument may reach -1 or 1"),
    "erfinv": (outward.erfinv, "the argument may reach -1 or 1"),
    "pow": (outward.power, "the base may be zero or negative where the exponent does not allow it"),
    "fmod": (remainders.fmod, "the divisor may be zero"),
    "remainder": (remainders.remainder, "the divisor may be zero"),
}
"""Operations that do not, with what can go wrong."""

_ITSELF: Mapping[str, float] = {
    "sub": 0.0, "lt": 0.0, "ne": 0.0, "le": 1.0, "eq": 1.0, "div": 1.0,
}  # fmt: skip
"""What an operation gives when both of its arguments are one quantity."""


def _both(a: Span, b: Span, combine: Callable[[Array, Array], Array]) -> Span:
    return Span(combine(a.lo, b.lo), combine(a.hi, b.hi))


def evaluate(
    graph: Rewritten,
    lower: Array,
    upper: Array,
    targets: Iterable[int],
    held: Held | None = None,
    work: Work | None = None,
) -> dict[int, Value]:
    """Enclose nodes of a graph on many boxes.

    Parameters
    ----------
    graph
        Where the nodes are.
    lower, upper
        Ends of the boxes, one row a coordinate, one column a box. An infinite end says that the coordinate, one that
        was tabulated, has no known value.
    targets
        The nodes that are wanted.
    held
        Ends that quantities are known to keep, by node, where they are narrower than what comes out.
    work
        What may be spent on branches of guards, by default some times what is evaluated anyway.

    Returns
    -------
    dict
        The targets and all that they depend on. A failed element is the whole real line. Branches are given on the
        whole box; a guard holds them as they are where its condition lets them count.
    """
    values: dict[int, Value] = {}
    order = graph.ancestors(tuple(targets))
    effort = Work(EFFORT * len(order)) if work is None else work
    branches = Branches(graph, lower, upper, held or {}, evaluate)
    with np.errstate(all="ignore"):
        for k in order:
            node = graph.nodes[k]
            if node.op == INPUT:
                low = lower[node.coordinate]
                high = low if upper is lower else upper[node.coordinate]
                known = np.isfinite(low) & np.isfinite(high)
                values[k] = Value(Span(low, high), None if known.all() else np.where(known, -1, k))
            elif node.op == CONSTANT:
                number = bool(np.isfinite(node.value))
                span = outward.point(node.value) if number else outward.full(np.zeros(1))
                values[k] = Value(span, None if number else np.array([k]))
            elif node.op in GUARDS:
                values[k] = _operate(graph, k, branches.arguments(k, values, effort))
            else:
                values[k] = _operate(graph, k, [values[a] for a in node.args])
            if held and k in held:
                values[k] = _kept(values[k], held[k])
    return values


def _kept(value: Value, ends: Span) -> Value:
    """Return a value within ends that it is known to keep; what misses them altogether stays as it is."""
    span = outward.meet(value.span, ends)
    good = span.lo <= span.hi
    if value.fault is not None:
        good = good & (value.fault < 0)
    return Value(Span(np.where(good, span.lo, value.span.lo), np.where(good, span.hi, value.span.hi)), value.fault)


def _operate(graph: Rewritten, k: int, values: list[Value]) -> Value:
    """Apply one operation to its enclosed arguments."""
    op, args = graph.nodes[k].op, graph.nodes[k].args
    spans = [value.span for value in values]
    bad: Mask | None = None
    if op == LOOKUP and not unreadable(graph.table_of(k)):
        span = enclosed(graph.table_of(k), graph.lookup_of(k), spans)
    elif op in PARTIAL:
        span, bad = PARTIAL[op][0](*spans)
    elif op in TOTAL:
        span = TOTAL[op](*spans)
    else:
        span, bad = outward.full(np.zeros(1)), np.array([True])
    if len(args) == 2 and args[0] == args[1] and op in _ITSELF:
        span = outward.point(_ITSELF[op])
    fault = _inherited(op, values)
    if bad is not None and bad.any():
        own = np.where(bad, k, -1)
        fault = own if fault is None else np.where(fault >= 0, fault, own)
    low, high = span
    if fault is not None:
        low, high = np.where(fault >= 0, -np.inf, low), np.where(fault >= 0, np.inf, high)
    return Value(Span(np.where(np.isnan(low), -np.inf, low), np.where(np.isnan(high), np.inf, high)), fault)


def _inherited(op: str, values: list[Value]) -> Faults | None:
    """Return the faults of the arguments that count: a branch that is surely not taken does not."""
    faults = [value.fault for value in values]
    if op == MEET:
        return faults[1]
    if op in ("if_else_zero", SELECT) and any(fault is not None for fault in faults[1:]):
        holds = outward_logic.truth(values[0].span)
        if faults[1] is not None:
            faults[1] = np.where(holds.hi == 0, -1, faults[1])
        if op == SELECT and faults[2] is not None:
            faults[2] = np.where(holds.lo == 1, -1, faults[2])
    result: Faults | None = None
    for fault in faults:
        if fault is not None:
            result = fault if result is None else np.where(result >= 0, result, fault)
    return result


def supported(graph: Rewritten, k: int) -> bool:
    """Say whether there is a rule for a node, so that splitting boxes may help where it fails."""
    node = graph.nodes[k]
    if node.op == LOOKUP:
        return not unreadable(graph.table_of(k))
    constant = node.op == CONSTANT and bool(np.isfinite(node.value))
    return node.op in TOTAL or node.op in PARTIAL or node.op == INPUT or constant


def reason(graph: Rewritten, values: Mapping[int, Value], fault: int, column: int = 0) -> str:
    """Say in a sentence which operation failed, on what, and where it stands."""
    node = graph.nodes[fault]
    where = f"at node {node.origin}, in {graph.describe(fault)}"
    name = node.op
    if node.op == CONSTANT:
        return f"the constant {node.value} is not a number to compute with ({where})"
    if node.op == INPUT:
        return f"not every whole number of the range gives it a finite value ({where})"
    if node.op == LOOKUP and unreadable(graph.table_of(fault)):
        return f"{unreadable(graph.table_of(fault))} ({where})"
    if node.op not in PARTIAL:
        return f"the operation {name} is not supported ({where})"
    ends = [[float(np.broadcast_to(end, column + 1)[column] if end.size == 1 else end[column])
             for end in values[k].span] for k in node.args]  # fmt: skip
    ranges = ", ".join(f"[{low!r}, {high!r}]" for low, high in ends)
    return f"{name}({ranges}): {PARTIAL[node.op][1]} ({where})"


@dataclass(frozen=True, kw_only=True, eq=False)
class Enclosure:
    """Ranges that hold every value of a Function on a box.

    Parameters
    ----------
    lower, upper
        Ends by output name, shaped like the outputs; infinite where nothing is known.
    undecided
        None, or a sentence saying why some entry could not be enclosed.
    """

    lower: Mapping[str, Array]
    upper: Mapping[str, Array]
    undecided: str | None

    def __str__(self) -> str:
        """Return the ranges, and what is undecided."""
        text = "; ".join(f"{name} in [{self.lower[name].tolist()}, {self.upper[name].tolist()}]" for name in self.lower)
        return text if self.undecided is None else f"{text} (undecided: {self.undecided})"


def enclose(function: Enclosed, box: Box) -> Enclosure:
    """Enclose all outputs of a Function on a box, in one go: whole numbers are taken for real ones.

    Parameters
    ----------
    function
        An SX Function, or an MX Function that expands to one.
    box
        A range for every input.

    Raises
    ------
    ValueError
        Where the box does not fit the Function's inputs. What cannot be enclosed is not an error but `undecided`.
    """
    lower, upper = box.coordinates(function)
    graph = rewritten(function)
    shapes = face(function).outputs
    low = {name: np.full(shape, -np.inf) for name, shape in shapes.items()}
    high = {name: np.full(shape, np.inf) for name, shape in shapes.items()}
    if not outward.arithmetic_is_ieee():
        return Enclosure(lower=low, upper=high, undecided="this process does not round to nearest or drops subnormals")
    if isinstance(graph, str):
        return Enclosure(lower=low, upper=high, undecided=graph)
    entries = [(name, entry) for name, nonzeros in graph.outputs.items() for entry in nonzeros]
    values = evaluate(graph, lower[:, None], upper[:, None], [entry.node for _, entry in entries])
    undecided: str | None = None
    for name in graph.outputs:
        low[name][:], high[name][:] = 0.0, 0.0
    for name, entry in entries:
        span, fault = values[entry.node]
        place = entry.row, entry.column
        low[name][place], high[name][place] = span.lo[0], span.hi[0]
        if fault is not None and fault[0] >= 0 and undecided is None:
            undecided = f"{name}[{entry.row}, {entry.column}]: {reason(graph, values, int(fault[0]))}"
    return Enclosure(lower=low, upper=high, undecided=undecided)
