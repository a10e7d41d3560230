"""Identities, slopes and ranges: what the checker accepts is true, and what is next to it is rejected."""

from __future__ import annotations

import copy
import dataclasses
import math
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

from verification.certificates.anywhere import anywhere
from verification.certificates.identity import constant, graph_of, identity
from verification.certificates.numbers import numbers
from verification.certificates.recheck import Recheck
from verification.certificates.theorem import theorem
from verification.checker.anywhere import ranges
from verification.checker.graph import Graph
from workbench.contracts.certificate import hashed
from workbench.contracts.claim import NotCertified
from workbench.graph import DOUBLES, evaluate, read

X, U, K = (ca.SX.sym(name) for name in ("x", "u", "k"))
SLOPE = ("y", 0, 0, "u")


def function(**outputs):
    return ca.Function("f", [X, U, K], [*outputs.values()], ["x", "u", "k"], [*outputs])


def sentence(certificate):
    return Recheck().sentence(certificate)


def rejected(certificate, match="did not accept"):
    with pytest.raises(NotCertified, match=match):
        sentence(certificate)


def changed(certificate, **statement):
    return dataclasses.replace(certificate, statement={**certificate.statement, **statement})


VAST = ca.sin(((X + U + K) ** 30 + 1) ** 30)  # of a polynomial with more terms than the checker bears
SIDES = [
    (VAST * (U + 1), U * VAST + VAST, True),
    (((X + U + K) ** 30 + 1) ** 30 + U, U + ((X + U + K) ** 30 + 1) ** 30, False),
    ((X + U) ** 2, X**2 + 2 * X * U + U**2, True),
    ((X + U) ** 2, X**2 + 2.0000000000000004 * X * U + U**2, False),
    ((X**2 - U**2) / (X - U), X + U, True),
    ((X**2 - U**2) / (X - U), X - U, False),
    (ca.sin(X) * (U + 1) - ca.sin(X), ca.sin(X) * U, True),
    (ca.sin(2 * X), 2 * ca.sin(X), False),
    (X**0.5 + U, U + X**0.5, True),
    (X**0.5 * X**0.5, X**0.4 * X**0.6, False),
    (ca.fabs(X) * U, X * U, False),
    (ca.fmax(X, U) + ca.fmin(X, U), X + U, False),
    (ca.if_else(K > 3, X, U), ca.if_else(K > 4, X, U), False),
    (X / 3 * 3, X, True),
    (0.1 * X + 0.2 * X, 0.3 * X, False),  # of doubles: 0.1 + 0.2 is not 0.3
    (ca.if_else(X > 2, U, 0) + ca.if_else(X > 2, X, 0), ca.if_else(X > 2, U + X, 0), False),
]


@pytest.mark.parametrize(("left", "right", "same"), SIDES, ids=[str(row[:2]) for row in SIDES])
def test_two_sides_are_one_or_are_rejected(left, right, same):
    certificate = identity("They are one.", function(left=left, right=right))
    if same:
        said = sentence(certificate)
        assert said.startswith("Of the graph") and "They are one. (left[0,0] = right[0,0], as fractions" in said
    else:
        rejected(certificate)


SLOPES = [
    (3.6 * 0.1 * U + X**2, Fraction(3.6 * 0.1)),
    (0.1 * (0.3 * U + X) + ca.sin(X), Fraction(0.1) * Fraction(0.3)),
    (X + U - U, Fraction(0)),
    (ca.if_else(K > 3, X, 2 * X) - U / 4, Fraction(-1, 4)),
    (ca.floor(X) + 2 * U, Fraction(2)),
    (X * U, None),
    (U**2, None),
    (ca.fabs(U), None),
    (ca.fmax(U, X), None),
    (ca.floor(U), None),
    (ca.sign(U), None),
    (ca.if_else(U > 0, 1, 0), None),
    (ca.if_else(U > 0, U, U + 1), None),  # its slope is 1 on either side of a jump
    (ca.if_else(K > 3, X, U), None),
    (ca.if_else(K > 3, U, 0), None),
    (U + 1e-300 * ca.floor(U), None),
]


@pytest.mark.parametrize(("y", "slope"), SLOPES, ids=[str(row[0]) for row in SLOPES])
def test_a_slope_is_a_number_or_none(y, slope):
    of = function(y=y)
    if slope is None:
        with pytest.raises(NotCertified, match="is no number"):
            constant(of, SLOPE)
    else:
        assert constant(of, SLOPE) == slope
        assert f"d y[0,0] / d u = {slope}" in sentence(identity("So.", of, [(SLOPE, slope)]))
    for wrong in (Fraction(0), Fraction(1), Fraction(2), (slope or 0) + Fraction(1, 2**80)):
        if wrong != slope:
            rejected(identity("So.", of, [(SLOPE, wrong)]))


def test_what_is_no_graph_is_not_certified():
    table = ca.interpolant("table", "linear", [[0.0, 1.0, 3.0]], [0.0, 2.0, 1.0])
    x = ca.MX.sym("u")
    of = ca.Function("f", [x], [table(x)], ["u"], ["y"])
    rejected(identity("So.", of, [(SLOPE, Fraction(1))]), match="lookup table")
    with pytest.raises(NotCertified, match="lookup table"):
        constant(of, SLOPE)
    with pytest.raises(NotCertified, match="lookup table"):
        anywhere("So.", of, "y")


FALSE_STATEMENTS = [
    {"equal": [[["y", 0, 0, "x"], "2"]]},
    {"equal": [[["y", 0, 0], "2"]]},
    {"equal": [[["y", 0, 1, "u"], "2"]]},
    {"equal": [[["z", 0, 0, "u"], "2"]]},
    {"equal": [[["y", 0, 0, "u", "u"], "2"]]},
    {"equal": [[["y", 0, 0, "v"], "2"]]},
    {"equal": [[["y", 0, 0, "u"], 2]]},
    {"equal": [[["y", 0, 0, "u"], "2.0"]]},
    {"equal": [[["y", 0, 0, "u"], "inf"]]},
    {"equal": [[["y", 0, 0, "u"]]]},
    {"equal": []},
    {"equal": [["1", "2"]]},
    {"says": "two\nlines"},
]


@pytest.mark.parametrize("statement", FALSE_STATEMENTS, ids=str)
def test_a_changed_statement_is_rejected(statement):
    good = identity("So.", function(y=X**2 + 2 * U), [(SLOPE, Fraction(2))])
    sentence(good)
    rejected(changed(good, **statement))


def test_no_number_is_taken_for_a_place_in_the_graph():
    of = function(y=X**2 + 2 * U + ca.sin(K))
    for value in range(-2, 12):
        rejected(identity("So.", of, [(("y", 0, 0), Fraction(value))]), match="differ")
        rejected(identity("So.", of, [(Fraction(value), ("y", 0, 0))]), match="differ")
    assert sentence(identity("So.", of, [(("y", 0, 0), ("y", 0, 0))]))


def test_another_graph_is_rejected_by_its_hash_or_by_what_it_gives():
    good = identity("So.", function(y=X**2 + 2 * U), [(SLOPE, Fraction(2))])
    other = graph_of(function(y=X**2 + 3 * U))
    name = good.statement["graph"]
    rejected(dataclasses.replace(good, graphs={name: other}), match="hash")
    rejected(dataclasses.replace(changed(good, graph=hashed(other)), graphs={hashed(other): other}), match="differ")
    rejected(dataclasses.replace(good, graphs={}), match="no certificate of the hash")


def slopes(b):
    return identity("So.", function(effect=X + b * U), [(("effect", 0, 0, "u"), Fraction(b))])


def gain(low, high):
    return numbers("So.", {"low": (Fraction(low), "1"), "high": (Fraction(high), "1")}, ("<=", "low", "high"))


JUST_BELOW_2 = math.nextafter(2.0, 0.0)
CONTRACTIONS = [
    (1.0, 0.3, 1.0, True),
    (1.0, 5e-324, JUST_BELOW_2, True),
    (1.0, 0.3, 2.0, False),
    (1.0, 0.0, 1.0, False),
    (1.0, -0.1, 1.0, False),
    (2.1, 1.0, 1.0, False),
    (-1.0, 0.3, 1.0, False),
    (-1.0, -1.0, -0.3, True),
    (0.5, 3.0, 2 * JUST_BELOW_2, True),
]


@pytest.mark.parametrize(("b", "low", "high", "holds"), CONTRACTIONS)
def test_gains_contract_between_their_ends_and_not_at_the_edge(b, low, high, holds):
    certificate = theorem("contraction", slopes=slopes(b), gain=gain(low, high))
    assert holds == all(abs(1 - Fraction(b) * Fraction(end)) < 1 for end in (low, high))
    if holds:
        assert "For every gain from low to high" in sentence(certificate)
    else:
        rejected(certificate, match="is false")


@pytest.mark.parametrize(("low", "holds"), [(0.6, True), (JUST_BELOW_2, True), (2.0, False), (0.0, False)])
def test_a_ratio_shrinks_between_0_and_2(low, holds):
    certificate = theorem("shrinking", identity=slopes(1.0), gain=gain(low, low))
    sentence(certificate) if holds else rejected(certificate, match="is false")


def test_a_theorem_needs_its_own_premises():
    sentence(theorem("effect", slopes=slopes(-0.5)))
    rejected(theorem("effect", slopes=slopes(0.0)), match="is false")
    rejected(theorem("effect", slopes=gain(1, 1)), match="has the premises")
    rejected(theorem("effect", slopes=slopes(1.0), gain=gain(1, 1)), match="has the premises")
    rejected(theorem("contraction", slopes=slopes(1.0)), match="has the premises")
    rejected(theorem("contraction", slopes=gain(1, 1), gain=slopes(1.0)), match="has the premises")
    rejected(theorem("contraction", slopes=slopes(1.0), gain=slopes(1.0)), match="has the premises")
    wrong = identity("So.", function(effect=X + U), [(("effect", 0, 0, "u"), Fraction(2))])
    rejected(theorem("effect", slopes=wrong), match="differ")


RANGES = [
    (1 / (1 + ca.exp(X)), (0.0, 1.0)),
    (0.3 + 0.7 / (1 + ca.exp(-5 * (X / ca.if_else(U > 0, U, 1) - 1))), (0.3, 1.0)),
    (ca.tanh(X * U) - ca.sin(ca.exp(K)), (-2.0, 2.0)),
    (ca.if_else(X > U, ca.cos(K), 3), (-1.0, 3.0)),
    (1 / (2 + ca.fabs(X)), (0.0, 0.5)),
    (ca.if_else(X > U, 5, 0), (0.0, 5.0)),
    (ca.sqrt(ca.tanh(X)), (0.0, math.inf)),
    (X, (-math.inf, math.inf)),
    (1 / X, (-math.inf, math.inf)),
    (1 / (1 + X**2), (0.0, 1.0)),
    (1 / (X**2 - 1), (-math.inf, math.inf)),
    (ca.log(1 + ca.exp(X)), (-math.inf, math.inf)),
    (ca.exp(ca.exp(700 + 10 * ca.sin(X))), (0.0, math.inf)),
    (1e308 * (3 + ca.sin(X)) - 1e308 * (3 + ca.sin(U)), (-math.inf, math.inf)),
]


@pytest.mark.parametrize(("y", "ends"), RANGES, ids=[str(row[0]) for row in RANGES])
def test_a_range_holds_whatever_the_inputs_are(y, ends):
    low, high = ends
    if not math.isfinite(low) or not math.isfinite(high):
        with pytest.raises(NotCertified, match="no bounds of y"):
            anywhere("So.", function(y=y), "y")
        return
    good = anywhere("So.", function(y=y), "y")
    found = [float.fromhex(good.statement[end]) for end in ("low", "high")]
    assert low - 1e-9 <= found[0] <= low <= high <= found[1] <= high + 1e-9
    assert f"1 entries of y lies in {found} where it exists" in sentence(good)
    inside = high - low
    rejected(changed(good, low=(low + 1e-9 * inside).hex()))
    rejected(changed(good, high=(high - 1e-9 * inside).hex()))
    rejected(changed(good, of="z"))
    rejected(changed(good, low="-inf"))


UNARY = [ca.exp, ca.sin, ca.cos, ca.tanh, ca.fabs, ca.sqrt, ca.sign, ca.floor, lambda a: a**2, lambda a: -a, ca.log]
BINARY = [
    lambda a, b: a + b, lambda a, b: a - b, lambda a, b: a * b, lambda a, b: a / b, ca.fmax, ca.fmin,
    lambda a, b: ca.if_else(a > b, a, b), lambda a, b: ca.if_else(a <= 1, b, 0),
]  # fmt: skip
FAR = [0.0, 1.0, -1.0, 1e-300, -1e-300, 1e150, -1e150, 700.0, -700.0, 0.5, 3.0]


@pytest.mark.parametrize("seed", range(40))
def test_no_value_of_a_random_graph_lies_outside_its_range(seed):
    rng = np.random.default_rng(seed)
    pool = [X, U, K, ca.SX(1), ca.SX(0.3), ca.SX(-2)]
    for _ in range(12):
        pick = [pool[int(i)] for i in rng.integers(len(pool), size=2)]
        binary = rng.random() < 0.6
        made = rng.choice(BINARY)(*pick) if binary else rng.choice(UNARY)(pick[0])
        pool += [] if made.is_constant() else [made]
    of = function(y=ca.vertcat(*pool[6:]))
    graph = Graph(graph_of(of))
    found = ranges(graph, graph.outputs.values())
    tried = 0
    with np.errstate(all="ignore"):
        for _ in range(60):
            values = of(*(float(one) * rng.choice([1.0, rng.normal()]) for one in rng.choice(FAR, 3))).full().ravel()
            for row, value in enumerate(values):
                low, high = found[graph.outputs["y", row, 0]]
                if np.isfinite(values[: row + 1]).all():
                    tried += 1
                    assert low - 1e-9 * abs(low) <= value <= high + 1e-9 * abs(high), (row, value, low, high)
    assert tried > 60


def test_a_graph_is_what_the_function_computes():
    of = function(y=ca.if_else(X > U, ca.sin(K) * X, U / (1 + K**2)))
    rng = np.random.default_rng(0)
    graph = read(of)
    for point in rng.normal(size=(1000, 3)):
        (entry,) = graph.outputs[0].entries
        assert evaluate(graph, point.tolist(), DOUBLES)[entry.node] == pytest.approx(float(of(*point)), rel=1e-15)
    assert hashed(graph_of(of)) == hashed(copy.deepcopy(graph_of(of)))
