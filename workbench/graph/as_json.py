"""A graph as JSON, and back to the same graph: numbers in hexadecimal, operations by name."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TypeAlias

from workbench.graph.graph import Entry, Graph, Node, Port, Result
from workbench.graph.operations import CONSTANT, INPUT, LOOKUP
from workbench.graph.table import Lookup, Table

FORMAT = "workbench.graph/1"
Json: TypeAlias = "bool | int | float | str | Sequence[Json] | Mapping[str, Json] | None"


def to_json(graph: Graph) -> str:
    """Return a graph as JSON text: the same graph gives the same text.

    A node is a list: its operation, then its arguments; an input has its coordinate, a constant its number in
    hexadecimal, a lookup its place among the lookups and then its arguments.
    """
    content: Json = {
        "format": FORMAT,
        "name": graph.name,
        "inputs": [
            {"name": port.name, "shape": port.shape, "places": port.places, "labels": port.labels}
            for port in graph.inputs
        ],
        "outputs": [
            {"name": result.name, "shape": result.shape, "entries": result.entries} for result in graph.outputs
        ],
        "nodes": [_written(node) for node in graph.nodes],
        "tables": [
            {
                "name": table.name,
                "kind": table.kind,
                "grid": [[point.hex() for point in points] for points in table.grid],
                "values": [value.hex() for value in table.values],
                "outputs": table.outputs,
                "degrees": table.degrees,
                "search": table.search,
                **({"spread": [one.hex() for one in table.spread]} if table.spread else {}),
            }
            for table in graph.tables
        ],
        "lookups": graph.lookups,
    }
    return json.dumps(content, separators=(",", ":"), allow_nan=False)


def _written(node: Node) -> Json:
    if node.op == CONSTANT:
        return [node.op, node.value.hex()]
    if node.op in (INPUT, LOOKUP):
        return [node.op, node.which, *node.args]
    return [node.op, *node.args]


def from_json(text: str) -> Graph:
    """Return the graph that JSON text holds. Raises ValueError, in one line, where it holds none."""
    try:
        content = json.loads(text)
    except json.JSONDecodeError as error:
        raise ValueError(f"a graph must be JSON text, got {str(text)[:40]!r} ({error})") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise ValueError(f"a graph must say that its format is {FORMAT!r}")
    try:
        return Graph(
            name=str(content["name"]),
            inputs=tuple(
                Port(
                    str(port["name"]),
                    _pair(port["shape"]),
                    tuple(map(_pair, port["places"])),
                    tuple(map(str, port["labels"])),
                )
                for port in content["inputs"]
            ),
            outputs=tuple(
                Result(str(one["name"]), _pair(one["shape"]), tuple(Entry(*map(int, e)) for e in one["entries"]))
                for one in content["outputs"]
            ),
            nodes=tuple(map(_read, content["nodes"])),
            tables=tuple(
                Table(
                    name=str(table["name"]),
                    kind=table["kind"],
                    grid=tuple(tuple(map(float.fromhex, points)) for points in table["grid"]),
                    values=tuple(map(float.fromhex, table["values"])),
                    outputs=int(table["outputs"]),
                    degrees=tuple(map(int, table["degrees"])),
                    search=tuple(map(int, table["search"])),
                    spread=tuple(map(float.fromhex, table.get("spread", ()))),
                )
                for table in content["tables"]
            ),
            lookups=tuple(
                Lookup(int(table), int(output), tuple(map(int, orders))) for table, output, orders in content["lookups"]
            ),
        )
    except (KeyError, TypeError, IndexError, AttributeError) as error:
        raise ValueError(f"a graph must have every part in its form, got {type(error).__name__}: {error}") from None


def _pair(given: Sequence[int]) -> tuple[int, int]:
    first, second = map(int, given)
    return first, second


def _read(given: Sequence[int | str]) -> Node:
    op, *rest = given
    if op == CONSTANT:
        return Node(CONSTANT, value=float.fromhex(str(rest[0])))
    if op in (INPUT, LOOKUP):
        return Node(str(op), tuple(int(arg) for arg in rest[1:]), which=int(rest[0]))
    return Node(str(op), tuple(int(arg) for arg in rest))
