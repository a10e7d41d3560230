"""Tables that a graph spells out: pieces under comparisons, as CasADi's ``pw_lin`` writes them, read as one table.

Such pieces are meant to meet at their breakpoints, and in exact arithmetic they do not: the slope of each was rounded
when it was made, so that neighbours miss each other by a part in 10^16. Read as switches they jump, and no slope bounds
a difference. Here the table stands for the continuous function through its points, and for the pieces as well: each of
its values is spread by how far either piece misses it. So an enclosure of its value, or of its slope, holds both what
is meant and what is written; what is continuous is what is meant.

Pieces that miss each other by more than their slopes may have been rounded are a jump, and stay one; so do pieces whose
slopes cancel, so that what is left of them is no larger than what was rounded. What goes into such a jump, along the
same quantity, is not read as a table either.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction

import numpy as np

from verification.enclosure.pieces import Line, Pieces, along, quantities
from workbench.graph import Graph, Lookup, Node, Table
from workbench.graph.operations import BOOLEAN, LOOKUP

ROUNDED = Fraction(1, 2**50)
"""By what part of what they rise pieces may miss each other: eight roundings of a slope."""
LEFT = Fraction(1, 2**40)
"""By what part of what the table itself rises, at its steepest, they may miss each other."""
BEYOND = 1.0
"""How far the outermost points lie beyond the breakpoints, of the larger of 1 and the breakpoint's magnitude."""


def with_tables(graph: Graph) -> Graph:
    """Return a graph in which tables that are spelled out are lookups; the graph itself where there are none."""
    found: dict[int, tuple[int, Table]] = {}
    for quantity in quantities(graph):
        family = along(graph, quantity)
        tables = {place: as_table(pieces, f"table{place}") for place, pieces in family.items()}
        jump = {place for place, pieces in family.items() if tables[place] is None and any(_gaps(pieces))}
        torn = _before(graph, family, jump)
        for place, table in tables.items():
            if table is not None and place not in torn and place not in found:
                found[place] = quantity, table
    return _put(graph, found) if found else graph


def _before(graph: Graph, family: Mapping[int, Pieces], jump: set[int]) -> set[int]:
    """Return the nodes of a family that jump, and those that go into one; a condition is to jump."""
    torn: set[int] = set()
    for place in sorted(family, reverse=True):
        node = graph.nodes[place]
        if node.op not in BOOLEAN and (place in jump or place in torn):
            torn |= {place, *node.args}
    return torn


def misses(graph: Graph) -> float:
    """Return by how much the pieces of a graph's tables miss their points at the most."""
    return max((spread for table in graph.tables for spread in table.spread), default=0.0)


def told(graph: Graph) -> str:
    """Return in words, to go on with, what a graph's tables stand for; empty where none is spelled out."""
    most = misses(graph)
    meant = "a table counts as the continuous function through its points, which its pieces miss, by rounding, by"
    return f"; {meant} {most:.2g} at the most" if most else ""


def as_table(pieces: Pieces, name: str) -> Table | None:
    """Return pieces that meet but for rounding as a table; None where they jump, or meet exactly, or are one line."""
    points = [float(point) for point in pieces.points]
    gaps = _gaps(pieces)
    if not any(gaps) or any(Fraction(point) != exact for point, exact in zip(points, pieces.points, strict=True)):
        return None
    if any(gap > _allowed(pieces, i) for i, gap in enumerate(gaps)):
        return None
    first, last = points[0] - BEYOND * max(1.0, abs(points[0])), points[-1] + BEYOND * max(1.0, abs(points[-1]))
    grid = (first, *points, last)
    ends = Fraction(first), Fraction(last)
    near: list[tuple[Fraction, ...]] = [_beside(pieces, i) for i in range(len(points))]
    near = [(pieces.lines[0].at(ends[0]),), *near, (pieces.lines[-1].at(ends[1]),)]
    values = [float(met[0]) for met in near]
    spread = [_up(max(abs(one - Fraction(value)) for one in met)) for met, value in zip(near, values, strict=True)]
    return Table(
        name=name, kind="linear", grid=(grid,), values=tuple(values), outputs=1, degrees=(1,), search=(0,),
        spread=tuple(spread),
    )  # fmt: skip


def _beside(pieces: Pieces, i: int) -> tuple[Fraction, ...]:
    """Return what stands at a breakpoint, and what the pieces to its left and right come to there."""
    point = pieces.points[i]
    return pieces.values[i], pieces.lines[i].at(point), pieces.lines[i + 1].at(point)


def _gaps(pieces: Pieces) -> list[Fraction]:
    """Return by how much pieces miss each other at each breakpoint."""
    beside = [_beside(pieces, i) for i in range(len(pieces.points))]
    return [max(met) - min(met) for met in beside]


def _allowed(pieces: Pieces, i: int) -> Fraction:
    """Return by how much the pieces to both sides of a breakpoint may miss each other there."""
    sides = [(line, _rise(line, pieces.points[i])) for line in pieces.lines[i : i + 2]]
    far = max((rise / line.steep for line, rise in sides if line.steep), default=Fraction(0))
    steepest = max(abs(line.slope) for line in pieces.lines)
    return min(ROUNDED * sum(rise for _, rise in sides), LEFT * steepest * far)


def _rise(line: Line, point: Fraction) -> Fraction:
    """Return the magnitudes that the slopes of a line were multiplied by up to a point, times these."""
    return line.steep * abs(point) + line.aside


def _up(exact: Fraction) -> float:
    """Return a double that is no less."""
    near = float(exact)
    return near if Fraction(near) >= exact else float(np.nextafter(near, np.inf))


def _put(graph: Graph, found: Mapping[int, tuple[int, Table]]) -> Graph:
    """Return a graph with lookups in place of some nodes, without nodes and tables that nothing needs any more."""
    nodes, tables, lookups = list(graph.nodes), list(graph.tables), list(graph.lookups)
    for place, (quantity, table) in found.items():
        nodes[place] = Node(LOOKUP, (quantity,), which=len(lookups))
        lookups.append(Lookup(len(tables), 0, (0,)))
        tables.append(table)
    made = replace(graph, nodes=tuple(nodes), tables=tuple(tables), lookups=tuple(lookups))
    made = made.only(*(result.name for result in made.outputs))
    read = sorted({node.which for node in made.nodes if node.op == LOOKUP})
    kept = sorted({lookups[which].table for which in read})
    return replace(
        made,
        nodes=tuple(node._replace(which=read.index(node.which)) if node.op == LOOKUP else node for node in made.nodes),
        lookups=tuple(lookups[which]._replace(table=kept.index(lookups[which].table)) for which in read),
        tables=tuple(tables[place] for place in kept),
    )
