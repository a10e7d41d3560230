"""Certificates of identities: sides that are equal as fractions of polynomials, and slopes that are numbers."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import casadi as ca

from verification.certificates.bounds import plain
from verification.certificates.numbers import written
from verification.checker.graph import Graph as Checked
from verification.checker.identities import fractions
from verification.checker.reading import Rejected
from workbench.contracts.certificate import Certificate, Json, hashed
from workbench.contracts.claim import NotCertified
from workbench.graph import Unreadable, read

Place = tuple[str, int, int] | tuple[str, int, int, str]
"""An entry of an output (name, row, column), or its slope along a coordinate, which stands last."""
Side = Place | Fraction
SIDES: Sequence[tuple[Side, Side]] = ((("left", 0, 0), ("right", 0, 0)),)
"""By default outputs ``left`` and ``right`` are equal."""


def identity(says: str, function: ca.Function, equal: Sequence[tuple[Side, Side]] = SIDES) -> Certificate:
    """Return the certificate that sides are equal. Raises NotCertified for a Function that is no graph."""
    content = graph_of(function)
    name = hashed(content)
    return Certificate(
        kind="identity",
        statement={
            "graph": name,
            "says": says,
            "equal": [[written(one) if isinstance(one, Fraction) else list(one) for one in pair] for pair in equal],
        },
        graphs={name: content},
    )


def constant(function: ca.Function, place: Place) -> Fraction:
    """Return the number that a result or slope is, whatever the inputs are. Raises NotCertified where it is none."""
    name, row, column, *along = place
    try:
        graph = Checked(graph_of(function))
        node = graph.outputs[name, row, column]
        for one in along:
            node = graph.slope(node, graph.coordinates.index(one))
        ((top, below),) = fractions(graph, [node])
    except Rejected as error:
        raise NotCertified(str(error)) from None
    if not (top.is_constant() and below.is_constant()):
        raise NotCertified(f"{name} along {along} is no number, but depends on the inputs")
    value = top.leading_coefficient() / below.leading_coefficient() if top else 0
    return Fraction(str(value))


def graph_of(function: ca.Function) -> Json:
    """Return a Function's graph as plain data. Raises NotCertified for a Function that is none."""
    try:
        return plain(read(function))
    except Unreadable as error:
        raise NotCertified(str(error)) from None
