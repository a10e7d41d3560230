"""Certificates made by hand, with graphs and values of their own: what tests of the checker hold against it.

Nothing here is taken from the makers or from the checker's arithmetic, except where a proof is sought.
"""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from hashlib import sha256
from typing import Any

from verification.checker.folder import Shown, Store
from verification.checker.reading import FORMAT, Rejected

Number = float | Fraction


def hashed(content: Any) -> str:
    """Return the hash by which data are named."""
    return sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def h(number: float) -> str:
    """Return a double as certificates hold it."""
    return float(number).hex()


@dataclass
class Forged:
    """A certificate as data, with graphs and with what it rests on."""

    kind: str
    statement: dict[str, Any]
    proof: dict[str, Any] = field(default_factory=dict)
    graphs: list[Any] = field(default_factory=list)
    rests_on: list[Forged] = field(default_factory=list)
    truth: Any = None
    """How to look whether it is true; for those that tests change."""

    @property
    def name(self) -> str:
        """The hash of what it states."""
        return hashed([self.kind, self.statement])

    def all(self) -> list[Forged]:
        """Return it and all that it rests on."""
        return [self, *(inner for one in self.rests_on for inner in one.all())]

    def files(self) -> dict[tuple[str, str], Any]:
        """Return what its folder would hold."""
        found: dict[tuple[str, str], Any] = {}
        for one in self.all():
            content = {"format": FORMAT, "kind": one.kind, "statement": one.statement, "proof": one.proof}
            found["proofs", one.name] = content
            found |= {("graphs", hashed(graph)): graph for graph in one.graphs}
        return found

    def copy(self) -> Forged:
        """Return one that can be changed."""
        return copy.deepcopy(self)


def shown(one: Forged) -> Shown:
    """Return what the checker shows of a certificate. Raises Rejected."""
    files = one.files()

    def read(kind: str, name: str) -> object:
        if (kind, name) not in files:
            raise Rejected("there is none")
        return json.loads(json.dumps(files[kind, name]))

    return Store(read).shown(one.name)


def accepted(one: Forged) -> bool:
    """Tell whether the checker accepts a certificate."""
    try:
        return bool(shown(one).sentence)
    except Rejected:
        return False


class Drawn:
    """A graph that is drawn node by node; equal rows may come twice, as they may in a file."""

    def __init__(self, ports: Mapping[str, Sequence[str] | int]) -> None:
        """``ports`` gives the labels of each port in a row, or how many columns it has."""
        self.inputs, self.nodes, self.results = [], [], list[Any]()
        self.at: dict[str, int] = {}
        for name, given in ports.items():
            labels = [f"{name}[{i}]" for i in range(given)] if isinstance(given, int) else list(given)
            places = [[0, i] for i in range(len(labels))]
            self.inputs.append({"name": name, "shape": [1, len(labels)], "places": places, "labels": labels})
            for label in labels:
                self.at[label] = self.put("input", len(self.at))

    def put(self, op: str, *args: int) -> int:
        """Add a node."""
        self.nodes.append([op, *args])
        return len(self.nodes) - 1

    def number(self, value: float) -> int:
        """Add a constant."""
        return self.put("const", h(value))  # type: ignore[arg-type]

    def scaled(self, factor: float, node: int) -> int:
        """Add a number times a node."""
        return self.put("mul", self.number(factor), node)

    def sum(self, *nodes: int) -> int:
        """Add a sum."""
        total, *more = nodes
        for one in more:
            total = self.put("add", total, one)
        return total

    def gives(self, name: str, *nodes: int) -> Drawn:
        """Add a result, a row of nodes."""
        entries = [[0, i, node] for i, node in enumerate(nodes)]
        self.results.append({"name": name, "shape": [1, len(nodes)], "entries": entries})
        return self

    @property
    def content(self) -> dict[str, Any]:
        """The graph as data."""
        return {
            "format": "workbench.graph/1", "name": "f", "inputs": self.inputs, "outputs": self.results,
            "nodes": self.nodes, "tables": [], "lookups": [],
        }  # fmt: skip


class Absent(ArithmeticError):
    """A value does not exist."""


def _real(op: str, a: Any, b: Any = None) -> Any:
    match op:
        case "add":
            return a + b
        case "sub":
            return a - b
        case "mul":
            return a * b
        case "div":
            return a / b
        case "inv":
            return 1 / a
        case "neg":
            return -a
        case "twice":
            return 2 * a
        case "assign":
            return a
        case "sq":
            return a * a
        case "fabs":
            return abs(a)
        case "fmin":
            return min(a, b)
        case "fmax":
            return max(a, b)
        case "sign":
            return (a > 0) - (a < 0)
        case "floor":
            return math.floor(a)
        case "ceil":
            return math.ceil(a)
        case "lt":
            return int(a < b)
        case "le":
            return int(a <= b)
        case "eq":
            return int(a == b)
        case "ne":
            return int(a != b)
        case "not":
            return int(not a)
        case "and":
            return int(bool(a and b))
        case "or":
            return int(bool(a or b))
        case "pow" | "constpow":
            if a < 0 and b != int(b):
                raise Absent(op)
            return a ** int(b) if b == int(b) else float(a) ** float(b)
        case "hypot":
            return math.hypot(a, b)
    return getattr(math, op)(a)  # fmt: skip


def values(graph: Mapping[str, Any], point: Sequence[Number]) -> dict[tuple[str, int, int], Number | None]:
    """Return every result of a graph at a point, None where it does not exist."""
    known: list[Number | None] = []
    for op, *args in graph["nodes"]:
        if op == "input":
            known.append(point[args[0]])
        elif op == "const":
            number = float.fromhex(args[0])
            known.append(Fraction(number) if isinstance(point[0], Fraction) else number)
        elif op == "if_else_zero":
            known.append(None if known[args[0]] is None else known[args[1]] if known[args[0]] else 0)
        else:
            given = [known[arg] for arg in args]
            try:
                known.append(None if None in given else _real(op, *given))
            except (ArithmeticError, ValueError):
                known.append(None)
    found: dict[tuple[str, int, int], Number | None] = {}
    for one in graph["outputs"]:
        found |= {(one["name"], i, j): 0 for i in range(one["shape"][0]) for j in range(one["shape"][1])}
        found |= {(one["name"], i, j): known[node] for i, j, node in one["entries"]}
    return found


def coordinate(name: str, low: float, high: float, whole: bool = False) -> dict[str, Any]:
    """Return a coordinate of a set."""
    return {"name": name, "unit": "", "low": h(low), "high": h(high), "whole": whole}


def claim(side: str, bound: float | None, by: str | None = None, of: str = "y", row: int = 0) -> dict[str, Any]:
    """Return what is claimed of a result or of its slope."""
    return {"of": [of, row, 0], "by": by, "is": side, "bound": None if bound is None else h(bound)}


def bounds(graph: Any, box: Sequence[Any], claims: Sequence[Any], trees: Sequence[Any]) -> Forged:
    """Return a certificate of bounds."""
    statement = {"graph": hashed(graph), "set": list(box), "claims": list(claims)}
    return Forged("bounds", statement, {"trees": list(trees)}, [graph])


def numbers(facts: Mapping[str, str], *holds: Any, says: str = "It is so.") -> Forged:
    """Return a certificate of relations."""
    return Forged("numbers", {"says": says, "facts": {k: [v, ""] for k, v in facts.items()}, "holds": list(holds)})


def theorem(name: str, **premises: Forged) -> Forged:
    """Return a certificate of a theorem."""
    named = {of: one.name for of, one in premises.items()}
    return Forged("theorem", {"theorem": name, "premises": named}, rests_on=list(premises.values()))
