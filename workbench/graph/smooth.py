"""Where the operations of a graph are not smooth."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from math import isfinite
from typing import Protocol

from workbench.graph.arithmetic import RATIONALS
from workbench.graph.graph import Graph
from workbench.graph.operations import BOOLEAN, CONSTANT, LOOKUP, OPERATIONS, Critical, Kind, Maker, first


class Operated(Protocol):
    """What is asked of a node: its operation, its arguments, and the number of a constant."""

    @property
    def op(self) -> str:
        """Name of the operation."""

    @property
    def args(self) -> tuple[int, ...]:
        """Places of its arguments."""

    @property
    def value(self) -> float:
        """The number of a constant."""


_FREE_BASE = Critical("pole", "nonpositive", first)
_ROOT = Critical("kink", "nonpositive", first, edge=True)
_NEGATIVE_POWER = Critical("pole", "zero", first)


def critical(nodes: Sequence[Operated], node: Operated) -> Critical | None:
    """Return where an operation is not smooth, given its arguments: None where it is smooth everywhere.

    A lookup has breakpoints instead, see :func:`breakpoints`.
    """
    if node.op in ("fmin", "fmax") and node.args[0] == node.args[1]:
        return None
    if node.op in ("not", "if_else_zero") and nodes[node.args[0]].op in BOOLEAN:
        return None  # constant between the jumps of the comparison, which is counted itself
    if node.op in ("and", "or"):
        return _truths(nodes, node)
    if node.op == "div" and nodes[node.args[1]].op == CONSTANT:
        return None if nodes[node.args[1]].value != 0 else OPERATIONS["div"].critical
    if node.op not in ("pow", "constpow"):
        known = OPERATIONS[node.op].critical if node.op in OPERATIONS else None
        held = all(nodes[arg].op == CONSTANT for arg in node.args)
        return None if known and known.edge and held else known  # a number at the end of a domain moves nowhere
    exponent = _number(nodes, node.args[1])
    if exponent is None:
        return _FREE_BASE
    if exponent.denominator == 1:
        return None if exponent >= 0 else _NEGATIVE_POWER
    return _ROOT if exponent > 0 else _FREE_BASE


def _number(nodes: Sequence[Operated], place: int) -> Fraction | None:
    """Return the number that a node is, as exponents of derivatives are sums of numbers; None where it is none."""
    node = nodes[place]
    if node.op == CONSTANT:
        return Fraction(node.value) if isfinite(node.value) else None
    if node.op not in ("add", "sub", "neg"):
        return None
    values = [_number(nodes, arg) for arg in node.args]
    known = [value for value in values if value is not None]
    return RATIONALS.operations[node.op](*known) if len(known) == len(values) else None


def _truths(nodes: Sequence[Operated], node: Operated) -> Critical | None:
    """Return where the truth of a number changes: where it is zero. That of a comparison is counted with it."""
    numbers = [i for i, arg in enumerate(node.args) if nodes[arg].op not in (*BOOLEAN, CONSTANT)]
    if not numbers:
        return None

    def level(make: Maker, *args: int) -> int:
        found = args[numbers[0]]
        return found if len(numbers) == 1 else make.operation("mul", *args)

    return Critical("jump", "zero", level)


def breakpoints(graph: Graph, place: int) -> tuple[tuple[int, float, Kind], ...]:
    """Return where a lookup is not infinitely differentiable: argument, its value there, and whether it jumps.

    Raises ValueError where the node is no lookup.
    """
    node = graph.nodes[place]
    if node.op != LOOKUP:
        raise ValueError(f"node {place} of {graph.name} must be a lookup, got {node.op}")
    table, orders = graph.table_of(node), graph.lookups[node.which].orders
    found: list[tuple[int, float, Kind]] = []
    for axis, order in enumerate(orders):
        if table.kind == "linear" and any(own > 1 for own in orders):
            continue  # the second derivative of straight pieces is zero
        for point, continuous in table.breakpoints(axis):
            found.append((axis, point, "kink" if continuous >= order else "jump"))
    return tuple(found)
