"""A graph as CasADi's symbols: the same operations again, on whatever expressions stand for its coordinates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from types import MappingProxyType

import casadi as ca

from workbench.graph.arithmetic import Arithmetic, evaluate
from workbench.graph.graph import Graph
from workbench.graph.operations import OPERATIONS
from workbench.graph.table import Lookup, Table

_SEARCH = ("linear", "exact", "binary")


# operations take different numbers of arguments
def _operation(name: str, arity: int) -> Callable[..., ca.SX]:
    # CasADi keeps its operations as constants of the module, by name
    number = getattr(ca, f"OP_{name.upper()}")
    made = ca.SX.unary if arity == 1 else ca.SX.binary
    return lambda *args: made(number, *args)


@lru_cache(maxsize=256)
def _function(table: Table) -> ca.Function:
    """Return a table as CasADi's Function of a column, which gives a column."""
    search = {"lookup_mode": [_SEARCH[how] for how in table.search]}
    if table.kind == "linear":
        return ca.interpolant(table.name, "linear", table.grid, table.values, search)
    spline = ca.Function.bspline(table.name, table.grid, table.values, table.degrees, table.outputs, search)
    x = ca.MX.sym("x", table.dimensions)
    return ca.Function(table.name, [x], spline.call([x], True, False), {"never_inline": True})


def _lookup(table: Table, lookup: Lookup, point: Sequence[ca.SX]) -> ca.SX:
    if any(lookup.orders):
        raise ValueError(f"the derivative of the table {table.name} has no symbol of CasADi's own")
    return _function(table)(ca.vertcat(*point))[lookup.output]


SYMBOLS: Arithmetic[ca.SX] = Arithmetic(
    operations=MappingProxyType(
        {
            name: (lambda x: x) if name == "assign" else _operation(name, operation.arity)
            for name, operation in OPERATIONS.items()
        }
    ),
    constant=ca.SX,
    lookup=_lookup,
)
"""CasADi's scalar expressions."""


def function(graph: Graph) -> ca.Function:
    """Return a graph as a CasADi Function of the same inputs and outputs: it computes the same doubles.

    Raises ValueError for a differentiated table.
    """
    symbols = [ca.SX.sym(label) for label in graph.labels()]
    values = evaluate(graph, symbols, SYMBOLS)
    inputs, start = [], 0
    for port in graph.inputs:
        matrix = ca.SX(ca.Sparsity.triplet(*port.shape, [row for row, _ in port.places], [c for _, c in port.places]))
        for place in port.places:
            matrix[place] = symbols[start]
            start += 1
        inputs.append(matrix)
    outputs = []
    for result in graph.outputs:
        matrix = ca.SX(*result.shape)
        for entry in result.entries:
            matrix[entry.row, entry.column] = values[entry.node]
        outputs.append(matrix)
    names = [port.name for port in graph.inputs], [result.name for result in graph.outputs]
    return ca.Function(graph.name, inputs, outputs, *names)
