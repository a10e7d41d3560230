"""What a sample computes from time and parameters alone: found in its graph, and computed once a campaign.

A sine of the sample index is the same in every trial. Such expressions are taken out of the sample and become rows
of numbers that it is handed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca

from workbench.graph import OPERATIONS, read
from workbench.graph.operations import CONSTANT, INPUT, LOOKUP
from workbench.graph.symbolic import SYMBOLS


class Timetable(NamedTuple):
    """Results with symbols in place of what depends on time alone, those symbols, and what they stand for."""

    results: list[ca.SX]
    symbols: ca.SX
    """(m, 1)."""
    values: ca.SX
    """(m, 1), expressions of k and the parameters only."""


class _Quantity(NamedTuple):
    """A node's expression, whether it depends on time and parameters alone, on the time, and is dear to compute."""

    value: ca.SX
    alone: bool
    of_k: bool
    dear: bool


def timetable(results: Sequence[ca.SX], k: ca.SX, parameters: ca.SX) -> Timetable:
    """Take out of SX expressions the largest parts that depend on k, on parameters and on nothing else.

    Only parts with an operation that is dear are taken; the other operations stay, in their order.
    """
    free = ca.symvar(ca.vertcat(*(ca.vec(result) for result in results)))
    timed = {symbol.element_hash() for symbol in ca.symvar(ca.vertcat(k, parameters))}
    moving = k.element_hash()
    graph = read(ca.Function("graph", free, [ca.densify(result) for result in results], {"cse": True}))
    symbols: list[ca.SX] = []
    values: list[ca.SX] = []
    taken: dict[int, ca.SX] = {}

    def handed(quantity: _Quantity) -> ca.SX:
        """Return a quantity's value for an operation that does more than tell the time."""
        value = quantity.value
        if not (quantity.alone and quantity.of_k and quantity.dear):
            return value
        if value.element_hash() not in taken:
            symbols.append(ca.SX.sym(f"timed{len(symbols)}"))
            values.append(value)
            taken[value.element_hash()] = symbols[-1]
        return taken[value.element_hash()]

    quantities: list[_Quantity] = []
    for node in graph.nodes:
        if node.op == CONSTANT:
            quantities.append(_Quantity(ca.SX(node.value), True, False, False))
            continue
        if node.op == INPUT:
            symbol = free[node.which]
            hashed = symbol.element_hash()
            quantities.append(_Quantity(symbol, hashed in timed, hashed == moving, False))
            continue
        args = [quantities[arg] for arg in node.args]
        alone = all(arg.alone for arg in args)
        given = [arg.value if alone else handed(arg) for arg in args]
        if node.op == LOOKUP:
            value = SYMBOLS.lookup(graph.table_of(node), graph.lookups[node.which], given)
        else:
            value = SYMBOLS.operations[node.op](*given)
        dear = node.op == LOOKUP or OPERATIONS[node.op].dear or any(arg.dear for arg in args)
        quantities.append(_Quantity(value, alone, any(arg.of_k for arg in args), dear))
    made = [ca.SX.zeros(*result.shape) for result in graph.outputs]
    for whole, result in zip(made, graph.outputs, strict=True):
        for entry in result.entries:
            whole[entry.row, entry.column] = handed(quantities[entry.node])
    return Timetable(made, ca.vertcat(*symbols), ca.vertcat(*values))
