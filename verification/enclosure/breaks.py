"""Whether a Function really breaks off where one of its operations jumps: shown by its values on both sides."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from verification.enclosure.box import Box
from verification.enclosure.interval import enclose
from verification.enclosure.outward import Array
from verification.enclosure.reach import Reach
from verification.enclosure.switches import Switches
from workbench.graph import Builder, Entry, Graph, Result, gradient
from workbench.graph.smooth import critical

_STEPS = (2.0**-20, 2.0**-30, 2.0**-40)  # to either side, of the larger of 1 and the coordinate's magnitude
_SHRUNK = 0.9  # a gap that keeps this share while the step shrinks a millionfold does not close


class Break(NamedTuple):
    """Where the only output of a graph breaks off, and between which ends its values to either side lie."""

    across: str
    """The coordinate along which it breaks off."""
    left: tuple[float, float]
    right: tuple[float, float]
    gap: float
    """The values are apart by at least that."""
    proved: bool
    """Whether that is enclosed around the place, or seen where two points come closer to it."""


def break_at(graph: Graph, box: Box, reach: Reach, along: tuple[str, ...] | None = None) -> Break | None:
    """Return how the only output of a graph breaks off where a jump of one of its operations is reached, or None.

    It is looked for along one real coordinate after the other, of the inputs named in ``along``, within the box. For
    a switch it is proved: a level that rises or falls along the coordinate passes zero, and the graph's two sides are
    apart around that place. For other operations the difference of two values is seen not to close.
    """
    if reach.reachable != "yes" or reach.point is None or reach.operation.kind != "jump":
        return None
    place = reach.operation.instruction
    lower, upper = box.coordinates(graph)
    point = reach.point.coordinates(graph)[0]
    names = [port.name for port in graph.inputs for _ in port.places]
    switches = Switches(graph)
    switch = switches.of(place)
    for i in np.flatnonzero(~box.whole_coordinates(graph) & (lower < upper)):
        if along is not None and names[i] not in along:
            continue
        segments = list(_segments(point, int(i), lower, upper))
        label = graph.labels()[i]
        if switch is None:
            found = _closing(graph, box.whole, segments, label)
        else:
            sides = switches.side(switch, -1), switches.side(switch, 1)
            level = _level(graph, place, int(i))
            own = dict(switch.nodes)[place]
            found = _apart(level, sides[::own], box.whole, segments, label)
        if found is not None:
            return found
    return None


def _segments(point: Array, i: int, lower: Array, upper: Array) -> Iterator[tuple[Array, Array]]:
    """Give the ends of ever shorter segments through a point along a coordinate, within the box."""
    for step in _STEPS:
        ends = point.copy(), point.copy()
        reach = step * max(1.0, abs(float(point[i])))
        ends[0][i], ends[1][i] = max(lower[i], point[i] - reach), min(upper[i], point[i] + reach)
        if ends[0][i] < point[i] < ends[1][i]:
            yield ends


def _level(graph: Graph, place: int, i: int) -> Graph | None:
    """Return the level of an operation and its slope along a coordinate."""
    build = Builder(graph)
    node = graph.nodes[place]
    found = critical(graph.nodes, node)
    if found is None:
        return None
    level = found.level(build, *node.args)
    slope = gradient(build, level).get(i)
    if slope is None:
        return None
    return build.built(
        tuple(Result(name, (1, 1), (Entry(0, 0, at),)) for name, at in (("level", level), ("slope", slope)))
    )


def _range(graph: Graph, whole: tuple[str, ...], low: Array, high: Array, output: str) -> tuple[float, float]:
    found = enclose(graph, Box.from_coordinates(graph, low, high, whole))
    return float(found.lower[output].min()), float(found.upper[output].max())


def _apart(
    level: Graph | None,
    sides: tuple[Graph, ...],
    whole: tuple[str, ...],
    segments: list[tuple[Array, Array]],
    label: str,
) -> Break | None:
    """Return the proved break between the sides of a negative and of a positive level."""
    if level is None:
        return None
    for low, high in segments:
        steep = _range(level, whole, low, high, "slope")
        if steep[0] <= 0 <= steep[1]:
            continue
        before, after = (_range(level, whole, end, end, "level") for end in (low, high))
        rising, falling = before[1] < 0 < after[0], after[1] < 0 < before[0]
        if not (rising or falling):
            continue
        name = sides[0].outputs[0].name
        left, right = (_range(side, whole, low, high, name) for side in (sides if rising else sides[::-1]))
        gap = max(left[0] - right[1], right[0] - left[1])
        if gap > 0 and np.isfinite([*left, *right]).all():
            return Break(label, left, right, gap, True)
    return None


def _closing(graph: Graph, whole: tuple[str, ...], segments: list[tuple[Array, Array]], label: str) -> Break | None:
    """Return the break that is left when two points come closer, if their difference does not close."""
    gaps, name = [], graph.outputs[0].name
    for low, high in segments:
        left, right = (_range(graph, whole, end, end, name) for end in (low, high))
        if not np.isfinite([*left, *right]).all():
            return None
        gaps.append(max(left[0] - right[1], right[0] - left[1]))
    if len(gaps) < 2 or gaps[-1] <= 0 or gaps[-1] < _SHRUNK * gaps[0]:
        return None
    return Break(label, left, right, gaps[-1], False)
