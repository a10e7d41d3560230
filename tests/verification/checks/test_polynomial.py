"""Normal forms against exact rational evaluation, and identities that hold, do not, or only seem to."""

from __future__ import annotations

import math
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

from verification.checks.polynomial import Identity, forms
from verification.checks.values import values_of
from workbench.contracts.finding import Standing
from workbench.graph import RATIONALS, evaluate, read

PROVED, REFUTED, UNDECIDED = Standing.PROVED, Standing.REFUTED, Standing.UNDECIDED
X, Y = ca.SX.sym("x"), ca.SX.sym("y")


def identity(left, right, x=1.7, y=0.6):
    return Identity(left=ca.SX(left), right=ca.SX(right), at={"x": (X, x), "y": (Y, y)}, method="two sides")


IDENTITIES = [
    ("multiplied out", (X + Y) ** 3, X**3 + 3 * X**2 * Y + 3 * X * Y**2 + Y**3, PROVED),
    ("a quotient by a product", (X**2 * Y + X * Y) / (X * Y), X + 1, PROVED),
    ("one sine on both sides", (ca.sin(X + Y) + 1) ** 2, ca.sin(Y + X) ** 2 + 2 * ca.sin(X + Y) + 1, PROVED),
    ("one condition on both sides", 2 * ca.if_else(X > Y, X, 0), ca.if_else(X > Y, X, 0) * 2, PROVED),
    ("numbers under a function", ca.fabs(ca.SX(-3)) * X, 3 * X, PROVED),
    ("a term too few", (X + Y) ** 2, X**2 + Y**2, REFUTED),
    ("a sign", X - Y, X + Y, REFUTED),
    ("a factor of two", 0.5 * X, X, REFUTED),
    ("a root of another argument", ca.sqrt(X), ca.sqrt(Y), REFUTED),
    ("what only exponentials know", ca.exp(X) * ca.exp(Y), ca.exp(X + Y), UNDECIDED),
    ("a last digit", 0.1 * X + 0.2 * X, 0.3 * X, UNDECIDED),
]


@pytest.mark.parametrize(("what", "left", "right", "standing"), IDENTITIES, ids=[row[0] for row in IDENTITIES])
def test_an_identity_stands_as_its_terms_say(what, left, right, standing):
    one = identity(left, right)
    found = one.finding()
    assert found.standing is standing
    if standing is REFUTED:
        assert found.margin < 0 and one.replay(found.witness) == found.margin
    if standing is PROVED:
        held = one.held()
        assert held.tries == 100 and held.margin > 0


def test_sides_that_agree_at_the_numbers_tried_prove_nothing():
    assert identity(X**2, X, x=1.0).finding().standing is UNDECIDED
    assert identity(X**2, X, x=2.0).finding().standing is REFUTED


def test_an_identity_that_fails_elsewhere_is_seen_by_the_draws():
    held = identity(X**2, X * 1.0, x=1.0).held()
    assert held.margin < 0 and held.witness


def expression(rng, depth):
    if depth == 0:
        return [X, Y, ca.SX(float(rng.integers(-3, 4)) / 4)][rng.integers(3)]
    a, b = expression(rng, depth - 1), expression(rng, depth - 1)
    return [a + b, a - b, a * b, -a, a**2, a / X, ca.fmax(a, b), ca.if_else(a < b, a, b)][rng.integers(8)]


def test_a_form_has_the_value_of_its_graph_at_rational_numbers():
    rng, seen = np.random.default_rng(3), 0
    for _ in range(60):
        function = ca.Function("f", [X, Y], [expression(rng, 4)], ["x", "y"], ["f"])
        ((form,),) = forms(function)["f"]
        if any(variable > 1 for powers in form.terms for variable, _ in powers):
            continue  # it holds what is no polynomial
        graph = read(function)
        for x, y in ((Fraction(3, 7), Fraction(-5, 3)), (Fraction(-9, 4), Fraction(1, 6))):
            point = [x, y][: graph.coordinates]
            exact = Fraction(0)
            for entry in graph.outputs[0].entries:
                exact = evaluate(graph, point, RATIONALS)[entry.node]
            total = sum(
                (c * math.prod(point[v] ** p for v, p in powers) for powers, c in form.terms.items()),
                Fraction(0),
            )
            assert total == exact
            seen += 1
    assert seen > 20


def test_what_is_not_finite_has_no_form():
    with pytest.raises(ValueError, match="must be made of finite numbers"):
        forms(ca.Function("f", [X], [X * np.inf], ["x"], ["f"]))


@pytest.mark.parametrize(
    ("expression", "low", "high"),
    [
        (0.3 + 0.7 / (1 + ca.exp(-5 * (X / Y - 1))), 0.3, 1.0),
        (ca.if_else(X > 0, 0.3 + 0.2 / (1 + ca.exp(X / Y)), 0.3), 0.3, 0.5),
        (ca.fmin(1.0, ca.fabs(X / Y)), 0.0, 1.0),
        (ca.if_else(X > 0, 2.0, 1.0) * ca.if_else(Y > 0, 1.0, 3.0), 1.0, 6.0),
        (X, -np.inf, np.inf),
        (ca.SX(1, 1), 0.0, 0.0),
    ],
)
def test_values_lie_where_they_are_said_to(expression, low, high):
    f = ca.Function("f", [X, Y], [expression], ["x", "y"], ["f"])
    found = values_of(f)
    assert found == pytest.approx((low, high), abs=1e-12)
    rng = np.random.default_rng(0)
    values = f(rng.normal(0, 10, (1, 2000)), rng.normal(0, 10, (1, 2000))).full()
    assert found[0] <= np.nanmin(values) and np.nanmax(values) <= found[1]
