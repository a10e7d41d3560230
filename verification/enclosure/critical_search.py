"""Whether a box meets the critical set of one operation: by splitting, and by points where it shows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from verification.enclosure import outward
from verification.enclosure.box import Box
from verification.enclosure.branch_and_bound import halved
from verification.enclosure.face import Enclosed
from verification.enclosure.guards import Condition, Value, restricted
from verification.enclosure.interval import evaluate
from verification.enclosure.outward import Array, Mask, Span
from verification.enclosure.outward_logic import truth
from verification.enclosure.reach import NonsmoothOperation, Reach, Reachable
from verification.enclosure.whole import Places, Sets, Table
from workbench.graph.operations import Rule

_BATCH = 64  # boxes in which points are looked at
_EACH = 4  # boxes more for every case that is not clear as a whole


def _clear(rule: Rule, level: Span) -> Mask:
    """Say on which boxes the critical set is provably missed."""
    if rule in ("nonpositive", "negative"):
        return np.asarray(level.lo > 0 if rule == "nonpositive" else level.lo >= 0)
    if rule == "zero":
        return ~outward.has_zero(level)
    return np.asarray(np.ceil(level.lo) > np.floor(level.hi))


@dataclass(frozen=True, kw_only=True)
class Question:
    """One operation over one box.

    Parameters
    ----------
    function, whole
        Whose operation it is, and which of its inputs are whole: what the point of an answer is made from.
    operation, rule
        What is asked about, and what its level must do to be critical.
    table
        The graph of the level, with what it reads of whole numbers.
    level
        The deciding argument.
    continuous
        Whether the level is known to be continuous in the real coordinates.
    conditions
        Where the operation counts: nodes that hold there, or do not.
    inside
        Where a level of zero is no break as long as the level stays on one side of it: ``above`` or ``below``.
    """

    function: Enclosed
    whole: tuple[str, ...]
    operation: NonsmoothOperation
    rule: Rule
    table: Table
    level: int
    continuous: bool
    conditions: tuple[Condition, ...] = ()
    inside: str = "both"

    @cached_property
    def _needed(self) -> frozenset[int]:
        """What the level depends on, if any condition may tell something about it."""
        return frozenset(self.table.graph.ancestors((self.level,)) if self.conditions else ())

    def levels(self, lower: Array, upper: Array) -> Span:
        """Enclose the deciding argument on many boxes."""
        low, high = evaluate(self.table.graph, lower, upper, [self.level])[self.level].span
        return Span(np.broadcast_to(low, lower.shape[1]), np.broadcast_to(high, lower.shape[1]))

    def counts(self, lower: Array, upper: Array) -> Mask:
        """Say on which boxes the operation surely counts, everywhere on them."""
        surely = np.ones(lower.shape[1], dtype=bool)
        if self.conditions:
            values = evaluate(self.table.graph, lower, upper, [condition for condition, _ in self.conditions])
            for condition, holds in self.conditions:
                span, fault = values[condition]
                known = truth(span)
                surely = surely & ((known.lo == 1) if holds else (known.hi == 0))
                if fault is not None:
                    surely = surely & (fault < 0)
        return surely

    def within(self, lower: Array, upper: Array) -> tuple[Value, NDArray[np.int64]]:
        """Enclose the deciding argument where the operation counts; the second says to which box each part belongs."""
        graph = self.table.graph
        with np.errstate(all="ignore"):
            parts = restricted(graph, lower, upper, self.conditions, evaluate, wanted=self._needed)
        return evaluate(graph, parts.lower, parts.upper, [self.level], parts.held)[self.level], parts.owner

    def answer(self, reachable: Reachable, why: str, at: Array | None = None) -> Reach:
        """Return the finding."""
        point = None if at is None else Box.from_coordinates(self.function, at, at, self.whole)
        return Reach(operation=self.operation, reachable=reachable, point=point, reason=why)

    def exists(self, lower: Array, upper: Array) -> bool:
        """Say whether the deciding argument has a value everywhere on the box."""
        sets = Sets(self.table)
        low, high = sets.columns(lower, upper, sets.single())
        (_, fault), _ = self.within(low, high)
        return fault is None or not np.any(fault >= 0)

    def unclear(self, lower: Array, upper: Array) -> Mask:
        """Say on which boxes the critical set may be met."""
        (span, _), owner = self.within(lower, upper)
        met = np.zeros(lower.shape[1], dtype=bool)
        met[owner[~np.broadcast_to(_clear(self.rule, span), owner.size)]] = True
        return met

    def one_sided(self, lower: Array, upper: Array) -> bool:
        """Say whether the level stays on the side on which nothing breaks off, on the whole box."""
        if self.inside == "both":
            return False
        sets = Sets(self.table)
        (span, fault), _ = self.within(*sets.columns(lower, upper, sets.single()))
        exists = fault is None or not np.any(fault >= 0)
        return exists and bool(np.all(span.lo >= 0) if self.inside == "above" else np.all(span.hi <= 0))

    def search(self, lower: Array, upper: Array, budget: int) -> Reach:
        """Split the box until the critical set is missed everywhere, met at a point, or the budget is spent."""
        if self.one_sided(lower, upper):
            return self.answer("no", "nothing breaks off on the side of the breakpoint on which the box lies")
        sets, first = Sets(self.table), self.table.first
        deciding = (self.level, *(condition for condition, _ in self.conditions))
        matters = self.table.graph.coordinates(deciding, first) & (upper > lower)
        held = np.array([sets.all])
        low, high = sets.columns(lower, upper, held)
        if self.unclear(low, high).any():  # every case by itself is a first partition, and no part of the budget
            held = sets.single()
            low, high = sets.columns(lower, upper, held)
            budget += _EACH * int(self.unclear(low, high).sum())
        scale = np.where(matters, upper - lower, np.inf)
        points, cases, levels = np.zeros((first, 0)), np.zeros(0, dtype=np.int64), Span(np.zeros(0), np.zeros(0))
        used = 1 - held.size
        while low.shape[1]:
            used += low.shape[1]
            keep = self.unclear(low, high)
            low, high, held = low[:, keep], high[:, keep], held[keep]
            if not low.shape[1]:
                break
            fresh, case = self._tried(low[:first, :_BATCH], high[:first, :_BATCH], sets.some(held[:_BATCH]))
            counting = self.counts(*self.table.at(fresh, case))
            fresh, case = fresh[:, counting], case[counting]
            points, cases = np.hstack([points, fresh]), np.concatenate([cases, case])
            found = self.levels(*self.table.at(fresh, case))
            levels = Span(*map(np.concatenate, zip(levels, found, strict=True)))
            hit = self._met(points, cases, levels, lower, upper)
            if hit is not None:
                return hit
            if used + 2 * low.shape[1] > budget:
                return self.answer("unknown", f"not excluded with a budget of {budget} boxes")
            weight = np.vstack([(high - low)[:first] / scale[:, None], sets.weights(held)])
            if not np.any(weight > 0):
                return self.answer("unknown", "not excluded at the resolution of doubles")
            low, high, held, splittable = halved(sets, low, high, held, weight.argmax(axis=0))
            if not splittable.all():
                return self.answer("unknown", "not excluded at the resolution of doubles")
        return self.answer("no", f"excluded on {used + sets.single().size} boxes")

    def _tried(self, low: Array, high: Array, cases: Places) -> tuple[Array, Places]:
        """Return points of boxes at which the level is looked at: middles, corners, and what is nearest to zero."""
        middle = np.clip(low / 2 + high / 2, low, high)
        case = np.tile(cases, 4)
        points = np.hstack([middle, low, high, np.clip(0.0, low, high)])
        return self.table.at(points, case)[0][: self.table.first], case

    def _room(self, points: Array, lower: Array, upper: Array) -> Array:
        """Return how far points stay away from the box's ends, as a share of its widths: inner points tell more."""
        wide = lower < upper
        wide[self.table.whole] = False
        low, high = lower[wide, None], upper[wide, None]
        share = np.minimum(points[wide] - low, high - points[wide]) / (high - low)
        return np.asarray(share.min(axis=0, initial=1.0))

    def _met(self, points: Array, cases: Places, levels: Span, lower: Array, upper: Array) -> Reach | None:
        """Return the finding "yes" if the points show it."""
        if self.rule in ("nonpositive", "negative"):
            hits = np.flatnonzero(levels.hi <= 0 if self.rule == "nonpositive" else levels.hi < 0)
            return self.answer("yes", "critical at the point", points[:, hits[0]]) if hits.size else None
        known = np.flatnonzero(np.isfinite(levels.lo) & np.isfinite(levels.hi))
        points, cases, levels = points[:, known], cases[known], Span(levels.lo[known], levels.hi[known])
        exact = np.flatnonzero((levels.lo == levels.hi) & (levels.lo == np.rint(levels.lo)))
        if self.rule == "zero":
            exact = exact[levels.lo[exact] == 0]
        hit = None
        if exact.size:
            what = "the argument is an integer" if self.rule == "integer" else "the deciding argument is zero"
            room = self._room(points[:, exact], lower, upper)
            hit = self.answer("yes", f"{what} at the point", points[:, exact[room.argmax()]])
            if room.max() > 0:
                return hit
        if not (known.size and self.continuous):
            return hit
        apart, group = np.unique(cases, return_inverse=True)  # a level is continuous within a case
        offset = np.zeros(apart.size)
        if self.rule == "integer":
            least = np.full(apart.size, np.inf)
            np.minimum.at(least, group, levels.lo)
            offset = np.ceil(least)
        below, above = levels.hi < offset[group], levels.lo > offset[group]
        both = np.intersect1d(group[below], group[above])
        if not both.size:
            return hit
        mine = group == both[0]
        start, end = np.flatnonzero(below & mine)[0], np.flatnonzero(above & mine)[0]
        found = self._between(points[:, start], points[:, end], int(apart[both[0]]), float(offset[both[0]]))
        return hit if found is None else found

    def _between(self, below: Array, above: Array, case: int, offset: float) -> Reach | None:
        """Halve the way between two points of opposite sign; a continuous argument is critical in between."""
        for _ in range(1100):  # a double is halved at most this often
            middle = below / 2 + above / 2
            middle[self.table.whole] = below[self.table.whole]
            if np.all((middle == below) | (middle == above)):
                break
            level = self.levels(*self.table.at(middle[:, None], np.array([case])))
            if level.hi[0] < offset:
                below = middle
            elif level.lo[0] > offset:
                above = middle
            elif level.lo[0] == level.hi[0] and self.counts(*self.table.at(middle[:, None], np.array([case]))).all():
                return self.answer("yes", "the deciding argument is critical at the point", middle)
            else:
                break
        gap = float(np.max(np.abs(above - below), initial=0.0))
        ends = [self.table.at(end[:, None], np.array([case])) for end in (below, above)]
        around = np.minimum(ends[0][0], ends[1][0]), np.maximum(ends[0][1], ends[1][1])
        if not self.counts(*around).all():
            return None  # between the two points the operation may not count
        middle = below / 2 + above / 2
        middle[self.table.whole] = below[self.table.whole]
        return self.answer("yes", f"the deciding argument changes sign within {gap!r} of the point", middle)
