"""A1 of model-free adaptive ILC (doi 10.7641/CTA.2024.30465): df/du exists and is continuous.

f gives y(k+d) from x(k), u(k) and what comes later; k is whole. That df/du exists asks f to be continuous along u
alone, at every fixed x: f may jump in x. That it is continuous is asked in x and u together. Statements about
differences between trials ask more, namely that f is continuous in x too.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np

from models.array import Array
from models.plant import Plant
from models.quantity import InvalidValue
from verification.checks.delayed import delayed_box, delayed_graph, delayed_output
from verification.checks.domain import described
from verification.checks.points import derivative_at, filled, point_of, value_at
from verification.checks.slope import slope
from verification.enclosure.box import Box
from verification.enclosure.breaks import Break, break_at
from verification.enclosure.interval import enclose
from verification.enclosure.reach import Reach, Smoothness
from verification.enclosure.smoothness import continuous_on
from verification.enclosure.switches import Switches
from verification.enclosure.tables import with_tables
from workbench.contracts.finding import Finding, Grounds, undecided
from workbench.evidence.ppd import gain_unit, units_of
from workbench.graph import Entry, Graph, Result, Unreadable, call, read

STEP = 1e-6
"""How far from the place a replay looks, of the larger of 1 and the coordinate's magnitude."""
OCTAVES = 10
"""By how many halvings a step shrinks from one difference quotient to the next."""
CLOSEST = 1e-8
"""How much closer than its step a replay comes to the place, a tenth at a time."""
GROWTH = 8.0
"""By how much difference quotients must grow in all, and by a hundredth each time, to be called unbounded."""


def continuous_slope(plant: Plant, box: Box, degree: int = 1) -> Finding:
    """A1: the derivative of y(k+d) by u(k) exists and is continuous on the box, for every whole k.

    PROVED where f along u, and df/du, reach no pole or end of a domain, and no jump but those that they mend. REFUTED
    at a point of the box: where the values to its two sides are apart, where f has no value, or where its difference
    quotients grow without bound.
    """
    try:
        f = read(delayed_output(plant, degree))
    except Unreadable as error:
        return undecided(str(error))
    slopes, inner = slope(f, "y", "u"), delayed_box(box, degree)
    everywhere = continuous_on(f, inner)
    asked = (
        ("f", f, ("u",), everywhere if everywhere.proved else continuous_on(f, inner, along=("u",))),
        ("df/du", slopes, None, continuous_on(slopes, inner)),
    )
    for what, graph, along, found in asked:
        for reach in found.reaches if not found.proved else ():
            refuted = _jumps(plant, f, slopes, inner, reach, break_at(graph, inner, reach, along), what) or (
                _has_no_end(plant, f, slopes, inner, reach, what)
            )
            if refuted is not None:
                return refuted
    for what, _, _, found in asked:
        if not found.proved:
            return undecided(f"continuity of {what} on the box could not be shown: {found.reason}")
    return Finding(
        grounds=Grounds.ENCLOSURE,
        holds=all(found.proved for *_, found in asked),
        method="no jump, pole or end of a domain of f along u, or of df/du, is reached"
        + _mended(found for *_, found in asked)
        + f", by intervals, for {described(plant, box)}"
        + ("" if everywhere.proved else f"; f itself is not shown to be continuous in x: {everywhere.reason}"),
    )


def _mended(found: Iterable[Smoothness]) -> str:
    """Return in words which switches are no jump because both sides agree."""
    names = dict.fromkeys(one.expression for each in found for one in each.mended)
    return f" but switches whose sides agree, by normal forms in rationals ({', '.join(names)})" if names else ""


def _point(reach: Reach) -> dict[str, Array]:
    return {} if reach.point is None else {name: value[0] for name, value in reach.point.items()}


def _witness(at: dict[str, Array], reach: Reach) -> dict[str, object]:
    point = {name: value.ravel().tolist() for name, value in at.items() if value.size}
    return {"point": point, "operation": f"{reach.operation.name} in {reach.operation.expression}"}


def _jumps(
    plant: Plant, f: Graph, slopes: Graph, box: Box, reach: Reach, broken: Break | None, what: str
) -> Finding | None:
    """Return the refutation by a break, with what a replay needs."""
    if broken is None:
        return None
    at = _point(reach)
    point, place = reach.point.coordinates(f)[0] if reach.point else np.zeros(0), f.labels().index(broken.across)
    step = STEP * max(1.0, abs(float(point[place])))
    sides: dict[str, object] = {}
    for side, shift in (("left", -step), ("right", step)):
        moved = point.copy()
        moved[place] += shift
        there = {name: ends[0] for name, ends in Box.from_coordinates(f, moved, moved).items()}
        sides[f"slope_{side}"] = float(call(slopes, there)["slope"][0, 0])
        sides[f"value_{side}"] = float(call(f, there)["y"][0, 0])
    how = "as both are enclosed there" if broken.proved else "however close the two come"
    kind = "value" if what == "f" else "slope"
    for side, ends in (("left", broken.left), ("right", broken.right)):
        sides[f"{kind}_{side}"] = ends[0] / 2 + ends[1] / 2
    return Finding(
        grounds=Grounds.ENCLOSURE if broken.proved else Grounds.SEARCH,
        margin=-broken.gap,
        unit=plant.outputs[0].unit if what == "f" else gain_unit(*units_of(plant)),
        witness={**_witness(at, reach), "of": what, "across": broken.across, "step": step, **sides},
        method=f"a {reach.operation.kind} of {what} is reached: along {broken.across} its values on the two sides are "
        f"apart by the margin, {how}",
    )


def jumps_with_input(witness: Mapping[str, object]) -> bool:
    """Tell whether a witness of :func:`continuous_slope` is a jump of the output along the input itself."""
    return witness.get("of") == "f" and witness.get("across") == "u"


def jump_reached(plant: Plant, box: Box, degree: int = 1) -> str:
    """Return in words where y(k+d) or a state jumps inside a box, along a state or an input, or an empty text."""
    try:
        f = with_tables(delayed_graph(plant, degree))
    except Unreadable:
        return ""
    inner = delayed_box(box, degree)
    for entry in (entry for result in f.outputs for entry in result.entries):
        row = replace(f, outputs=(Result("f", (1, 1), (Entry(0, 0, entry.node),)),)).only("f")
        found = continuous_on(row, inner)
        for reach in found.reaches if not found.proved else ():
            broken = break_at(row, inner, reach)
            if broken is not None:
                return f"it jumps by {broken.gap:.4g} along {broken.across}, at {reach.operation.expression}"
    return ""


def _ends_finite(slopes: Graph, reach: Reach, at: dict[str, Array], what: str) -> bool:
    """Tell whether df/du is finite at a point, and to both sides of the switch of df/du that was reached there."""
    sides = [slopes]
    if what != "f" and reach.operation.kind == "jump":
        switches = Switches(slopes)
        switch = switches.of(reach.operation.instruction)
        sides += [] if switch is None else [switches.side(switch, sign) for sign in (-1, 1)]
    return all(np.isfinite(call(side, at)["slope"][0, 0]) for side in sides)


def _has_no_end(plant: Plant, f: Graph, slopes: Graph, box: Box, reach: Reach, what: str) -> Finding | None:
    """Return the refutation where f has no value at a point, or no finite slope."""
    if reach.reachable != "yes" or reach.point is None:
        return None
    at = _point(reach)
    value = float(call(f, at)["y"][0, 0])
    if not np.isfinite(value) and enclose(f, reach.point).undecided is not None:
        return Finding(
            grounds=Grounds.ENCLOSURE,
            holds=bool(np.isfinite(value)),
            witness=_witness(at, reach),
            method=f"f has no finite value at the point: it lies outside of the domain of {reach.operation.name} in "
            f"{reach.operation.expression}, so no derivative exists there",
        )
    if _ends_finite(slopes, reach, at, what):
        return None
    for side in (1.0, -1.0):
        steps, quotients = _quotients(f, box, at, side)
        grows = all(b > 1.01 * a for a, b in pairwise(quotients))
        if len(quotients) > 2 and grows and quotients[-1] > GROWTH * quotients[0] > 0:
            return Finding(
                grounds=Grounds.SEARCH,
                margin=-quotients[-1],
                unit=gain_unit(*units_of(plant)),
                witness={**_witness(at, reach), "steps": steps, "quotients": quotients},
                method=f"df/du has no finite value at the point ({reach.operation.name} in "
                f"{reach.operation.expression}): difference quotients of f along u grow as steps shrink; the margin "
                "is minus the largest that was met",
            )
    return None


def _quotients(f: Graph, box: Box, at: dict[str, Array], side: float) -> tuple[list[float], list[float]]:
    """Return steps of u to one side of a point that halve again and again, and what |df| is over each at the least."""
    steps, quotients = [], []
    low, high = (float(end[0, 0]) for end in box["u"])
    start = float(at["u"][0, 0])
    here = _ends(f, at)
    step = 2.0**-OCTAVES * max(1.0, abs(start))
    while low <= start + side * step <= high and step > 2.0**-40 * abs(start) and step > 2.0**-400:
        moved = at["u"].copy()
        moved[0, 0] = start + side * step
        there = _ends(f, {**at, "u": moved})
        gap = max(there[0] - here[1], here[0] - there[1], 0.0)
        steps.append(float(moved[0, 0] - start))
        quotients.append(gap / abs(steps[-1]))
        step *= 2.0**-OCTAVES
    return steps, quotients


def _ends(f: Graph, at: dict[str, Array]) -> tuple[float, float]:
    found = enclose(f, Box(at))
    return float(found.lower["y"][0, 0]), float(found.upper["y"][0, 0])


def replay(plant: Plant, degree: int, witness: Mapping[str, object]) -> float:
    """Return the margin of :func:`continuous_slope` at a witness, on the compiled plant.

    Minus by how much the values on both sides are apart where they stay apart as the sides come closer, minus the last
    difference quotient, or 1/2 less 1 where the output has no value at the point. Raises InvalidValue for a witness
    that lacks its point.
    """
    f, point = delayed_output(plant, degree), point_of(witness)
    quotients, steps, across, step = (witness.get(name) for name in ("quotients", "steps", "across", "step"))
    if isinstance(steps, list) and isinstance(quotients, list) and steps:
        aside = {**point, "u": point["u"] + float(steps[-1]) * np.eye(point["u"].size, 1).ravel()}
        return -abs(value_at(f, aside) - value_at(f, point)) / abs(float(steps[-1]))
    if not isinstance(across, str) or not isinstance(step, float):
        return 0.5 - float(not np.isfinite(value_at(f, point)))
    graph = read(f)
    if across not in graph.labels():
        raise InvalidValue(f"the witness must be across one of {', '.join(graph.labels())}, got {across!r}")
    place = graph.labels().index(across)
    at = Box({name: (end, end) for name, end in filled(f, point).items()}).coordinates(graph)[0]
    value = value_at if witness.get("of") == "f" else derivative_at
    least = max(64 * np.finfo(float).eps * abs(float(at[place])), CLOSEST * step)
    gaps = []
    size = step
    while size >= least:
        ends = []
        for side in (-size, size):
            moved = at.copy()
            moved[place] += side
            there = Box.from_coordinates(graph, moved, moved)
            ends.append(value(f, {name: end[0] for name, end in there.items()}))
        gaps.append(abs(ends[1] - ends[0]))
        size /= 10
    return -gaps[-1] if len(gaps) > 1 and gaps[-1] > 0.5 * gaps[-2] else gaps[-1]
