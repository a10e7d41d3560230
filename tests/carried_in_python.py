"""The passes of :mod:`verification.enclosure.recursion` once more, in Python, to judge the C.

Nothing but the plant's graph is shared with it. Ranges and
slopes are those of :mod:`verification.enclosure.interval`, on parts of a box side by side; targets are closed in on by
grids of inputs; what remains is computed in fractions, without error, and rounded outwards once.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from models.array import Array
from verification.enclosure import outward
from verification.enclosure.carried import Carried, Ended, Question
from verification.enclosure.interval import evaluate
from verification.enclosure.outward import Mask, Span
from verification.enclosure.recursion import Recursion
from verification.enclosure.rewriting import Rewritten
from verification.enclosure.slopes import gradient

HALVINGS = 2  # of every box that a goal is enclosed on
GRID, ROUNDS = 33, 3  # inputs among which an end of the targets is sought, and how often anew between two of them
TRIES = 60
LEAST, HUGE = 1e-300, 1e308  # by which a search is widened at least; what stands for a gain without bound
Ends = tuple[float, float]


class _End(Exception):
    """Why a pass ends."""

    def __init__(self, why: Ended) -> None:
        super().__init__(why)
        self.why: Ended = why


@dataclass(frozen=True, kw_only=True)
class Passes:
    """A plant's graph and its goals: every next state, what the learned signal gains, and the output."""

    graph: Rewritten
    goals: tuple[int, ...]
    table: Array
    """Readings by sample, (N + 1, readings, 2)."""
    fixed: Array
    """Ranges of all coordinates but states and input, (N + 1, coordinates, 2)."""

    def carry(self, question: Question) -> Carried:
        """Carry the set of states through all samples."""
        n, nx = len(question.plan), len(question.start)
        x, y = np.full((n + 1, nx, 2), np.nan), np.full((n + 1, 2), np.nan)
        u, target, slope, after = (np.full((n, 2), np.nan) for _ in range(4))
        found, k = Carried(x, y, u, target, slope, after, "fine", -1), 0
        x[0] = question.start
        try:
            for k in range(n + 1):
                self._sample(k, question, found)
        except _End as end:
            return found._replace(ended=end.why, sample=k)
        return found

    def _sample(self, k: int, question: Question, found: Carried) -> None:
        """Fill in what is known of one sample."""
        n, nx = len(question.plan), len(question.start)
        box = np.vstack([self.fixed[k], self.table[k]])
        box[:nx] = found.x[k]
        plan = _ends(question.plan[min(k, n - 1)])
        if not np.isfinite(found.x[k]).all():
            raise _End("unbounded")
        found.y[k] = self._range(nx + 1, box, plan)
        if k == n:
            return
        if not np.isfinite(plan).all():
            raise _End("undefined")
        target = _outward(self._target(box, plan, _ends(question.wanted[k])))
        found.target[k] = target
        u = plan
        for u, slope in self._inputs(box, question, plan, target):  # noqa: B007  # the last is what is asked for
            found.slope[k] = slope
            _rising(slope, "not rising")
        found.u[k] = u
        if question.moves is not None:
            found.after[k] = _moved(u, target, slope, _ends(question.moves[k]))
        jolt = np.zeros(nx) if question.jolt is None else question.jolt
        for i in range(nx):
            low, high = self._range(i, box, u)
            found.x[k + 1, i] = -math.inf, math.inf
            if math.isfinite(jolt[i]):
                found.x[k + 1, i] = _rounded(Fraction(low) - Fraction(jolt[i]), Fraction(high) + Fraction(jolt[i]))

    def _inputs(self, box: Array, question: Question, plan: Ends, target: Ends) -> Iterator[tuple[Ends, Ends]]:
        """Return the inputs of all trials, and the slopes between them and their targets, better ones last."""
        given = question.moves is not None
        u = plan if given else target if question.settled else _hull(plan, target)
        for _ in range(TRIES):
            region = _hull(u, target)
            slope = self._slope(box, region)
            yield u, slope
            if given:
                return
            reach = Fraction(min(question.most_gain, HUGE)) * Fraction(slope[1])
            if reach <= 1:
                return
            if reach >= 2:
                break
            middle = (Fraction(target[0]) + Fraction(target[1])) / 2
            width = Fraction(target[1]) - middle
            far = max(width, width * reach / (2 - reach))
            if not question.settled:
                far = max(far, Fraction(plan[1]) - middle, middle - Fraction(plan[0]))
            u = _rounded(middle - far, middle + far)
            if region[0] <= u[0] and u[1] <= region[1]:
                yield u, slope
                return
            u = _hull(u, region)
        raise _End("gain")

    def _target(self, box: Array, plan: Ends, wanted: Ends) -> Ends:
        """Return the inputs with which the gain is what is wanted, from every point of a box."""
        gained, start = len(self.goals) - 2, plan[0] / 2 + plan[1] / 2
        there = self._range(gained, box, (start, start))
        slope = self._slope(box, (start, start))
        _rising(slope, "not rising")
        above, below = (1.01 * max(end, 0.0) / slope[0] for end in (wanted[1] - there[0], there[1] - wanted[0]))
        for _ in range(TRIES):
            region = start - below, start + above
            if not np.isfinite(region).all():
                raise _End("unbounded")
            slope = self._slope(box, region)
            _rising(slope, "unreached")
            low, high = self._gains(box, np.array(region))
            if high[0] <= wanted[0] and low[1] >= wanted[1]:
                break
            below += 0.0 if high[0] <= wanted[0] else below + LEAST
            above += 0.0 if low[1] >= wanted[1] else above + LEAST
        else:
            raise _End("unreached")
        most, least = (Fraction(wanted[1]) - Fraction(there[0])), (Fraction(wanted[0]) - Fraction(there[1]))
        first = Fraction(start) + least / Fraction(slope[0] if least < 0 else slope[1])
        last = Fraction(start) + most / Fraction(slope[0] if most > 0 else slope[1])
        by_slope = _rounded(first, last)
        at_least, at_most = region, region
        for _ in range(ROUNDS):
            inputs = np.linspace(*at_least, GRID)
            enough = np.flatnonzero(self._gains(box, inputs)[1] <= wanted[0]).max(initial=0)
            at_least = float(inputs[enough]), float(inputs[min(enough + 1, GRID - 1)])
            inputs = np.linspace(*at_most, GRID)
            enough = np.flatnonzero(self._gains(box, inputs)[0] >= wanted[1]).min(initial=GRID - 1)
            at_most = float(inputs[max(enough - 1, 0)]), float(inputs[enough])
        return max(by_slope[0], at_least[0]), min(by_slope[1], at_most[1])

    def _gains(self, box: Array, inputs: Array) -> tuple[Array, Array]:
        """Return the ends of the gain with each of some inputs."""
        low, high = (np.repeat(box[:, i : i + 1], inputs.size, axis=1) for i in range(2))
        low[self._input], high[self._input] = inputs, inputs
        return self._enclosed(self.goals[-2], low, high)

    @property
    def _input(self) -> int:
        return int(self.fixed.shape[1]) - 1

    def _with(self, box: Array, u: Ends) -> tuple[Array, Array]:
        box = box.copy()
        box[self._input] = u
        return box[:, :1], box[:, 1:]

    def _range(self, goal: int, box: Array, u: Ends) -> Ends:
        """Enclose a goal on a box with some inputs."""
        span = self._enclosed(self.goals[goal], *self._with(box, u))
        if not np.isfinite(span).all():
            raise _End("undefined")
        return float(span.lo[0]), float(span.hi[0])

    def _slope(self, box: Array, u: Ends) -> Ends:
        """Enclose the slope of the gain by the input on a box with some inputs; open where it is not known."""
        span, slopes = self._look(self.goals[-2], *self._with(box, u))
        ends = float(slopes.lo[self._input, 0]), float(slopes.hi[self._input, 0])
        return ends if np.isfinite([span.lo[0], span.hi[0], *ends]).all() else (-math.inf, math.inf)

    def _look(self, goal: int, low: Array, high: Array) -> tuple[Span, Span]:
        """Enclose a goal and its slopes on boxes, one a column."""
        values = evaluate(self.graph, low, high, [goal])
        span = Span(*(np.broadcast_to(end, low.shape[1]) for end in values[goal].span))
        return span, gradient(self.graph, goal, values, (len(low), low.shape[1]))

    def _enclosed(self, goal: int, low: Array, high: Array) -> Span:
        """Enclose a goal on boxes, each in parts: plain, monotone, and by the mean value."""
        count = low.shape[1]
        with np.errstate(all="ignore"):
            for _ in range(HALVINGS):  # where it costs most
                slopes = self._look(goal, low, high)[1]
                steep = np.maximum(np.abs(slopes.lo), np.abs(slopes.hi))
                cost = (np.where(np.isfinite(steep), steep, 1.0) * (high - low))[: self.fixed.shape[1]]
                at = cost.argmax(axis=0), np.arange(low.shape[1])
                left, right = high.copy(), low.copy()
                left[at] = right[at] = np.clip(low[at] / 2 + high[at] / 2, low[at], high[at])
                low, high = np.hstack([low, right]), np.hstack([left, high])
            span, slopes = self._look(goal, low, high)
            known = np.isfinite(slopes.lo) & np.isfinite(slopes.hi) & np.isfinite(span.lo) & np.isfinite(span.hi)
            rising, falling = known & (slopes.lo >= 0), known & (slopes.hi <= 0)
            least = np.where(falling, high, low), np.where(rising & ~falling, low, high)
            most = np.where(rising, high, low), np.where(falling & ~rising, low, high)
            lower, upper = (self._at_mean(goal, slopes, known, *part) for part in (least, most))
            parts = np.maximum(span.lo, lower.lo), np.minimum(span.hi, upper.hi)
        return Span(parts[0].reshape(-1, count).min(axis=0), parts[1].reshape(-1, count).max(axis=0))

    def _at_mean(self, goal: int, slopes: Span, known: Mask, low: Array, high: Array) -> Span:
        """Enclose a goal on boxes, plain and from the middle of what has slopes."""
        centre = np.clip(low / 2 + high / 2, low, high)
        at = Span(np.where(known, centre, low), np.where(known, centre, high))
        plain, mean = (self._plain(goal, *one) for one in ((low, high), at))
        off = outward.mul(
            Span(np.where(known, slopes.lo, 0.0), np.where(known, slopes.hi, 0.0)),
            outward.sub(Span(low, high), Span(at.lo, np.where(known, at.hi, at.lo))),
        )
        for row in np.flatnonzero((low < high).any(axis=1)):
            mean = outward.add(
                mean, Span(np.where(known[row], off.lo[row], 0.0), np.where(known[row], off.hi[row], 0.0))
            )
        return outward.meet(plain, mean)

    def _plain(self, goal: int, low: Array, high: Array) -> Span:
        return Span(*(np.broadcast_to(end, low.shape[1]) for end in evaluate(self.graph, low, high, [goal])[goal].span))


def _ends(row: Array) -> Ends:
    return float(row[0]), float(row[1])


def _hull(a: Ends, b: Ends) -> Ends:
    return min(a[0], b[0]), max(a[1], b[1])


def _outward(a: Ends) -> Ends:
    return math.nextafter(a[0], -math.inf), math.nextafter(a[1], math.inf)


def _rising(slope: Ends, otherwise: Ended) -> None:
    """Raise _End unless a slope is known and positive."""
    if not np.isfinite(slope).all():
        raise _End("undefined")
    if not slope[0] > 0:
        raise _End(otherwise)


def _rounded(low: Fraction, high: Fraction) -> Ends:
    """Return doubles around two fractions; one step off for a fraction that is none."""
    try:
        below, above = float(low), float(high)
    except OverflowError:
        raise _End("unbounded") from None
    return (
        below if Fraction(below) <= low else math.nextafter(below, -math.inf),
        above if Fraction(above) >= high else math.nextafter(above, math.inf),
    )


def _moved(u: Ends, target: Ends, slope: Ends, moves: Ends) -> Ends:
    """Return where inputs are that have moved towards their targets."""
    shares = [Fraction(min(one, HUGE)) * Fraction(steep) for one in moves for steep in slope]
    if not max(shares) < 2:
        raise _End("gain")
    corners = [(1 - s) * Fraction(a) + s * Fraction(t) for s in (min(shares), max(shares)) for a in u for t in target]
    return _rounded(min(corners), max(corners))


def slowly(recursion: Recursion, question: Question) -> Carried:
    """Carry the set of states through all samples in Python: sets may be a little wider."""
    question.fits(recursion.samples, recursion.states, recursion.disturbances, recursion.parameters)
    fixed = recursion.fixed(question)[:, : recursion.width]
    passes = Passes(graph=recursion.read.graph, goals=recursion.plain, table=recursion.table, fixed=fixed)
    return passes.carry(question)
