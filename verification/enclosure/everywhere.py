"""A graph over all real numbers: what intervals and guards tell of it where its inputs have no ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from verification.enclosure.outward import Array
from verification.enclosure.rewriting import Quantity, Rewritten
from workbench.graph.operations import CONSTANT, INPUT

LARGEST = float(np.finfo(float).max)


def over_the_reals(graph: Rewritten, real: NDArray[np.bool_]) -> tuple[Rewritten, int]:
    """Return a graph in which some coordinates are any real number, and by how many places its nodes are moved.

    Each is the largest double times a coordinate of its own, which :func:`ends` lets run between the largest doubles:
    rounded outwards their product has no ends, so that an enclosure holds whatever the real number is.
    """
    inputs = {node.coordinate for node in graph.nodes if node.op == INPUT and _is(real, node.coordinate)}
    before = [Quantity(CONSTANT, value=LARGEST), *(Quantity(INPUT, coordinate=place) for place in sorted(inputs))]
    place = {node.coordinate: k for k, node in enumerate(before) if node.op == INPUT}
    moved = len(before)
    nodes = [
        Quantity("mul", (0, place[node.coordinate]), origin=node.origin)
        if node.op == INPUT and node.coordinate in place
        else node._replace(args=tuple(arg + moved for arg in node.args))
        for node in graph.nodes
    ]
    outputs = {
        name: tuple(entry._replace(node=entry.node + moved) for entry in entries)
        for name, entries in graph.outputs.items()
    }
    return replace(graph, nodes=(*before, *nodes), outputs=outputs), moved


def ends(lower: Array, upper: Array, real: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return the ends of coordinates of :func:`over_the_reals`, given those of the others."""
    return np.where(real, -LARGEST, lower), np.where(real, LARGEST, upper)


def _is(real: NDArray[np.bool_], coordinate: int) -> bool:
    return coordinate < real.size and bool(real[coordinate])
