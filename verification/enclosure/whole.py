"""Whole numbers among the coordinates of a box: what depends on them alone is tabulated, number for number.

The index of a sample takes finitely many values, so a quantity that depends on it alone (a *reading*: the
coefficient that a plant has at a sample) takes finitely many too. Each is enclosed at every one of them. A search
then runs over the real coordinates and over sets of tabulated cases, and needs no interval of indices: a periodic
coefficient has as many cases as its period, and a pole between two samples is met by none.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from verification.enclosure.interval import evaluate
from verification.enclosure.outward import Array, Span
from verification.enclosure.rewriting import Quantity, Rewritten
from workbench.graph.operations import INPUT

LIMIT = 2**16  # cases that are told apart: where there are more, neighbouring whole numbers share an enclosure
Places = NDArray[np.int64]
Flags = NDArray[np.bool_]
_CONSTANT, _WHOLE, _MIXED = 0, 1, 2


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """A graph whose readings are coordinates of their own, behind those of the box, and the cases that there are.

    Parameters
    ----------
    graph
        The graph; no node of it depends on a whole coordinate but through a reading.
    first
        How many coordinates the box has: that of the first reading.
    whole
        The rows of the box's coordinates that are whole.
    lower, upper
        What encloses each reading in each case, (readings, cases); infinite where it has no value.
    at_lower, at_upper
        The same at the whole numbers that stand for the case.
    numbers
        These whole numbers, (whole coordinates, cases).
    """

    graph: Rewritten
    first: int
    whole: Places
    lower: Array
    upper: Array
    at_lower: Array
    at_upper: Array
    numbers: Array

    @property
    def readings(self) -> int:
        """The number of readings."""
        return len(self.lower)

    @property
    def cases(self) -> int:
        """The number of cases."""
        return len(self.lower.T)

    def at(self, points: Array, cases: Places) -> tuple[Array, Array]:
        """Return the ends of coordinates at points of the box, each in a case; both are one array where that fits."""
        exact = points.copy()
        exact[self.whole] = self.numbers[:, cases]
        if not self.readings:
            return exact, exact
        return np.vstack([exact, self.at_lower[:, cases]]), np.vstack([exact, self.at_upper[:, cases]])


def _kinds(graph: Rewritten, targets: tuple[int, ...], whole: Flags) -> dict[int, int]:
    """Say of every node that the targets need on what it depends."""
    kinds: dict[int, int] = {}
    for k in graph.ancestors(targets):
        node = graph.nodes[k]
        if node.op == INPUT:
            kinds[k] = _WHOLE if whole[node.coordinate] else _MIXED
        else:
            kinds[k] = max((kinds[arg] for arg in node.args), default=_CONSTANT)
    return kinds


def _cases(lower: Array, upper: Array) -> tuple[Array, Array]:
    """Return the ends of the cases of some whole ranges: of every combination of numbers, if there are not too many."""
    counts = upper - lower + 1
    most = np.inf if np.prod(counts) <= LIMIT else max(int(LIMIT ** (1 / counts.size)), 1)
    pieces = []
    for start, count in zip(lower, counts, strict=True):
        number = int(min(count, most))
        pieces.append(start + np.floor(np.arange(number + 1) * count / number))
    low = np.meshgrid(*(cuts[:-1] for cuts in pieces), indexing="ij")
    high = np.meshgrid(*(cuts[1:] - 1 for cuts in pieces), indexing="ij")
    return np.stack([one.ravel() for one in low]), np.stack([one.ravel() for one in high])


def tabulated(graph: Rewritten, lower: Array, upper: Array, whole: Flags, targets: tuple[int, ...]) -> Table:
    """Tabulate what the targets read of the whole coordinates of a box; cases with the same readings are one."""
    kinds = _kinds(graph, targets, whole)
    read = set(targets).union(*(graph.nodes[k].args for k, kind in kinds.items() if kind == _MIXED))
    readings = [k for k, kind in kinds.items() if kind == _WHOLE and k in read]
    places = np.flatnonzero(whole)
    used = whole & graph.coordinates(tuple(readings), lower.size)
    if not readings or not used.any():
        none = np.zeros((0, 1))
        return Table(graph=graph, first=lower.size, whole=places, lower=none, upper=none, at_lower=none,
                     at_upper=none, numbers=lower[places, None])  # fmt: skip
    low_cases, high_cases = _cases(lower[used], upper[used])
    low = np.repeat(lower[:, None], low_cases.shape[1], axis=1)
    high = low.copy()
    low[used], high[used] = low_cases, high_cases
    at = _enclosed(graph, low, low, readings)
    over = at if np.array_equal(low, high) else _enclosed(graph, low, high, readings)
    _, kept = np.unique(np.vstack([*over, *at]), axis=1, return_index=True)
    kept.sort()
    nodes = list(graph.nodes)
    for row, k in enumerate(readings):
        nodes[k] = Quantity(INPUT, coordinate=lower.size + row, origin=nodes[k].origin)
    return Table(
        graph=replace(graph, nodes=tuple(nodes)),
        first=lower.size,
        whole=places,
        lower=over.lo[:, kept],
        upper=over.hi[:, kept],
        at_lower=at.lo[:, kept],
        at_upper=at.hi[:, kept],
        numbers=low[places][:, kept],
    )


class Read(NamedTuple):
    """A graph whose readings are coordinates of their own, behind those of the box, and what encloses them."""

    graph: Rewritten
    lower: Array
    """(readings, numbers); infinite where a reading has no value."""
    upper: Array


def readings_at(graph: Rewritten, targets: tuple[int, ...], whole: Flags, numbers: Array) -> Read:
    """Tabulate what the targets read of one whole coordinate, enclosed at each of some numbers, in their order."""
    kinds = _kinds(graph, targets, whole)
    read = set(targets).union(*(graph.nodes[k].args for k, kind in kinds.items() if kind == _MIXED))
    readings = [k for k, kind in kinds.items() if kind == _WHOLE and k in read]
    if not readings:
        none = np.zeros((0, numbers.size))
        return Read(graph, none, none)
    at = np.zeros((whole.size, numbers.size))
    at[whole] = numbers
    found = _enclosed(graph, at, at, readings)
    nodes = list(graph.nodes)
    for row, k in enumerate(readings):
        nodes[k] = Quantity(INPUT, coordinate=whole.size + row, origin=nodes[k].origin)
    return Read(replace(graph, nodes=tuple(nodes)), found.lo, found.hi)


def _enclosed(graph: Rewritten, low: Array, high: Array, nodes: list[int]) -> Span:
    """Enclose nodes on many boxes, one row a node; infinite where one has no value."""
    found = evaluate(graph, low, low if np.array_equal(low, high) else high, nodes)
    spans = [found[k].span for k in nodes]
    return Span(*(np.stack([np.broadcast_to(end, low.shape[1]) for end in ends]) for ends in zip(*spans, strict=True)))


class Sets:
    """Sets of cases, by number: below the number of cases those of one case each, then those that were asked for."""

    def __init__(self, table: Table) -> None:
        self.table = table
        self._members: list[Places] = []
        self._ends: list[tuple[Array, Array]] = []
        self._halves: dict[tuple[int, int], tuple[int, int]] = {}
        self.scale = self._widths()
        self.all = self.of(np.arange(table.cases))

    def _widths(self) -> Array:
        """Return how far apart the values of each reading are that exist, one where they are not."""
        known = np.isfinite(self.table.lower) & np.isfinite(self.table.upper)
        low = np.where(known, self.table.lower, np.inf).min(axis=1, initial=np.inf)
        high = np.where(known, self.table.upper, -np.inf).max(axis=1, initial=-np.inf)
        with np.errstate(all="ignore"):
            return np.where(np.isfinite(high - low) & (high > low), high - low, 1.0)

    def single(self) -> Places:
        """Return the sets of one case each, all of them."""
        return np.arange(self.table.cases)

    def of(self, members: Places) -> int:
        """Return the set of some cases."""
        if members.size == 1:
            return int(members[0])
        self._members.append(members)
        self._ends.append((self.table.lower[:, members].min(axis=1), self.table.upper[:, members].max(axis=1)))
        return self.table.cases + len(self._members) - 1

    def members(self, which: int) -> Places:
        """Return the cases of a set."""
        return np.array([which]) if which < self.table.cases else self._members[which - self.table.cases]

    def divisible(self, sets: Places) -> Flags:
        """Say which sets hold more than one case."""
        return np.asarray(sets >= self.table.cases)

    def ends(self, sets: Places) -> tuple[Array, Array]:
        """Return what encloses the readings on sets, (readings, sets)."""
        alone = np.where(self.divisible(sets), 0, sets)
        lower, upper = self.table.lower[:, alone], self.table.upper[:, alone]
        for i in np.flatnonzero(self.divisible(sets)):
            lower[:, i], upper[:, i] = self._ends[sets[i] - self.table.cases]
        return lower, upper

    def columns(self, lower: Array, upper: Array, sets: Places) -> tuple[Array, Array]:
        """Return the ends of a box of real coordinates with sets, one column each, readings and all."""
        reads = self.ends(sets)
        low = np.vstack([np.repeat(lower[:, None], sets.size, axis=1), reads[0]])
        return low, np.vstack([np.repeat(upper[:, None], sets.size, axis=1), reads[1]])

    def weights(self, sets: Places) -> Array:
        """Return how wide each reading is on sets, as a share of its range; zero where nothing is left to split."""
        lower, upper = self.ends(sets)
        with np.errstate(all="ignore"):
            share = (upper - lower) / self.scale[:, None]
        return np.where(self.divisible(sets), np.where(np.isfinite(share), share, 2.0), 0.0)

    def some(self, sets: Places) -> Places:
        """Return a case of each set."""
        found = sets.copy()
        for i in np.flatnonzero(self.divisible(sets)):
            members = self.members(int(sets[i]))
            found[i] = members[members.size // 2]
        return found

    def least(self, sets: Places, rows: Places, largest: Flags) -> Places:
        """Return the case of each set in which a reading of it is smallest, or largest."""
        found, table = sets.copy(), self.table
        for i in np.flatnonzero(self.divisible(sets)):
            members, row = self.members(int(sets[i])), rows[i]
            place = table.upper[row, members].argmax() if largest[i] else table.lower[row, members].argmin()
            found[i] = members[place]
        return found

    def split(self, which: int, row: int) -> tuple[int, int]:
        """Return the halves of a set of several cases, apart by a reading: those without a value, or the smaller."""
        key = which, row
        if key not in self._halves:
            members = self.members(which)
            low, high = self.table.lower[row, members], self.table.upper[row, members]
            known = np.isfinite(low) & np.isfinite(high)
            below = known
            if known.all():
                middle = low / 2 + high / 2
                below = middle <= middle.min() / 2 + middle.max() / 2
            if below.all() or not below.any():
                below = np.arange(members.size) < members.size // 2
            self._halves[key] = self.of(members[below]), self.of(members[~below])
        return self._halves[key]
