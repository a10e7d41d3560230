"""How small and how large a Function gets on a box, and whether it keeps a bound: rigorous, by branch and bound.

Inputs that the box says are whole take whole numbers only, in bounds, proofs and witnesses.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from verification.enclosure import outward
from verification.enclosure.box import Box
from verification.enclosure.branch_and_bound import Scalar, Search, minimise
from verification.enclosure.face import Enclosed, face
from verification.enclosure.interval import reason, supported
from verification.enclosure.outward import Array
from verification.enclosure.rewriting import rewritten
from verification.enclosure.whole import Table, tabulated

Standing = Literal["proved", "refuted", "undecided"]
BUDGET = 4096  # boxes
TOLERANCE = 1e-6  # of the larger of 1 and the magnitude of the extremum


@dataclass(frozen=True, kw_only=True, eq=False)
class Attained:
    """A value that the Function takes: a point, and the ends between which the value there provably lies."""

    point: Box
    lower: float
    upper: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Bounds:
    """What is known about the extrema of an output on a box.

    The infimum lies in ``[lower, attained_min.upper]``, the supremum in ``[attained_max.lower, upper]``.

    Parameters
    ----------
    output
        Name of the output.
    lower, upper
        Proven bounds, infinite where nothing is known.
    attained_min, attained_max
        The best points found, None if the Function could not be evaluated anywhere.
    boxes_used
        How many boxes were enclosed.
    reason
        None if both extrema are known to the tolerance, otherwise a sentence saying why not.
    """

    output: str
    lower: float
    upper: float
    attained_min: Attained | None
    attained_max: Attained | None
    boxes_used: int
    reason: str | None


@dataclass(frozen=True, kw_only=True, eq=False)
class Proof:
    """Whether an output keeps its bounds on a box.

    Parameters
    ----------
    standing
        ``"proved"`` for the whole box, ``"refuted"`` by the witness, or ``"undecided"``.
    lower, upper
        What was proved about the output on the way, whatever the standing.
    witness
        The point that refutes, with its rigorously enclosed value; None otherwise.
    boxes_used
        How many boxes were enclosed.
    reason
        None, or a sentence saying why the question is undecided.
    """

    standing: Standing
    lower: float
    upper: float
    witness: Attained | None
    boxes_used: int
    reason: str | None


def _scalars(
    function: Enclosed, box: Box, output: str | None, signs: tuple[int, ...], slopes: bool
) -> tuple[list[Scalar], Table] | str:
    """Return the scalars of an output and the table that they read, or a sentence saying why there are none."""
    title, _, outputs = face(function)
    names = list(outputs)
    if output is None and len(names) != 1:
        raise ValueError(f"{title} has outputs {names}: name one")
    name = names[0] if output is None else output
    if name not in names:
        raise ValueError(f"{title} has outputs {names}, got {name!r}")
    if not outward.arithmetic_is_ieee():
        return "this process does not round to nearest or drops subnormals"
    graph = rewritten(function)
    if isinstance(graph, str):
        return graph
    for k in graph.ancestors(tuple(entry.node for entry in graph.outputs[name])):
        if not supported(graph, k):
            return reason(graph, {}, k)
    nodes = [entry.node for entry in graph.outputs[name]]
    rows, columns = graph.shapes[name]
    if not rows * columns:
        raise ValueError(f"{title}: the output {name} is empty")
    if len(nodes) < rows * columns:
        graph, zero = graph.with_constant(0.0)
        nodes.append(zero)
    wanted = tuple(dict.fromkeys(nodes))
    table = tabulated(graph, *box.coordinates(function), box.whole_coordinates(function), wanted)
    return [Scalar(graph=table.graph, node=k, sign=sign, sloped=slopes) for k in wanted for sign in signs], table


def _attained(function: Enclosed, box: Box, search: Search, sign: int) -> Attained | None:
    """Return the best point of a search as a named point."""
    if search.where is None:
        return None
    low, high = search.best if sign > 0 else (-search.best[1], -search.best[0])
    return Attained(point=Box.from_coordinates(function, search.where, search.where, box.whole), lower=low, upper=high)


def _extremum(
    table: Table,
    ends: tuple[Array, Array],
    entries: list[Scalar],
    budget: int,
    settled: Callable[[float, float], bool],
) -> Search:
    """Minimise over all entries, each with its share of what is left of the budget."""
    searches: list[Search] = []
    used = 0
    for k, scalar in enumerate(entries):
        searches.append(minimise(scalar, table, *ends, max((budget - used) // (len(entries) - k), 1), settled))
        used += searches[-1].used
    best = min(searches, key=lambda search: search.best[1])
    trouble = next((search.trouble for search in searches if search.trouble is not None), None)
    return Search(
        lower=min(search.lower for search in searches), best=best.best, where=best.where, used=used, trouble=trouble
    )


def bound(
    function: Enclosed,
    box: Box,
    output: str | None = None,
    *,
    budget: int = BUDGET,
    tolerance: float = TOLERANCE,
    slopes: bool = True,
) -> Bounds:
    """Bound the infimum and the supremum of an output on a box, over all its entries.

    Parameters
    ----------
    function
        An SX Function, or an MX Function that expands to one.
    box
        A range for every input.
    output
        Name of the output; may be left out where there is one only.
    budget
        How many boxes may be enclosed, half of them for either extremum.
    tolerance
        Stop at a gap of this times the larger of 1 and the magnitude of the extremum.
    slopes
        Whether to use the gradient where it can be enclosed.

    Raises
    ------
    ValueError
        Where the box or the output does not fit the Function, or the budget or the tolerance is not positive.
    """
    _check_budget(budget)
    if not tolerance > 0:
        raise ValueError(f"tolerance must be positive, got {tolerance}")
    ends = box.coordinates(function)
    found = _scalars(function, box, output, (1, -1), slopes)
    name = output or next(iter(face(function).outputs))
    if isinstance(found, str):
        return Bounds(output=name, lower=-np.inf, upper=np.inf, attained_min=None, attained_max=None, boxes_used=0,
                      reason=found)  # fmt: skip
    entries, table = found

    def settled(smallest: float, best: float) -> bool:
        return math.isfinite(best) and best - smallest <= tolerance * max(1.0, abs(best))

    low = _extremum(table, ends, entries[::2], budget // 2, settled)
    high = _extremum(table, ends, entries[1::2], budget - low.used, settled)
    return Bounds(
        output=name,
        lower=low.lower,
        upper=-high.lower,
        attained_min=_attained(function, box, low, 1),
        attained_max=_attained(function, box, high, -1),
        boxes_used=low.used + high.used,
        reason=low.trouble or high.trouble,
    )


def _check_budget(budget: int) -> None:
    if budget < 2:
        raise ValueError(f"budget must be at least 2 boxes, got {budget}")


def prove_bounds(
    function: Enclosed,
    box: Box,
    output: str | None = None,
    *,
    lower: float | None = None,
    upper: float | None = None,
    strict: bool = False,
    budget: int = BUDGET,
    slopes: bool = True,
) -> Proof:
    """Prove or refute ``lower <= output <= upper`` on a box, for all entries of the output.

    Parameters
    ----------
    function, box, output, budget, slopes
        As for `bound`.
    lower, upper
        The bounds to prove; None leaves a side open.
    strict
        Whether the bounds themselves are excluded.

    Raises
    ------
    ValueError
        As for `bound`, and where no bound is given.
    """
    _check_budget(budget)
    if (lower is None and upper is None) or any(b is not None and math.isnan(b) for b in (lower, upper)):
        raise ValueError(f"expected a lower or an upper bound, got {lower} and {upper}")
    ends = box.coordinates(function)
    sides = [(1, lower)] if lower is not None else []
    sides += [(-1, -upper)] if upper is not None else []
    scalars = _scalars(function, box, output, tuple(sign for sign, _ in sides), slopes)
    if isinstance(scalars, str):
        return Proof(standing="undecided", lower=-np.inf, upper=np.inf, witness=None, boxes_used=0, reason=scalars)
    entries, table = scalars
    found = {1: -np.inf, -1: -np.inf}
    used, trouble = 0, None
    for k, (sign, level) in enumerate(sides):

        def keeps(value: float, level: float = level) -> bool:
            return value > level if strict else value >= level

        def settled(smallest: float, best: float, keeps: Callable[[float], bool] = keeps) -> bool:
            return keeps(smallest) or not keeps(best)

        search = _extremum(table, ends, entries[k :: len(sides)], (budget - used) // (len(sides) - k), settled)
        used += search.used
        found[sign] = search.lower
        if not keeps(search.best[1]):
            return Proof(standing="refuted", lower=found[1], upper=-found[-1], boxes_used=used, reason=None,
                         witness=_attained(function, box, search, sign))  # fmt: skip
        trouble = trouble or search.trouble
    return Proof(standing="proved" if trouble is None else "undecided", lower=found[1], upper=-found[-1], witness=None,
                 boxes_used=used, reason=trouble)  # fmt: skip


def prove_positive(
    function: Enclosed, box: Box, output: str | None = None, *, budget: int = BUDGET, slopes: bool = True
) -> Proof:
    """Prove or refute that every entry of an output is positive on a box; see `prove_bounds`."""
    return prove_bounds(function, box, output, lower=0.0, strict=True, budget=budget, slopes=slopes)
