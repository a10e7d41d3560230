"""The fuzzy engine against an independent NumPy inference."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from models.quantity import InvalidValue
from workbench.controllers.parts.fuzzy import Rule, Rules, s_shaped, triangle, z_shaped
from workbench.controllers.parts.immune import RULES, stimulus

AXIS = np.linspace(-1, 1, 101)


def smf(x, a, b):
    x = np.asarray(x, dtype=float)
    middle = (a + b) / 2
    rise, fall = 2 * ((x - a) / (b - a)) ** 2, 1 - 2 * ((x - b) / (b - a)) ** 2
    return np.where(x <= a, 0.0, np.where(x <= middle, rise, np.where(x < b, fall, 1.0)))


def inferred(u, du):
    """Return the degrees on the axis by the four rules, written out."""
    pu, pd = float(smf(u, -1, 1)), float(smf(du, -1, 1))
    negative = np.minimum(min(pu, pd), 1 - smf(AXIS, -1, 0))
    zero = np.minimum(max(min(pu, 1 - pd), min(1 - pu, pd)), np.maximum(0, 1 - np.abs(AXIS)))
    positive = np.minimum(min(1 - pu, 1 - pd), smf(AXIS, 0, 1))
    return np.maximum(np.maximum(negative, zero), positive)


POINTS = [
    *np.random.default_rng(1).uniform(-1.3, 1.3, (60, 2)).tolist(),
    [0.0, 0.0],
    [1.0, 1.0],
    [-1.0, -1.0],
    [1.0, -1.0],
    [0.5, 0.0],
    [0.0, 0.5],
    [26.0, 0.01],
    [-3.0, -0.2],
]


@pytest.fixture(scope="module")
def engine():
    u, du = ca.SX.sym("u"), ca.SX.sym("du")
    values = {"u": u, "du": du}
    outputs = [ca.vertcat(*RULES.aggregated(values)), RULES.mean_of_maxima(**values)]
    return ca.Function("engine", [u, du], outputs, ["u", "du"], ["degrees", "maxima"])


@pytest.mark.parametrize("point", POINTS)
def test_inference_is_that_of_numpy(engine, point):
    degrees, maxima = (np.asarray(value).ravel() for value in engine(*point))
    expected = inferred(*point)
    np.testing.assert_allclose(degrees, expected, rtol=0, atol=1e-12)
    top = expected >= expected.max() - 1e-12
    assert maxima[0] == pytest.approx(AXIS[top].mean(), abs=1e-9)


def test_symbolic_kinds_agree():
    for symbol in (ca.SX.sym, ca.MX.sym):
        u, du = symbol("u"), symbol("du")
        f = ca.Function("f", [u, du], [stimulus("rules", u, du)])
        assert float(f(0.3, 0.2)) == float(RULES.mean_of_maxima(u=ca.DM(0.3), du=ca.DM(0.2)))


def test_smooth_form():
    assert float(stimulus("smooth", ca.DM(0.4), ca.DM(-0.1))) == pytest.approx(-(np.tanh(0.8) - np.tanh(0.2)) / 2)


@pytest.mark.parametrize(
    ("membership", "z", "degree"),
    [
        (s_shaped(-1, 1), -1.0, 0.0),
        (s_shaped(-1, 1), -0.5, 0.125),
        (s_shaped(-1, 1), 0.0, 0.5),
        (s_shaped(-1, 1), 0.5, 0.875),
        (s_shaped(-1, 1), 7.0, 1.0),
        (z_shaped(0, 4), 1.0, 0.875),
        (triangle(-1, 0, 2), 1.0, 0.5),
        (triangle(-1, 0, 2), 3.0, 0.0),
    ],
)
def test_memberships(membership, z, degree):
    assert float(membership.degree(z)) == pytest.approx(degree, abs=1e-15)


def test_another_law_could_use_it():
    tipping = Rules(
        inputs={"service": {"poor": z_shaped(0, 5), "good": s_shaped(5, 10)}},
        output={"low": triangle(0, 5, 10), "high": triangle(10, 15, 20)},
        rules=(Rule({"service": "poor"}, "low"), Rule({"service": "good"}, "high")),
        low=0.0,
        high=20.0,
    )
    assert float(tipping.mean_of_maxima(service=ca.DM(0))) == pytest.approx(5.0)
    assert float(tipping.mean_of_maxima(service=ca.DM(10))) == pytest.approx(15.0)


@pytest.mark.parametrize(
    ("rules", "message"),
    [
        ((), "at least one rule"),
        ((Rule({"v": "P"}, "N"),), "names the input 'v'"),
        ((Rule({"u": "Q"}, "N"),), "names the term 'Q'"),
        ((Rule({"u": "P"}, "Q"),), "ends in the term 'Q'"),
        ((Rule({}, "N"),), "at least one input"),
    ],
)
def test_bad_rules_are_refused(rules, message):
    with pytest.raises(InvalidValue, match=message):
        Rules(inputs={"u": {"P": s_shaped(-1, 1)}}, output={"N": z_shaped(-1, 0)}, rules=rules)


def test_corners_must_rise():
    with pytest.raises(InvalidValue, match="rising order"):
        triangle(0, 0, 1)
