"""What is carried from sample to sample: row sums of slopes, and sets that hold every trial of a law that learns."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

from flint import fmpq

from verification.checker.bounds import Quantity, Shown
from verification.checker.graph import Graph
from verification.checker.interval import INF, Known, Span, hull, mul
from verification.checker.reading import Rejected, exact, need, number, record, rows, text, whole


def _up(value: float) -> float:
    return math.nextafter(value, INF)


def check_rows(statement: object, shown: Sequence[Shown | None]) -> tuple[str, dict[str, fmpq]]:
    """Check that sum over j <= k of |dy(k)/du(j)| weight^(k-j) is at most p, for k = 0..N-1.

    With |dx+/dx| <= A, |dx+/du| <= B, |dy/dx| <= C and |dy/du| <= b over a convex set, sums over earlier inputs are at
    most C R(k), where R(k+1) = weight (A R(k) + B) and R(0) = 0.
    """
    _, states, by, samples, given, most = record(statement, "bounds", "states", "input", "samples", "weight", "p")
    n, weight, p = whole(samples, 1, 10**7), number(given), number(most)
    need(weight >= 0, "the weight must be at least 0")

    def size(of: str, row: int, along: object) -> float:
        held = [one for one in shown if one and one.of == (of, row, 0) and one.by == along]
        low = [one.bound for one in held if one.side in ("above", "at least")]
        high = [one.bound for one in held if one.side in ("below", "at most")]
        need(low and high, f"the slope of {of}[{row}] along {along} must be bounded on both sides")
        return max(-max(low), min(high), 0.0)

    names = [text(one) for one in rows(states)]
    a = [[size("x_next", i, one) for one in names] for i in range(len(names))]
    b, c = [size("x_next", i, by) for i in range(len(names))], [size("y", 0, one) for one in names]
    own, reach, largest = size("y", 0, by), [0.0] * len(names), 0.0
    for _ in range(n):
        total = 0.0
        for one, far in zip(c, reach, strict=True):
            total = _up(total + _up(one * far))
        largest = max(largest, _up(total + own))
        after = []
        for line, more in zip(a, b, strict=True):
            moved = 0.0
            for one, far in zip(line, reach, strict=True):
                moved = _up(moved + _up(one * far))
            after.append(_up(weight * _up(moved + more)))
        reach = after
    need(largest <= p, f"row sums must be at most {p!r}, they come to {largest!r}")
    said = f"the sum over j <= k of |dy(k)/d{by}(j)| {weight!r}^(k-j) is at most {p!r}"
    return f"In trials of {n} samples that stay in the set {said}.", {"p": exact(most)}


class _Inner:
    """The range of what depends on one coordinate alone; the pieces between cuts are looked at once."""

    def __init__(self, graph: Graph, node: int, width: int, cuts: Mapping[int, list[float]]) -> None:
        (self.along,) = graph.depends[node]
        self._quantity, self._width = Quantity(graph, node, None), width
        self._cuts, self._known = cuts.get(self.along, []), dict[Span, Known]()

    def over(self, span: Span) -> Known:
        places = [span[0], *(cut for cut in self._cuts if span[0] < cut < span[1]), span[1]]
        return hull(*(self._piece(piece) for piece in pairwise(places)))

    def _piece(self, span: Span) -> Known:
        if span not in self._known:
            box = [(0.0, 0.0)] * self._width
            box[self.along] = span
            self._known[span] = _ends(self._quantity, box)
        return self._known[span]


def _ends(quantity: Quantity, box: Sequence[Span]) -> Known:
    low, high = (quantity.on(box, "v", low=side) for side in (True, False))
    return None if low is None or high is None else (low[0], high[1])


def _sure(span: Known, k: int, what: str) -> Span:
    if span is None:
        raise Rejected(f"sample {k}: {what} is not known to exist")
    return span


def check_funnel(statement: object, proof: object, graph: Graph) -> tuple[str, dict[str, fmpq]]:
    """Check that sets hold every trial of a law that learns u <- u + l e, e the error of the output's increment.

    The sets U(k) of inputs are given. With X(0) around every start and X(k+1) around the next states of X(k) x U(k),
    it is enough that at each sample, for all of X(k): the increment F rises in u, with slopes B in [b_low, b_high] and
    b_low > 0; F(x, t_low) <= w_low and w_high <= F(x, t_high) for ends t of U(k), so the target t that gives what is
    wanted lies between them; and an input of U(k), moved by a share l B in [0, l_max b_high] towards a target, stays in
    U(k). Then by induction, over samples and in each over trials, u_i(k) is in U(k) and x_i(k) in X(k).
    """
    names = "states", "start", "input", "sample", "others", "plan", "reference", "noise", "gain", "bands"
    states, start, by, count, others, plan, reference, noise, gain, bands = record(statement, *names)
    inputs, targets, _, cuts = record(proof, "inputs", "targets", "apart", "cuts")
    n = len(rows(plan))
    of = {name: i for i, name in enumerate(graph.coordinates)}
    need(sorted([*rows(states), by, count, *others]) == sorted(of), "every coordinate must have its part in a funnel")
    fixed = {of[name]: [_span(one) for one in rows(ends)] for name, ends in others.items()}
    need(all(len(ends) in (1, n) for ends in fixed.values()), "what else acts must have one range, or one a sample")
    width = len(of) + len(graph.inner)
    at = {of[name]: sorted(number(cut) for cut in rows(ends)) for name, ends in cuts.items() if name in of}
    inner = [_Inner(graph, node, width, at) for node in graph.inner]
    step = [Quantity(graph, graph.outputs[f"next_{i}", 0, 0], None) for i in range(len(states))]
    gained = Quantity(graph, graph.outputs["gained", 0, 0], None)
    slope = Quantity(graph, gained.node, of[by])
    l_max, spread, wanted = number(gain), 2 * exact(noise), [exact(one) for one in rows(reference, n + 1)]
    need(l_max >= 0 and spread >= 0, "gain and noise must be at least 0")
    x = [_span(one) for one in rows(start, len(states))]
    held, (b_low, b_high) = [[one] for one in x], (INF, -INF)
    for k, (first, given, goals) in enumerate(zip(plan, rows(inputs, n), rows(targets, n), strict=True)):
        u, t = _span(given), _span(goals)
        need(
            u[0] <= t[0] and t[1] <= u[1] and u[0] <= number(first) <= u[1],
            f"sample {k}: inputs must hold plan and targets",
        )
        box: list[Span] = [(0.0, 0.0)] * width
        box[of[count]] = (float(k), float(k))
        for name, span in zip(states, x, strict=True):
            box[of[name]] = span
        for i, ends in fixed.items():
            box[i] = ends[min(k, len(ends) - 1)]
        box[of[by]] = u
        for i, one in enumerate(inner):
            box[len(of) + i] = _sure(one.over(box[one.along]), k, "a part of the equations")
        b = _sure(_ends(slope, box), k, "the slope of the increment")
        share = _sure(mul((0.0, l_max), (max(b[1], 0.0), max(b[1], 0.0))), k, "the share")[1]
        need(b[0] > 0 and share < 2, f"sample {k}: the slope must be positive and l_max B below 2, got {b}")
        _moved_inside(u, t, share, k)
        rise = wanted[k + 1] - wanted[k]
        for end, upper in ((t[0], False), (t[1], True)):
            box[of[by]] = (end, end)
            span = _sure(gained.on(box, "v", low=upper), k, "the increment")
            good = exact(span[0].hex()) >= rise + spread if upper else exact(span[1].hex()) <= rise - spread
            need(good, f"sample {k}: the target must lie between {t[0]!r} and {t[1]!r}")
        box[of[by]] = u
        x = [_sure(_ends(one, box), k, "a state") for one in step]
        for line, span in zip(held, x, strict=True):
            line.append(span)
        b_low, b_high = min(b_low, b[0]), max(b_high, b[1])
    held.append([_span(one) for one in inputs])
    said = []
    for name, spans, band in zip([*states, by], held, rows(bands, len(states) + 1), strict=True):
        low, high = _span(band)
        need(all(low <= one[0] and one[1] <= high for one in spans), f"the band of {name} must hold its sets")
        said.append(f"{name} in [{low!r}, {high!r}]")
    facts = {"b_low": exact(b_low.hex()), "b_high": exact(b_high.hex()), "l_max": exact(gain)}
    return (
        f"In every trial of {n} samples or less, whatever the gain in [0, {l_max!r}] at each: {', '.join(said)}.",
        facts,
    )


def _span(given: object) -> Span:
    low, high = rows(given, 2)
    span = number(low), number(high)
    need(span[0] <= span[1], f"a range must not be empty, got {span}")
    return span


def _moved_inside(u: Span, t: Span, share: float, k: int) -> None:
    """Check that every input of u, moved by up to a share of its way to a target of t, stays in u."""
    low, high, first, last, most = (exact(one.hex()) for one in (*u, *t, max(share, 0.0)))
    good = most <= 1 or (low + most * (last - low) <= high and high + most * (first - high) >= low)
    need(good, f"sample {k}: inputs must not be moved out of their set")
