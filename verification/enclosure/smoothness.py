"""Where a Function may have kinks, jumps or poles, and whether a box reaches them.

A kink is a point where a formula stays continuous and its derivative does not, or where its domain ends at a
finite value; at a jump the value itself breaks off; at a pole it does not exist. An operation is reached if the
argument that decides meets its critical set anywhere in the closed box. This is asked of every operation as it
stands in the Function: kinks that cancel, or that hide in a branch not taken, are still counted.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import casadi as ca
import numpy as np

from verification.enclosure import outward
from verification.enclosure.box import Box
from verification.enclosure.interval import Value, evaluate, reason, supported
from verification.enclosure.outward import Array, Mask, Span
from verification.enclosure.reach import Kind, NonsmoothOperation, Reach, Reachable, Smoothness
from verification.enclosure.rewriting import BOOLEAN, COMPARISONS, COVER, NAMES, Graph, Node, graph_of

Rule = Literal["zero", "nonpositive", "negative", "integer"]
BUDGET = 512  # boxes for one operation
_BATCH = 64
_ONE = outward.point(1.0)


@dataclass(frozen=True)
class _Critical:
    """When an operation is not smooth: where `level`, made from its arguments, meets the set that `rule` names.

    At an `edge` the domain ends: the value at zero level is finite, below there is none.
    """

    kind: Kind
    rule: Rule
    level: Callable[..., Span]
    edge: bool = False


def _first(*spans: Span) -> Span:
    return spans[0]


def _second(*spans: Span) -> Span:
    return spans[1]


def _room(a: Span) -> Span:
    """Return how far a magnitude stays below one."""
    return outward.sub(_ONE, outward.magnitude(a))


def _larger(a: Span, b: Span) -> Span:
    return Span(np.maximum(a.lo, b.lo), np.maximum(a.hi, b.hi))


def _off_cut(y: Span, x: Span) -> Span:
    return _larger(outward.magnitude(y), x)


def _off_origin(a: Span, b: Span) -> Span:
    return _larger(outward.magnitude(a), outward.magnitude(b))


def _turns(a: Span, b: Span) -> Span:
    """Return the size of the quotient whose integer part `fmod` takes, raised to 1/2: zero turns are no jump."""
    result, bad = outward.div(a, b)
    size = outward.magnitude(Span(np.where(bad, -np.inf, result.lo), np.where(bad, np.inf, result.hi)))
    return Span(np.maximum(size.lo, 0.5), np.maximum(size.hi, 0.5))


_TABLE: Mapping[int, _Critical] = {
    ca.OP_FABS: _Critical("kink", "zero", _first),
    ca.OP_FMIN: _Critical("kink", "zero", outward.sub),
    ca.OP_FMAX: _Critical("kink", "zero", outward.sub),
    ca.OP_SQRT: _Critical("kink", "nonpositive", _first, edge=True),
    ca.OP_HYPOT: _Critical("kink", "nonpositive", _off_origin),
    ca.OP_ASIN: _Critical("kink", "nonpositive", _room, edge=True),
    ca.OP_ACOS: _Critical("kink", "nonpositive", _room, edge=True),
    ca.OP_ACOSH: _Critical("kink", "nonpositive", lambda a: outward.sub(a, _ONE), edge=True),
    ca.OP_SIGN: _Critical("jump", "zero", _first),
    ca.OP_FLOOR: _Critical("jump", "integer", _first),
    ca.OP_CEIL: _Critical("jump", "integer", _first),
    ca.OP_FMOD: _Critical("jump", "integer", _turns),
    ca.OP_COPYSIGN: _Critical("jump", "zero", _second),
    ca.OP_ATAN2: _Critical("jump", "nonpositive", _off_cut),
    ca.OP_NOT: _Critical("jump", "zero", _first),
    ca.OP_IF_ELSE_ZERO: _Critical("jump", "zero", _first),
    **{op: _Critical("jump", "zero", outward.sub) for op in COMPARISONS},
    ca.OP_DIV: _Critical("pole", "zero", _second),
    ca.OP_INV: _Critical("pole", "zero", _first),
    ca.OP_TAN: _Critical("pole", "zero", outward.cos),
    ca.OP_LOG: _Critical("pole", "nonpositive", _first),
    ca.OP_LOG1P: _Critical("pole", "nonpositive", lambda a: outward.add(a, _ONE)),
    ca.OP_ATANH: _Critical("pole", "nonpositive", _room),
    ca.OP_ERFINV: _Critical("pole", "nonpositive", _room),
}
_FREE_BASE = _Critical("pole", "nonpositive", _first)
_ROOT = _Critical("kink", "nonpositive", _first, edge=True)
_NEGATIVE_POWER = _Critical("pole", "zero", _first)


def _critical(graph: Graph, node: Node) -> _Critical | None:
    """Return when a node is not smooth, None if always."""
    if node.op in (ca.OP_FMIN, ca.OP_FMAX) and node.args[0] == node.args[1]:
        return None
    if node.op in (ca.OP_NOT, ca.OP_IF_ELSE_ZERO) and graph.nodes[node.args[0]].op in BOOLEAN:
        return None  # constant between the jumps of the comparison, which is counted itself
    if node.op == ca.OP_DIV and graph.nodes[node.args[1]].op in (ca.OP_CONST, COVER):
        constant = graph.nodes[node.args[1]]
        return None if constant.op == COVER or constant.value != 0 else _TABLE[ca.OP_DIV]
    if node.op != ca.OP_POW:
        return _TABLE.get(node.op)
    exponent = graph.nodes[node.args[1]]
    if exponent.op != ca.OP_CONST:
        return _FREE_BASE
    if exponent.value.is_integer():
        return None if exponent.value >= 0 else _NEGATIVE_POWER
    return _ROOT if exponent.value > 0 else _FREE_BASE


def _listed(graph: Graph) -> list[tuple[int, NonsmoothOperation, _Critical]]:
    """Return the nonsmooth nodes of the Function, in order, without those that only a rewriting brought in."""
    result = []
    for k in graph.ancestors(graph.targets(), rewritten=False):
        node = graph.nodes[k]
        found = _critical(graph, node)
        if found is not None and node.instruction >= 0:
            operation = NonsmoothOperation(
                name=NAMES[node.op], kind=found.kind, instruction=node.instruction, expression=graph.describe(k)
            )
            result.append((k, operation, found))
    return result


def nonsmooth_operations(function: ca.Function) -> tuple[NonsmoothOperation, ...]:
    """List the operations of a Function that are not smooth everywhere.

    Raises
    ------
    ValueError
        Where the Function has no form of scalar instructions.
    """
    graph = graph_of(function)
    if isinstance(graph, str):
        raise ValueError(graph)
    return tuple(operation for _, operation, _ in _listed(graph))


def _level(graph: Graph, k: int, critical: _Critical, values: dict[int, Value], n: int) -> Span:
    """Enclose the deciding argument of a node on every box; the whole line where evaluation failed."""
    node = graph.nodes[k]
    arguments = [values[a] for a in node.args]
    if critical.level is outward.sub and node.args[0] == node.args[1]:
        return Span(np.zeros(n), np.zeros(n))
    span = critical.level(*(value.span for value in arguments))
    low, high = (np.broadcast_to(np.where(np.isnan(end), limit, end), n) for end, limit in
                 zip(span, (-np.inf, np.inf), strict=True))  # fmt: skip
    for value in arguments:
        if value.fault is not None:
            low = np.where(value.fault >= 0, -np.inf, low)
            high = np.where(value.fault >= 0, np.inf, high)
    return Span(low, high)


def _clear(rule: Rule, level: Span) -> Mask:
    """Say on which boxes the critical set is provably missed."""
    if rule in ("nonpositive", "negative"):
        return np.asarray(level.lo > 0 if rule == "nonpositive" else level.lo >= 0)
    if rule == "zero":
        return ~outward.has_zero(level)
    return np.asarray(np.ceil(level.lo) > np.floor(level.hi))


@dataclass(frozen=True, kw_only=True)
class _Question:
    """One node of a graph over one box."""

    function: ca.Function
    graph: Graph
    node: int
    operation: NonsmoothOperation
    critical: _Critical
    continuous: bool  # whether the deciding argument is known to be continuous on the box

    def levels(self, lower: Array, upper: Array) -> Span:
        """Enclose the deciding argument on many boxes."""
        values = evaluate(self.graph, lower, upper, self.graph.nodes[self.node].args)
        with np.errstate(all="ignore"):
            return _level(self.graph, self.node, self.critical, values, lower.shape[1])

    def answer(self, reachable: Reachable, why: str, at: Array | None = None) -> Reach:
        """Return the finding."""
        point = None if at is None else Box.from_coordinates(self.function, at, at)
        return Reach(operation=self.operation, reachable=reachable, point=point, reason=why)

    def search(self, lower: Array, upper: Array, budget: int) -> Reach:
        """Split the box until the critical set is missed everywhere, met at a point, or the budget is spent."""
        low, high = lower[:, None], upper[:, None]
        points, levels = np.zeros((lower.size, 0)), Span(np.zeros(0), np.zeros(0))
        matters = self.graph.coordinates(self.graph.nodes[self.node].args, lower.size) & (upper > lower)
        scale = np.where(matters, upper - lower, np.inf)
        used = 0
        while low.shape[1]:
            used += low.shape[1]
            keep = ~_clear(self.critical.rule, self.levels(low, high))
            low, high = low[:, keep], high[:, keep]
            if not low.shape[1]:
                break
            middle = np.clip(low / 2 + high / 2, low, high)
            fresh = np.hstack([middle[:, :_BATCH], low[:, :_BATCH], high[:, :_BATCH]])
            found = self.levels(fresh, fresh)
            points, levels = np.hstack([points, fresh]), Span(*map(np.concatenate, zip(levels, found, strict=True)))
            hit = self._met(points, levels)
            if hit is not None:
                return hit
            if used + 2 * low.shape[1] > budget:
                return self.answer("unknown", f"not excluded with a budget of {budget} boxes")
            along = ((high - low) / scale[:, None]).argmax(axis=0) if lower.size else np.zeros(1, dtype=int)
            columns = np.arange(low.shape[1])
            if not lower.size or np.any((middle == low)[along, columns] & (high > low)[along, columns]):
                return self.answer("unknown", "not excluded at the resolution of doubles")
            left, right = high.copy(), low.copy()
            left[along, columns] = right[along, columns] = middle[along, columns]
            low, high = np.hstack([low, right]), np.hstack([left, high])
        return self.answer("no", f"excluded on {used} boxes")

    def _met(self, points: Array, levels: Span) -> Reach | None:
        """Return the finding "yes" if the points show it."""
        rule = self.critical.rule
        if rule in ("nonpositive", "negative"):
            hits = np.flatnonzero(levels.hi <= 0 if rule == "nonpositive" else levels.hi < 0)
            return self.answer("yes", "critical at the point", points[:, hits[0]]) if hits.size else None
        offset = 0.0
        if rule == "integer":
            known = np.isfinite(levels.lo) & np.isfinite(levels.hi)
            if not known.any():
                return None
            exact = np.flatnonzero(known & (levels.lo == levels.hi) & (levels.lo == np.rint(levels.lo)))
            if exact.size:
                return self.answer("yes", "the argument is an integer at the point", points[:, exact[0]])
            offset = float(np.ceil(levels.hi[known].min()))
        zero = np.flatnonzero((levels.lo == offset) & (levels.hi == offset))
        if zero.size:
            return self.answer("yes", "the deciding argument is zero at the point", points[:, zero[0]])
        below, above = np.flatnonzero(levels.hi < offset), np.flatnonzero(levels.lo > offset)
        if not (below.size and above.size and self.continuous):
            return None
        return self._between(points[:, below[0]], points[:, above[0]], offset)

    def _between(self, below: Array, above: Array, offset: float) -> Reach:
        """Halve the way between two points of opposite sign; a continuous argument is critical in between."""
        for _ in range(1100):  # a double is halved at most this often
            middle = below / 2 + above / 2
            if np.all((middle == below) | (middle == above)):
                break
            level = self.levels(middle[:, None], middle[:, None])
            if level.hi[0] < offset:
                below = middle
            elif level.lo[0] > offset:
                above = middle
            elif level.lo[0] == level.hi[0]:
                return self.answer("yes", "the deciding argument is critical at the point", middle)
            else:
                break
        gap = float(np.max(np.abs(above - below), initial=0.0))
        return self.answer(
            "yes", f"the deciding argument changes sign within {gap!r} of the point", below / 2 + above / 2
        )


def reaches(function: ca.Function, box: Box, *, budget: int = BUDGET) -> tuple[Reach, ...] | str:
    """Ask of every nonsmooth operation whether a box reaches its critical set.

    Parameters
    ----------
    function
        An SX Function, or an MX Function that expands to one.
    box
        A range for every input.
    budget
        How many boxes may be enclosed for one operation.

    Returns
    -------
    tuple or str
        One finding an operation, or a sentence saying why the Function cannot be judged at all.

    Raises
    ------
    ValueError
        Where the box does not fit the Function, or the budget is not positive.
    """
    return _findings(function, box, budget, False)


def _findings(function: ca.Function, box: Box, budget: int, defined_only: bool) -> tuple[Reach, ...] | str:
    """Answer `reaches`; on demand ask at the edge of a domain only whether it is left."""
    if budget < 1:
        raise ValueError(f"budget must be at least 1 box, got {budget}")
    lower, upper = box.coordinates(function)
    graph = graph_of(function)
    if isinstance(graph, str):
        return graph
    if not outward.arithmetic_is_ieee():
        return "this process does not round to nearest or drops subnormals"
    for k in graph.ancestors(graph.targets()):
        if not supported(graph.nodes[k]):
            return reason(graph, {}, k)
    breaks: set[int] = set()
    findings = []
    for k, operation, rule in _listed(graph):
        critical = replace(rule, rule="negative") if defined_only and rule.edge else rule
        question = _Question(function=function, graph=graph, node=k, operation=operation, critical=critical,
                             continuous=breaks.isdisjoint(graph.ancestors(graph.nodes[k].args)))  # fmt: skip
        findings.append(question.search(lower, upper, budget))
        if findings[-1].reachable != "no" and (critical.kind != "kink" or critical.edge):
            breaks.add(k)
    return tuple(findings)


def _judge(function: ca.Function, box: Box, budget: int, continuity: bool) -> Smoothness:
    found = _findings(function, box, budget, continuity)
    if isinstance(found, str):
        return Smoothness(proved=False, reaches=(), reason=found)
    edges = {op for op, critical in _TABLE.items() if critical.edge} | {ca.OP_POW}
    edge_names = {NAMES[op] for op in edges}
    asked = tuple(r for r in found if not continuity or r.operation.kind != "kink" or r.operation.name in edge_names)
    for r in asked:
        if r.reachable != "no":
            at = "" if r.point is None else f" at {r.point}"
            what = f"{r.operation.kind} of {r.operation.name} in {r.operation.expression}"
            return Smoothness(proved=False, reaches=asked, reason=f"{what}: {r.reachable}{at} ({r.reason})")
    return Smoothness(proved=True, reaches=asked, reason=None)


def continuous_on(function: ca.Function, box: Box, *, budget: int = BUDGET) -> Smoothness:
    """Show that a Function is defined and continuous on a box: no jump, pole or end of a domain is reached.

    Applied to a derivative, made by automatic differentiation, together with `smooth_on` of the Function itself it
    shows that the derivative exists and is continuous.
    """
    return _judge(function, box, budget, True)


def smooth_on(function: ca.Function, box: Box, *, budget: int = BUDGET) -> Smoothness:
    """Show that a Function is infinitely differentiable on a box: no kink, jump or pole is reached."""
    return _judge(function, box, budget, False)
