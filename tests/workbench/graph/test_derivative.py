"""Derivatives on the graph, against finite differences, CasADi's own, and exact rationals."""

from __future__ import annotations

from fractions import Fraction

import casadi as ca
import numpy as np
import pytest
from flint import arb, ctx

from workbench.graph import DOUBLES, RATIONALS, Arithmetic, call, evaluate, from_json, jacobian, read, to_json
from workbench.graph.derivative import _SLOPES

x, y = ca.SX.sym("x"), ca.SX.sym("y")
FREE, POSITIVE, SMALL, LARGE = (-3.0, 3.0), (0.2, 3.0), (-0.9, 0.9), (1.1, 3.0)
CASES = {
    "add": (x + y, FREE),
    "sub": (x - y, FREE),
    "mul": (x * y, FREE),
    "div": (x / y, POSITIVE),
    "neg": (-x, FREE),
    "inv": (1 / x, POSITIVE),
    "twice": (2 * x, FREE),
    "sq": (x * x, FREE),
    "sqrt": (ca.sqrt(x), POSITIVE),
    "pow": (x**y, POSITIVE),
    "constpow": (x**3.5 + y**-2, POSITIVE),
    "exp": (ca.exp(x), FREE),
    "expm1": (ca.expm1(x), FREE),
    "log": (ca.log(x), POSITIVE),
    "log1p": (ca.log1p(x), SMALL),
    "sin": (ca.sin(x), FREE),
    "cos": (ca.cos(x), FREE),
    "tan": (ca.tan(x), SMALL),
    "asin": (ca.asin(x), SMALL),
    "acos": (ca.acos(x), SMALL),
    "atan": (ca.atan(x), FREE),
    "atan2": (ca.atan2(x, y), POSITIVE),
    "sinh": (ca.sinh(x), FREE),
    "cosh": (ca.cosh(x), FREE),
    "tanh": (ca.tanh(x), FREE),
    "asinh": (ca.asinh(x), FREE),
    "acosh": (ca.acosh(x), LARGE),
    "atanh": (ca.atanh(x), SMALL),
    "erf": (ca.erf(x), FREE),
    "erfinv": (ca.erfinv(x), (-0.65, 0.9)),
    "hypot": (ca.hypot(x, y), FREE),
    "fabs": (ca.fabs(x), FREE),
    "sign": (ca.sign(x) * y, FREE),
    "floor": (ca.floor(x) * y, FREE),
    "ceil": (ca.ceil(x) + x, FREE),
    "fmod": (ca.fmod(x, y), POSITIVE),
    "remainder": (ca.remainder(x, y), POSITIVE),
    "copysign": (ca.copysign(x, y), FREE),
    "fmin": (ca.fmin(x, y) * x, FREE),
    "fmax": (ca.fmax(x, 0.5) * y, FREE),
    "lt": ((x < y) * x, FREE),
    "le": ((x <= y) * x, FREE),
    "eq": ((x == y) + x, FREE),
    "ne": ((x != y) * x, FREE),
    "not": (ca.logic_not(x > y) * x, FREE),
    "and": (ca.logic_and(x > 0, y > 0) * x, FREE),
    "or": (ca.logic_or(x > 0, y > 0) * x, FREE),
    "if_else_zero": (ca.if_else(x > y, x * y, y**2), FREE),
}
NOT_CASADIS = {"copysign"}
"""CasADi gives copysign the slope of |x| = x for negative x too."""


def scalar(expression: ca.SX) -> ca.Function:
    return ca.Function("f", [x, y], [expression], ["x", "y"], ["f"])


def test_every_operation_has_a_case():
    assert set(CASES) | {"assign"} == set(_SLOPES) | {"if_else_zero"}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("by", ["x", "y"])
def test_slopes_agree_with_differences_and_with_casadi(name, by):
    expression, (low, high) = CASES[name]
    f, rng = scalar(expression), np.random.default_rng(3)
    graph = read(f)
    assert name in {node.op for node in graph.nodes}
    slope = jacobian(graph, "f", by)
    assert from_json(to_json(slope)) == slope
    theirs = ca.Function("d", [x, y], [ca.jacobian(expression, {"x": x, "y": y}[by])])
    compared = 0
    for at in rng.uniform(low, high, (60, 2)):
        found = call(slope, {"x": at[0], "y": at[1]})[f"df_d{by}"][0, 0]
        if name not in NOT_CASADIS:
            assert found == pytest.approx(float(theirs(*at)), rel=1e-13, abs=1e-13)
        h, direction = 1e-6, np.array([by == "x", by == "y"], dtype=float)
        sides = [float(f(*(at + side * h * direction))) for side in (-1, 0, 1)]
        if abs(sides[0] - 2 * sides[1] + sides[2]) > 1e-7:  # a kink or jump lies between
            continue
        compared += 1
        rough = 1e-4 if name == "erfinv" else 1e-6  # CasADi's is good to twelve digits
        assert found == pytest.approx((sides[2] - sides[0]) / (2 * h), rel=rough, abs=rough)
    assert compared > 40


@pytest.mark.parametrize("name", ["sin", "div", "tanh", "pow", "erf", "hypot", "if_else_zero"])
def test_second_slopes(name):
    expression, (low, high) = CASES[name]
    second = jacobian(jacobian(read(scalar(expression)), "f", "x"), "df_dx", "x")
    theirs = ca.Function("d", [x, y], [ca.jacobian(ca.jacobian(expression, x), x)])
    for at in np.random.default_rng(4).uniform(low, high, (20, 2)):
        found = call(second, {"x": at[0], "y": at[1]})["ddf_dx_dx"][0, 0]
        assert found == pytest.approx(float(theirs(*at)), rel=1e-11, abs=1e-11)


def test_no_constant_is_computed_in_rounded_arithmetic():
    """x + ((1e16 y - y) - 1e16 y) + y/2 has the slope -1/2 by y; CasADi computes 1e16 - 1 - 1e16 on the way."""
    expression = x + ((1e16 * y - y) - 1e16 * y) + 0.5 * y
    slope = jacobian(read(scalar(expression)), "f", "y")
    node = slope.output("df_dy").entries[0].node
    assert evaluate(slope, [Fraction(3), Fraction(7)], RATIONALS)[node] == Fraction(-1, 2)
    assert float(ca.Function("d", [x, y], [ca.jacobian(expression, y)])(3, 7)) == 0.5


def test_slopes_of_transcendental_functions_are_exact_expressions():
    """In balls of 200 bits the slope of erf agrees with the function's own to all digits: no constant was rounded."""
    balls = Arithmetic(
        operations={
            "acos": arb.acos,
            "sqrt": arb.sqrt,
            "div": lambda a, b: a / b,
            "exp": arb.exp,
            "neg": lambda a: -a,
            "sq": lambda a: a * a,
            "mul": lambda a, b: a * b,
            "erf": arb.erf,
        },
        constant=arb,
        lookup=lambda table, lookup, point: arb(0),
    )
    slope = jacobian(read(scalar(ca.erf(x))), "f", "x")
    with ctx.workprec(200):
        found = evaluate(slope, [arb(0.3), arb(0)], balls)[slope.output("df_dx").entries[0].node]
        exact = 2 / arb.pi().sqrt() * (-(arb(0.3) ** 2)).exp()
        assert found.overlaps(exact) and found.rad() < arb(2) ** -180


def test_matrices_keep_their_places():
    state, force = ca.SX.sym("state", 3), ca.SX.sym("force", 2)
    value = ca.vertcat(state[0] * force[1], ca.SX(2.0), state[2] ** 2)
    f = ca.Function("f", [state, force], [value], ["state", "force"], ["next"])
    for by, variable in (("state", state), ("force", force)):
        slope = jacobian(read(f), "next", by)
        theirs = ca.Function("d", [state, force], [ca.jacobian(value, variable)])
        given = {"state": [1.5, -2.0, 0.5], "force": [3.0, -0.7]}
        assert np.array_equal(call(slope, given)[f"dnext_d{by}"], theirs(*given.values()).full())
        assert call(slope, given)[f"dnext_d{by}"].shape == (3, variable.numel())


@pytest.mark.parametrize(
    ("of", "by", "said"),
    [("g", "x", r"f has outputs \['f'\], got 'g'"), ("f", "z", r"f has inputs \['x', 'y'\], got 'z'")],
)
def test_unknown_names(of, by, said):
    with pytest.raises(ValueError, match=said):
        jacobian(read(scalar(x * y)), of, by)


def test_ties():
    for expression, expected in ((ca.fmin(x, y), 0.5), (ca.fmax(x, y), 0.5), (ca.fabs(x - y), 0.0)):
        slope = jacobian(read(scalar(expression)), "f", "x")
        assert call(slope, {"x": 0.3, "y": 0.3})["df_dx"][0, 0] == expected
        assert float(ca.Function("d", [x, y], [ca.jacobian(expression, x)])(0.3, 0.3)) == expected
    assert DOUBLES.operations["sign"](0.0) == 0.0


GUARDED = [
    # expression, point, slope by x
    (ca.if_else(x > 0, ca.sqrt(x), 0), -1.0, 0.0),
    (ca.if_else(x > 0, ca.sqrt(x), 0), 0.25, 1.0),
    (ca.if_else(x > 0, ca.sqrt(x) * ca.sqrt(x) + ca.log(x), 3 * x), -1.0, 3.0),
    (ca.if_else(x > 0, ca.sin(ca.sqrt(x)) + ca.sqrt(x), 3 * x) * y, -1.0, 6.0),
    (ca.if_else(x > 0, ca.if_else(x > 1, ca.sqrt(x - 1), x), 2 * x), 0.5, 1.0),
    (ca.if_else(x > 0, ca.if_else(x > 1, ca.sqrt(x - 1), x), 2 * x), -0.5, 2.0),
    (ca.if_else(ca.fabs(x) > 0.5, 1 / x, 4 * x), 0.0, 4.0),
    (ca.sqrt(ca.if_else(x > 0, x, 0)) + x, 0.25, 2.0),
    ((x > 0) * ca.sqrt(x), -1.0, np.nan),  # nothing guards the root: it has no value either
]


@pytest.mark.parametrize(("expression", "at", "expected"), GUARDED, ids=lambda one: str(one)[:50])
def test_a_branch_that_does_not_count_has_no_share_in_the_slope(expression, at, expected):
    found = call(jacobian(read(scalar(expression)), "f", "x"), {"x": at, "y": 2.0})["df_dx"][0, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-15)
