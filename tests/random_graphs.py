"""Random graphs with guards and lookup tables, and their values in rationals where branches not taken need none."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction

import numpy as np

from workbench.graph import RATIONALS, Arithmetic, Entry, Graph, Lookup, Node, Port, Result, Table, evaluate
from workbench.graph.operations import CONSTANT, INPUT, LOOKUP

PLAIN = ("add", "sub", "mul", "div", "sq", "neg", "fabs", "fmin", "fmax", "twice", "inv", "floor", "sign")
COMPARED = ("lt", "le", "eq", "ne", "and", "or", "not", "lt", "le")
COORDINATES = 2


def random_table(rng: np.random.Generator, axes: int) -> Table:
    """Return a table of one output with points that meet, on dyadic numbers."""
    kind = "linear" if rng.random() < 0.6 else "bspline"
    grid, degrees, sizes = [], [], []
    for _ in range(axes):
        points = sorted(rng.choice(np.arange(-6, 7) / 4, int(rng.integers(2, 5)), replace=False).tolist())
        degree = 1 if kind == "linear" else int(rng.integers(0, 4))
        if kind == "bspline":
            points = [points[0]] * degree + points + [points[-1]] * degree
        grid.append(tuple(points))
        degrees.append(degree)
        sizes.append(len(points) if kind == "linear" else len(points) - degree - 1)
    values = rng.integers(-8, 9, int(np.prod(sizes))) / 4
    return Table(name="table", kind=kind, grid=tuple(grid), values=tuple(values.tolist()), outputs=1,
                 degrees=tuple(degrees), search=(int(rng.choice([0, 2])),) * axes)  # fmt: skip


def random_graph(rng: np.random.Generator, size: int, tabled: bool = False) -> Graph:
    """Return a graph of two coordinates x and y: operations on earlier nodes, about a third of them guards."""
    nodes = [Node(INPUT, which=i) for i in range(COORDINATES)]
    nodes += [Node(CONSTANT, value=float(value)) for value in rng.integers(-4, 5, 3) / 2]
    tables = tuple(random_table(rng, axes) for axes in (1, 2)) if tabled else ()
    lookups = tuple(
        Lookup(i, 0, tuple(rng.choice([0, 0, 0, 1], table.dimensions).tolist())) for i, table in enumerate(tables)
    )
    numbers, conditions = list(range(len(nodes))), []

    def add(node: Node) -> int:
        nodes.append(node)
        return len(nodes) - 1

    def some(places: Sequence[int], count: int = 1) -> tuple[int, ...]:
        return tuple(int(place) for place in rng.choice(places[-8:] if rng.random() < 0.7 else places, count))

    while len(nodes) < size:
        kind = rng.random()
        if kind < 0.3 or not conditions:
            op = str(rng.choice(COMPARED))
            if op in ("and", "or", "not") and conditions:
                conditions.append(add(Node(op, some(conditions, 1 if op == "not" else 2))))
            elif op not in ("and", "or", "not"):
                conditions.append(add(Node(op, some(numbers, 2))))
        elif kind < 0.6:
            (condition,), (yes, no) = some(conditions), some(numbers, 2)
            first = add(Node("if_else_zero", (condition, yes)))
            if rng.random() < 0.7:  # as CasADi writes if_else
                other = add(Node("if_else_zero", (add(Node("not", (condition,))), no)))
                first = add(Node("add", (first, other)))
            numbers.append(first)
        elif tabled and kind < 0.75:
            which = int(rng.integers(len(tables)))
            numbers.append(add(Node(LOOKUP, some(numbers, tables[which].dimensions), which=which)))
        else:
            op = str(rng.choice(PLAIN))
            numbers.append(add(Node(op, some(numbers, 2 if op in (*PLAIN[:4], "fmin", "fmax") else 1))))
    ports = tuple(Port(name, (1, 1), ((0, 0),), (name,)) for name in "xy")
    result = Result("f", (1, 1), (Entry(0, 0, numbers[-1]),))
    return Graph(name="f", inputs=ports, outputs=(result,), nodes=tuple(nodes), tables=tables, lookups=lookups)


def _lenient(name: str, operation: Callable[..., Fraction]) -> Callable[..., Fraction | None]:
    """Return an operation that gives None where it has no value, and is not asked for branches that are not taken."""

    def lenient(*arguments: Fraction | None) -> Fraction | None:
        if name == "if_else_zero" and arguments[0] == 0:
            return Fraction(0)
        if any(argument is None for argument in arguments):
            return None
        try:
            return operation(*arguments)
        except (ZeroDivisionError, ValueError):
            return None

    return lenient


def _read(table: Table, lookup: Lookup, point: Sequence[Fraction | None]) -> Fraction | None:
    known = [one for one in point if one is not None]
    return RATIONALS.lookup(table, lookup, known) if len(known) == len(point) else None


LENIENT: Arithmetic[Fraction | None] = Arithmetic(
    operations={name: _lenient(name, operation) for name, operation in RATIONALS.operations.items()},
    constant=Fraction,
    lookup=_read,
)


def exact(graph: Graph, point: Sequence[float]) -> Fraction | None:
    """Return the value of the only output at a point, None where there is none."""
    target = graph.outputs[0].entries[0].node
    return evaluate(graph, [Fraction(x) for x in point], LENIENT, [target])[target]
