"""The interval engine against closed forms, against 200-bit balls, and where it has to fail."""

import math

import casadi as ca
import numpy as np
import pytest
from balls import ball, holds
from flint import arb, ctx
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from verification.enclosure import outward
from verification.enclosure.bounds import bound, prove_bounds, prove_positive
from verification.enclosure.box import Box
from verification.enclosure.interval import enclose, evaluate
from verification.enclosure.rewriting import rewritten as graph_of
from verification.enclosure.slopes import gradient
from verification.enclosure.smoothness import continuous_on, nonsmooth_operations, reaches, smooth_on

x, y = ca.SX.sym("x"), ca.SX.sym("y")
PI = math.pi


def scalar(expression: ca.SX) -> ca.Function:
    return ca.Function("f", [x, y], [expression], ["x", "y"], ["f"])


def ends(expression: ca.SX, x_range: tuple[float, float], y_range: tuple[float, float] = (0.0, 0.0)):
    found = enclose(scalar(expression), Box({"x": x_range, "y": y_range}))
    return float(found.lower["f"][0, 0]), float(found.upper["f"][0, 0]), found.undecided


# ------------------------------------------------------------------ tables

TIGHT = 1 + 4e-16
CLOSED_FORMS = [
    ("add", x + y, (1, 2), (3, 4), 4, 6),
    ("sub", x - y, (1, 2), (3, 4), -3, -1),
    ("sub itself", (x + y) - (x + y), (1, 2), (3, 4), 0, 0),
    ("mul", x * y, (-1, 2), (-3, 4), -6, 8),
    ("square", x * x, (-1, 2), (0, 0), 0, 4),
    ("cube", x**3, (-1, 2), (0, 0), -1, 8),
    ("fourth", (x * x) * (x * x), (-3, 2), (0, 0), 0, 81),
    ("div", x / y, (1, 2), (-4, -2), -1, -0.25),
    ("inv", 1 / y, (0, 0), (2, 4), 0.25, 0.5),
    ("sqrt", ca.sqrt(x), (0, 4), (0, 0), 0, 2),
    ("exp", ca.exp(x), (0, 1), (0, 0), 1, math.e),
    ("expm1", ca.expm1(x), (0, 1), (0, 0), 0, math.expm1(1)),
    ("log", ca.log(x), (1, math.e), (0, 0), 0, 1),
    ("log1p", ca.log1p(x), (0, 1), (0, 0), 0, math.log(2)),
    ("pow fraction", x**1.5, (0, 4), (0, 0), 0, 8),
    ("pow negative", x**-3, (-2, -1), (0, 0), -1, -0.125),
    ("pow even", x**10, (-2, 1), (0, 0), 0, 1024),
    ("pow free", x**y, (0.5, 2), (-1, 2), 0.25, 4),
    ("pow free, held at 3", x**y, (-2, 2), (3, 3), -8, 8),
    ("sin over a top", ca.sin(x), (0, 2), (0, 0), 0, 1),
    ("sin over all", ca.sin(x), (0, 7), (0, 0), -1, 1),
    ("sin large", ca.sin(x), (1e17, 2e17), (0, 0), -1, 1),
    ("cos over a bottom", ca.cos(x), (3, 4), (0, 0), -1, math.cos(4)),
    ("cos over a top", ca.cos(x), (-1, 0.5), (0, 0), math.cos(1), 1),
    ("tan", ca.tan(x), (-1, 1), (0, 0), -math.tan(1), math.tan(1)),
    ("asin", ca.asin(x), (-1, 1), (0, 0), -PI / 2, PI / 2),
    ("acos", ca.acos(x), (-1, 1), (0, 0), 0, PI),
    ("atan", ca.atan(x), (-1, 1), (0, 0), -PI / 4, PI / 4),
    ("atan2", ca.atan2(x, y), (1, 2), (-1, 1), PI / 4, 3 * PI / 4),
    ("atan2 over the cut", ca.atan2(x, y), (-1, 1), (-2, -1), -PI, PI),
    ("sinh", ca.sinh(x), (0, 1), (0, 0), 0, math.sinh(1)),
    ("cosh", ca.cosh(x), (-1, 2), (0, 0), 1, math.cosh(2)),
    ("tanh", ca.tanh(x), (0, 1), (0, 0), 0, math.tanh(1)),
    ("asinh", ca.asinh(x), (0, 1), (0, 0), 0, math.asinh(1)),
    ("acosh", ca.acosh(x), (1, 2), (0, 0), 0, math.acosh(2)),
    ("atanh", ca.atanh(x), (0, 0.5), (0, 0), 0, math.atanh(0.5)),
    ("erf", ca.erf(x), (0, 1), (0, 0), 0, math.erf(1)),
    ("erfinv", ca.erfinv(x), (0, math.erf(1)), (0, 0), 0, 1),
    ("fabs", ca.fabs(x), (-3, 2), (0, 0), 0, 3),
    ("sign", ca.sign(x), (0, 2), (0, 0), 0, 1),
    ("fmin", ca.fmin(x, y), (0, 4), (1, 2), 0, 2),
    ("fmax", ca.fmax(x, y), (0, 4), (1, 2), 1, 4),
    ("floor", ca.floor(x), (0.5, 2.5), (0, 0), 0, 2),
    ("ceil", ca.ceil(x), (0.5, 2.5), (0, 0), 1, 3),
    ("copysign", ca.copysign(x, y), (-3, 2), (-2, -1), -3, 0),
    ("copysign at zero", ca.copysign(x, y), (1, 2), (0, 1), -2, 2),
    ("fmod decided", ca.fmod(x, y), (5, 5.5), (2, 2), 1, 1.5),
    ("remainder decided", ca.remainder(x, y), (5, 5.5), (2, 2), -1, 1),
    ("remainder of one turn", ca.remainder(x, y), (5.25, 6.5), (2, 2), -0.75, 0.5),
    ("remainder undecided", ca.remainder(x, y), (-1, 9), (2, 3), -1.5, 1.5),
    ("remainder to even", ca.remainder(x, y), (1, 3), (1, 1), -0.5, 0.5),
    ("remainder of small numbers", ca.remainder(x, y), (-0.25, 0.125), (1, 2), -0.25, 0.125),
    ("fmod undecided", ca.fmod(x, y), (-1, 9), (2, 3), -1, 3),
    ("hypot", ca.hypot(x, y), (-3, 1), (-4, 4), 0, 5),
    ("lt", x < y, (0, 1), (2, 3), 1, 1),
    ("lt undecided", x < y, (0, 2), (2, 3), 0, 1),
    ("lt never", x < y, (3, 4), (2, 3), 0, 0),
    ("le", x <= y, (0, 2), (2, 3), 1, 1),
    ("eq", ca.eq(x, y), (0, 2), (2, 3), 0, 1),
    ("ne", ca.ne(x, y), (0, 1), (2, 3), 1, 1),
    ("not", ca.logic_not(x < y), (0, 1), (2, 3), 0, 0),
    ("and", ca.logic_and(x < y, x > 0), (0, 1), (2, 3), 0, 1),
    ("or", ca.logic_or(x < y, x > 0), (0, 1), (2, 3), 1, 1),
    ("if_else_zero", ca.if_else(x > 0, y, 0), (-1, 1), (2, 3), 0, 3),
    ("if_else keeps its branches together", ca.if_else(x > 0, y, y + 1), (-1, 1), (2, 3), 2, 4),
    ("overlapping conditions", ca.if_else(x < 0, y, 0) + ca.if_else(x <= 1, y, 0), (-1, 2), (2, 3), 0, 6),
    ("two comparisons of which one holds", (x <= y) + (y <= x), (0, 1), (0, 1), 1, 2),
    ("eq and ne", ca.if_else(ca.eq(x, y), 5, 0) + ca.if_else(ca.ne(x, y), 4, 0), (0, 1), (0, 1), 4, 5),
    ("scaled if_else", 2 * ca.if_else(x > 0, y, 4) / 4, (-1, 1), (2, 3), 1, 2),
    ("nested if_else", ca.if_else(x > 0, ca.if_else(y > 2.5, 5, 6), 7), (-1, 1), (2, 3), 5, 7),
    ("the branch not taken does not count", ca.if_else(x > 0, ca.log(x), y), (-2, -1), (2, 3), 2, 3),
    ("slope of a saturation", ca.gradient(ca.fmin(ca.fmax(x, -1), 1), x), (-3, 3), (0, 0), 0, 1),
    ("slope of an if_else", ca.gradient(ca.if_else(x > 0, 2 * x, 3 * x), x), (-3, 3), (0, 0), 2, 3),
]  # fmt: skip


@pytest.mark.parametrize(("name", "expression", "x_range", "y_range", "low", "high"), CLOSED_FORMS)
def test_enclosures_are_the_ranges(name, expression, x_range, y_range, low, high):
    lower, upper, undecided = ends(expression, x_range, y_range)
    assert undecided is None
    assert lower == pytest.approx(low, rel=1e-15, abs=1e-15)
    assert upper == pytest.approx(high, rel=1e-15, abs=1e-15)
    if low == int(low):  # such ends are exact doubles, so rigour can be asked for without a margin
        assert lower <= low
    if high == int(high):
        assert upper >= high


FAILURES = [
    ("sqrt", ca.sqrt(x), (-1, 2), "sqrt([-1.0, 2.0]): the argument may be negative"),
    ("log", ca.log(x), (0, 2), "log([0.0, 2.0]): the argument may be zero or negative"),
    ("log1p", ca.log1p(x), (-1, 2), "log1p"),
    ("div", y / x, (-1, 2), "div([0.0, 0.0], [-1.0, 2.0]): the divisor may be zero"),
    ("inv", 1 / x, (0, 2), "inv"),
    ("tan", ca.tan(x), (1, 2), "tan"),
    ("asin", ca.asin(x), (0, 1.5), "asin"),
    ("acos", ca.acos(x), (-1.5, 0), "acos"),
    ("acosh", ca.acosh(x), (0.5, 2), "acosh"),
    ("atanh", ca.atanh(x), (0, 1), "atanh"),
    ("erfinv", ca.erfinv(x), (-1, 0), "erfinv"),
    ("negative power", x**-3, (-1, 1), "the divisor may be zero"),
    ("fraction of a negative base", x**0.5 + x**1.5, (-1, 1), "sqrt"),
    ("power of a negative base", x**2.5, (-1, 1), "pow"),
    ("free power", x ** (y + 0.5), (-1, 1), "pow"),
    ("fmod", ca.fmod(y, x), (-1, 1), "fmod"),
    ("remainder", ca.remainder(x, y), (0, 1), "remainder([0.0, 1.0], [0.0, 0.0]): the divisor may be zero"),
    ("nan", x + ca.SX(math.nan), (0, 1), "the constant nan"),
    ("infinite constant", x + ca.SX(math.inf), (0, 1), "the constant inf"),
    ("a branch that may be taken", ca.if_else(x > 0, ca.log(x), 0), (-1, 1), "log"),
]


@pytest.mark.parametrize(("name", "expression", "x_range", "sentence"), FAILURES)
def test_failures_are_sentences(name, expression, x_range, sentence):
    lower, upper, undecided = ends(expression, x_range)
    assert sentence in undecided
    assert (lower, upper) == (-math.inf, math.inf)


def test_an_mx_function_is_expanded_or_says_why_not():
    m, v = ca.MX.sym("m"), ca.SX.sym("v")
    smooth = ca.Function("smooth", [m], [m**2], ["m"], ["f"])
    assert enclose(smooth, Box({"m": (-1, 2)})).upper["f"][0, 0] == 4
    solver = ca.rootfinder("solver", "newton", {"x": v, "p": x, "g": v**3 - x})
    called = ca.Function("called", [m], [solver(x0=1, p=m)["x"]], ["m"], ["f"])
    assert "calls a Function that is no graph: solver" in enclose(called, Box({"m": (1, 2)})).undecided
    implicit = ca.Function("implicit", [m], [ca.find(m)], ["m"], ["f"])
    box = Box({"m": (1, 2)})
    sentence = "implicit has no form of scalar instructions"
    assert sentence in enclose(implicit, box).undecided
    assert sentence in bound(implicit, box).reason
    assert sentence in prove_positive(implicit, box).reason
    assert sentence in smooth_on(implicit, box).reason
    with pytest.raises(ValueError, match=sentence):
        nonsmooth_operations(implicit)


def test_free_variables_are_named():
    free = ca.Function("free", [x], [x * y], ["x"], ["f"], {"allow_free": True})
    assert "free variable" in enclose(free, Box({"x": (0, 1)})).undecided


def test_shapes_and_sparsity_are_kept():
    m = ca.SX.sym("m", ca.Sparsity.lower(2))
    function = ca.Function("g", [m, y], [2 * m, ca.SX(0, 0), m.T], ["m", "y"], ["a", "none", "t"])
    found = enclose(function, Box({"m": ([[1, 9], [3, 4]], [[2, 9], [5, 6]]), "y": 0}))
    assert found.lower["a"].tolist() == [[2, 0], [6, 8]]
    assert found.upper["t"].tolist() == [[2, 5], [0, 6]]
    assert found.lower["none"].shape == (0, 0)


# ------------------------------------------------------------------ rounding


def test_a_sum_that_is_no_double_is_enclosed():
    lower, upper, _ = ends(x + y, (0.1, 0.1), (0.2, 0.2))
    with ctx.workprec(200):
        assert arb(lower) < arb(0.1) + arb(0.2) < arb(upper)
    assert upper == math.nextafter(lower, math.inf)


ROUNDED = [x + y, x - y, x * y, x / y, ca.sqrt(x), x * x, ca.exp(x), ca.sin(y), x**3, ca.hypot(x, y), x**y]


@pytest.mark.parametrize("expression", ROUNDED)
def test_planted_slip_rounding_to_nearest_is_noticed(expression, monkeypatch):
    """The containment test below must fail once the outward step is taken out."""

    def misses() -> int:
        rng = np.random.default_rng(1)
        missed = 0
        for a, b in rng.uniform(0.1, 3, (40, 2)):
            lower, upper, _ = ends(expression, (a, a), (b, b))
            missed += not holds(lower, upper, ball(scalar(expression), [a, b]))
        return missed

    assert misses() == 0
    monkeypatch.setattr(outward, "down", lambda v: v)
    monkeypatch.setattr(outward, "up", lambda v: v)
    monkeypatch.setattr(outward, "floats_around", lambda b: (float(b.mid()), float(b.mid())))
    assert misses() > 0


@pytest.mark.parametrize(
    ("a", "b"),
    [(5e-324, 0.5), (1e-200, 1e-200), (1e308, 10.0), (1e300, 1e-300), (-1e308, 1e-10), (2.2e-308, 0.3), (0.0, 1e308)],
)
def test_the_ends_of_the_exponent_range(a, b):
    for expression in (x * y, x + y, x - y, x / y, x * x, ca.exp(-x * x), ca.fabs(x) ** 1.5, ca.hypot(x, y)):
        lower, upper, undecided = ends(expression, (a, a), (b, b))
        assert undecided is None
        assert holds(lower, upper, ball(scalar(expression), [a, b]))


@pytest.mark.parametrize("turns", [0, 1, -3, 10, 1000, 10**6, 10**12])
def test_turning_points_and_poles_are_found(turns):
    top = PI / 2 + 2 * PI * turns
    for width in (1e-3 + abs(top) * 1e-15, 2 * math.ulp(top)):
        around = top - width, top + width
        assert ends(ca.sin(x), around)[1] == 1
        assert ends(-ca.sin(x), around)[0] == -1
        assert ends(ca.cos(x - ca.SX(PI / 2)), around)[1] == 1
        assert "pole" in ends(ca.tan(x), around)[2]


def test_overflow_is_unbounded_and_not_a_number_is_never_returned():
    assert ends(ca.exp(x), (0, 1e9))[1:] == (math.inf, None)
    lower, upper, _ = ends(ca.exp(x) - ca.exp(2 * x), (0, 1e9))
    assert (lower, upper) == (-math.inf, math.inf)
    assert ends(0 * y + ca.exp(x) * y, (0, 1e9), (0, 0)) == (0, 0, None)


def test_the_process_is_checked(monkeypatch):
    assert outward.arithmetic_is_ieee()
    monkeypatch.setattr(outward, "arithmetic_is_ieee", lambda: False)
    assert "does not round to nearest" in ends(x, (0, 1))[2]


# ------------------------------------------------------------------ random formulas

UNARY = [ca.sqrt, ca.exp, ca.log, ca.sin, ca.cos, ca.tan, ca.asin, ca.acos, ca.atan, ca.sinh, ca.cosh, ca.tanh,
         ca.asinh, ca.acosh, ca.atanh, ca.erf, ca.erfinv, ca.expm1, ca.log1p, ca.fabs, ca.sign, ca.floor, ca.ceil,
         lambda a: -a, lambda a: 2 * a, lambda a: 1 / a, lambda a: a * a, lambda a: a**3, lambda a: a**-2,
         lambda a: a**2.5, ca.logic_not]  # fmt: skip
BINARY = [lambda a, b: a + b, lambda a, b: a - b, lambda a, b: a * b, lambda a, b: a / b, lambda a, b: a**b,
          ca.fmin, ca.fmax, ca.atan2, ca.copysign, ca.hypot, ca.fmod, lambda a, b: a < b, lambda a, b: a <= b,
          ca.eq, ca.ne, ca.logic_and, ca.logic_or, lambda a, b: ca.if_else(a, b, 0),
          lambda a, b: ca.if_else(a > 0, a, b),
          lambda a, b: ca.if_else(a <= b, a * b, a - b)]  # fmt: skip

leaves = st.sampled_from([x, y, x, y, x + 2, y - 1]) | st.sampled_from([-2.0, -0.1, 0.0, 0.5, 1.0, 3.0]).map(ca.SX)
formulas = st.recursive(
    leaves,
    lambda inner: (
        st.tuples(st.sampled_from(UNARY), inner).map(lambda t: t[0](t[1]))
        | st.tuples(st.sampled_from(BINARY), inner, inner).map(lambda t: t[0](t[1], t[2]))
    ),
    max_leaves=20,
)
centres = st.floats(-3, 3, allow_subnormal=False)
ranges = st.tuples(centres, st.sampled_from([0.0, 0.0, 1e-9, 0.01, 0.5, 2.0])).map(lambda t: (t[0], t[0] + t[1]))
calm = settings(deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


def samples(x_range: tuple[float, float], y_range: tuple[float, float], count: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    inner = rng.uniform([x_range[0], y_range[0]], [x_range[1], y_range[1]], (count, 2))
    return np.vstack([[[a, b] for a in x_range for b in y_range], inner])


def assert_holds(expression: ca.SX, x_range: tuple[float, float], y_range: tuple[float, float]) -> bool:
    lower, upper, undecided = ends(expression, x_range, y_range)
    assert not math.isnan(lower) and not math.isnan(upper) and lower <= upper
    if undecided is not None:
        return False
    function = scalar(expression)
    for point in samples(x_range, y_range, 8):
        value = ball(function, point.tolist())
        assert value is None or holds(lower, upper, value), (point, value, lower, upper)
    return True


@settings(calm, max_examples=400)
@given(formulas, ranges, ranges)
def test_no_point_outside(expression, x_range, y_range):
    assert_holds(expression, x_range, y_range)


@settings(calm, max_examples=150)
@given(formulas, ranges, ranges)
def test_no_point_of_a_derivative_outside(expression, x_range, y_range):
    assert_holds(ca.gradient(expression, x), x_range, y_range)


@pytest.mark.parametrize("expression", [f(x) for f in UNARY] + [f(x, y) for f in BINARY], ids=str)
def test_every_operation_is_decided_somewhere(expression):
    """Without this, the two tests above could pass by giving up."""
    places = [((0.2, 0.4), (0.3, 0.6)), ((1.2, 1.4), (0.3, 0.9)), ((-0.5, 0.5), (1, 2))]
    assert any([assert_holds(expression, a, b) for a, b in places])


@settings(calm, max_examples=200)
@given(formulas, ranges, ranges)
def test_slopes_hold_every_chord(expression, x_range, y_range):
    """The difference of two values lies in the slopes times the step, kinks included, without any margin."""
    function = scalar(expression)
    graph = graph_of(function)
    lower, upper = np.array([x_range[:1], y_range[:1]]), np.array([x_range[1:], y_range[1:]])
    if not graph.outputs["f"]:
        return  # a structural zero
    node = graph.outputs["f"][0].node
    values = evaluate(graph, lower, upper, [node])
    slopes = gradient(graph, node, values, (2, 1))
    if values[node].fault is not None or not np.isfinite([slopes.lo, slopes.hi]).all():
        return
    points = samples(x_range, y_range, 4)
    found = [ball(function, point.tolist()) for point in points]
    with ctx.workprec(200):
        for i, j in np.ndindex(len(points), len(points)):
            if found[i] is None or found[j] is None:
                continue
            low, high = arb(0), arb(0)
            for k in range(2):
                step = arb(points[i, k]) - arb(points[j, k])
                ways = arb(slopes.lo[k, 0]) * step, arb(slopes.hi[k, 0]) * step
                low, high = low + ways[0].min(ways[1]), high + ways[0].max(ways[1])
            assert not found[i] - found[j] < low and not found[i] - found[j] > high


SMOOTH = [e for n, e, *_ in CLOSED_FORMS if not {"lt", "eq", "ne", "not", "and", "or", "le"} & {n.split()[0]}]


@pytest.mark.parametrize("expression", SMOOTH)
def test_slopes_hold_the_derivatives(expression):
    """CasADi's derivatives fold constants in rounded arithmetic, hence the margin of 1e-12."""
    graph = graph_of(scalar(expression))
    slopes = [scalar(ca.gradient(expression, v)) for v in (x, y)]
    for a, b in [((0.2, 0.4), (0.3, 0.6)), ((1.2, 1.4), (1.5, 1.9)), ((-0.5, -0.1), (1, 2)), ((-1, 1), (0.5, 2))]:
        lower, upper = np.array([[a[0]], [b[0]]]), np.array([[a[1]], [b[1]]])
        node = graph.outputs["f"][0].node
        found = gradient(graph, node, evaluate(graph, lower, upper, [node]), (2, 1))
        for point in samples(a, b, 10):
            for i, slope in enumerate(slopes):
                value = ball(slope, point.tolist())
                if value is not None and value.is_finite() and np.isfinite([found.lo[i, 0], found.hi[i, 0]]).all():
                    margin = 1e-12 * (1 + abs(float(value)))
                    assert found.lo[i, 0] - margin <= float(value) <= found.hi[i, 0] + margin


def test_slopes_are_not_used_across_a_jump():
    for expression in (ca.sign(x), ca.floor(x), x < 0, ca.if_else(x > 0, 1, 2), ca.copysign(1 + y, x), ca.atan2(x, -1)):
        graph = graph_of(scalar(expression))
        node = graph.outputs["f"][0].node
        box = np.array([[-1.0], [0.0]]), np.array([[1.0], [0.0]])
        assert not np.isfinite(gradient(graph, node, evaluate(graph, *box, [node]), (2, 1)).hi[0, 0])


# ------------------------------------------------------------------ bounds and proofs

EXTREMA = [
    ("parabola", x**2 - x, (-1, 2), (0, 0), -0.25, 2),
    ("saddle", x * y, (-1, 2), (-3, 1), -6, 3),
    ("rosenbrock", (1 - x) ** 2 + 100 * (y - x**2) ** 2, (-1, 2), (-1, 3), 0, 2501),
    ("kinks", ca.fabs(x - y) + ca.fmax(x, 0), (-1, 2), (-1, 1), 0, 5),
    ("correlated", x / (1 + x), (0, 1), (0, 0), 0, 0.5),
    ("branches", ca.if_else(x > 0, x + 2, x), (-1, 2), (0, 0), -1, 4),
    ("wave", ca.sin(3 * x) * ca.exp(-x), (0, 2), (0, 0), None, math.sin(math.atan(3)) * math.exp(-math.atan(3) / 3)),
    ("bell", ca.erf(x) - x, (0, 1), (0, 0), math.erf(1) - 1, None),
    ("held", x + y, (1, 1), (2, 2), 3, 3),
]


@pytest.mark.parametrize("slopes", [True, False])
@pytest.mark.parametrize(("name", "expression", "x_range", "y_range", "low", "high"), EXTREMA)
def test_extrema_lie_between(name, expression, x_range, y_range, low, high, slopes):
    found = bound(scalar(expression), Box({"x": x_range, "y": y_range}), tolerance=1e-4, slopes=slopes, budget=2000)
    assert found.boxes_used <= 2000
    assert found.lower <= found.attained_min.upper and found.attained_max.lower <= found.upper
    if slopes:
        assert found.reason is None
        assert found.attained_min.upper - found.lower <= 1e-4 * max(1, abs(found.lower))
    for exact, (a, b) in ((low, (found.lower, found.attained_min.upper)),
                          (high, (found.attained_max.lower, found.upper))):  # fmt: skip
        assert exact is None or a - 1e-15 <= exact <= b + 1e-15
    for best in (found.attained_min, found.attained_max):
        point = [best.point[v][0][0, 0] for v in "xy"]
        assert best.point.is_point and holds(best.lower, best.upper, ball(scalar(expression), point))


def test_all_entries_of_an_output_count():
    function = ca.Function("g", [x], [ca.diag(ca.vertcat(x, 3 - x)), x], ["x"], ["m", "other"])
    found = bound(function, Box({"x": (1, 2)}), "m")
    assert found.lower == 0 and found.attained_min.upper == 0  # a structural zero is an entry too
    assert found.upper == 2 and found.reason is None
    with pytest.raises(ValueError, match="name one"):
        bound(function, Box({"x": (1, 2)}))


def test_a_spent_budget_is_a_sentence():
    found = bound(scalar(x * x - x), Box({"x": (0, 1), "y": 0}), budget=4, slopes=False)
    assert "the budget of 2 boxes for one entry and side is spent" in found.reason
    assert found.lower <= -0.25 <= found.attained_min.upper
    pole = bound(scalar(1 / (x - y)), Box({"x": (0, 1), "y": (0, 1)}), budget=200)
    assert "budget" in pole.reason and "the divisor may be zero" in pole.reason
    split = bound(scalar(ca.remainder(x, 2)), Box({"x": (0, 1), "y": 0}))
    assert split.reason is None and (split.lower, split.upper) == (0, 1)


def test_boxes_of_neighbouring_doubles_still_count():
    """The reader must not get a lower bound from which the boxes that could not be split are missing."""
    point = 0.3, math.nextafter(0.3, 1)
    found = bound(scalar(ca.sin(x) - x), Box({"x": point, "y": 0}), tolerance=1e-300, slopes=False)
    assert "cannot be split any further" in found.reason
    for value in (ball(scalar(ca.sin(x) - x), [p, 0.0]) for p in point):
        assert holds(found.lower, found.upper, value)


def test_proofs_and_witnesses():
    box = Box({"x": (0.1, 1), "y": (0, 1)})
    form = scalar(x**2 + y**2 - x * y)
    assert prove_positive(form, box).standing == "proved"
    assert prove_bounds(form, box, lower=0, upper=1.1).standing == "proved"
    wider = Box({"x": (-1, 1), "y": (-1, 1)})
    refuted = prove_positive(form, wider)  # zero at the origin, and nowhere negative
    assert refuted.standing == "refuted" and refuted.witness.upper <= 0
    assert prove_bounds(form, wider, lower=-1e-3).standing == "proved"
    above = prove_bounds(form, wider, upper=2.9)
    assert above.standing == "refuted" and above.witness.lower > 2.9
    few = prove_bounds(form, wider, lower=0, budget=8)
    assert few.standing == "undecided" and "budget" in few.reason
    assert prove_positive(scalar(1 + ca.sqrt(x)), wider, budget=50).standing == "undecided"


def test_a_smooth_looking_jump_is_not_smoothed_over():
    """A slope of zero on both sides of a step must not prove that the step is not there."""
    assert prove_bounds(scalar(ca.sign(x - 0.3)), Box({"x": (-1, 1), "y": 0}), upper=0.5).standing == "refuted"
    assert bound(scalar(ca.floor(x)), Box({"x": (0, 2.5), "y": 0})).upper == 2


# ------------------------------------------------------------------ smoothness

REACHES = [
    ("kink far", ca.fabs(y - x * x), (0, 1), (2, 3), "no", "kink"),
    ("kink crossed", ca.fabs(y - x * x - 0.1), (0, 1), (0.3, 3), "yes", "kink"),
    ("kink touched at a corner", ca.fabs(x), (0, 1), (0, 0), "yes", "kink"),
    ("tangent without a double", ca.fabs((x * x - 2) ** 2 * (1 + y)), (1, 2), (0, 0), "unknown", "kink"),
    ("fmin", ca.fmin(x, y), (0, 1), (2, 3), "no", "kink"),
    ("fmax", ca.fmax(x, y), (0, 2), (1, 3), "yes", "kink"),
    ("sqrt", ca.sqrt(x), (0, 1), (0, 0), "yes", "kink"),
    ("sqrt off zero", ca.sqrt(1 + x * x), (-1, 1), (0, 0), "no", "kink"),
    ("hypot", ca.hypot(x, y), (-1, 1), (-1, 1), "yes", "kink"),
    ("asin", ca.asin(x), (0, 0.5), (0, 0), "no", "kink"),
    ("pow", x**2.5, (0, 1), (0, 0), "yes", "kink"),
    ("sign", ca.sign(x), (1, 2), (0, 0), "no", "jump"),
    ("floor", ca.floor(x * y), (0.3, 0.9), (0.5, 2), "yes", "jump"),
    ("ceil between", ca.ceil(x), (0.3, 0.9), (0, 0), "no", "jump"),
    ("fmod below one turn", ca.fmod(x, y), (0, 1), (2, 3), "no", "jump"),
    ("fmod", ca.fmod(x, y), (0, 5), (2, 3), "yes", "jump"),
    ("comparison", ca.if_else(x > 0.3, x, y), (0, 1), (0, 1), "yes", "jump"),
    ("comparison decided", ca.if_else(x > -0.3, x, y), (0, 1), (0, 1), "no", "jump"),
    ("copysign", ca.copysign(x, y), (0, 1), (-1, 1), "yes", "jump"),
    ("atan2", ca.atan2(y, x), (-1, 1), (0.1, 1), "no", "jump"),
    ("atan2 on its cut", ca.atan2(y, x), (-1, 1), (-1, 1), "yes", "jump"),
    ("division", x / (y - 1.1), (0, 1), (0, 3), "yes", "pole"),
    ("division off zero", 1 / (1.5 - x * y), (0, 1), (0, 1), "no", "pole"),
    ("log", ca.log(x + y), (0, 1), (0.1, 1), "no", "pole"),
    ("log at zero", ca.log(x), (0, 1), (0, 0), "yes", "pole"),
    ("tan", ca.tan(x), (0, 2), (0, 0), "yes", "pole"),
    ("free power", x**y, (0.5, 1), (0, 1), "no", "pole"),
    ("negative power", (x - 0.3) ** -2.5, (0.5, 1), (0, 1), "no", "pole"),
    ("truth of numbers", ca.logic_and(x, y), (0.5, 1), (-1, 1), "yes", "jump"),
    ("truth of numbers kept", ca.logic_or(x, y), (0.5, 1), (0.5, 1), "no", "jump"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "expression", "x_range", "y_range", "reachable", "kind"), REACHES)
def test_reach(name, expression, x_range, y_range, reachable, kind):
    function, box = scalar(expression), Box({"x": x_range, "y": y_range})
    (operation,) = nonsmooth_operations(function)
    (found,) = reaches(function, box)
    assert found.operation == operation
    assert (found.reachable, operation.kind) == (reachable, kind)
    assert (found.point is not None) == (reachable == "yes")
    if found.point is not None:
        assert all(np.all(box[v][0] <= end) and np.all(end <= box[v][1]) for v in "xy" for end in found.point[v])
    smooth, continuous = smooth_on(function, box), continuous_on(function, box)
    assert smooth.proved == (reachable == "no")
    assert (smooth.reason is None) == smooth.proved
    assert continuous.proved == (reachable == "no" or kind == "kink")


def test_continuity_asks_whether_a_domain_is_left():
    assert continuous_on(scalar(ca.sqrt(x)), Box({"x": (0, 1), "y": 0})).proved
    left = continuous_on(scalar(ca.sqrt(x - 0.5)), Box({"x": (0, 1), "y": 0}))
    assert not left.proved and "sqrt" in left.reason


def test_a_sign_change_across_a_jump_shows_nothing():
    step, outer = reaches(scalar(ca.fabs(ca.sign(x) - 0.5)), Box({"x": (-1, 1), "y": 0}))
    assert step.reachable == "yes" and outer.reachable == "unknown"


def test_the_derivative_of_a_saturated_law_exists_where_it_does_not_saturate():
    law = ca.fmin(ca.fmax(x * y, -1), 1)
    derivative = scalar(ca.gradient(law, y))
    inside, across = Box({"x": (-1, 1), "y": (-0.9, 0.9)}), Box({"x": (-1, 1), "y": (-0.9, 1.9)})
    assert smooth_on(scalar(law), inside).proved and continuous_on(derivative, inside).proved
    assert continuous_on(scalar(law), across).proved and not continuous_on(derivative, across).proved


def test_nonsmooth_operations_leave_out_what_is_smooth():
    assert nonsmooth_operations(scalar(ca.sin(x) * x**3 / 2 + ca.tanh(y) + ca.erf(x))) == ()
    assert [op.name for op in nonsmooth_operations(scalar(ca.fabs(x) + 1 / y))] == ["fabs", "inv"]
    assert [op.kind for op in nonsmooth_operations(scalar(ca.remainder(x, y)))] == ["jump"]


# ------------------------------------------------------------------ boxes


@pytest.mark.parametrize(
    ("ranges", "sentence"),
    [
        ({"x": (2, 1)}, "expected lower <= upper"),
        ({"x": (0, math.inf)}, "must be finite"),
        ({"x": math.nan}, "must be finite"),
        ({"x": (1, 2, 3)}, "a range is a pair"),
        ({"x": ([1, 2], [1, 2, 3])}, "lower is"),
        ({"x": 2**53 + 1}, "is not a double"),
        ({"x": np.zeros((1, 1, 1))}, "3 dimensions"),
    ],
)
def test_bad_boxes_are_refused(ranges, sentence):
    with pytest.raises(ValueError, match=sentence):
        Box(ranges)


def test_a_box_must_fit_the_function():
    with pytest.raises(ValueError, match="has inputs"):
        enclose(scalar(x), Box({"x": 1}))
    with pytest.raises(ValueError, match="expects"):
        enclose(scalar(x), Box({"x": [1, 2], "y": 0}))
    with pytest.raises(ValueError, match="got 'z'"):
        bound(scalar(x), Box({"x": 1, "y": 1}), "z")
    with pytest.raises(ValueError, match="budget"):
        bound(scalar(x), Box({"x": 1, "y": 1}), budget=1)
    with pytest.raises(ValueError, match="tolerance"):
        bound(scalar(x), Box({"x": 1, "y": 1}), tolerance=0)
    with pytest.raises(ValueError, match="a lower or an upper"):
        prove_bounds(scalar(x), Box({"x": 1, "y": 1}))
    with pytest.raises(ValueError, match="budget"):
        reaches(scalar(x), Box({"x": 1, "y": 1}), budget=0)


def test_a_box_reads_splits_and_stays():
    box = Box({"x": ([0, 100], [1, 101]), "k": 5})
    assert str(box) == "x[0] in [0.0, 1.0], x[1] in [100.0, 101.0], k = 5.0"
    left, right = box.split()
    assert str(left) == "x[0] in [0.0, 0.5], x[1] in [100.0, 101.0], k = 5.0"
    assert right["x"][0].ravel().tolist() == [0.5, 100]
    assert box.midpoint()["x"].ravel().tolist() == [0.5, 100.5] and box.width() == 1
    assert box == Box(dict(box)) != left and hash(box) == hash(left) and box != 5 and repr(left) == f"Box({left})"
    assert not box.is_point and Box({"k": 5}).split()[0].is_point
    with pytest.raises(ValueError, match="read-only"):
        box["x"][0][0, 0] = 7
