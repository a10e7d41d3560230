"""Growing a graph: a node that is known already is found, and no number is ever computed."""

from __future__ import annotations

from dataclasses import replace

from workbench.graph.graph import Graph, Node, Result
from workbench.graph.operations import CONSTANT, LOOKUP
from workbench.graph.table import Lookup


class Builder:
    """Adds nodes to those of a graph."""

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        self.nodes = list(graph.nodes)
        self.lookups = list(graph.lookups)
        self._known = {self._key(node): place for place, node in reversed(list(enumerate(self.nodes)))}

    @staticmethod
    def _key(node: Node) -> tuple[str, tuple[int, ...], str, int]:
        return node.op, node.args, float(node.value).hex(), node.which

    def add(self, node: Node) -> int:
        """Return the place of a node, at the end where it is new."""
        place = self._known.setdefault(self._key(node), len(self.nodes))
        if place == len(self.nodes):
            self.nodes.append(node)
        return place

    def operation(self, op: str, *args: int) -> int:
        """Return the node of an operation on nodes."""
        return self.add(Node(op, args))

    def constant(self, value: float) -> int:
        """Return the node of a number."""
        return self.add(Node(CONSTANT, value=float(value)))

    def lookup(self, lookup: Lookup, *args: int) -> int:
        """Return the node of what is read of a table."""
        if lookup not in self.lookups:
            self.lookups.append(lookup)
        return self.add(Node(LOOKUP, args, which=self.lookups.index(lookup)))

    def built(self, outputs: tuple[Result, ...], name: str | None = None) -> Graph:
        """Return the graph with these outputs, without nodes that none of them needs."""
        whole = replace(
            self.graph,
            name=name or self.graph.name,
            nodes=tuple(self.nodes),
            lookups=tuple(self.lookups),
            outputs=outputs,
        )
        return whole.only(*(result.name for result in outputs))
