"""Certificates of bounds and continuity of a Function over a box."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from verification.certificates.trees import bounded, continuous, tree
from verification.checker.bounds import Quantity, read_set
from verification.checker.graph import Graph as Checked
from verification.checker.reading import Rejected
from verification.enclosure.box import Box
from workbench.contracts.certificate import Certificate, Json, hashed
from workbench.contracts.claim import NotCertified
from workbench.graph import Graph, to_json

SPARE = 1e-6
"""Share by which a bound is certified wider than it was found: a bound at its best would need many pieces."""


class Ask(NamedTuple):
    """What is to be certified: a value of an output, or its slope along a coordinate, and its bound.

    ``side`` is ``above``, ``at least``, ``below``, ``at most`` or ``continuous``, which has no bound; with
    `` everywhere`` behind it the coordinates that are not whole may be any real numbers.
    """

    of: tuple[str, int, int]
    by: str | None
    side: str
    bound: float | None = None


def looser(bound: float, side: str, spare: float = SPARE) -> float:
    """Return a bound a little wider, so that it is shown in few pieces."""
    off = spare * abs(bound)
    return bound - off if side.startswith(("above", "at least")) else bound + off


def bounds(graph: Graph, box: Box, units: Mapping[str, str], asks: Sequence[Ask]) -> Certificate:
    """Return the certificate of what is asked. Raises NotCertified where the checker's rules do not show it."""
    content = plain(graph)
    given = set_of(graph, box, units)
    try:
        checked = Checked(content)
        coordinates = read_set(given, checked)
        claims, trees = list[Json](), list[Json]()
        for ask in asks:
            along = None if ask.by is None else checked.coordinates.index(ask.by)
            wholes = [i for i, one in enumerate(coordinates) if one.whole]
            quantity = Quantity(checked, checked.outputs[ask.of], along, wholes)
            kind = ask.side.removesuffix(" everywhere")
            if kind != ask.side and not checked.everywhere(quantity.node, wholes):
                raise NotCertified(f"{ask.of} is not seen to be {kind} everywhere")
            leaf = continuous(quantity) if ask.bound is None else bounded(quantity, kind, ask.bound)
            found: list[Json] | None = []
            if ask.side != "continuous everywhere" or ask.by is not None:
                found = tree(quantity, coordinates, leaf)
            if found is None:
                raise NotCertified(f"no tree of pieces was found for {ask}")
            trees.append(found)
            claims.append({"of": list(ask.of), "by": ask.by, "is": ask.side, "bound": _hex(ask.bound)})
    except Rejected as error:
        raise NotCertified(str(error)) from None
    name = hashed(content)
    return Certificate(
        kind="bounds",
        statement={"graph": name, "set": given, "claims": claims},
        proof={"trees": trees},
        graphs={name: content},
    )


def plain(graph: Graph) -> Json:
    """Return a graph as plain data."""
    content: Json = json.loads(to_json(graph))
    return content


def set_of(graph: Graph, box: Box, units: Mapping[str, str]) -> list[Json]:
    """Return a box as the set of a statement."""
    low, high = box.coordinates(graph)
    whole = box.whole_coordinates(graph)
    return [
        {"name": name, "unit": units.get(name, ""), "low": _hex(a), "high": _hex(b), "whole": bool(w)}
        for name, a, b, w in zip(graph.labels(), low.ravel(), high.ravel(), whole, strict=True)
    ]


def _hex(value: float | None) -> str | None:
    return None if value is None else float(value).hex()
