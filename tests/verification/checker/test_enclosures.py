"""What the checker's arithmetic says of a box holds at points of it, exactly: values, slopes, and continuity."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest
from random_graphs import COMPARED, exact, random_graph

from verification.checker.bounds import Quantity
from verification.checker.graph import Graph
from workbench.graph import Entry, Node, Result, to_json
from workbench.graph import Graph as Given

GRAPHS = 150
ENDS = [float(one) / 4 for one in range(-8, 9)]


def alike(rng: np.random.Generator, size: int) -> Given:
    """Return a graph in which branches under one condition, with one slope, are taken from each other or compared."""
    graph = random_graph(rng, size // 2 + 2)
    nodes = list(graph.nodes)

    def add(op: str, *args: int) -> int:
        nodes.append(Node(op, args))
        return len(nodes) - 1

    conditions = [i for i, node in enumerate(nodes) if node.op in COMPARED]
    numbers = [i for i, node in enumerate(nodes) if node.op not in COMPARED]
    for _ in range(int(rng.integers(2, 5))):
        held, a, constant = (int(rng.choice(of)) for of in (conditions[-3:], numbers[-6:], (2, 3, 4)))
        other = add(str(rng.choice(["add", "sub"])), a, constant)
        if rng.random() < 0.3:
            held = add("lt", a, add("sign", a)) if rng.random() < 0.5 else add("eq", add("sign", a), constant)
        both = [add("if_else_zero", held, one) for one in (a, other)]
        if rng.random() < 0.4:
            no = add("not", held)
            both = [add("add", one, add("if_else_zero", no, int(rng.choice(numbers)))) for one in both]
        numbers.append(add(str(rng.choice(["sub", "sub", "fmax", "fmin", "mul", "div", "add"])), *both))
        if rng.random() < 0.5:
            numbers.append(add(str(rng.choice(["fabs", "sq", "neg"])), numbers[-1]))
    result = Result("f", (1, 1), (Entry(0, 0, numbers[-1]),))
    return dataclasses.replace(graph, nodes=tuple(nodes), outputs=(result,))


def fuzzed(seed: int, graphs: int, make: Callable[[np.random.Generator, int], Given]) -> tuple[int, int]:
    """Compare enclosures of random graphs with values at points of boxes; return how many ends and pairs were seen."""
    rng = np.random.default_rng(seed)
    ends, pairs = 0, 0
    for _ in range(graphs):
        graph = make(rng, int(rng.integers(8, 24)))
        checked = Graph(json.loads(to_json(graph)))
        node = checked.outputs["f", 0, 0]
        for _ in range(3):
            box = [tuple(sorted(float(one) for one in rng.choice(ENDS, 2))) for _ in range(2)]
            points = [[Fraction(low) + Fraction(int(i), 16) * (Fraction(high) - Fraction(low)) for (low, high), i in
                       zip(box, rng.choice([0, 0, 16, 16, 3, 8, 11], 2), strict=True)] for _ in range(12)]  # fmt: skip
            found = [exact(graph, point) for point in points]
            for along in (None, 0, 1):
                quantity = Quantity(checked, node, along)
                seen: list[tuple[Fraction, object]] = []
                if along is None:
                    seen = [(value, point) for value, point in zip(found, points, strict=True) if value is not None]
                else:
                    for point, value in zip(points, found, strict=True):
                        other = list(point)
                        other[along] = Fraction(float(rng.choice(box[along])))
                        after = exact(graph, other)
                        if None not in (value, after) and other[along] != point[along]:
                            seen.append(((after - value) / (other[along] - point[along]), (point, other)))
                for low in (True, False):
                    spans = {method: quantity.on(box, method, low=low) for method in "pmv"}
                    spans["tight"] = quantity.tight(box, low=low)
                    for method, span in spans.items():
                        if span is None:
                            continue
                        ends += 1
                        assert along is not None or None not in found, (box, method)
                        for value, at in seen:
                            good = span[0] <= value if low else value <= span[1]
                            assert good, (to_json(graph), box, along, method, low, span, float(value), at)
                if along is None and quantity.continuous(box):
                    pairs += 1
                    tiny = Fraction(1, 2**70)
                    for point, value in zip(points, found, strict=True):
                        middle = [Fraction(low + high) / 2 for low, high in box]
                        near = exact(graph, [a + tiny * (b - a) for a, b in zip(point, middle, strict=True)])
                        assert near is not None and abs(near - value) < Fraction(1, 2**20), (to_json(graph), box, point)
    return ends, pairs


@pytest.mark.parametrize("make", [random_graph, alike])
def test_enclosures_hold_values_and_slopes_at_points(make):
    ends, pairs = fuzzed(16, GRAPHS, make)
    assert ends > 2 * GRAPHS and pairs > GRAPHS / 4


@pytest.mark.slow
@pytest.mark.parametrize("make", [random_graph, alike])
@pytest.mark.parametrize("seed", range(5))
def test_enclosures_of_many_graphs(seed, make):
    assert all(fuzzed(seed, 1000, make))
