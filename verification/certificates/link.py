"""That the graph of a certificate is the compiled Function that runs: both are computed at points of the set."""

from __future__ import annotations

import casadi as ca
import numpy as np

from verification.certificates.bounds import plain
from verification.checker.graph import Graph as Checked
from verification.checker.reading import Rejected
from verification.enclosure.box import Box
from workbench.contracts.claim import NotCertified
from workbench.graph import Graph

POINTS = 1000
"""Points of a set at which graph and compiled Function are compared."""
ROUNDED = 1e-9
"""How far they may be apart, of the larger of 1, the value and the coordinates: doubles round, intervals do not."""


def linked(function: ca.Function, graph: Graph, box: Box) -> None:
    """Compare a graph, as the checker computes it, with a compiled Function at random points of a box.

    Raises NotCertified where they differ.
    """
    low, high = (end.ravel() for end in box.coordinates(graph))
    share = np.random.default_rng(0).random((POINTS, low.size))
    points = low + share * (high - low)
    whole = np.array(box.whole_coordinates(graph), dtype=bool)
    points[:, whole] = np.round(points[:, whole])
    widths = np.cumsum([len(port.places) for port in graph.inputs])[:-1]
    given = [np.zeros((port.shape[0], port.shape[1], POINTS)) for port in graph.inputs]
    for one, port, rows in zip(given, graph.inputs, np.split(points.T, widths), strict=True):
        for (row, column), value in zip(port.places, rows, strict=True):
            one[row, column] = value
    try:
        checked = Checked(plain(graph))
    except Rejected as error:
        raise NotCertified(str(error)) from None
    plan = checked.plan(checked.outputs.values())
    for i, point in enumerate(points):
        results = function(*(ca.DM(one[:, :, i]) for one in given))
        values = checked.enclose(plan, [(float(x), float(x)) for x in point], {})
        for of, node in checked.outputs.items():
            result = results[function.index_out(of[0])] if function.n_out() > 1 else results
            span, computed = values[node], float(result[of[1], of[2]])
            off = ROUNDED * max(1.0, abs(computed), float(np.abs(point).max(initial=0.0)))
            if span is not None and not span[0] - off <= computed <= span[1] + off:
                raise NotCertified(
                    f"the graph gives {of[0]} between {span[0]!r} and {span[1]!r} at a point of the set where the "
                    f"compiled plant gives {computed!r}"
                )
