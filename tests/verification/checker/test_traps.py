"""Falsehoods for which a rule must look twice: each has a point, in reach of the sentence, at which it fails."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest
from forging import Drawn, Forged, accepted, bounds, claim, coordinate, h, hashed, numbers, values

X = {"x": ["x"]}
EVERY = ([["p"]], [["m"]], [["v"]], [[[0, h(0.0)], "p", "p"]], [[[0, h(0.0)], "m", "v"]])


def below_its_sign() -> Drawn:
    g = Drawn(X)
    x = g.at["x"]
    return g.gives("y", g.put("if_else_zero", g.put("lt", x, g.put("sign", x)), x))


def jumps_alike(op: str = "lt", whole: bool = False) -> Drawn:
    """Two branches whose slopes are one, less each other: the difference jumps."""
    g = Drawn(X)
    x, zero = g.at["x"], g.number(0.0)
    held = g.put(op, zero, x)
    one, other = (g.put("if_else_zero", held, node) for node in (x, g.put("add", x, g.number(1.0))))
    if whole:
        no = g.put("not", held)
        one, other = (g.put("add", node, g.put("if_else_zero", no, x)) for node in (one, other))
    return g.gives("y", g.put("sub", one, other))


def jumps_alike_in_the_larger() -> Drawn:
    """The larger of two that jump alike and have one slope."""
    g = Drawn(X)
    x, held = g.at["x"], 0
    held = g.put("lt", g.number(0.0), x)
    one = g.put("if_else_zero", held, g.put("sub", x, g.number(2.0)))
    other = g.put("if_else_zero", held, g.put("sub", x, g.number(1.0)))
    return g.gives("y", g.put("fmax", one, other))


def kinked(at: float = 0.0) -> Drawn:
    g = Drawn(X)
    return g.gives("y", g.put("fabs", g.put("sub", g.at["x"], g.number(at))))


def floored() -> Drawn:
    g = Drawn(X)
    return g.gives("y", g.put("floor", g.at["x"]))


def zero_times_a_pole() -> Drawn:
    g = Drawn(X)
    return g.gives("y", g.put("mul", g.number(0.0), g.put("inv", g.at["x"])))


def root(power: float = 0.5) -> Drawn:
    g = Drawn(X)
    return g.gives("y", g.put("constpow", g.at["x"], g.number(power)))


POINTWISE = [
    (below_its_sign, (-3, 3), ("at least", -1.0), -2.0),
    (jumps_alike, (-1, 1), ("at least", 0.0), 0.5),
    (jumps_alike, (-1, 1), ("above", -1.0), 0.5),
    (lambda: jumps_alike("le"), (-1, 1), ("at least", 0.0), 0.0),
    (lambda: jumps_alike(whole=True), (-1, 1), ("at least", 0.0), 0.5),
    (jumps_alike_in_the_larger, (-1, 2), ("at least", 0.0), 0.5),
    (kinked, (-1, 1), ("above", 0.0), 0.0),
    (floored, (-1, 1), ("at least", 0.0), -0.5),
    (floored, (0, 1), ("at most", 0.0), 1.0),
]


@pytest.mark.parametrize(("made", "ends", "said", "point"), POINTWISE)
@pytest.mark.parametrize("tree", EVERY)
def test_a_value_that_fails_at_a_point_is_not_accepted(made, ends, said, point, tree):
    graph, (side, bound) = made().content, said
    value = values(graph, [point])["y", 0, 0]
    holds = {"at least": value >= bound, "above": value > bound, "at most": value <= bound}[side]
    assert not holds and ends[0] <= point <= ends[1]
    assert not accepted(bounds(graph, [coordinate("x", *ends)], [claim(side, bound)], tree))


QUOTIENTS = [
    (jumps_alike, (-1, 1), ("at least", 0.0), (0.0, 2.0**-40)),
    (jumps_alike_in_the_larger, (-1, 2), ("at least", 0.0), (0.0, 2.0**-40)),
    (floored, (0, 1), ("at most", 0.0), (0.5, 1.0)),
    (kinked, (-1, 1), ("at least", -0.5), (-1.0, 0.0)),
    (kinked, (0, 1), ("at most", 0.5), (0.0, 1.0)),
    (root, (0, 1), ("at most", 1e9), (0.0, 2.0**-80)),
    (lambda: root(1.0 / 3), (0, 1), ("at most", 1e9), (0.0, 2.0**-80)),
    (lambda: root(-1.0), (-1, 1), ("at most", 0.0), (-1.0, 1.0)),
]


@pytest.mark.parametrize(("made", "ends", "said", "pair"), QUOTIENTS)
@pytest.mark.parametrize("tree", EVERY)
def test_a_slope_that_fails_between_two_points_is_not_accepted(made, ends, said, pair, tree):
    graph, (side, bound), (start, end) = made().content, said, pair
    first, last = (values(graph, [point])["y", 0, 0] for point in pair)
    quotient = (last - first) / (end - start)
    assert not (quotient >= bound if side == "at least" else quotient <= bound)
    assert not accepted(bounds(graph, [coordinate("x", *ends)], [claim(side, bound, "x")], tree))


@pytest.mark.parametrize("made", [jumps_alike, jumps_alike_in_the_larger, floored, below_its_sign, zero_times_a_pole])
@pytest.mark.parametrize("side", ["continuous", "continuous everywhere"])
@pytest.mark.parametrize("tree", EVERY)
def test_what_jumps_or_is_not_there_is_not_continuous(made, side, tree):
    graph, off = made().content, 1e-12
    near = [[values(graph, [at + way * off])["y", 0, 0] for way in (-1, 1)] for at in (-1.0, 0.0, 1.0)]
    gone = values(graph, [0.0])["y", 0, 0] is None
    assert gone or max(abs(after - before) for before, after in near) > 0.5
    assert not accepted(bounds(graph, [coordinate("x", -2, 2)], [claim(side, None)], tree))


@pytest.mark.parametrize(("ends", "tree"), [((1, 2), ["p"]), ((-2, -1), ["p"])])
def test_a_slope_is_continuous_on_its_box_and_not_everywhere(ends, tree):
    graph, box = kinked().content, [coordinate("x", *ends)]
    before, after = (values(graph, [x + 1])["y", 0, 0] - values(graph, [x])["y", 0, 0] for x in (-1, 0))
    assert before != after  # the slope jumps at 0, which is one of all numbers
    assert accepted(bounds(graph, box, [claim("continuous", None, "x")], [tree]))
    assert not accepted(bounds(graph, box, [claim("continuous everywhere", None, "x")], [tree]))


def test_no_whole_number_is_skipped_where_doubles_are_far_apart():
    first = 2.0**53 + 2
    g = Drawn({"k": ["k"]})
    off, back = (g.put("sub", g.at["k"], g.number(end)) for end in (first, first + 2))
    graph = g.gives("y", g.put("mul", off, back)).content
    assert values(graph, [Fraction(int(first) + 1)])["y", 0, 0] == -1
    box = [coordinate("k", first, first + 2, True)]
    for tree in (["p"], [[0, h(first)], "p", "p"], [[0, h(first)], "m", "v"]):
        assert not accepted(bounds(graph, box, [claim("at least", 0.0)], [tree]))


def test_a_range_of_whole_numbers_has_whole_ends_and_cuts():
    graph = floored().content
    box = [coordinate("x", 0, 2, True)]
    assert accepted(bounds(graph, box, [claim("at most", 2.0)], [["p"]]))
    for tree in ([[0, h(0.5)], "p", "p"], [[0, h(2.0)], "p", "p"], [[0, h(-1.0)], "p", "p"], ["p", "p"], []):
        assert not accepted(bounds(graph, box, [claim("at most", 2.0)], [tree]))
    assert not accepted(bounds(graph, [coordinate("x", 0.5, 2, True)], [claim("at most", 2.0)], [["p"]]))
    assert not accepted(bounds(graph, [coordinate("x", 2, 0, True)], [claim("at most", -2.0)], [["p"]]))


def step(*nodes: tuple, plan: int, **cases: object) -> Forged:
    """Return a funnel of one sample of x, v, k and u, whose increment is the last of nodes; u begins at ``plan``."""
    g = Drawn({"x": ["x"], "w": ["v"], "k": ["k"], "u": ["u"]})
    for op, *args in nodes:
        g.put(op, *args)
    graph = g.gives("next_0", g.at["x"]).gives("gained", len(g.nodes) - 1).content
    point, zero = [h(0), h(0)], h(0)
    statement = {
        "graph": hashed(graph), "states": ["x"], "start": [point], "input": "u", "sample": "k",
        "others": {"v": [[h(-1), h(1)]]}, "plan": [h(plan)], "reference": [zero, zero], "noise": zero, "gain": h(1),
        "bands": [point, [h(0), h(1)]],
    }  # fmt: skip
    proof = {"inputs": [[h(0), h(1)]], "targets": [[h(1), h(1)]], "apart": [], "cuts": {}}
    one = Forged("funnel", statement, proof, [graph])
    for name, given in cases.items():
        (one.statement if name in one.statement else one.proof)[name] = given
    return one


FALLING = (
    ("const", h(1)), ("const", h(0.5)), ("sub", 3, 4), ("sub", 4, 3), ("sq", 1), ("const", h(2)), ("add", 9, 8),
    ("mul", 5, 7), ("sub", 10, 11), ("mul", 7, 12), ("fmax", 6, 13),
)  # fmt: skip
"""The larger of u - 1 and (1 - u)((2 + v^2) - (1 - u)/2): on [0, 1] the second, which falls with u."""


def test_what_was_decided_on_a_box_is_kept_on_its_parts():
    one = step(*FALLING, plan=0)
    gained = [values(one.graphs[0], [0.0, 0.5, 0.0, u])["gained", 0, 0] for u in (0.0, 0.5, 1.0)]
    assert gained[0] > gained[1] > gained[2] == 0.0  # so u goes from 0 to -gained[0], and leaves [0, 1]
    assert not accepted(one)


WAVES = (("const", h(20)), ("mul", 4, 3), ("sin", 5), ("const", h(0.5)), ("mul", 7, 6), ("add", 3, 8))
"""u + sin(20 u)/2, which does not rise with u."""


def test_what_depends_on_the_input_does_not_stand_apart():
    wide, cuts = [h(-3), h(3)], {"u": [h(-3 + i / 100) for i in range(601)]}
    given = {"gain": h(0.5), "bands": [[h(0), h(0)], wide], "inputs": [wide], "targets": [[h(-1), h(1)]]}
    one = step(*WAVES, plan=0, **given, cuts=cuts, apart=[8])
    gained = [values(one.graphs[0], [0.0, 0.0, 0.0, u])["gained", 0, 0] for u in (0.1, 0.15)]
    assert gained[1] < gained[0]
    assert not accepted(one)
    assert not accepted(step(*WAVES, plan=0, **given, cuts=cuts, apart=[3]))


@pytest.mark.parametrize(("given", "holds"), [
    ({"a": "0x1.00000000000000001p+0"}, ["=", "a", "1"]), ({"2": "1"}, ["<", "2", "3/2"]),
    ({"0x1.0000000000000p+1": "1"}, ["<", "0x1.0000000000000p+1", "3/2"]), ({"-1": "1"}, [">", "-1", "0"]),
    ({"a": " 0x1.0000000000000p+0"}, ["=", "a", "1"]), ({"a": "0x1p-2000"}, ["=", "a", "0"]),
])  # fmt: skip
def test_a_number_is_what_is_written(given, holds):
    assert not accepted(numbers(given, holds))


def test_a_slope_at_the_end_of_a_domain_is_not_there():
    graph = root().content
    for low in (0.0, -1.0):
        for tree in EVERY:
            assert not accepted(bounds(graph, [coordinate("x", low, 1)], [claim("at least", 0.0, "x")], tree))
    inside = [coordinate("x", 0.25, 1)]
    assert accepted(bounds(graph, inside, [claim("at least", 0.5 - 1e-9, "x")], [["m"]]))
    assert not accepted(bounds(graph, inside, [claim("at least", math.nextafter(0.5, 1), "x")], [["m"]]))


TWICE = [
    ("inputs", lambda g: g["inputs"].append(g["inputs"][0])),
    ("inputs", lambda g: g["inputs"].append({**g["inputs"][0], "labels": ["other"]})),
    ("inputs", lambda g: g["inputs"].append({**g["inputs"][0], "name": "z"})),
    ("inputs", lambda g: g["inputs"].append({"name": "z", "shape": [1, 1], "places": [[0, 1]], "labels": ["z"]})),
    ("inputs", lambda g: g["inputs"].append({"name": "z", "shape": [1, 2], "places": [[0, 1]] * 2, "labels": "zw"})),
    ("outputs", lambda g: g["outputs"].append(g["outputs"][0])),
    ("outputs", lambda g: g["outputs"][0]["entries"].append([0, 0, 0])),
    ("outputs", lambda g: g["outputs"][0]["entries"].append([0, 1, 0])),
]


@pytest.mark.parametrize(("what", "change"), TWICE)
def test_names_and_places_are_used_once(what, change):
    graph = kinked().content
    box, said = [coordinate("x", -1, 1)], [claim("at least", -2.0)]
    assert accepted(bounds(graph, box, said, [["p"]]))
    change(graph)
    labels = [label for port in graph["inputs"] for label in port["labels"]]
    assert not accepted(bounds(graph, [{**box[0], "name": label} for label in labels], said, [["p"]]))


def test_an_entry_that_is_not_written_is_zero():
    graph = kinked().content
    graph["outputs"].append({"name": "z", "shape": [1, 2], "entries": [[0, 1, 1]]})
    box = [coordinate("x", -1, 1)]
    assert accepted(bounds(graph, box, [claim("at least", 0.0, of="z")], [["p"]]))
    assert not accepted(bounds(graph, box, [claim("at least", 2.0**-1074, of="z")], [["p"]]))


@pytest.mark.parametrize(
    "words", ["z: y[0,0] is above 9. For all x", "m; y is above 9", "\ud800", "two\nlines", "x" * 300]
)
def test_a_name_makes_no_sentence_of_its_own(words):
    graph, box = kinked().content, coordinate("x", -1, 1)
    said = [claim("at least", -2.0)]
    assert not accepted(bounds(graph, [{**box, "unit": words}], said, [["p"]]))
    assert not accepted(numbers({words: "1"}, ["=", "1", "1"]))
    graph["inputs"][0]["labels"] = [words]
    assert not accepted(bounds(graph, [{**box, "name": words}], said, [["p"]]))
