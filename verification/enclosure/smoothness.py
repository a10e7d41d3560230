"""Where a Function may have kinks, jumps or poles, and whether a box reaches them.

A kink is a point where a formula stays continuous and its derivative does not, or where its domain ends at a
finite value; at a jump the value itself breaks off; at a pole it does not exist. An operation is reached if the
argument that decides meets its critical set anywhere in the closed box, or in the closed part of it where the
operation counts: one that stands in a branch of a guard, and nowhere else, counts where the guard lets it. Kinks that
cancel are still counted. A lookup table is asked about at every breakpoint of each of its axes.

Inputs that the box says are whole take whole numbers only, and nothing is continuous or smooth in them: what they
decide alone is no kink and no jump. A pole or the end of a domain that one of them meets counts.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from verification.enclosure import outward
from verification.enclosure.box import Box
from verification.enclosure.critical_search import Question
from verification.enclosure.everywhere import ends, over_the_reals
from verification.enclosure.face import Enclosed, face
from verification.enclosure.guards import Condition, conditions_of
from verification.enclosure.interval import reason, supported
from verification.enclosure.lookups import breaks
from verification.enclosure.reach import NonsmoothOperation, Reach, Smoothness
from verification.enclosure.rewriting import COVER, Quantity, Rewritten, rewritten
from verification.enclosure.switches import Switches
from verification.enclosure.whole import Table, tabulated
from workbench.graph import Graph
from workbench.graph.operations import CONSTANT, LOOKUP, OPERATIONS, Critical
from workbench.graph.smooth import critical

BUDGET = 512  # boxes for one operation


class _Listed(NamedTuple):
    """A place where an operation is not smooth."""

    node: int
    operation: NonsmoothOperation
    critical: Critical
    inside: str = "both"
    """On which sides of a breakpoint the operation goes on to its value there."""


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


def _listed(graph: Rewritten) -> list[_Listed]:
    """Return where the Function is not smooth, in order, without nodes that only a rewriting brought in."""
    result: list[_Listed] = []
    for k in graph.ancestors(graph.targets(), rewritten=False):
        node = graph.nodes[k]
        if node.op == LOOKUP:
            result += _breakpoints(graph, k)
            continue
        found = _critical(graph, node)
        if found is not None and node.origin >= 0:
            operation = NonsmoothOperation(
                name=node.op, kind=found.kind, instruction=node.origin, expression=graph.describe(k)
            )
            result.append(_Listed(k, operation, found))
    return result


def _breakpoints(graph: Rewritten, k: int) -> Iterator[_Listed]:
    """Give the breakpoints of a lookup: the level of each is how far the argument lies beyond it."""
    node = graph.nodes[k]
    for found in breaks(graph.table_of(k), graph.lookup_of(k)):
        what = f"{graph.describe(k, 60)} where {graph.describe(node.args[found.axis], 30)} is {found.point!r}"
        operation = NonsmoothOperation(name=LOOKUP, kind=found.kind, instruction=node.origin, expression=what)
        yield _Listed(k, operation, Critical(found.kind, "zero", _beyond(found.axis, found.point)), found.inside)


def _beyond(axis: int, point: float) -> Callable[..., int]:  # as many arguments as the table has axes
    return lambda make, *args: make.operation("sub", args[axis], make.constant(point))


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
    return tuple(one.operation for one in _listed(graph))


def continuous_everywhere(function: Enclosed) -> bool:
    """Tell whether a Function is made of operations that are defined and continuous for all arguments."""
    return not breaks_somewhere(function)


def breaks_somewhere(function: Enclosed, whole: Mapping[str, tuple[float, float]] | None = None) -> str:
    """Return which operation is not defined and continuous for all real arguments, or an empty text.

    ``whole`` names inputs that take whole numbers between two ends only; what they decide alone is no jump, and where
    they alone decide a divisor, or a value, it is looked at for every one of them. Nothing breaks where a guard
    keeps an operation from its pole, or from the end of its domain, nor where both sides of a switch agree.
    """
    graph = rewritten(function)
    if isinstance(graph, str):
        return graph
    ranges = {} if whole is None else whole
    names = [one.name for one in face(function).inputs for _ in one.rows]
    lower, upper = (np.array([ranges.get(name, (0.0, 0.0))[end] for name in names]) for end in (0, 1))
    table = tabulated(graph, lower, upper, np.array([name in ranges for name in names], dtype=bool), graph.targets())
    graph = table.graph
    for k in graph.ancestors(graph.targets()):
        if not supported(graph, k):
            return reason(graph, {}, k)
    if not (np.isfinite(table.lower) & np.isfinite(table.upper)).all():
        return "not every whole number gives a finite value"
    levels = _Levels(graph)
    listed = _listed(graph)
    of = [one.critical.level(levels, *graph.nodes[one.node].args) for one in listed]
    counts = conditions_of(graph, graph.targets())
    above = replace(graph, nodes=tuple(levels.nodes))
    switches, broken = Switches(graph.graph), set[int]()
    for (k, operation, found, _), level in zip(listed, of, strict=True):
        if found.kind == "kink" and not found.edge:
            continue
        moving = above.coordinates((level,), table.first + table.readings)[: table.first].any()
        row = above.nodes[level].coordinate - table.first
        apart = 0 <= row and bool(((table.lower[row] > 0) | (table.upper[row] < 0)).all())
        if not moving and (found.kind == "jump" or (found.kind == "pole" and found.rule == "zero" and apart)):
            continue
        if found.kind == "jump":
            known = broken.isdisjoint(above.ancestors(graph.nodes[k].args))
            switch = switches.of(operation.instruction) if known else None
            broken.add(k)
            if switch is not None and switches.agree(switch):
                continue
        elif _shut_out(function, replace(table, graph=above), names, ranges, operation, found, level, counts[k]):
            continue
        what = "the end of a domain" if found.kind == "kink" else f"a {found.kind}"
        return f"{what} of {operation.name} in {operation.expression}"
    return ""


def _shut_out(
    function: Enclosed,
    table: Table,
    names: Sequence[str],
    ranges: Mapping[str, tuple[float, float]],
    operation: NonsmoothOperation,
    found: Critical,
    level: int,
    conditions: Iterable[Condition],
) -> bool:
    """Say whether the conditions under which an operation counts keep it from where it ends, for all real numbers."""
    real = np.array([name not in ranges for name in names], dtype=bool)
    graph, moved = over_the_reals(table.graph, real)
    given = np.array([ranges.get(name, (0.0, 0.0)) for name in names])
    low, high = ends(given[:, 0], given[:, 1], real)
    readings = table.lower.min(axis=1), table.upper.max(axis=1)
    question = Question(
        function=function,
        whole=(),
        operation=operation,
        rule="negative" if found.edge else found.rule,
        table=replace(table, graph=graph),
        level=level + moved,
        continuous=True,
        conditions=tuple((condition + moved, holds) for condition, holds in sorted(conditions)),
    )
    lower, upper = (np.concatenate(one)[:, None] for one in zip((low, high), readings, strict=True))
    return not bool(question.unclear(lower, upper).any())


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
    found = _findings(function, box, budget, False, None)
    return found if isinstance(found, str) else found.reaches


class _Found(NamedTuple):
    """What was found of every nonsmooth operation, in order."""

    reaches: tuple[Reach, ...]
    known: tuple[bool, ...]
    """Whether the level of each is known to be continuous."""
    graph: Graph


def _findings(
    function: Enclosed, box: Box, budget: int, defined_only: bool, along: tuple[str, ...] | None
) -> _Found | str:
    """Answer `reaches`; on demand ask at the edge of a domain only whether it is left, and of some inputs' jumps."""
    if budget < 1:
        raise ValueError(f"budget must be at least 1 box, got {budget}")
    lower, upper = box.coordinates(function)
    whole = box.whole_coordinates(function)
    moving = ~whole & _named(function, box, along)
    graph = rewritten(function)
    if isinstance(graph, str):
        return graph
    if not outward.arithmetic_is_ieee():
        return "this process does not round to nearest or drops subnormals"
    for k in graph.ancestors(graph.targets()):
        if not supported(graph, k):
            return reason(graph, {}, k)
    listed = _listed(graph)
    levels = _Levels(graph)
    of = [one.critical.level(levels, *graph.nodes[one.node].args) for one in listed]
    counts = conditions_of(graph, graph.targets())
    graph = replace(graph, nodes=tuple(levels.nodes))
    broken: set[int] = set()
    findings, known = [], []
    for (k, operation, rule, inside), level in zip(listed, of, strict=True):
        held = not np.any(moving & graph.coordinates((level,), lower.size))
        asked = "negative" if rule.edge and (defined_only or held) else rule.rule
        known.append(broken.isdisjoint(graph.ancestors(graph.nodes[k].args)))
        conditions = tuple(sorted(counts[k]))
        table = tabulated(graph, lower, upper, whole, (level, *(condition for condition, _ in conditions)))
        question = Question(function=function, whole=box.whole, operation=operation, rule=asked, level=level,
                            table=table, continuous=known[-1], conditions=conditions, inside=inside)  # fmt: skip
        if held and rule.kind != "pole" and not rule.edge and question.exists(lower, upper):
            findings.append(question.answer("no", "decided by whole numbers, or by inputs that are held"))
            continue
        findings.append(question.search(lower, upper, budget))
        if findings[-1].reachable != "no" and (rule.kind != "kink" or rule.edge):
            broken.add(k)
    return _Found(tuple(findings), tuple(known), graph.graph)


def _named(function: Enclosed, box: Box, along: tuple[str, ...] | None) -> NDArray[np.bool_]:
    """Say of each coordinate whether it belongs to one of the inputs in which continuity is asked for."""
    inputs = face(function).inputs
    if along is not None and not set(along) <= set(box):
        raise ValueError(f"along must name inputs of the box, which has {list(box)}, got {list(along)}")
    parts = [np.full(len(taken.rows), along is None or taken.name in along) for taken in inputs]
    return np.concatenate([np.zeros(0, dtype=bool), *parts])


def _judge(
    function: Enclosed, box: Box, budget: int, continuity: bool, along: tuple[str, ...] | None = None
) -> Smoothness:
    found = _findings(function, box, budget, continuity, along)
    if isinstance(found, str):
        return Smoothness(proved=False, reaches=(), reason=found)
    edge_names = {name for name, one in OPERATIONS.items() if one.critical and one.critical.edge} | {"pow"}
    asked = [
        (r, known)
        for r, known in zip(found.reaches, found.known, strict=True)
        if not continuity or r.operation.kind != "kink" or r.operation.name in edge_names
    ]
    reaches = tuple(r for r, _ in asked)
    switches = Switches(found.graph)
    mended = []
    for r, known in asked:
        if r.reachable == "no":
            continue
        switch = switches.of(r.operation.instruction) if continuity and known and r.operation.kind == "jump" else None
        if switch is not None and switches.agree(switch):
            mended.append(r.operation)
            continue
        at = "" if r.point is None else f" at {r.point}"
        what = f"{r.operation.kind} of {r.operation.name} in {r.operation.expression}"
        return Smoothness(proved=False, reaches=reaches, reason=f"{what}: {r.reachable}{at} ({r.reason})")
    return Smoothness(proved=True, reaches=reaches, reason=None, mended=tuple(mended))


def continuous_on(
    function: Enclosed, box: Box, *, budget: int = BUDGET, along: tuple[str, ...] | None = None
) -> Smoothness:
    """Show that a Function is defined and continuous on a box, in its real inputs, for all values of the whole ones.

    No pole or end of a domain is reached, and no jump but those that the Function mends: where both sides of a switch
    are equal, see `switches`. Applied to a derivative, made by automatic differentiation, together with the same of
    the Function itself it shows that the derivative exists and is continuous.

    Parameters
    ----------
    function, box, budget
        As for `reaches`.
    along
        Names of the inputs in which it is to be continuous while the others are held, by default all that are real.
        It is to be defined on the whole box either way.
    """
    return _judge(function, box, budget, True, along)


def smooth_on(function: Enclosed, box: Box, *, budget: int = BUDGET) -> Smoothness:
    """Show that a Function is infinitely differentiable on a box in its real inputs, for all values of the whole ones.

    No kink, jump or pole is reached.
    """
    return _judge(function, box, budget, False)
