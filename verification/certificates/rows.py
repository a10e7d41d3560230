"""Certificates of row sums of the lifted plant, from bounds of its slopes."""

from __future__ import annotations

import math

from verification.certificates.bounds import plain
from verification.checker.bounds import Shown
from verification.checker.graph import Graph as Checked
from verification.checker.reading import Rejected
from verification.checker.recursion import row_sums
from workbench.contracts.certificate import Certificate, Json
from workbench.contracts.claim import NotCertified
from workbench.graph import Graph


def rows(slopes: Certificate, graph: Graph, samples: int, weight: float) -> Certificate:
    """Return the certificate of bounds of sum over earlier inputs of |dy(k)/du(j)| weight^(k-j).

    ``slopes`` bounds the slopes of ``x_next`` and ``y`` of a graph by all states and by the input.
    """
    claims = slopes.statement["claims"]
    assert isinstance(claims, list)
    shown = [
        Shown(tuple(one["of"]), one["by"], one["is"], float.fromhex(one["bound"])) for one in claims if one["bound"]
    ]
    try:
        earlier, every = row_sums(shown, Checked(plain(graph)), samples, weight)
    except Rejected as error:
        raise NotCertified(str(error)) from None
    if not math.isfinite(every):
        raise NotCertified("the row sums are not finite")
    statement: dict[str, Json] = {
        "bounds": slopes.name,
        "samples": samples,
        "weight": float(weight).hex(),
        "r": earlier.hex(),
        "p": every.hex(),
    }
    return Certificate(kind="rows", statement=statement, rests_on=(slopes,))
