"""Every operation in doubles, against CasADi's virtual machine, bit for bit."""

from __future__ import annotations

import math
import struct

import casadi as ca
import numpy as np
import pytest

from workbench.graph import DOUBLES, OPERATIONS, RATIONALS, call, from_json, read, to_json
from workbench.graph.symbolic import SYMBOLS, function

x, y = ca.SX.sym("x"), ca.SX.sym("y")
SPECIAL = [0.0, -0.0, 1.0, -1.0, 0.5, -0.5, 2.0, -2.0, 3.0, -3.7, 0.7, -0.7, 0.99, 1.5, math.pi, 1e16, 710.0, -745.2]
SPECIAL += [1e-310, -1e-310, 5e-324, 1e308, -1e308, math.inf, -math.inf, math.nan]
UNARY = {
    "neg": -x,
    "inv": 1 / x,
    "twice": 2 * x,
    "sq": x * x,
    "sqrt": ca.sqrt(x),
    "constpow": x**3.5,
    "exp": ca.exp(x),
    "expm1": ca.expm1(x),
    "log": ca.log(x),
    "log1p": ca.log1p(x),
    "sin": ca.sin(x),
    "cos": ca.cos(x),
    "tan": ca.tan(x),
    "asin": ca.asin(x),
    "acos": ca.acos(x),
    "atan": ca.atan(x),
    "sinh": ca.sinh(x),
    "cosh": ca.cosh(x),
    "tanh": ca.tanh(x),
    "asinh": ca.asinh(x),
    "acosh": ca.acosh(x),
    "atanh": ca.atanh(x),
    "erf": ca.erf(x),
    "erfinv": ca.erfinv(x),
    "fabs": ca.fabs(x),
    "sign": ca.sign(x),
    "floor": ca.floor(x),
    "ceil": ca.ceil(x),
    "not": ca.logic_not(x),
}
BINARY = {
    "add": x + y,
    "sub": x - y,
    "mul": x * y,
    "div": x / y,
    "pow": x**y,
    "atan2": ca.atan2(x, y),
    "fmod": ca.fmod(x, y),
    "remainder": ca.remainder(x, y),
    "copysign": ca.copysign(x, y),
    "hypot": ca.hypot(x, y),
    "fmin": ca.fmin(x, y),
    "fmax": ca.fmax(x, y),
    "lt": x < y,
    "le": x <= y,
    "eq": x == y,
    "ne": x != y,
    "and": ca.logic_and(x, y),
    "or": ca.logic_or(x, y),
    "if_else_zero": ca.if_else(x, y, 0),
}
EXPRESSIONS = UNARY | BINARY


def bits(value: float) -> bytes:
    """The bits of a double; every NaN is one."""
    return b"nan" if math.isnan(value) else struct.pack("<d", value)


def points(name: str) -> list[tuple[float, float]]:
    rng = np.random.default_rng(sorted(EXPRESSIONS).index(name))
    drawn = [*rng.normal(0, 3, (150, 2)), *rng.uniform(-1, 1, (150, 2))]
    firsts = SPECIAL if name in BINARY else [0.0]
    return [(a, b) for a in SPECIAL for b in firsts] + [(float(a), float(b)) for a, b in drawn]


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_the_doubles_are_those_of_the_virtual_machine(name):
    f = ca.Function("f", [x, y], [EXPRESSIONS[name]], ["x", "y"], ["f"])
    graph = read(f)
    assert name in {node.op for node in graph.nodes}
    again, symbols = from_json(to_json(graph)), function(graph)
    assert again == graph
    for a, b in points(name):
        expected = bits(float(f(a, b)))
        assert bits(call(graph, {"x": a, "y": b})["f"][0, 0]) == expected, (a, b)
        assert bits(call(again, {"x": a, "y": b})["f"][0, 0]) == expected, (a, b)
        assert bits(float(symbols(a, b))) == expected, (a, b)


def test_every_operation_is_tried_and_has_every_arithmetic():
    assert set(EXPRESSIONS) | {"assign"} == set(OPERATIONS) == set(DOUBLES.operations) == set(SYMBOLS.operations)
    assert set(RATIONALS.operations) < set(OPERATIONS)
    assert all(OPERATIONS[name].arity == (2 if name in BINARY or name == "constpow" else 1) for name in EXPRESSIONS)


@pytest.mark.parametrize("slip", ["sub", "fmin", "sign", "fmod", "atan2"])
def test_a_slip_in_an_operation_is_seen(slip):
    wrong = {
        "sub": lambda a, b: b - a,
        "fmin": min,  # not a NaN's other side
        "sign": lambda a: math.copysign(1.0, a),
        "fmod": lambda a, b: a % b if b and math.isfinite(a) and math.isfinite(b) else math.nan,
        "atan2": lambda a, b: math.atan2(b, a),
    }[slip]
    object.__setattr__(DOUBLES, "operations", (kept := DOUBLES.operations) | {slip: wrong})
    try:
        with pytest.raises(AssertionError):
            test_the_doubles_are_those_of_the_virtual_machine(slip)
    finally:
        object.__setattr__(DOUBLES, "operations", kept)


def test_a_thousand_random_graphs_compute_the_same_doubles():
    rng = np.random.default_rng(7)
    one = [e for name, e in UNARY.items() if name != "erfinv"]
    two = [e for name, e in BINARY.items() if name != "copysign"]  # it tells the sign of a NaN

    def expression(depth: int) -> ca.SX:
        if depth == 0:
            return [x, y, ca.SX(0.1), ca.SX(-3.0), ca.SX(1e16)][rng.integers(5)]
        if rng.random() < 0.4:
            return ca.substitute(one[rng.integers(len(one))], x, expression(depth - 1))
        operation = two[rng.integers(len(two))]
        return ca.substitute([operation], [x, y], [expression(depth - 1), expression(depth - 1)])[0]

    finite = 0
    for _ in range(1000):
        f = ca.Function("f", [x, y], [expression(int(rng.integers(1, 6)))], ["x", "y"], ["f"])
        graph = read(f)
        for a, b in rng.normal(0, 2, (3, 2)).tolist():
            expected = float(f(a, b))
            assert bits(call(graph, {"x": a, "y": b})["f"][0, 0]) == bits(expected), (f, a, b)
            finite += math.isfinite(expected)
    assert finite > 1500
