"""Where a Function may have kinks, jumps or poles, and whether a box reaches them.

A kink is a point where a formula stays continuous and its derivative does not, or where its domain ends at a
finite value; at a jump the value itself breaks off; at a pole it does not exist. An operation is reached if the
argument that decides meets its critical set anywhere in the closed box. This is asked of every operation as it
stands in the Function: kinks that cancel, or that hide in a branch not taken, are still counted.
"""

from dataclasses import dataclass, replace

import numpy as np

from verification.enclosure import outward
from verification.enclosure.box import Box
from verification.enclosure.face import Enclosed
from verification.enclosure.interval import evaluate, reason, supported
from verification.enclosure.outward import Array, Mask, Span
from verification.enclosure.reach import NonsmoothOperation, Reach, Reachable, Smoothness
from verification.enclosure.rewriting import COVER, Quantity, Rewritten, rewritten
from workbench.graph.operations import CONSTANT, OPERATIONS, Critical, Rule
from workbench.graph.smooth import critical

BUDGET = 512  # boxes for one operation
_BATCH = 64


class _Levels:
    """Adds to a graph what decides where an operation is not smooth."""

    def __init__(self, graph: Rewritten) -> None:
        self.nodes = list(graph.nodes)

    def operation(self, op: str, *args: int) -> int:
        """Return the place of an operation on nodes."""
        self.nodes.append(Quantity(op, args))
        return len(self.nodes) - 1

    def constant(self, value: float) -> int:
        """Return the place of a number."""
        self.nodes.append(Quantity(CONSTANT, value=value))
        return len(self.nodes) - 1


def _critical(graph: Rewritten, node: Quantity) -> Critical | None:
    """Return when a quantity is not smooth, None if always."""
    if node.op == "div" and graph.nodes[node.args[1]].op == COVER:
        return None  # at least one of the two comparisons holds
    return critical(graph.nodes, node)


def _listed(graph: Rewritten) -> list[tuple[int, NonsmoothOperation, Critical]]:
    """Return the nonsmooth nodes of the Function, in order, without those that only a rewriting brought in."""
    result = []
    for k in graph.ancestors(graph.targets(), rewritten=False):
        node = graph.nodes[k]
        found = _critical(graph, node)
        if found is not None and node.origin >= 0:
            operation = NonsmoothOperation(
                name=node.op, kind=found.kind, instruction=node.origin, expression=graph.describe(k)
            )
            result.append((k, operation, found))
    return result


def nonsmooth_operations(function: Enclosed) -> tuple[NonsmoothOperation, ...]:
    """List the operations of a Function that are not smooth everywhere.

    Raises
    ------
    ValueError
        Where the Function has no form of scalar instructions.
    """
    graph = rewritten(function)
    if isinstance(graph, str):
        raise ValueError(graph)
    return tuple(operation for _, operation, _ in _listed(graph))


def continuous_everywhere(function: Enclosed) -> bool:
    """Tell whether a Function is made of operations that are defined and continuous for all arguments."""
    graph = rewritten(function)
    if isinstance(graph, str):
        return False
    known = all(supported(graph.nodes[k]) for k in graph.ancestors(graph.targets()))
    return known and all(found.kind == "kink" and not found.edge for _, _, found in _listed(graph))


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

    function: Enclosed
    graph: Rewritten
    node: int
    operation: NonsmoothOperation
    critical: Critical
    level: int
    continuous: bool  # whether the deciding argument is known to be continuous on the box

    def levels(self, lower: Array, upper: Array) -> Span:
        """Enclose the deciding argument on many boxes."""
        low, high = evaluate(self.graph, lower, upper, [self.level])[self.level].span
        return Span(np.broadcast_to(low, lower.shape[1]), np.broadcast_to(high, lower.shape[1]))

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


def reaches(function: Enclosed, box: Box, *, budget: int = BUDGET) -> tuple[Reach, ...] | str:
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


def _findings(function: Enclosed, box: Box, budget: int, defined_only: bool) -> tuple[Reach, ...] | str:
    """Answer `reaches`; on demand ask at the edge of a domain only whether it is left."""
    if budget < 1:
        raise ValueError(f"budget must be at least 1 box, got {budget}")
    lower, upper = box.coordinates(function)
    graph = rewritten(function)
    if isinstance(graph, str):
        return graph
    if not outward.arithmetic_is_ieee():
        return "this process does not round to nearest or drops subnormals"
    for k in graph.ancestors(graph.targets()):
        if not supported(graph.nodes[k]):
            return reason(graph, {}, k)
    listed = _listed(graph)
    levels = _Levels(graph)
    of = {k: found.level(levels, *graph.nodes[k].args) for k, _, found in listed}
    graph = replace(graph, nodes=tuple(levels.nodes))
    breaks: set[int] = set()
    findings = []
    for k, operation, rule in listed:
        asked = rule._replace(rule="negative") if defined_only and rule.edge else rule
        question = _Question(function=function, graph=graph, node=k, operation=operation, critical=asked, level=of[k],
                             continuous=breaks.isdisjoint(graph.ancestors(graph.nodes[k].args)))  # fmt: skip
        findings.append(question.search(lower, upper, budget))
        if findings[-1].reachable != "no" and (asked.kind != "kink" or asked.edge):
            breaks.add(k)
    return tuple(findings)


def _judge(function: Enclosed, box: Box, budget: int, continuity: bool) -> Smoothness:
    found = _findings(function, box, budget, continuity)
    if isinstance(found, str):
        return Smoothness(proved=False, reaches=(), reason=found)
    edge_names = {name for name, one in OPERATIONS.items() if one.critical and one.critical.edge} | {"pow"}
    asked = tuple(r for r in found if not continuity or r.operation.kind != "kink" or r.operation.name in edge_names)
    for r in asked:
        if r.reachable != "no":
            at = "" if r.point is None else f" at {r.point}"
            what = f"{r.operation.kind} of {r.operation.name} in {r.operation.expression}"
            return Smoothness(proved=False, reaches=asked, reason=f"{what}: {r.reachable}{at} ({r.reason})")
    return Smoothness(proved=True, reaches=asked, reason=None)


def continuous_on(function: Enclosed, box: Box, *, budget: int = BUDGET) -> Smoothness:
    """Show that a Function is defined and continuous on a box: no jump, pole or end of a domain is reached.

    Applied to a derivative, made by automatic differentiation, together with `smooth_on` of the Function itself it
    shows that the derivative exists and is continuous.
    """
    return _judge(function, box, budget, True)


def smooth_on(function: Enclosed, box: Box, *, budget: int = BUDGET) -> Smoothness:
    """Show that a Function is infinitely differentiable on a box: no kink, jump or pole is reached."""
    return _judge(function, box, budget, False)
