"""What is carried from sample to sample: row sums of slopes, and sets that hold every trial of a law that learns."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

from flint import fmpq

from verification.checker.bounds import Quantity, Shown, ends
from verification.checker.graph import Graph
from verification.checker.interval import INF, Known, Span, hull
from verification.checker.reading import Json, Rejected, exact, need, number, record, rows, whole


def _up(value: float) -> float:
    return math.nextafter(value, INF)


def row_sums(shown: Sequence[Shown | None], graph: Graph, samples: int, weight: float) -> Span:
    """Return bounds of sum over j < k, and over j <= k, of |dy(k)/du(j)| weight^(k-j), for k = 0..N-1.

    With |dx+/dx| <= A, |dx+/du| <= B, |dy/dx| <= C and |dy/du| <= b over a convex set, sums over earlier inputs are at
    most C R(k), where R(k+1) = weight (A R(k) + B) and R(0) = 0; u is the first input.
    """

    def size(of: str, row: int, along: str) -> float:
        held = ends(shown, (of, row, 0), along)
        need(len(held) == 2, f"the slope of {of}[{row}] along {along} must be bounded on both sides")
        return _up(max(-float(held["low"]), float(held["high"]), 0.0))

    states, (by, *_) = graph.ports["x"], graph.ports["u"]
    results = [("y", 0, 0), *(("x_next", i, 0) for i in range(len(states)))]
    moved = {graph.coordinates[i] for of in results for i in graph.depends[graph.outputs[of]]}
    moved -= {*states, by, *graph.ports["k"], *graph.ports["w"], *graph.ports.get("later_w", ())}
    need(not moved and len(graph.outputs) == len(results), f"nothing else may move the output, got {moved}")
    a = [[size("x_next", i, one) for one in states] for i in range(len(states))]
    b, c = [size("x_next", i, by) for i in range(len(states))], [size("y", 0, one) for one in states]
    own, reach, largest = size("y", 0, by), [0.0] * len(states), 0.0
    for _ in range(samples):
        largest = max(largest, _product(c, reach))
        reach = [_up(weight * _up(_product(line, reach) + more)) for line, more in zip(a, b, strict=True)]
    return largest, _up(largest + own)


def _product(line: Sequence[float], reach: Sequence[float]) -> float:
    total = 0.0
    for one, far in zip(line, reach, strict=True):
        total = _up(total + _up(one * far))
    return total


def check_rows(statement: object, shown: Sequence[Shown | None], graph: Graph) -> tuple[str, dict[str, fmpq]]:
    """Check that row sums are at most r (over earlier samples) and p (over all)."""
    _, samples, given, less, most = record(statement, "bounds", "samples", "weight", "r", "p")
    n, weight, r, p = whole(samples, 1, 10**7), number(given), number(less), number(most)
    need(weight > 0 and n * (len(graph.ports["x"]) + 1) ** 2 <= 10**7, "too many samples, or a weight of 0 or less")
    earlier, every = row_sums(shown, graph, n, weight)
    need(earlier <= r and every <= p, f"row sums must be smaller, they come to {earlier!r} and {every!r}")
    said = f"the sum of |dy(k)/du(j)| {weight!r}^(k-j) is at most {r!r} over j < k, and {p!r} over j <= k"
    facts = {"r": exact(less), "p": exact(most)} | ends(shown, ("y", 0, 0), graph.ports["u"][0])
    return f"In trials of {n} samples that stay in the set {said}.", facts


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
    low, high = (quantity.tight(box, low=side) for side in (True, False))
    return None if low is None or high is None else (low[0], high[1])


def _sure(span: Known, k: int, what: str) -> Span:
    if span is None:
        raise Rejected(f"sample {k}: {what} is not known to exist")
    return span


class Sets:
    """What is carried from sample to sample of a funnel: the set of states ``x``, from the graph of one step.

    ``cuts`` says where the ranges of what depends on one coordinate alone are cut.
    """

    def __init__(self, statement: object, cuts: dict[str, object], graph: Graph) -> None:
        names = "states", "start", "input", "sample", "others", "plan", "reference", "noise", "gain", "bands"
        states, start, by, count, others, plan, reference, noise, gain, self.bands = record(statement, *names)
        self.of = {name: i for i, name in enumerate(graph.coordinates)}
        need(sorted([*rows(states), by, count, *others]) == sorted(self.of), "every coordinate must have its part")
        need(states == graph.ports["x"], f"the states must be those of the graph, {graph.ports['x']}")
        self.states, self.by, self.count, self.n = states, self.of[by], self.of[count], len(rows(plan))
        self.others = {self.of[name]: [span_of(one) for one in rows(ends)] for name, ends in others.items()}
        need(all(len(one) in (1, self.n) for one in self.others.values()), "ranges must be one, or one a sample")
        self.plan, self.l_max, self.spread = [number(one) for one in plan], number(gain), 2 * exact(noise)
        need(self.l_max >= 0 and self.spread >= 0, "gain and noise must be at least 0")
        wanted = [exact(one) for one in rows(reference, self.n + 1)]
        self.rise = [after - before for before, after in pairwise(wanted)]
        self.x = [span_of(one) for one in rows(start, len(states))]
        self.width = len(self.of) + len(graph.inner)
        at = {self.of[name]: sorted(number(cut) for cut in rows(given)) for name, given in cuts.items()}
        self.inner = [_Inner(graph, node, self.width, at) for node in graph.inner]
        need(all(one.along != self.by for one in self.inner), "what depends on the input must not stand apart")
        self.next = [Quantity(graph, graph.outputs[f"next_{i}", 0, 0], None) for i in range(len(states))]
        self.gained = Quantity(graph, graph.outputs["gained", 0, 0], None)
        self.slope = Quantity(graph, self.gained.node, self.by)

    def box(self, k: int, u: Span) -> list[Span]:
        """Return the states that are held at a sample, with inputs and all that acts besides."""
        box: list[Span] = [(0.0, 0.0)] * self.width
        for name, span in zip(self.states, self.x, strict=True):
            box[self.of[name]] = span
        for i, given in self.others.items():
            box[i] = given[min(k, len(given) - 1)]
        box[self.count], box[self.by] = (float(k), float(k)), u
        for i, one in enumerate(self.inner):
            box[len(self.of) + i] = _sure(one.over(box[one.along]), k, "a part of the equations")
        return box

    def beyond(self, box: list[Span], k: int, end: float, *, upper: bool) -> bool:
        """Tell whether an input gives no less (or no more) than what is wanted, from every state of a box."""
        box = list(box)
        box[self.by] = (end, end)
        low, high = (exact(one.hex()) for one in _sure(self.gained.tight(box, low=upper), k, "the increment"))
        return bool(low >= self.rise[k] + self.spread if upper else high <= self.rise[k] - self.spread)

    def step(self, k: int, u: Span, t: Span) -> Span:
        """Go on to the next sample, with inputs u and targets t; return the slope of the increment by the input."""
        need(u[0] <= t[0] and t[1] <= u[1] and u[0] <= self.plan[k] <= u[1], f"sample {k}: plan and targets leave u")
        box = self.box(k, u)
        b = _sure(_ends(self.slope, box), k, "the slope of the increment")
        need(b[0] > 0, f"sample {k}: the increment must rise with the input, its slope is {b}")
        low, high, first, last, most = (exact(one.hex()) for one in (*u, *t, b[1]))
        most *= exact(self.l_max.hex())
        good = most <= 1 or (most < 2 and low + most * (last - low) <= high and high + most * (first - high) >= low)
        need(good, f"sample {k}: inputs must not be moved out of their set")
        for end, upper in ((t[0], False), (t[1], True)):
            need(self.beyond(box, k, end, upper=upper), f"sample {k}: a target must lie between {t[0]!r} and {t[1]!r}")
        self.x = [_sure(_ends(one, box), k, "a state") for one in self.next]
        return b


def check_funnel(statement: Json, proof: object, graph: Graph) -> tuple[str, dict[str, fmpq]]:
    """Check that sets hold every trial of a law that learns u <- u + l e, e the error of the output's increment.

    The sets U(k) of inputs are given. With X(0) around every start and X(k+1) around the next states of X(k) x U(k),
    it is enough that at each sample, for all of X(k): the increment F rises in u, with slopes B in [b_low, b_high] and
    b_low > 0; F(x, t_low) <= w_low and w_high <= F(x, t_high) for ends t of U(k), so the target t that gives what is
    wanted lies between them; and an input of U(k), moved by a share l B in [0, l_max b_high] towards a target, stays in
    U(k). Then by induction, over samples and in each over trials, u_i(k) is in U(k) and x_i(k) in X(k).
    """
    inputs, targets, _, cuts = record(proof, "inputs", "targets", "apart", "cuts")
    sets = Sets(statement, cuts, graph)
    held, slopes = [[one] for one in sets.x], []
    used = [span_of(one) for one in rows(inputs, sets.n)]
    for k, (u, given) in enumerate(zip(used, rows(targets, sets.n), strict=True)):
        slopes.append(sets.step(k, u, span_of(given)))
        for line, span in zip(held, sets.x, strict=True):
            line.append(span)
    said = []
    names = [*sets.states, graph.coordinates[sets.by]]
    for name, spans, band in zip(names, [*held, used], rows(sets.bands, len(names)), strict=True):
        low, high = span_of(band)
        need(all(low <= one[0] and one[1] <= high for one in spans), f"the band of {name} must hold its sets")
        said.append(f"{name} in [{low!r}, {high!r}]")
    facts = {"b_low": min(one[0] for one in slopes), "b_high": max(one[1] for one in slopes), "l_max": sets.l_max}
    around = [(f"first {name}", [span_of(one)]) for name, one in zip(sets.states, statement["start"], strict=True)]
    around += [(graph.coordinates[i], given) for i, given in sets.others.items()]
    of = ", ".join(f"{name} in [{min(one)[0]!r}, {max(e for _, e in one)!r}]" for name, one in around)
    words = f"with {of} and noise of at most {sets.spread / 2}, whatever the gain in [0, {sets.l_max!r}] at each sample"
    return f"In every trial of {sets.n} samples or less, {words} and trial: {', '.join(said)}.", {
        name: exact(one.hex()) for name, one in facts.items()
    }


def span_of(given: object) -> Span:
    """Return a range that is not empty."""
    low, high = rows(given, 2)
    span = number(low), number(high)
    need(span[0] <= span[1], f"a range must not be empty, got {span}")
    return span
