"""Certificates of ranges: where a Function's values lie, whatever its inputs are."""

from __future__ import annotations

import casadi as ca
import numpy as np

from verification.certificates.identity import graph_of
from verification.checker.anywhere import ranges
from verification.checker.graph import Graph
from verification.checker.reading import Rejected
from workbench.contracts.certificate import Certificate, hashed
from workbench.contracts.claim import NotCertified


def anywhere(says: str, function: ca.Function, of: str) -> Certificate:
    """Return the certificate of the least range that is shown for all entries of an output.

    Raises NotCertified where that is not finite.
    """
    content = graph_of(function)
    try:
        graph = Graph(content)
        nodes = [node for (name, _, _), node in graph.outputs.items() if name == of]
        found = ranges(graph, nodes)
    except Rejected as error:
        raise NotCertified(str(error)) from None
    low, high = min(found[k][0] for k in nodes), max(found[k][1] for k in nodes)
    if not np.isfinite([low, high]).all():
        raise NotCertified(f"no bounds of {of} were found that hold whatever the inputs are")
    name = hashed(content)
    return Certificate(
        kind="range",
        statement={"graph": name, "says": says, "of": of, "low": low.hex(), "high": high.hex()},
        graphs={name: content},
    )
