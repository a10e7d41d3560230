"""The fuzzy engine against an independent NumPy inference."""

from __future__ import annotations

import itertools
import math

import casadi as ca
import numpy as np
import pytest

from models.quantity import InvalidValue
from workbench.controllers.parts.fuzzy import (
    Rule,
    Rules,
    gaussian,
    left_shoulder,
    right_shoulder,
    s_shaped,
    trapezoid,
    triangle,
    z_shaped,
)
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
        default=0.0,
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
    for make in (
        lambda: triangle(0, 1, 0.5),
        lambda: triangle(1, 1, 1),
        lambda: trapezoid(0, 2, 1, 3),
        lambda: trapezoid(2, 2, 2, 2),
        lambda: s_shaped(1, 1),
        lambda: z_shaped(2, 1),
        lambda: left_shoulder(1, 1),
        lambda: right_shoulder(2, 1),
    ):
        with pytest.raises(InvalidValue, match="rising order"):
            make()
    with pytest.raises(InvalidValue, match="positive width, got 0"):
        gaussian(0, 0)
    for make in (lambda: triangle(math.nan, 0, 1), lambda: gaussian(0, math.inf), lambda: left_shoulder(-math.inf, 0)):
        with pytest.raises(InvalidValue, match="needs finite numbers"):
            make()


# --- an independent Mamdani inference, in plain Python numbers ---


def tent(z, left, first, last, right):
    """A polygon, 0 outside [left, right]; infinite ends are shoulders."""
    if first <= z <= last:
        return 1.0
    if left < z < first:
        return 1.0 if math.isinf(left) else (z - left) / (first - left)
    if last < z < right:
        return 1.0 if math.isinf(right) else (right - z) / (right - last)
    return 0.0


def spline(z, low, high):
    t = min(1.0, max(0.0, (z - low) / (high - low)))
    return 2 * t * t if t <= 0.5 else 1 - 2 * (1 - t) ** 2


ORACLES = {
    "triangle": lambda z, a, b, c: tent(z, a, b, b, c),
    "trapezoid": tent,
    "left_shoulder": lambda z, top, right: tent(z, -math.inf, -math.inf, top, right),
    "right_shoulder": lambda z, left, top: tent(z, left, top, math.inf, math.inf),
    "gaussian": lambda z, c, w: math.exp(-((z - c) ** 2) / (2 * w**2)),
    "s": spline,
    "z": lambda z, low, high: 1 - spline(z, low, high),
}


def mamdani(rules, values):
    """Degrees on the axis, mean of maxima and centroid, as a textbook writes them; the default where nothing fires."""
    degrees = []
    for z in (rules.low + (rules.high - rules.low) * i / (rules.points - 1) for i in range(rules.points)):
        degree = 0.0
        for rule in rules.rules:
            strength = min(
                ORACLES[rules.inputs[n][t].shape](values[n], *rules.inputs[n][t].corners) for n, t in rule.when.items()
            )
            term = rules.output[rule.then]
            degree = max(degree, min(strength, ORACLES[term.shape](z, *term.corners)))
        degrees.append((z, degree))
    top = max(degree for _, degree in degrees)
    if top == 0:
        return degrees, rules.default, rules.default
    peak = [z for z, degree in degrees if degree >= top * (1 - 1e-12)]
    area = sum(degree for _, degree in degrees)
    return degrees, sum(peak) / len(peak), sum(z * degree for z, degree in degrees) / area


def speed_rules(**options):
    """Two inputs, seven kinds of terms, a rule on one input alone."""
    fields = {
        "inputs": {
            "v": {
                "slow": left_shoulder(2, 5),
                "middle": trapezoid(2, 4, 6, 8),
                "fast": right_shoulder(6, 9),
            },
            "slope": {"down": z_shaped(-4, 1), "flat": gaussian(0, 2), "up": s_shaped(-1, 4)},
        },
        "output": {
            "brake": triangle(-1, -1, -0.2),
            "hold": triangle(-0.5, 0.1, 0.4),
            "drive": trapezoid(0.2, 0.7, 1, 1),
        },
        "rules": (
            Rule({"v": "slow"}, "drive"),
            Rule({"v": "middle", "slope": "down"}, "brake"),
            Rule({"v": "middle", "slope": "flat"}, "hold"),
            Rule({"v": "middle", "slope": "up"}, "drive"),
            Rule({"v": "fast"}, "brake"),
        ),
    }
    return Rules(**{**fields, **options})


GAPPED = Rules(
    inputs={"v": {"low": triangle(0, 0, 2), "high": trapezoid(3, 4, 5, 5)}},
    output={"a": triangle(0.013, 0.317, 1), "b": triangle(0.211, 0.753, 1)},
    rules=(Rule({"v": "low"}, "a"), Rule({"v": "high"}, "b")),
    low=-1.0,
    high=1.0,
    points=41,
    default=-0.25,
)
BASES = {
    "speed": (speed_rules(), ("v", "slope")),
    "few points": (speed_rules(points=11), ("v", "slope")),
    "gapped": (GAPPED, ("v",)),
    "immune": (RULES, ("u", "du")),
}
EDGES = [-20.0, -1.0, 0.0, 1.0, 1.999, 2.0, 2.5, 3.0, 4.0, 5.0, 5.001, 6.0, 7.3, 9.0, 60.0]


@pytest.mark.parametrize("name", sorted(BASES))
def test_inference_is_that_of_plain_python(name):
    rules, inputs = BASES[name]
    symbols = {key: ca.SX.sym(key) for key in inputs}
    outputs = [ca.vertcat(*rules.aggregated(symbols)), rules.mean_of_maxima(**symbols), rules.centroid(**symbols)]
    compiled = ca.Function("compiled", list(symbols.values()), outputs, list(inputs), ["degrees", "maxima", "centroid"])
    random = np.random.default_rng(3).uniform(-3, 11, (60, len(inputs))).tolist()
    for point in [*random, *itertools.product(EDGES, repeat=len(inputs))]:
        values = dict(zip(inputs, point, strict=True))
        degrees, maxima, centroid = mamdani(rules, values)
        found = compiled(**values)
        assert np.allclose(np.asarray(found["degrees"]).ravel(), [d for _, d in degrees], rtol=0, atol=1e-14), point
        assert float(found["maxima"]) == pytest.approx(maxima, abs=1e-9), point
        assert float(found["centroid"]) == pytest.approx(centroid, abs=1e-9), point


def test_where_no_rule_fires_the_law_commands_what_was_declared():
    for v in (2.0, 2.5, 3.0, 5.1, -0.1, 1e9):
        assert float(GAPPED.mean_of_maxima(v=ca.DM(v))) == float(GAPPED.centroid(v=ca.DM(v))) == -0.25
    for v in (0.0, 1.999, 3.001, 5.0):
        assert float(GAPPED.mean_of_maxima(v=ca.DM(v))) != -0.25


@pytest.mark.parametrize(
    ("membership", "points"),
    [
        (triangle(0, 0, 5), [(-1e-9, 0), (0, 1), (2.5, 0.5), (5, 0)]),
        (triangle(0, 5, 5), [(0, 0), (2.5, 0.5), (5, 1), (5.001, 0)]),
        (trapezoid(0, 1, 3, 5), [(-1, 0), (0.25, 0.25), (1, 1), (2, 1), (3, 1), (4, 0.5), (6, 0)]),
        (trapezoid(1, 1, 3, 3), [(0.999, 0), (1, 1), (3, 1), (3.001, 0)]),
        (left_shoulder(1, 3), [(-1e9, 1), (1, 1), (2, 0.5), (3, 0), (9, 0)]),
        (right_shoulder(1, 3), [(-9, 0), (1, 0), (2, 0.5), (3, 1), (1e9, 1)]),
        (gaussian(1, 2), [(1, 1), (3, math.exp(-0.5)), (-3, math.exp(-2)), (1 + 38 * 2, math.exp(-722))]),
    ],
)
def test_shapes_by_hand(membership, points):
    for z, degree in points:
        assert float(membership.degree(ca.DM(z))) == pytest.approx(degree, rel=1e-12), z
        assert membership.support.holds(z) == (degree > 0 and z != 1 + 38 * 2), z


@pytest.mark.parametrize("shape", ["s", "z"])
def test_a_support_holds_only_what_is_positive_in_double_precision(shape):
    for membership in (s_shaped(0, 4), s_shaped(-1, 1)) if shape == "s" else (z_shaped(0, 4), z_shaped(-1, 1)):
        low, high = membership.corners
        for z in [low + (high - low) * 10.0**-k for k in range(1, 20)] + [
            high - (high - low) * 10.0**-k for k in range(20)
        ]:
            assert not membership.support.holds(z) or float(membership.degree(z)) > 0, z


GAPS = {
    "a hole": ({"v": {"a": triangle(0, 1, 2), "b": triangle(3, 4, 5)}}, "v = "),
    "a point": ({"v": {"a": left_shoulder(0, 2), "b": right_shoulder(2, 3)}}, "v = 2;"),
    "a point between splines": ({"v": {"a": z_shaped(0, 5), "b": s_shaped(5, 10)}}, "v = 5;"),
    "less than rounding": ({"v": {"a": z_shaped(0, 5), "b": s_shaped(5 - 1e-9, 10)}}, "v = 5;|v = 4.99"),
    "beyond the last": ({"v": {"a": left_shoulder(0, 2), "b": triangle(1, 2, 3)}}, "v = "),
    "far from a bell": ({"v": {"a": gaussian(0, 1), "b": gaussian(3, 1)}}, "v = "),
}


@pytest.mark.parametrize("name", sorted(GAPS))
def test_rules_that_leave_a_gap_need_a_default(name):
    inputs, where = GAPS[name]
    fields = {
        "inputs": inputs,
        "output": {"x": triangle(-1, -0.5, 0), "y": triangle(0, 0.5, 1)},
        "rules": (Rule({"v": "a"}, "x"), Rule({"v": "b"}, "y")),
    }
    with pytest.raises(InvalidValue, match=f"no rule fires at ({where}).*declare a default output"):
        Rules(**fields)
    rules = Rules(**fields, default=0.125)
    gap = rules.uncovered()
    assert gap is not None
    assert all(float(term.degree(gap["v"])) < 1e-15 for term in inputs["v"].values())


def test_a_gap_between_upright_sides_is_found_between_them():
    terms = {"a": left_shoulder(0, 2), "b": triangle(1, 2, 2), "c": trapezoid(3, 3, 4, 5), "d": right_shoulder(4, 5)}
    with pytest.raises(InvalidValue, match=r"no rule fires at v = 2\.5;"):
        Rules(inputs={"v": terms}, output={"x": triangle(-1, 0, 1)}, rules=tuple(Rule({"v": t}, "x") for t in terms))


def test_a_combination_that_no_rule_is_for_is_found():
    with pytest.raises(InvalidValue, match=r"no rule fires at v = .*, slope = "):
        speed_rules(rules=speed_rules().rules[:3] + speed_rules().rules[4:])
    assert speed_rules().uncovered() is None and RULES.uncovered() is None
    dense = np.random.default_rng(0).uniform(-50, 50, (400, 2))
    for v, slope in dense:  # what is said to be covered is: some rule fires
        assert max(float(ca.DM(s)) for s in speed_rules().strengths({"v": v, "slope": slope}).values()) > 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"output": {**speed_rules().output, "hold": triangle(0.001, 0.002, 0.003)}}, "'hold' is 0 at each of the 101"),
        ({"output": {**speed_rules().output, "hold": triangle(2, 3, 4)}}, "'hold' is 0 at each"),
        ({"low": 1.0, "high": -1.0}, "low must be below high"),
        ({"low": -math.inf}, "low must be below high, both finite"),
        ({"default": 1.5}, r"default must lie in \[-1, 1\], got 1.5"),
        ({"default": math.nan}, "default must lie in"),
    ],
)
def test_outputs_that_cannot_be_are_refused(options, message):
    with pytest.raises(InvalidValue, match=message):
        speed_rules(**options)


def test_inputs_are_given_by_name_and_all_of_them():
    with pytest.raises(InvalidValue, match="the inputs are v, slope, got v"):
        speed_rules().mean_of_maxima(v=1.0)
    with pytest.raises(InvalidValue, match="the inputs are v, slope, got v, slope, w"):
        speed_rules().centroid(v=1.0, slope=0.0, w=2.0)
