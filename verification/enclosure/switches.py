"""Where a graph switches, what it is on either side, and whether both sides agree there.

A *switch* is a comparison, a sign or the truth of a number: it changes where its level is zero and nowhere else. All
that have one level up to a factor switch together. With them held as they are where the level is negative, zero or
positive, the graph has three continuous *sides*; where the three are equal as long as the level is zero, the graph is
continuous across it, though its operations jump (pasting lemma). So |u| u and max(u, 0)^2 have a continuous slope.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property

from verification.enclosure.ring import Atoms, Form, NoForm, Ring, added
from workbench.graph import Graph, Node
from workbench.graph.operations import BOOLEAN, COMPARISONS, CONSTANT

_ALL = (-1, 0, 1)


@dataclass(frozen=True, kw_only=True)
class Switch:
    """What switches together.

    Parameters
    ----------
    level
        The normal form that is zero where it switches.
    nodes
        The nodes of the graph, each with 1 or -1: the factor's sign between its own level and this one. Sizes and
        extremes (``fabs``, ``fmin``, ``fmax``) that have their kink there change sides with them.
    """

    level: Form
    nodes: tuple[tuple[int, int], ...]


class Switches:
    """The switches of a graph.

    Parameters
    ----------
    graph
        The graph; of its outputs it is asked whether they are continuous.
    depth
        How many kinks within the level of a switch are taken one by one.
    """

    def __init__(self, graph: Graph, depth: int = 2) -> None:
        self.graph = graph
        self._depth = depth
        self._targets = [entry.node for result in graph.outputs for entry in result.entries]
        self._atoms = Atoms(graph.coordinates)
        self._agree: dict[int, bool] = {}

    def of(self, place: int) -> Switch | None:
        """Return the switch that a node belongs to, None where it is none or has no normal form."""
        return next((one for one in self._found if any(place == node for node, _ in one.nodes)), None)

    @cached_property
    def _forms(self) -> Mapping[int, Form]:
        try:
            return Ring(self._atoms).forms(self.graph, self._targets)
        except NoForm:
            return {}

    def level(self, place: int) -> Form | None:
        """Return the form that is zero where a node switches or has its kink, None where there is none."""
        node, forms = self.graph.nodes[place], self._forms
        if place not in forms:
            return None
        if node.op in COMPARISONS or node.op in ("fmin", "fmax"):
            return added(forms[node.args[0]], forms[node.args[1]], Fraction(-1))
        if node.op in ("sign", "fabs"):
            return forms[node.args[0]]
        if node.op in ("not", "if_else_zero") and self.graph.nodes[node.args[0]].op not in BOOLEAN:
            return forms[node.args[0]]
        return None

    @cached_property
    def _found(self) -> tuple[Switch, ...]:
        """Return the switches, and the kinks that change sides with them or by themselves."""
        groups: dict[object, list[tuple[int, int]]] = {}
        levels: dict[object, Form] = {}
        for place in self._forms:
            level = self.level(place)
            if level is None or level.constant is not None:
                continue
            scale = level.terms[min(product for product in level.terms if product)]
            scaled = Form({product: one / scale for product, one in level.terms.items()})
            levels[scaled.key] = scaled
            groups.setdefault(scaled.key, []).append((place, 1 if scale > 0 else -1))
        return tuple(Switch(level=levels[key], nodes=tuple(nodes)) for key, nodes in groups.items())

    def side(self, switch: Switch, sign: int) -> Graph:
        """Return the graph as it is where the level of a switch has a sign: -1, 0 or 1."""
        nodes = list(self.graph.nodes)
        for place, own in switch.nodes:
            nodes[place] = _held(nodes[place], own * sign)
        return replace(self.graph, nodes=tuple(nodes))

    def agree(self, switch: Switch) -> bool:
        """Say whether the three sides are shown to be equal wherever the level is zero."""
        key = switch.nodes[0][0]
        if key not in self._agree:
            self._agree[key] = self._shown(switch) or self._shown_by_parts(switch)
        return self._agree[key]

    def _shown(self, switch: Switch) -> bool:
        try:
            ring = Ring(self._atoms, switch.level)
            sides = []
            for sign in _ALL:
                found = ring.forms(self.side(switch, sign), self._targets)
                sides.append([found[target].key for target in self._targets])
        except NoForm:
            return False
        return sides[0] == sides[1] == sides[2]

    def _shown_by_parts(self, switch: Switch) -> bool:
        """Say the same where the level has a kink in it, as |u| - 1 has: on each side of the kink by itself."""
        place = switch.nodes[0][0]
        if not self._depth:
            return False
        inner = [k for k in self.graph.ancestors([place]) if self.graph.nodes[k].op in ("fabs", "fmin", "fmax")]
        kink = next((one for one in map(self.of, inner) if one is not None and one != switch), None)
        if kink is None:
            return False
        for sign in _ALL:
            part = Switches(self.side(kink, sign), self._depth - 1)
            level, own = part.level(place), part.of(place)
            never = level is not None and bool(level.constant)  # the level is a number there, and not zero
            if not never and (own is None or not part.agree(own)):
                return False
        return True


def _held(node: Node, sign: int) -> Node:
    """Return what a switch is where its level has a sign."""
    if node.op == "if_else_zero":
        return Node("assign", (node.args[1],)) if sign else Node(CONSTANT, value=0.0)
    if node.op == "fabs":
        return Node("neg" if sign < 0 else "assign", node.args) if sign else Node(CONSTANT, value=0.0)
    if node.op in ("fmin", "fmax"):
        return Node("assign", (node.args[int((sign < 0) == (node.op == "fmax"))],))
    value = {
        "lt": sign < 0,
        "le": sign <= 0,
        "eq": sign == 0,
        "ne": sign != 0,
        "not": sign == 0,
        "sign": sign,
    }[node.op]
    return Node(CONSTANT, value=float(value))
