"""Slips in the checker's own source: each lets in one falsehood that the tests hold, so none survives."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from fractions import Fraction
from typing import NamedTuple

import numpy as np
import pytest
from falsehoods import SAYS, plant, rows, rows_of, slopes, theorems
from forging import Drawn, Forged, accepted, bounds, claim, coordinate, h, hashed, numbers, theorem
from learned_by_hand import law
from slips.planting import Slip, function_of, planted
from small_funnels import funnel

X, BOTH = [coordinate("x", -1, 2)], [coordinate("x", -1, 2), coordinate("u", 1, 2)]


def rng() -> np.random.Generator:
    return np.random.default_rng(16)


def drawn(*nodes: tuple, labels: tuple[str, ...] = ("x",)) -> dict:
    g = Drawn({"x": labels})
    for op, *args in nodes:
        g.put(op, *args)
    return g.gives("y", len(g.nodes) - 1).content


def of(*nodes: tuple, says: tuple, tree: tuple | list = ("p",), box: list | None = None) -> Callable[[], Forged]:
    """Return what makes a certificate of the last of nodes; one coordinate is x, two are x and u."""
    box = X if box is None else box

    def made() -> Forged:
        graph = drawn(*nodes, labels=tuple(one["name"] for one in box))
        return bounds(graph, box, [claim(*says)], [list(tree)])

    return made


def on(low: float, high: float, whole: bool = False) -> list:
    return [coordinate("x", low, high, whole)]


SAME, ZERO, ONE, POSITIVE = ("assign", 0), ("const", h(0)), ("const", h(1)), ("lt", 1, 0)
JUMP = (ZERO, POSITIVE, ("const", h(1)), ("if_else_zero", 2, 3))
ALIKE = (ZERO, POSITIVE, ("if_else_zero", 2, 0), ONE, ("add", 0, 4), ("if_else_zero", 2, 5), ("sub", 3, 6))
HALF = [[0, h(0.0)], "p", "p"]


def inexact(op: str) -> Callable[[], Forged]:
    """Return the claim that a number is at most the double below it, to which it is rounded."""
    for a in range(1, 99):
        x, y = a / 7, 0.1
        exact = Fraction(x) * Fraction(y) if op == "mul" else Fraction(x) + Fraction(y)
        near = x * y if op == "mul" else x + y
        if exact > Fraction(near):
            return of(("const", h(y)), (op, 0, 1), says=("at most", near), box=on(x, x))
    raise AssertionError


def step(*nodes: tuple, **given: object) -> Callable[[], Forged]:
    """Return a funnel of one sample of x, v, k and u, whose increment is the last of nodes."""

    def made() -> Forged:
        g = Drawn({"x": ["x"], "w": ["v"], "k": ["k"], "u": ["u"]})
        for op, *args in nodes:
            g.put(op, *args)
        graph = g.gives("next_0", 0).gives("gained", len(g.nodes) - 1).content
        point, unit = [h(0), h(0)], [h(0), h(1)]
        statement = {
            "graph": hashed(graph), "states": ["x"], "start": [point], "input": "u", "sample": "k",
            "others": {"v": [[h(-1), h(1)]]}, "plan": [h(0)], "reference": [h(0), h(0)], "noise": h(0), "gain": h(1),
            "bands": [point, unit],
        }  # fmt: skip
        one = Forged("funnel", statement, {"inputs": [unit], "targets": [point], "apart": [], "cuts": {}}, [graph])
        for name, value in given.items():
            (one.statement if name in one.statement else one.proof)[name] = value
        return one

    return made


FALLING = (
    ("const", h(1)), ("const", h(0.5)), ("sub", 3, 4), ("sub", 4, 3), ("sq", 1), ("const", h(2)), ("add", 9, 8),
    ("mul", 5, 7), ("sub", 10, 11), ("mul", 7, 12), ("fmax", 6, 13),
)  # fmt: skip
END = [[h(1), h(1)]]
WIDE = [h(-3), h(3)]
WAVES = (("const", h(20)), ("mul", 4, 3), ("sin", 5), ("const", h(0.5)), ("mul", 7, 6), ("add", 3, 8))
CUTS = {"u": [h(-3 + i / 100) for i in range(601)]}


def sums(change: Callable[[dict], dict]) -> Callable[[], Forged]:
    def made() -> Forged:
        base, at = rows_of(rng())
        r, p = (float(at[name]) * (1 + 1e-12) for name in "rp")
        return rows(base, **{"samples": at["samples"], "weight": at["weight"], "r": r, "p": p, **change(at)})

    return made


def another_input() -> Forged:
    _, at = rows_of(rng())
    r, p = (float(at[name]) * (1 + 1e-12) for name in "rp")
    return rows(slopes(plant(*at["made"], more="p"), *at["made"]), at["samples"], at["weight"], r, p)


def bands_of_the_start() -> Forged:
    one = funnel(rng())
    one.statement["bands"][0] = one.statement["start"][0]
    return one


def said_of(name: str, **changed: Forged) -> Callable[[], Forged]:
    return lambda: theorem(name, **(dict(theorems(rng()))[name] | changed))


def sides() -> Forged:
    graph = Drawn({"x": ["x"]})
    left, right = graph.scaled(0.1, 0), graph.scaled(0.3, 0)
    content = graph.gives("left", left).gives("right", right).content
    pair = [["left", 0, 0], ["right", 0, 0]]
    return Forged("identity", {"graph": hashed(content), "says": "They are.", "equal": [pair]}, {}, [content])


class Mutant(NamedTuple):
    where: str
    stands: str
    slipped: str
    accepts: Callable[[], Forged]


B, G, V, R, L = (f"verification.checker.{one}" for one in ("bounds", "graph", "interval", "recursion", "learned"))
N = "verification.checker.numbers"
MUTANTS = (
    Mutant(f"{B}:keeps", "span[0] > bound if strict", "span[0] >= bound if strict", of(SAME, says=("above", -1.0))),
    Mutant(f"{B}:keeps", "return False", "return True", of(("inv", 0), says=("at least", 0.0))),
    Mutant(f"{B}:walk", "need(not stack,", "need(True,", of(SAME, says=("at most", 0.0), tree=[[0, h(0.0)], "p"])),
    Mutant(f"{B}:walk", "after = at + 1", "after = at + 2", of(
        ONE, ("sub", 0, 1), ("sq", 2), says=("at least", 1.0), tree=HALF, box=on(0, 2, True))),
    Mutant(f"{B}:read_set", "abs(end) < 2**53", "True", of(
        ("const", h(2.0**53 + 2)), ("const", h(2.0**53 + 4)), ("sub", 0, 1), ("sub", 0, 2), ("mul", 3, 4),
        says=("at least", 0.0), tree=[[0, h(2.0**53 + 2)], "p", "p"], box=on(2.0**53 + 2, 2.0**53 + 4, True))),
    Mutant(f"{B}:check", '(kind == "continuous" and by is None)', '(kind == "continuous")', of(
        ("fabs", 0), says=("continuous everywhere", None, "x"), box=on(1, 2))),
    Mutant(f"{B}:Quantity.continuous", "self.along is None or", "True or", of(
        ("fabs", 0), says=("continuous", None, "x"), tree=HALF)),
    Mutant(f"{B}:Quantity._kinks", "a[0] > b[1] or a[1] < b[0]", "a[0] >= b[1] or a[1] <= b[0]", of(
        ("fabs", 0), says=("continuous", None, "x"), tree=HALF)),
    Mutant(f"{B}:Quantity._reduced", "(span[0] >= 0) == low", "(span[0] >= 0) != low", of(
        ("exp", 0), says=("at most", 1.0), tree="m")),
    Mutant(f"{B}:Quantity._reduced", "or span[1] <= 0:", "or span[1] >= 0:", of(
        ("sq", 0), says=("at least", 3.0), tree="m")),
    Mutant(f"{B}:Quantity._reduced", "else add(change, by)", "else change", of(
        ("sq", 0), says=("at least", 0.2), tree="v")),
    Mutant(f"{B}:Quantity._reduced", "dict(decided)", "{}", step(*FALLING, targets=END)),
    Mutant(f"{G}:Graph._minus", 'endswith("!")', 'endswith("?")', of(*ALIKE, says=("at least", 0.0), tree="m")),
    Mutant(f"{G}:Graph._slope", 'self.put("flat", k)', "self.put(*ZERO)", of(
        ("floor", 0), says=("at most", 0.0, "x"))),
    Mutant(f"{G}:Graph._slope", 'op.endswith("!") or any', 'op.endswith("!") and any', of(
        *JUMP, says=("at most", 0.0, "x"))),
    Mutant(f"{G}:Graph._slope", "self._times(k, d[1])", "self._times(a, d[1])", of(
        ("inv", 0), says=("at most", -0.2, "x"), box=on(2, 4))),
    Mutant(f"{G}:Graph._outer", 'self.put("neg", self.put("sin", a))', 'self.put("sin", a)', of(
        ("cos", 0), says=("at least", 0.0, "x"), box=on(1, 2))),
    Mutant(f"{G}:Graph._outer", 'self.put("sq", k)', 'self.put("sq", a)', of(
        ("tanh", 0), says=("at most", -1.0, "x"), box=on(2, 3))),
    Mutant(f"{G}:Graph.everywhere", ' and last[0] == "const" and last[1] != 0', "", of(
        ("inv", 0), says=("continuous everywhere", None), tree=[])),
    Mutant(f"{G}:Graph.everywhere", '("sel", "gate") and self.depends[args[0]] <= set(wholes)', '("sel", "gate")', of(
        ONE, ("if_else_zero", 0, 1), says=("continuous everywhere", None), tree=[])),
    Mutant(f"{G}:Graph._narrowed", 'if op == "eq" else not holds', "or not holds", of(
        ("sign", 0), ("lt", 0, 1), ("if_else_zero", 2, 0), says=("at least", -1.0), box=on(-3, 3))),
    Mutant(f"{G}:_decided", "1 if b[1] <= a[0]", "1 if b[0] <= a[0]", of(("fabs", 0), says=("at least", 1.0, "x"))),
    Mutant(f"{G}:_chosen", 'op.endswith("!") or', "", of(*JUMP, says=("at most", 0.0, "x"))),
    Mutant(f"{G}:Graph.put", "else of.union(*parts)", "else of", of(
        ("add", 0, 1), says=("at most", 0.0, "u"), box=BOTH)),
    Mutant(f"{G}:Graph.join", '== ("not", a[1])', '[0] == "not"', of(
        ZERO, POSITIVE, ONE, ("lt", 3, 0), ("not", 4), ("if_else_zero", 2, 3), ("if_else_zero", 5, 3), ("add", 6, 7),
        says=("at most", 1.0))),
    Mutant(f"{G}:Graph._times", "return q", "return p", of(("mul", 0, 1), says=("at most", 1.0, "x"), box=BOTH)),
    Mutant(f"{G}:Graph.__init__", "for names in (self.coordinates, self.places):", "for names in (self.coordinates,):",
           lambda: law(4, "one_place_twice", 0.5)),
    Mutant(f"{V}:outward", "math.nextafter(high, INF)", "high", inexact("mul")),
    Mutant(f"{V}:_sum", "near if off <= 0 else", "near if off <= 1 else", inexact("add")),
    Mutant(f"{V}:power", "magnitude(a) if y % 2 == 0 else a", "a", of(
        ("const", h(2)), ("constpow", 0, 1), says=("at least", 0.5))),
    Mutant(f"{V}:magnitude", "0.0 if a[0] <= 0 <= a[1] else min", "min", of(("fabs", 0), says=("at least", 1.0))),
    Mutant(f"{V}:div", "if b[0] <= 0 <= b[1]", "if b[0] == 0", of(("inv", 0), says=("at most", 2.0))),
    Mutant(f"{R}:row_sums", "_up(largest + own)", "largest", sums(lambda at: {"p": float(at["r"]) * (1 + 1e-12)})),
    Mutant(f"{R}:row_sums", "need(not moved and", "need(True and", another_input),
    Mutant(f"{R}:row_sums", "_up(_product(line, reach) + more)", "_up(_product(line, reach))", sums(
        lambda at: {"r": 1e-9, "p": at["made"][3] * (1 + 1e-9)})),
    Mutant(f"{R}:Sets.step", "need(b[0] > 0", "need(True", step(*FALLING, targets=END)),
    Mutant(f"{R}:Sets.step", "most <= 1 or", "most <= 9 or", step(("assign", 3), gain=h(3))),
    Mutant(f"{R}:Sets.beyond", "self.rise[k] - self.spread", "self.rise[k] + self.spread", step(
        ("assign", 3), noise=h(0.5), targets=[[h(0), h(1)]])),
    Mutant(f"{R}:Sets.__init__", "all(one.along != self.by for one in self.inner)", "True", step(
        *WAVES, gain=h(0.5), bands=[[h(0), h(0)], WIDE], inputs=[WIDE], targets=[[h(-1), h(1)]], cuts=CUTS, apart=[8])),
    Mutant(f"{R}:check_funnel", "need(all(low", "need(any(low", bands_of_the_start),
    Mutant(f"{L}:Column.content", "column == 0", "0", lambda: law(4, "missing_at_first", 0.5)),
    Mutant(f"{L}:_copies", 'or (f"next_{name}", row, column) not in graph.outputs', "",
           lambda: law(4, "was_narrow", 0.5)),
    Mutant(f"{L}:_copies", "name in left or", "", lambda: law(4, "named_e", 0.5)),
    Mutant(f"{L}:Column.boxes", 'what not in ("y", "e") or column <= sure', "True",
           lambda: law(4, "missing_in_memory", 0.5)),
    Mutant(f"{L}:between", "(top - low * below, high * below - top)", "(high * below - top,)",
           lambda: law(4, "less_by_a_digit", 0.5)),
    Mutant(f"{L}:_moves", "need(not len(top)", "need(True", lambda: law(4, "moves_unreached", 0.5)),
    Mutant(f"{L}:_moves", "need(not len(rest)", "need(True", lambda: law(4, "adds", 0.5)),
    Mutant(f"{L}:check", 'begins.get(port) != "0"', "False", lambda: law(4, "was_begins", 0.5)),
    Mutant("verification.checker.identities:check", "times(a, d) == times(c, b)",
           "len(times(a, d)) == len(times(c, b))", sides),
    Mutant(f"{N}:related", "need(_COMPARED[sign](a, b)", "need(_COMPARED[sign](a, b) or a == b",
           lambda: numbers({"a": "1"}, ["<", "a", "1"])),
    Mutant(f"{N}:check", "not any(", "True or any(", lambda: numbers({"2": "1"}, ["<", "2", "3/2"])),
    Mutant(f"{N}:check_theorem", "need(good,", "need(True,", said_of(
        "lambda_min", slopes=numbers({"low": "0", "high": "1/9"}, ["<", "low", "high"]))),
    Mutant(f"{N}:check_theorem", "need(about,", "need(True,", said_of(
        "theorem1.conclusion", no_filter=numbers({"the law has a filter": "0"}, ["=", "1", "1"]))),
    Mutant("verification.checker.reading:number", "value.hex() == text", "True",
           lambda: numbers({"a": "0x1.00000000000000001p+0"}, ["=", "a", "1"])),
)  # fmt: skip


def test_there_are_many_and_of_many_functions():
    assert len(MUTANTS) >= 45 and len(Counter(one.where for one in MUTANTS)) >= 30
    assert all(function_of(one.where) for one in MUTANTS) and len(SAYS) > 9


@pytest.mark.parametrize("one", MUTANTS, ids=lambda one: f"{one.where.split('.')[-1]} {one.slipped[:20]}")
def test_no_mutant_of_the_checker_survives(one):
    false = one.accepts()
    assert not accepted(false)
    slip = Slip(where=one.where, stands=one.stands, slipped=one.slipped, causes="a falsehood", check=lambda: None)
    with planted(slip):
        assert accepted(false), "the slip lets this falsehood not in: another one is needed"
