"""Exact slopes of a plant's equations as graphs: no constant is computed in rounded arithmetic on the way."""

from __future__ import annotations

from dataclasses import replace

from workbench.graph import Builder, Entry, Graph, Result, jacobian


def slope(graph: Graph, of: str, by: str, row: int = 0, column: int = 0) -> Graph:
    """Return one entry of the derivative of an output by an input, as a graph whose only output is ``slope``.

    An entry that is structurally zero is the constant 0. Raises ValueError for an unknown name.
    """
    whole = jacobian(graph, of, by)
    (result,) = whole.outputs
    found = [entry.node for entry in result.entries if (entry.row, entry.column) == (row, column)]
    if not found:
        build = Builder(replace(whole, outputs=()))
        return build.built((Result("slope", (1, 1), (Entry(0, 0, build.constant(0.0)),)),))
    one = Result("slope", (1, 1), (Entry(0, 0, found[0]),))
    return replace(whole, outputs=(one,)).only("slope")
