"""Two trials next to each other on the two sides of a jump: what refutes that differences of outputs have a bound.

A plant that jumps with its input, or with a state that the input moves, has no bound of the output's difference by the
inputs' difference: two plans, however near to each other, that pass the jump on different sides give outputs that are
apart by it. Such plans are looked for along lines between plans. Where a switch of the equations stands on different
sides at the two ends of a line, the line is halved until no plan lies between its ends.

A steep slope that is continuous looks alike from afar. So two things are asked besides: that the graph of the equations
provably breaks off there, and that the difference of the outputs stays while that of the plans goes to zero.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import casadi as ca
import numpy as np

from models.array import Array
from models.plant import Plant
from verification.checks.delayed import delayed_box, delayed_graph
from verification.enclosure.box import Box
from verification.enclosure.breaks import Break, break_at
from verification.enclosure.smoothness import continuous_on
from workbench.evidence.ppd import Evidence, learned_signal
from workbench.graph import Builder, Entry, Graph, Result, Unreadable, call
from workbench.graph.operations import Rule
from workbench.graph.smooth import critical
from workbench.graph.symbolic import function

NEAR = 1e-9
"""How far round the two trials the equations are asked whether they break off, of the larger of 1 and the size."""
STEPS = (2.0**-20, 2.0**-30, 2.0**-40)
"""Shares of a line by which plans that lie further apart differ."""
STAYS = 0.9
"""Share of a difference that has to be left when plans come together, for it to be a jump's."""
GROWS = 8.0
"""By how much the ratio has to grow from one pair of plans to the next."""
LINES = 12
"""Lines of each kind that are looked along at most."""
ROUNDED = 1e3
"""Times what a double rounds of the largest output: a difference below is not seen."""
PAIRS, FEW = 12, 1
"""Lines along which pairs of plans are made at most, for a switch that is seen to break off and for others."""
HALVINGS = 200
"""More than it takes to come from the ends of a line to a unit in the last place of them."""


class Across(NamedTuple):
    """Two plans that pass a jump on different sides, with pairs further apart before them."""

    trial: int
    """Whose start and disturbance both have."""
    sample: int
    """At which the learned signals are apart."""
    plans: tuple[Array, Array]
    du: list[float]
    """The largest difference of inputs that came before, falling from pair to pair."""
    ratios: list[float]
    """That of the signals over it."""
    apart: float
    """By how much the signals are apart at the last pair."""
    broken: Break
    """How the equations break off there."""
    switch: str


@dataclass(frozen=True, kw_only=True)
class Switch:
    """What jumps in one row of a plant's equations."""

    row: Graph
    """The row, its only output."""
    level: ca.Function
    """What decides."""
    rule: Rule
    expression: str
    breaks: bool
    """Whether the row is seen to break off somewhere where it switches."""

    def sides(self, x: Array, plan: Array, w: Array) -> Array:
        """Return for the steps of a run numbers that are the same as long as nothing switches, NaN without a level."""
        n = plan.size
        none = np.zeros((1, 0)), np.zeros((w.shape[0], 0))
        level = self.level.map(n)(x[:, :n], plan[None, :], w, np.arange(n), *none).full().ravel()
        with np.errstate(invalid="ignore"):
            side = np.floor(level) + np.ceil(level) if self.rule == "integer" else np.sign(level)
        return np.where(np.isfinite(level), side, np.nan)


class Runs:
    """Runs of a plant over plans, from one state and with one disturbance."""

    def __init__(self, plant: Plant, x0: Array, w: Array) -> None:
        at = plant.symbols()
        n = w.shape[1]
        self.x0, self.w, self.samples = x0, w, n
        self._fold = ca.Function("step", list(at.values()), [plant.next_state(**at)]).mapaccum("runs", n)
        self._output = plant.output_function().map(n + 1)

    def of(self, plan: Array) -> tuple[Array, Array]:
        """Return states (nx, N + 1) and the output (N + 1,)."""
        states = self._fold(self.x0, plan[None, :], self.w, np.arange(self.samples)).full()
        x = np.column_stack([self.x0, states])
        return x, self._output(x).full()[0]

    def side(self, switch: Switch, plan: Array, k: int) -> float:
        """Return on which side a switch stands at a sample."""
        return float(switch.sides(self.of(plan)[0], plan, self.w)[k])

    def met(self, x: Array, plan: Array, k: int) -> dict[str, Array]:
        """Return what the step at a sample is made with, of a run that is known."""
        none = {"later_u": np.zeros((1, 0)), "later_w": np.zeros((self.w.shape[0], 0))}
        return {"x": x[:, k], "u": plan[k : k + 1], "w": self.w[:, k], "k": np.array([float(k)]), **none}


def switches(plant: Plant, box: Box) -> list[Switch]:
    """Return what may jump in the next state or output somewhere in a box."""
    try:
        step = delayed_graph(plant, 1)
    except Unreadable:
        return []
    inner, found = delayed_box(box, 1), dict[tuple[str, int], Switch]()
    for place, entry in enumerate(entry for result in step.outputs for entry in result.entries):
        row = replace(step, outputs=(Result("f", (1, 1), (Entry(0, 0, entry.node),)),)).only("f")
        whole = continuous_on(row, inner)
        for reach in whole.reaches if not whole.proved else ():
            rule = critical(row.nodes, row.nodes[reach.operation.instruction])
            if reach.operation.kind != "jump" or reach.reachable == "no" or rule is None:
                continue
            if rule.rule not in ("zero", "integer"):
                continue
            build = Builder(row)
            node = rule.level(build, *row.nodes[reach.operation.instruction].args)
            level = build.built((Result("level", (1, 1), (Entry(0, 0, node),)),)).only("level")
            expression, breaks = reach.operation.expression, break_at(row, inner, reach) is not None
            found[expression, place] = Switch(
                row=row, level=function(level), rule=rule.rule, expression=expression, breaks=breaks
            )
    return list(found.values())


def across_jump(plant: Plant, evidence: Evidence, box: Box) -> Across | None:
    """Return two plans whose trials stay in a box and pass a jump on different sides, or None."""
    found, taken = switches(plant, box), evidence.trajectories
    plans = [one for one in taken.u if np.isfinite(one).all()]
    if not found or not plans:
        return None
    trial = taken.u.shape[0] - 1
    runs = Runs(plant, taken.x[trial, :, 0], taken.w[trial])
    left = [PAIRS if one.breaks else FEW for one in found]
    for line in _lines(plans, box):
        for i, k in _switching(runs, found, line):
            if left[i] == 0:
                continue
            left[i] -= 1
            (low, above), (below, high) = (_between(runs, found[i], k, line, side) for side in (True, False))
            for pair in dict.fromkeys(((low, above), (below, high), (low, high))):
                made = _apart(runs, evidence, box, found[i], k, line, pair)
                if made is not None:
                    return made._replace(trial=trial + 1)
    return None


def _lines(plans: Sequence[Array], box: Box) -> Iterator[tuple[Array, Array]]:
    """Give the ends of lines of plans: between plans that were run, and from the last to the ends of the input."""
    last, n = plans[-1], plans[-1].size
    low, high = (float(end[0, 0]) for end in box["u"])
    yield from list(pairwise(plans))[-LINES:]
    for k in np.unique(np.linspace(0, n - 1, min(n, LINES)).astype(int)):
        for end in (low, high):
            moved = last.copy()
            moved[k] = end
            yield last, moved
    for end in (low, high):
        yield last, np.full(n, end)
    yield np.full(n, low), np.full(n, high)


def _switching(runs: Runs, found: Sequence[Switch], line: tuple[Array, Array]) -> Iterator[tuple[int, int]]:
    """Give which of the switches stand on different sides at the ends of a line, each with the first such sample."""
    ends = [runs.of(plan)[0] for plan in line]
    for i, switch in enumerate(found):
        low, high = (switch.sides(x, plan, runs.w) for x, plan in zip(ends, line, strict=True))
        differ = np.flatnonzero((low != high) & np.isfinite(low) & np.isfinite(high))
        if differ.size:
            yield i, int(differ[0])


def _between(runs: Runs, switch: Switch, k: int, line: tuple[Array, Array], low_side: bool) -> tuple[float, float]:
    """Return shares of a line between which a switch turns: no plan lies between, but for the last place of the ends.

    Of the sides (below, at and above the level) the first end's is left, or the last end's is come to.
    """
    first, last = (runs.side(switch, end, k) for end in line)
    low, high, least = 0.0, 1.0, np.finfo(float).eps * float(np.abs(line).max())
    for _ in range(HALVINGS):
        middle = low / 2 + high / 2
        ends, here = (_on(line, low), _on(line, high)), _on(line, middle)
        if any((here == end).all() for end in ends) or np.abs(ends[1] - ends[0]).max() <= least:
            break
        side = runs.side(switch, here, k)
        if (side == first) if low_side else (side != last):
            low = middle
        else:
            high = middle
    return low, high


def _on(line: tuple[Array, Array], share: float) -> Array:
    return line[0] + share * (line[1] - line[0]) if share < 1 else line[1]


def _apart(
    runs: Runs, evidence: Evidence, box: Box, switch: Switch, k: int, line: tuple[Array, Array],
    shares: tuple[float, float],
) -> Across | None:  # fmt: skip
    """Return what a pair shows, where the signals stay apart as plans come together and the equations break off."""
    plans = _on(line, shares[0]), _on(line, shares[1])
    met = [runs.of(plan) for plan in plans]
    inside = _inside(box, [x for x, _ in met], plans)
    signals = [learned_signal(y, evidence.increment) for _, y in met]
    differences = np.abs(signals[1] - signals[0])[: inside + 1]
    differences[: min(max(k + 1, evidence.degree), differences.size)] = 0.0
    if not differences.size or not np.isfinite(differences).all() or not differences.any():
        return None
    m = int(np.argmax(differences))
    if not differences[m] > ROUNDED * np.finfo(float).eps * max(float(np.abs(y[: m + 1]).max()) for _, y in met):
        return None
    du, ratios = list[float](), list[float]()
    pairs = [(max(0.0, shares[0] - step), min(1.0, shares[1] + step)) for step in STEPS]
    for low, high in [*pairs, shares]:
        ends = _on(line, low), _on(line, high)
        moved = float(np.abs(ends[1] - ends[0])[: m - evidence.degree + 1].max())
        seen = [learned_signal(runs.of(plan)[1], evidence.increment)[m] for plan in ends]
        if not moved > 0 or not np.isfinite(seen).all():
            return None
        du.append(moved)
        ratios.append(float(abs(seen[1] - seen[0])) / moved)
    growing = all(later >= GROWS * before for before, later in pairwise(ratios))
    stays = ratios[-1] * du[-1] >= STAYS * ratios[0] * du[0]
    if not growing or not stays:
        return None
    broken = _breaks(switch, [runs.met(x, plan, k) for (x, _), plan in zip(met, plans, strict=True)])
    return None if broken is None else Across(0, m, plans, du, ratios, float(differences[m]), broken, switch.expression)


def _inside(box: Box, states: Sequence[Array], plans: Sequence[Array]) -> int:
    """Return the last sample to which all trials stay in a box."""
    last = plans[0].size
    for x, plan in zip(states, plans, strict=True):
        (x_low, x_high), (u_low, u_high) = box["x"], (end[0, 0] for end in box["u"])
        left = np.flatnonzero(~((x_low <= x) & (x <= x_high)).all(axis=0))
        beyond = np.flatnonzero(~((u_low <= plan) & (plan <= u_high)))
        last = min([last, *(int(k) - 1 for k in left[:1]), *(int(k) for k in beyond[:1])])
    return last


def _breaks(switch: Switch, points: Sequence[dict[str, Array]]) -> Break | None:
    """Return how the row of a switch breaks off next to two points, if its values there are apart by that."""
    ends: dict[str, tuple[Array, Array]] = {}
    for name, shape in ((port.name, port.shape) for port in switch.row.inputs):
        both = np.array([np.reshape(one[name], shape) for one in points])
        low, high = both.min(axis=0, initial=np.inf), both.max(axis=0, initial=-np.inf)
        room = 0.0 if name == "k" else NEAR * np.maximum(1.0, np.maximum(np.abs(low), np.abs(high)))
        ends[name] = low - room, high + room
    box = Box(ends, whole=("k",))
    values = [float(call(switch.row, one)["f"][0, 0]) for one in points]
    for reach in continuous_on(switch.row, box).reaches:
        broken = break_at(switch.row, box, reach) if reach.operation.expression == switch.expression else None
        if broken is not None and abs(values[1] - values[0]) >= STAYS * broken.gap:
            return broken
    return None
