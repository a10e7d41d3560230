"""A Function as plain data: nodes in an order in which arguments come first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from workbench.graph.operations import CONSTANT, INPUT, LOOKUP, OPERATIONS
from workbench.graph.table import Lookup, Table


class Node(NamedTuple):
    """One operation on earlier nodes, a number, a coordinate of the inputs, or a value of a lookup table."""

    op: str
    """A name in :data:`~workbench.graph.operations.OPERATIONS`, or ``input``, ``const`` or ``lookup``."""
    args: tuple[int, ...] = ()
    value: float = 0.0
    """The number of a constant."""
    which: int = -1
    """Which coordinate an input is; which of the graph's lookups a lookup is."""


class Port(NamedTuple):
    """An input: its shape, and the places and names of its structural nonzeros, column after column."""

    name: str
    shape: tuple[int, int]
    places: tuple[tuple[int, int], ...]
    labels: tuple[str, ...]


class Entry(NamedTuple):
    """One structural nonzero of an output."""

    row: int
    column: int
    node: int


class Result(NamedTuple):
    """An output: its shape and its structural nonzeros, column after column."""

    name: str
    shape: tuple[int, int]
    entries: tuple[Entry, ...]


@dataclass(frozen=True, kw_only=True)
class Graph:
    """A Function as plain data.

    Coordinates are the structural nonzeros of all inputs, one after another.

    Parameters
    ----------
    name
        Name of the Function.
    inputs, outputs
        What it takes and what it gives.
    nodes
        Arguments stand before what is made of them.
    tables
        Numbers of the lookup tables.
    lookups
        What is read of them: which table, which of its outputs, differentiated how often along which axis.
    """

    name: str
    inputs: tuple[Port, ...]
    outputs: tuple[Result, ...]
    nodes: tuple[Node, ...]
    tables: tuple[Table, ...] = ()
    lookups: tuple[Lookup, ...] = ()

    def __post_init__(self) -> None:
        """Raise ValueError where the data is no graph."""
        for lookup in self.lookups:
            table = self.tables[lookup.table] if 0 <= lookup.table < len(self.tables) else None
            if table is None or not 0 <= lookup.output < table.outputs or len(lookup.orders) != table.dimensions:
                raise ValueError(f"a lookup of {self.name} must read an output of a table of its, got {lookup}")
            if min(lookup.orders) < 0:
                raise ValueError(f"a lookup of {self.name} must be differentiated 0 times or more, got {lookup}")
        for port in self.inputs:
            if len(set(port.places)) != len(port.places) or len(port.labels) != len(port.places):
                raise ValueError(f"input {port.name} of {self.name} must name every place once")
            self._inside(port.name, port.shape, port.places)
        for result in self.outputs:
            places = [(entry.row, entry.column) for entry in result.entries]
            if len(set(places)) != len(places):
                raise ValueError(f"output {result.name} of {self.name} must name every place once")
            self._inside(result.name, result.shape, places)
        coordinates = self.coordinates
        for place, node in enumerate(self.nodes):
            if any(not 0 <= arg < place for arg in node.args):
                raise ValueError(f"node {place} of {self.name} must have earlier nodes as arguments, got {node.args}")
            if node.op == INPUT:
                good = not node.args and 0 <= node.which < coordinates
            elif node.op == CONSTANT:
                good = not node.args
            elif node.op == LOOKUP:
                good = 0 <= node.which < len(self.lookups) and len(node.args) == self.table_of(node).dimensions
            else:
                good = node.op in OPERATIONS and len(node.args) == OPERATIONS[node.op].arity
            if not good:
                raise ValueError(f"node {place} of {self.name} must be an operation with its arguments, got {node}")
        for result in self.outputs:
            if any(not 0 <= entry.node < len(self.nodes) for entry in result.entries):
                raise ValueError(f"output {result.name} of {self.name} must name nodes that exist")

    def _inside(self, name: str, shape: tuple[int, int], places: Sequence[tuple[int, int]]) -> None:
        if any(not (0 <= row < shape[0] and 0 <= column < shape[1]) for row, column in places):
            raise ValueError(f"{name} of {self.name} must have places within its shape {shape}")

    @property
    def coordinates(self) -> int:
        """The number of coordinates."""
        return sum(len(port.places) for port in self.inputs)

    def labels(self) -> tuple[str, ...]:
        """Return the names of the coordinates."""
        return tuple(label for port in self.inputs for label in port.labels)

    def output(self, name: str) -> Result:
        """Return an output by name. Raises ValueError for an unknown one."""
        for result in self.outputs:
            if result.name == name:
                return result
        raise ValueError(f"{self.name} has outputs {[result.name for result in self.outputs]}, got {name!r}")

    def table_of(self, node: Node) -> Table:
        """Return the table that a lookup reads."""
        return self.tables[self.lookups[node.which].table]

    def ancestors(self, targets: Sequence[int]) -> tuple[int, ...]:
        """Return nodes and everything that they depend on, in order."""
        needed, stack = set(targets), list(targets)
        while stack:
            fresh = [arg for arg in self.nodes[stack.pop()].args if arg not in needed]
            needed.update(fresh)
            stack.extend(fresh)
        return tuple(sorted(needed))

    def only(self, *outputs: str) -> Graph:
        """Return the graph with some of its outputs, without nodes that none of them needs."""
        kept = tuple(self.output(name) for name in outputs)
        needed = self.ancestors([entry.node for result in kept for entry in result.entries])
        new = {old: place for place, old in enumerate(needed)}
        nodes = [self.nodes[old] for old in needed]
        return replace(
            self,
            nodes=tuple(node._replace(args=tuple(new[arg] for arg in node.args)) for node in nodes),
            outputs=tuple(
                result._replace(entries=tuple(entry._replace(node=new[entry.node]) for entry in result.entries))
                for result in kept
            ),
        )

    def describe(self, node: int, limit: int = 80) -> str:
        """Return the expression of a node as text, cut to a length."""
        text = self._text(node, 4 * limit)
        return text if len(text) <= limit else text[: limit - 3] + "..."

    def _text(self, place: int, room: int) -> str:
        node = self.nodes[place]
        if node.op == INPUT:
            return self.labels()[node.which]
        if node.op == CONSTANT:
            return f"{node.value:g}" if float(f"{node.value:g}") == node.value else repr(node.value)
        if room <= 0:
            return "..."
        shares = [self._text(arg, (room - 4) // len(node.args)) for arg in node.args]
        if node.op == LOOKUP:
            primes = "'" * sum(self.lookups[node.which].orders)
            return f"{self.table_of(node).name}{primes}({','.join(shares)})"
        return OPERATIONS[node.op].form.format(*shares)
