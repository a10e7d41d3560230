"""What a Function takes and gives, whether it is CasADi's or a graph."""

from __future__ import annotations

from typing import NamedTuple, TypeAlias

import casadi as ca

from workbench.graph import Graph

Enclosed: TypeAlias = ca.Function | Graph
"""What can be enclosed: a CasADi Function, or its graph."""


class Taken(NamedTuple):
    """An input: its name, shape, and the rows and columns of its structural nonzeros."""

    name: str
    shape: tuple[int, int]
    rows: tuple[int, ...]
    columns: tuple[int, ...]


class Face(NamedTuple):
    """Name, inputs, and the shapes of the outputs by name."""

    name: str
    inputs: tuple[Taken, ...]
    outputs: dict[str, tuple[int, int]]


def face(function: Enclosed) -> Face:
    """Return what a Function takes and gives."""
    if isinstance(function, Graph):
        taken = [
            Taken(port.name, port.shape, tuple(row for row, _ in port.places), tuple(c for _, c in port.places))
            for port in function.inputs
        ]
        return Face(function.name, tuple(taken), {result.name: result.shape for result in function.outputs})
    inputs = []
    for i, name in enumerate(function.name_in()):
        rows, columns = function.sparsity_in(i).get_triplet()
        inputs.append(Taken(name, function.size_in(i), tuple(rows), tuple(columns)))
    return Face(function.name(), tuple(inputs), {name: function.size_out(name) for name in function.name_out()})
