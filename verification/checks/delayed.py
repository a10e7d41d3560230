"""What is learned on at the first sample that an input reaches, as a Function of the sample at which it acts."""

from __future__ import annotations

import casadi as ca
import numpy as np

from models.plant import Plant
from verification.checks.slope import slope
from verification.enclosure.box import Box
from verification.enclosure.tables import with_tables
from workbench.graph import Graph, read

LATER = ("later_u", "later_w")
"""Inputs and disturbances after sample k."""


def delayed_output(plant: Plant, degree: int, *, increment: bool = False) -> ca.Function:
    """Return the learned signal ``y`` at k + d as a Function of x, u, w and k, and of later inputs and disturbances.

    The signal is the first output, or its increment.
    """
    step = delayed_step(plant, degree, increment=increment)
    at = [ca.SX.sym(name, *step.size_in(name)) for name in step.name_in()]
    return ca.Function("delayed_output", at, [step(*at)[0]], step.name_in(), ["y"])


def delayed_step(plant: Plant, degree: int, *, increment: bool = False) -> ca.Function:
    """Return :func:`delayed_output` with the next state, ``x_next``, beside the signal."""
    at = plant.symbols()
    later = {of: ca.SX.sym(name, at[of].shape[0], degree - 1) for name, of in zip(LATER, ("u", "w"), strict=True)}
    x = before = at["x"]
    first = x
    for step in range(degree):
        u, w = (at[of] if step == 0 else later[of][:, step - 1] for of in ("u", "w"))
        before, x = x, plant.next_state(x, u, w, at["k"] + step)
        first = x if step == 0 else first
    y = plant.measured(x)[0]
    if increment:
        y = y - plant.measured(before)[0]
    return ca.Function("delayed_step", [*at.values(), *later.values()], [y, first], [*at, *LATER], ["y", "x_next"])


def delayed_box(box: Box, degree: int) -> Box:
    """Return a box with what is later in the same ranges as now; the last step still lies in the box.

    The steps that make y(k+d) are those at k to k+d-1, so k ends d - 1 samples before the box's own. It is whole,
    whatever the box says.
    """
    ranges = dict(box)
    for name, of in zip(LATER, ("u", "w"), strict=True):
        low, high = (np.asarray(end).reshape(-1, 1) for end in box[of])
        ranges[name] = (np.tile(low, (1, degree - 1)), np.tile(high, (1, degree - 1)))
    first, last = box["k"]
    ranges["k"] = (first, np.maximum(first, last - (degree - 1)))
    return Box(ranges, whole=tuple(dict.fromkeys((*box.whole, "k"))))


def delayed_graph(plant: Plant, degree: int, *, increment: bool = False) -> Graph:
    """Return :func:`delayed_step` as a graph, with tables that it spells out read as tables.

    So its slopes are those of the continuous function through a table's points. Raises Unreadable where it has none.
    """
    return with_tables(read(delayed_step(plant, degree, increment=increment)))


def delayed_slope(graph: Graph) -> Graph:
    """Return the exact derivative of the output ``y`` by the first entry of ``u``, as a graph."""
    return slope(graph, "y", "u")
