"""Graphs of real operations, their slopes, and what they give on a box.

A slope is the derivative, and more: where the slope of f along a coordinate is enclosed by [b, c] on a closed box,
f is continuous there and f(x + t e) - f(x) lies between b t and c t. For on a line along the coordinate every node is
then Lipschitz, by induction, so differentiable almost everywhere; there the larger of two has the slope of one that
attains it, and the hull of both (``pick``) holds it. What may jump (a comparison, a floor, a branch that the box does
not decide) has no slope; boxes are closed, so a switching point lies in one and is not missed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from flint import fmpq

from verification.checker.interval import INF, NONE, RULES, STEPS, Known, Rule, Span, hull, truth
from verification.checker.reading import Json, Unknown, exact, need, number, record, rows, whole, word

GRAPH = "workbench.graph/1"
Node = tuple[Json, ...]  # an operation's name, then its arguments; an input's place, a constant's number
ARITY = {op: rule.__code__.co_argcount for op, rule in RULES.items() if op != "flat"}
ARITY |= {"assign": 1, "inv": 1, "twice": 1, "constpow": 2, "tan": 1, "hypot": 2, "if_else_zero": 2}
TOTAL = frozenset("const input add sub mul neg sq fabs fmin fmax sin cos atan tanh exp sinh cosh asinh erf".split())
ZERO, ONE = ("const", 0.0), ("const", 1.0)
Box = Sequence[Span]
MOST = 500_000
"""Nodes that a graph may have, and results."""


class Plan(NamedTuple):
    """How nodes are enclosed: constants, places of inputs, and operations with their arguments, in order."""

    constants: dict[int, Span]
    inputs: list[tuple[int, int]]
    steps: list[tuple[int, Rule | None, str, int, int, list[int]]]


class Graph:
    """Nodes of which no two are equal, arguments first. It grows as slopes are asked for.

    ``outputs`` names the nodes of results, ``coordinates`` the inputs in their order, ``ports`` those of each port,
    ``places`` their port, row and column, and ``wide`` tells which ports have several columns.
    Nodes that are ``apart`` depend on one coordinate each; they become coordinates too, ``inner`` holds what they are.
    """

    def __init__(self, content: object, apart: Sequence[int] = ()) -> None:
        form, _, inputs, outputs, given, tables, lookups = record(
            content, "format", "name", "inputs", "outputs", "nodes", "tables", "lookups"
        )
        need(form == GRAPH, f"a graph must be of the form {GRAPH}, got {form!r:.40}")
        if tables or lookups:
            raise Unknown("a lookup table has no rule here")
        self.coordinates: list[str] = []
        self.ports: dict[str, list[str]] = {}
        self.places: list[tuple[str, int, int]] = []
        self.wide: dict[str, bool] = {}
        for port in rows(inputs):
            name, shape, places, labels = record(port, "name", "shape", "places", "labels")
            need(word(name) not in self.ports, f"ports must have names of their own, got {name!r:.40} twice")
            height, width = (whole(size, 0, MOST) for size in rows(shape, 2))
            for row, column in (rows(place, 2) for place in rows(places)):
                self.places.append((name, whole(row, 0, height - 1), whole(column, 0, width - 1)))
            self.wide[name] = width > 1
            self.ports[name] = [word(label) for label in rows(labels, len(places))]
            self.coordinates += self.ports[name]
        for names in (self.coordinates, self.places):
            need(len(set(names)) == len(names), "coordinates must have names and places of their own")
        need(len(rows(given)) <= MOST, f"a graph must have at most {MOST} nodes")
        self.nodes: list[Node] = []
        self.depends: list[frozenset[int]] = []
        self._places: dict[Node, int] = {}
        self._room = 20 * MOST
        self._slopes: dict[tuple[int, int], int] = {}
        self.inner: list[int] = []
        known: list[int] = []
        for place, row in enumerate(rows(given)):
            known.append(self._read(rows(row), known))
            if place in apart:
                need(len(self.depends[known[-1]]) == 1, f"node {place} must depend on one coordinate to stand apart")
                self.inner.append(known[-1])
                known[-1] = self.put("input", len(self.coordinates) + len(self.inner) - 1)
        self.outputs: dict[tuple[str, int, int], int] = {}
        for one in rows(outputs):
            name, shape, entries = record(one, "name", "shape", "entries")
            height, width = (whole(size, 0, MOST) for size in rows(shape, 2))
            need(len(self.outputs) + height * width <= MOST, f"a graph must have at most {MOST} results")
            own = {(word(name), i, j): self.put(*ZERO) for i in range(height) for j in range(width)}
            need(not own.keys() & self.outputs.keys(), f"outputs must have names of their own, got {name!r:.40} twice")
            self.outputs |= own
            places = [(name, whole(i, 0, height - 1), whole(j, 0, width - 1)) for i, j, _ in rows(entries)]
            need(len(set(places)) == len(places), f"entries of {name!r:.40} must have places of their own")
            for at, (_, _, node) in zip(places, entries, strict=True):
                self.outputs[at] = known[whole(node, 0, len(known) - 1)]

    def _read(self, row: list[Json], known: list[int]) -> int:
        op, *args = row
        if op == "input":
            need(len(args) == 1, f"an input must have its place, got {row}")
            return self.put("input", whole(args[0], 0, len(self.coordinates) - 1))
        if op == "const":
            need(len(args) == 1, f"a constant must have its number, got {row}")
            return self.put("const", number(args[0]))
        if not isinstance(op, str) or op not in ARITY:
            raise Unknown(f"the operation {op!r:.40} has no rule here")
        need(len(args) == ARITY[op], f"{op} must have {ARITY[op]} arguments, got {row!r:.60}")
        a, *more = (known[whole(arg, 0, len(known) - 1)] for arg in args)
        if op == "assign":
            return a
        if op == "inv":
            return self.put("div", self.put(*ONE), a)
        if op == "twice":
            return self.put("mul", self.put("const", 2.0), a)
        if op == "tan":
            return self.put("div", self.put("sin", a), self.put("cos", a))
        if op == "hypot":
            return self.put("sqrt", self.put("add", self.put("sq", a), self.put("sq", more[0])))
        return self.join({"constpow": "pow", "if_else_zero": "gate"}.get(op, op), a, *more)

    def put(self, *node: Json) -> int:
        """Return the place of a node, made where there is none that is equal."""
        if node not in self._places:
            self._places[node] = len(self.nodes)
            self.nodes.append(node)
            op, *args = node
            parts = [self.depends[one] for one in args] if op not in ("input", "const") else []
            of = max(parts, key=len, default=frozenset(args if op == "input" else ()))
            self.depends.append(of if all(one is of or one <= of for one in parts) else of.union(*parts))
            self._room -= len(of) if self.depends[-1] is not of else 0
            need(self._room > 0, "too many nodes depend on too many coordinates")
        return self._places[node]

    def join(self, op: str, *args: int) -> int:
        """Put a node in the form that keeps correlations: a square, and a choice made of its two halves."""
        if op == "mul" and args[0] == args[1]:
            return self.put("sq", args[0])
        if op == "add":
            for p, q in (args, args[::-1]):
                a, b = self.nodes[p], self.nodes[q]
                if a[0] == b[0] == "gate" and self.nodes[b[1]] == ("not", a[1]):
                    return self.put("sel", a[1], a[2], b[2])
        return self.put(op, *args)

    def _times(self, a: int, b: int) -> int:
        for p, q in ((a, b), (b, a)):
            if self.nodes[p] == ZERO:
                return p
            if self.nodes[p] == ONE:
                return q
        return self.join("mul", a, b)

    def _plus(self, a: int, b: int) -> int:
        return b if self.nodes[a] == ZERO else a if self.nodes[b] == ZERO else self.put("add", a, b)

    def _minus(self, a: int, b: int) -> int:
        if a == b and not any(self.nodes[k][0].endswith("!") for k in self.ancestors([a])):
            return self.put(*ZERO)  # with a jump in it, two different values may have one slope
        if self.nodes[a] == ZERO:
            return self.put("neg", b)
        return a if self.nodes[b] == ZERO else self.put("sub", a, b)

    def slope(self, node: int, along: int) -> int:
        """Return the node of the slope of a node along a coordinate."""
        need(len(self._slopes) + node <= 4 * MOST, "too many slopes are asked for")
        for k in range(node + 1):  # in order, so that nothing recurs
            if (k, along) not in self._slopes:
                self._slopes[k, along] = self._slope(k, along) if along in self.depends[k] else self.put(*ZERO)
        return self._slopes[node, along]

    def _slope(self, k: int, along: int) -> int:
        op, *args = self.nodes[k]
        if op == "input":
            return self.put(*ONE)
        if op in STEPS:
            return self.put("flat", k)
        if op == "flat":
            return k
        d, a = [self._slopes[one, along] for one in args], args[0]
        if op == "add":
            return self._plus(*d)
        if op == "sub":
            return self._minus(*d)
        if op == "mul":
            return self._plus(self._times(d[0], args[1]), self._times(a, d[1]))
        if op == "div":
            top = self._minus(d[0], self._times(k, d[1]))
            return top if self.nodes[top] == ZERO else self.put("div", top, args[1])
        if op == "neg":
            return self._minus(self.put(*ZERO), d[0])
        if op in ("fmin", "fmax", "fabs"):
            b, e = (args[1], d[1]) if op != "fabs" else (self.put("neg", a), self._minus(self.put(*ZERO), d[0]))
            return d[0] if d[0] == e else self.put("pick", *((b, a) if op == "fmin" else (a, b)), d[0], e)
        if (kind := op.removesuffix("!")) in ("pick", "sel", "gate"):
            heads = 2 if kind == "pick" else 1
            moved = op.endswith("!") or any(along in self.depends[head] for head in args[:heads])
            return self.put(f"{kind}!" if moved else kind, *args[:heads], *d[heads:])
        return self._times(self._outer(k, op, a, args), d[0])

    def _outer(self, k: int, op: str, a: int, args: list[int]) -> int:
        """Return the node of an operation's own derivative."""
        one = self.put(*ONE)
        if op == "pow":
            kind, y = self.nodes[args[1]]
            if kind != "const":
                raise Unknown("a power whose exponent varies has no slope here")
            less = exact(y.hex()) - 1
            need(fmpq(*float(y - 1).as_integer_ratio()) == less, "an exponent must have a decrement that is a double")
            return self._times(args[1], self.put("pow", a, self.put("const", y - 1)))
        if op in ("exp", "sinh", "cosh", "sin"):
            return {"exp": k, "sinh": self.put("cosh", a), "cosh": self.put("sinh", a), "sin": self.put("cos", a)}[op]
        if op == "cos":
            return self.put("neg", self.put("sin", a))
        if op == "sq":
            return self._times(self.put("const", 2.0), a)
        if op == "expm1":
            return self.put("exp", a)
        if op == "tanh":
            return self.put("sub", one, self.put("sq", k))
        if op == "sqrt":
            return self.put("div", self.put("const", 0.5), k)
        below = {
            "log": lambda: a,
            "log1p": lambda: self.put("add", one, a),
            "atan": lambda: self.put("add", one, self.put("sq", a)),
            "asinh": lambda: self.put("sqrt", self.put("add", one, self.put("sq", a))),
        }
        if op not in below:
            raise Unknown(f"the slope of {op} has no rule here")
        return self.put("div", one, below[op]())

    def ancestors(self, targets: Iterable[int]) -> list[int]:
        """Return nodes and all that they are made of, arguments first."""
        found = set(targets)
        stack = list(found)
        while stack:
            op, *args = self.nodes[stack.pop()]
            fresh = [k for k in args if k not in found] if op not in ("input", "const") else []
            found.update(fresh)
            stack += fresh
        return sorted(found)

    def everywhere(self, node: int, wholes: Iterable[int]) -> bool:
        """Tell whether a node is seen to be defined and continuous for all real numbers, whole coordinates as given."""
        for k in self.ancestors([node]):
            op, *args = self.nodes[k]
            last = self.nodes[args[-1]] if op in ("div", "pow") else ("const", 0.0)
            divides = op == "div" and last[0] == "const" and last[1] != 0
            raises = op == "pow" and last[0] == "const" and last[1] >= 0 and float(last[1]).is_integer()
            steps = op in STEPS and self.depends[k] <= set(wholes)
            chooses = op in ("sel", "gate") and self.depends[args[0]] <= set(wholes)
            if not (op in TOTAL or divides or raises or steps or chooses):
                return False
        return True

    def plan(self, targets: Iterable[int]) -> Plan:
        """Return how nodes are enclosed, with all that they are made of."""
        wanted = [(k, *self.nodes[k]) for k in self.ancestors(targets)]
        return Plan(
            {k: (args[0], args[0]) for k, op, *args in wanted if op == "const"},
            [(k, args[0]) for k, op, *args in wanted if op == "input"],
            [
                (k, RULES.get(op), op, args[0], args[-1], args)
                for k, op, *args in wanted
                if op not in ("const", "input")
            ],
        )

    def enclose(self, plan: Plan, box: Sequence[Known], taken: dict[int, int | None]) -> dict[int, Known]:
        """Enclose nodes on a box; ``taken`` keeps which branches it decides.

        A part of a box must be given what was decided on the whole: on its edge it might decide otherwise, and be no
        part of the same smooth quantity.
        """
        values: dict[int, Known] = dict(plan.constants)
        for k, i in plan.inputs:
            values[k] = box[i]
        for k, rule, op, first, last, args in plan.steps:
            if rule is None:
                of = [values[arg] for arg in args]
                if k not in taken:
                    taken[k] = _decided(op, of)
                if taken[k] is None and op in ("sel", "gate"):
                    of[1:] = [self._narrowed(a, values, args[0], i == 0) for i, a in enumerate(args[1:])]
                values[k] = _chosen(op, of, taken[k])
                continue
            a, b = values[first], values[last]
            values[k] = None if a is None or b is None else rule(a) if len(args) == 1 else rule(a, b)
        return values

    def _narrowed(self, node: int, values: dict[int, Known], condition: int, holds: bool) -> Known:
        """Return an interval around a branch of a choice, cut to what its condition tells of that node itself."""
        span, (op, *args) = values[node], self.nodes[condition]
        if op == "not":
            return self._narrowed(node, values, args[0], not holds)
        if op == ("and" if holds else "or"):
            for arg in args:
                span = self._narrowed(node, values | {node: span}, arg, holds)
            return span
        if op not in ("lt", "le", "eq") or (op == "eq" and not holds):
            return span
        swapped = self.nodes[args[1]] == ("sign", node) if op == "eq" else not holds
        small, large = args[::-1] if swapped else args
        low, high = (values[small] or (-INF, INF))[0], (values[large] or (-INF, INF))[1]
        if op == "eq":
            if self.nodes[small] != ("sign", node):
                return span
            low, high = 0.0 if (values[large] or NONE)[0] > 0 else -INF, 0.0 if (values[large] or NONE)[1] < 0 else INF
        elif node in (small, large):
            low, high = (low, INF) if node == large else (-INF, high)
        else:
            return span
        found = None if span is None else (max(span[0], low), min(span[1], high))
        return found if found and found[0] <= found[1] else span


def _decided(op: str, of: list[Known]) -> int | None:
    """Return which branch of a choice holds on all of a box, 1 or 0, or None. At a tie of two either is right."""
    if op.startswith("pick"):
        a, b = of[:2]
        return None if a is None or b is None else 1 if b[1] <= a[0] else 0 if a[1] <= b[0] else None
    held = None if of[0] is None else truth(of[0])
    return int(held[0]) if held and held[0] == held[1] else None


def _chosen(op: str, of: list[Known], taken: int | None) -> Known:
    """Return the value of a choice: a branch that is not taken need not exist.

    A name that ends in ``!`` is a slope along what moves the condition: there is none while that is undecided.
    """
    heads = 2 if op.startswith("pick") else 1
    yes, no = (*of[heads:], NONE)[:2]
    if taken is not None:
        return yes if taken else no
    return None if op.endswith("!") or None in of[:heads] else hull(yes, no)
