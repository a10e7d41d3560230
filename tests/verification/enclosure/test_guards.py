"""Branches under guards: what is narrowed, what must not be, and values and slopes against exact rationals."""

from __future__ import annotations

import math
from fractions import Fraction
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from random_graphs import exact, random_graph

from verification.enclosure import interval
from verification.enclosure.bounds import TOLERANCE, bound, prove_bounds
from verification.enclosure.box import Box
from verification.enclosure.contraction import cases, contract
from verification.enclosure.guards import conditions_of, restricted
from verification.enclosure.interval import enclose, evaluate
from verification.enclosure.outward import Span
from verification.enclosure.rewriting import Rewritten, rewritten
from verification.enclosure.slopes import gradient
from verification.enclosure.smoothness import continuous_on, reaches, smooth_on
from workbench.graph import DOUBLES, read
from workbench.graph import evaluate as valued

x, y, k = (ca.SX.sym(name) for name in "xyk")
AND, OR, NOT, IF = ca.logic_and, ca.logic_or, ca.logic_not, ca.if_else
ROOT = ca.sqrt(x)


def scalar(expression) -> ca.Function:
    return ca.Function("f", [x, y], [expression], ["x", "y"], ["f"])


def graph(expression) -> Rewritten:
    found = rewritten(scalar(expression))
    assert isinstance(found, Rewritten)
    return found


def ends(expression, x_range, y_range=(0.0, 0.0)):
    found = enclose(scalar(expression), Box({"x": x_range, "y": y_range}))
    return float(found.lower["f"][0, 0]), float(found.upper["f"][0, 0]), found.undecided


NARROWED = [
    # expression, x, y, and the ends of its range
    ("greater", IF(x > 0, ROOT, 0), (-1, 2), (0, 0), 0, math.sqrt(2)),
    ("turned", IF(0 < x, ROOT, 0), (-1, 2), (0, 0), 0, math.sqrt(2)),
    ("closed", IF(x >= 0, ROOT, 0), (-1, 2), (0, 0), 0, math.sqrt(2)),
    ("the other branch", IF(x < 0, 0, ROOT), (-1, 2), (0, 0), 0, math.sqrt(2)),
    ("not", IF(NOT(x < 0), ROOT, 0), (-1, 2), (0, 0), 0, math.sqrt(2)),
    ("both branches", IF(x > 0, ROOT, ca.sqrt(-x)), (-4, 2), (0, 0), 0, 2),
    ("a limit", IF(x > 1, x, 1), (-3, 2), (0, 0), 1, 2),
    ("a limit from below", IF(x < 1, 1, x), (-3, 2), (0, 0), 1, 2),
    ("between", IF(AND(x > 0, x < 1), ca.sqrt(x) + ca.sqrt(1 - x), 2), (-5, 5), (0, 0), 0, 2),
    ("either way out", IF(OR(x < 0, x > 4), 0, ROOT), (-5, 9), (0, 0), 0, 2),
    ("not both", IF(NOT(AND(x > 0, y > 0)), 0, ROOT), (-1, 4), (-1, 1), 0, 2),
    ("inverse beyond", IF(x > 0.5, 1 / x, 0), (-1, 2), (0, 0), 0, 2),
    ("inverse of a size beyond", IF(ca.fabs(x) > 0.5, 1 / x, 0), (-1, 2), (0, 0), -2, 2),
    ("inverse of a square beyond", IF(x**2 > 0.25, 1 / x, 0), (-1, 2), (0, 0), -2, 2),
    ("a size within", IF(ca.fabs(x) < 0.5, ca.asin(2 * x), 0), (-9, 9), (0, 0), -math.pi / 2, math.pi / 2),
    ("two coordinates", IF(x > y, ca.sqrt(x - y), 0), (-1, 2), (-2, 5), 0, 2),
    ("a difference turned", IF(x > y, x, ca.sqrt(y - x)), (0, 2), (-2, 4), 0, 2),
    ("a quantity", IF(x * x + y - 1 > 0, ca.sqrt(x * x + y - 1), 0), (-3, 3), (-1, 1), 0, 3),
    ("equal", IF(x == 0.25, 1 / x, 4), (-1, 1), (0, 0), 4, 4),
    ("not unequal", IF(x != 0.25, 4, 1 / x), (-1, 1), (0, 0), 4, 4),
    ("through exp", IF(ca.exp(x) > 1, ROOT, 0), (-1, 4), (0, 0), 0, 2),
    ("through log", IF(x > 0.5, IF(ca.log(x) > 0, ca.sqrt(x - 1), 0), 0), (-1, 5), (0, 0), 0, 2),
    ("through a cube", IF(x > 0, IF(x**3 > 8, ca.sqrt(x - 1.75), 0), 0), (-1, 5.75), (0, 0), 0, 2),
    ("through a product", IF(-2 * x < 0, ROOT, 0), (-1, 4), (0, 0), 0, 2),
    ("through a quotient", IF(x / 4 > 0, ROOT, 0), (-1, 4), (0, 0), 0, 2),
    ("through a root", IF(ca.sqrt(x + 1) > 1, ROOT, 0), (-1, 4), (0, 0), 0, 2),
    ("through a floor", IF(ca.floor(x) >= 0, ROOT, 0), (-1.5, 4), (0, 0), 0, 2),
    ("through a ceiling", IF(ca.ceil(x) <= 0, ca.sqrt(-x), 0), (-4, 1.5), (0, 0), 0, 2),
    ("through a minimum", IF(ca.fmin(x, y) > 0, ca.sqrt(x) + ca.sqrt(y), 0), (-1, 4), (-1, 1), 0, 3),
    ("through a maximum", IF(ca.fmax(x, y) < 0, ca.sqrt(-x) + ca.sqrt(-y), 0), (-4, 1), (-1, 1), 0, 3),
    ("nested", IF(x > 0, IF(y > 0, ca.sqrt(x) + ca.sqrt(y), -1), 0), (-1, 4), (-1, 1), -1, 3),
    ("nested, again", IF(x > 0, IF(x > 1, ca.sqrt(x - 1), ROOT), 0), (-1, 5), (0, 0), 0, 2),
    ("one that never holds", IF(AND(x > 1, x < -1), 1 / (x - x * y), 3), (-2, 2), (-2, 2), 3, 3),
    ("zero under a guard", ca.if_else(x > 1, x, 0), (-3, 2), (0, 0), 0, 2),
]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "expression", "x_range", "y_range", "low", "high"), NARROWED, ids=[row[0] for row in NARROWED]
)
def test_branches_are_enclosed_where_their_condition_holds(name, expression, x_range, y_range, low, high):
    found = ends(expression, x_range, y_range)
    assert found[2] is None
    assert low - 1e-9 <= found[0] <= low and high <= found[1] <= high + 1e-9


def test_a_removable_singularity_is_bounded_by_its_limit():
    sinc = scalar(IF(ca.fabs(x) > 1e-8, ca.sin(x) / x, 1))
    found = bound(sinc, Box({"x": (-3, 3), "y": 0}))
    assert found.reason is None and found.upper <= 1 + TOLERANCE and found.attained_max.upper >= 1
    assert found.lower <= math.sin(3) / 3 <= found.lower + 2 * TOLERANCE


MEAN_SLOPES = [ca.sin(x) / x, ca.tanh(x) / x, ca.expm1(x) / x, ca.log1p(x) / x, ca.sinh(x) / x, ca.sin(3 * x) / x,
               ca.atan(-2 * x) / x, ca.asin(x) / x, ca.erf(x) / x, ca.tan(x) / x]  # fmt: skip


@pytest.mark.parametrize("expression", MEAN_SLOPES, ids=str)
def test_quotients_that_are_mean_slopes_hold_their_values_and_stay_bounded(expression):
    guarded = scalar(IF(ca.fabs(x) > 1e-9, expression, y))
    rng = np.random.default_rng(3)
    for low, high in ((-0.5, 0.75), (1e-6, 1e-3), (-0.9, -0.1)):
        found = enclose(guarded, Box({"x": (low, high), "y": 1}))
        lower, upper = float(found.lower["f"][0, 0]), float(found.upper["f"][0, 0])
        assert found.undecided is None and -11 < lower < upper < 11
        for at in rng.uniform(low, high, 50):
            assert lower - 1e-12 <= float(guarded(at, 1)) <= upper + 1e-12
    pole = enclose(scalar(expression), Box({"x": (-0.5, 0.75), "y": 1}))
    assert "the divisor may be zero" in pole.undecided


NOT_NARROWED = [
    # expression, x, y, what stands in the way
    ("a condition on another coordinate", IF(y > 0, ROOT, 0), (-1, 2), (-1, 1), "sqrt([-1.0, 2.0])"),
    ("the wrong branch", IF(x > 0, 0, ROOT), (-1, 2), (0, 0), "sqrt([-1.0, 0.0])"),
    ("too little", IF(x > -0.5, ROOT, 0), (-1, 2), (0, 0), "sqrt([-0.5, 2.0])"),
    ("one of the two", IF(OR(x > 0, y > 0), ROOT, 0), (-1, 2), (-1, 1), "sqrt([-1.0, 2.0])"),
    ("not both, the other branch", IF(AND(x > 0, y > 0), 0, ROOT), (-1, 2), (-1, 1), "sqrt([-1.0"),
    ("a product is no guard", (x > 0) * ROOT, (-1, 2), (0, 0), "sqrt([-1.0, 2.0])"),
    ("used outside as well", IF(x > 0, ROOT, 0) + ROOT, (-1, 2), (0, 0), "sqrt([-1.0, 2.0])"),
    ("the condition has no value", IF(ca.log(x) > 0, ROOT, 0), (-1, 2), (0, 0), "log([-1.0, 2.0])"),
    ("a pole at the open end", IF(x > 0, 1 / x, 0), (-1, 2), (0, 0), "the divisor may be zero"),
    ("unequal", IF(x != 0, 1 / x, 0), (-1, 2), (0, 0), "the divisor may be zero"),
    ("truth of a number", IF(x, 1 / x, 0), (-1, 2), (0, 0), "the divisor may be zero"),
    ("a size beyond less", IF(ca.fabs(x) > -1, 1 / x, 0), (-1, 2), (0, 0), "the divisor may be zero"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "expression", "x_range", "y_range", "why"), NOT_NARROWED, ids=[row[0] for row in NOT_NARROWED]
)
def test_what_a_guard_does_not_keep_out_stays_in(name, expression, x_range, y_range, why):
    low, high, undecided = ends(expression, x_range, y_range)
    assert (low, high) == (-np.inf, np.inf) and undecided is not None
    assert why in undecided or "argument may be negative" in undecided


KEPT = [
    # expression, x, a point of the box, the value there: what a slip would lose
    ("the closed end", IF(x >= 1, 2 * x, 9), (-1, 1), 1, 2),
    ("the closed end of the other branch", IF(x > 1, 9, 2 * x), (1, 3), 1, 2),
    ("the open end's limit", IF(x > 1, 2 * x, 9), (-1, 1 + 2.0**-52), 1 + 2.0**-52, 2 + 2.0**-51),
    ("equal at an end", IF(x == 1, 5, 0), (1, 2), 1, 5),
    ("not equal", IF(x == 1, 5, x), (0, 1), 0, 0),
    ("two pieces, the left", IF(ca.fabs(x) > 1, x, 0), (-2, 3), -2, -2),
    ("two pieces, the right", IF(ca.fabs(x) > 1, x, 0), (-3, 2), 2, 2),
    ("either, the first", IF(OR(x > 1, x < -1), x, 0), (-2, 2), -2, -2),
    ("either, the second", IF(OR(x < -1, x > 1), x, 0), (-2, 2), 2, 2),
    ("an inverse that turns", IF(1 / (x + 4) < 0.25, x, 9), (-1, 2), 2, 2),
    ("below a floor", IF(ca.floor(x) <= 0, x, 0), (-1, 2), 1 - 2.0**-53, 1 - 2.0**-53),
    ("a minimum from one side", IF(ca.fmin(x, 1) <= 0.5, x, 0), (-1, 2), -1, -1),
]  # fmt: skip


@pytest.mark.parametrize(("name", "expression", "x_range", "at", "value"), KEPT, ids=[row[0] for row in KEPT])
def test_no_value_is_lost_at_the_ends_of_what_a_condition_leaves(name, expression, x_range, at, value):
    low, high, _ = ends(expression, x_range)
    assert low <= value <= high
    assert float(scalar(expression)(at, 0)) == value


# ------------------------------------------------------------------ against exact rationals


def _boxes(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return ends of boxes in two coordinates, half of them on quarters, so that they touch where conditions change."""
    shape = (2, 2, count)
    found = np.where(rng.random(shape) < 0.5, rng.integers(-8, 9, shape) / 4, rng.uniform(-2, 2, shape))
    low, high = np.sort(found, axis=0)
    return low, high


def _points(rng: np.random.Generator, low: np.ndarray, high: np.ndarray) -> list[list[float]]:
    choices = [low, high, np.clip(rng.integers(-8, 9, 2) / 4, low, high), rng.uniform(low, high)]
    return [[float(choices[rng.integers(4)][i]) for i in range(2)] for _ in range(5)]


@pytest.mark.parametrize("tabled", [False, True], ids=["guards", "guards and tables"])
def test_random_guarded_graphs_hold_their_values_and_difference_quotients(tabled):
    rng = np.random.default_rng(5 + tabled)
    slopes_held = 0
    for _ in range(150):
        made = random_graph(rng, int(rng.integers(8, 30)), tabled)
        found = rewritten(made)
        assert isinstance(found, Rewritten)
        low, high = _boxes(rng, 8)
        (node,) = found.targets()
        values = evaluate(found, low, high, [node])
        (span, fault), slopes = values[node], gradient(found, node, values, low.shape)
        bottom, top = (np.broadcast_to(end, 8) for end in span)
        failed = np.zeros(8, dtype=bool) if fault is None else np.broadcast_to(fault >= 0, 8)
        for i in range(8):
            points = _points(rng, low[:, i], high[:, i])
            at = [exact(made, point) for point in points]
            for point, value in zip(points, at, strict=True):
                assert value is not None or failed[i], point
                assert value is None or bottom[i] == -np.inf or Fraction(bottom[i]) <= value, point
                assert value is None or top[i] == np.inf or value <= Fraction(top[i]), point
            ends_here = slopes.lo[:, i], slopes.hi[:, i]
            if failed[i] or not np.isfinite(ends_here).all():
                continue
            for (p, one), (q, other) in pairwise(zip(points, at, strict=True)):
                steps = [Fraction(a) - Fraction(b) for a, b in zip(p, q, strict=True)]
                reach = [[Fraction(end[j]) * steps[j] for end in ends_here] for j in range(2)]
                assert sum(map(min, reach)) <= one - other <= sum(map(max, reach)), (p, q)
                slopes_held += 1
    assert slopes_held > 1000


UNDER = [ca.exp, ca.log, ca.sqrt, ca.tanh, ca.sinh, ca.asinh, ca.expm1, ca.log1p, ca.erf, ca.atanh, ca.atan, ca.fabs,
         lambda a: a**2, lambda a: a**3, lambda a: a**1.5, lambda a: 1 / a, lambda a: -2 * a + y, lambda a: a * y,
         lambda a: a / (y + 3), lambda a: ca.fmin(a, y), lambda a: ca.fmax(a, -y), ca.floor, ca.ceil]  # fmt: skip
BRANCHES = [lambda a, x: ca.sqrt(x), lambda a, x: 1 / x, lambda a, x: ca.log(a), lambda a, x: ca.sqrt(a - 0.25) + x,
            lambda a, x: x * a, lambda a, x: ca.asin(x / 2)]  # fmt: skip
CONDITIONS = [lambda a: a > 0.25, lambda a: a <= 0.25, lambda a: a >= -0.5, lambda a: ca.fabs(a) > 0.5,
              lambda a: AND(a > -0.5, a < 1), lambda a: NOT(OR(a > 1, a < 0)), lambda a: a == 0.25]  # fmt: skip


@pytest.mark.parametrize("outer", range(len(UNDER)))
def test_conditions_through_functions_lose_no_value(outer):
    rng = np.random.default_rng(outer)
    for _ in range(40):
        inner = UNDER[rng.integers(len(UNDER))](x) if rng.random() < 0.6 else x
        quantity = UNDER[outer](inner)
        condition, branch = CONDITIONS[rng.integers(len(CONDITIONS))], BRANCHES[rng.integers(len(BRANCHES))]
        yes, no = branch(quantity, x), ca.if_else(x > 0, x, -x) if rng.random() < 0.5 else x
        expression = IF(condition(quantity), *((yes, no) if rng.random() < 0.5 else (no, yes)))
        made = read(scalar(expression))
        found = rewritten(made)
        low, high = _boxes(rng, 6)
        node = found.targets()[0]
        span, fault = evaluate(found, low, high, [node])[node]
        for i in range(6):
            for point in _points(rng, low[:, i], high[:, i]):
                value = valued(made, point, DOUBLES)[made.outputs[0].entries[0].node]
                if fault is not None and np.broadcast_to(fault, 6)[i] >= 0:
                    continue
                bottom, top = (float(np.broadcast_to(end, 6)[i]) for end in span)
                slack = 1e-9 * (1 + abs(value))
                near = abs(value) > 1e300 or bottom - slack <= value <= top + slack
                assert near, (expression, point, value, bottom, top)


# ------------------------------------------------------------------ kinks, jumps and poles behind guards

BEHIND = [
    # expression, of which operation, whether x in [-1, 2], y in [-1, 1] reaches it
    ("a pole that is kept out", IF(x > 0.25, 1 / x, 4), "inv", "no"),
    ("a pole at the closed end", IF(x >= 0, 1 / x, 4), "inv", "yes"),
    ("a pole at the open end", IF(x > 0, 1 / x, 4), "inv", "unknown"),
    ("a pole at the one point that is left out", IF(x != 0, 1 / x, 4), "inv", "unknown"),
    ("a pole on the other side", IF(x > 0.25, 4, 1 / x), "inv", "yes"),
    ("a pole between", IF(ca.fabs(x) > 0.25, 1 / x, 4), "inv", "no"),
    ("a pole that is kept in", IF(ca.fabs(x) < 0.25, 1 / x, 4), "inv", "yes"),
    ("a pole guarded by another", IF(y > 0.25, 1 / x, 4), "inv", "yes"),
    ("used outside as well", IF(x > 0.25, 1 / x, 4) + 1 / x, "inv", "yes"),
    ("guarded twice", IF(x > 0.25, IF(y > 0, 1 / x, 1), 4), "inv", "no"),
    ("guarded by one of two", IF(x > 0.25, 1 / x, IF(y > 0, 1 / x, 1)), "inv", "yes"),
    ("guarded by both of two", IF(x > 0.25, 1 / x, IF(x < -0.5, 1 / x, 1)), "inv", "yes"),  # only what both say counts
    ("a kink that is kept out", IF(x > 0.25, ca.fabs(x), 4), "fabs", "no"),
    ("a kink that is kept in", IF(x > -0.25, ca.fabs(x), 4), "fabs", "yes"),
    ("the end of a domain", IF(x > 0.25, ca.log(x), 4), "log", "no"),
    ("a quantity's pole", IF(x * y > 0.25, 1 / (x * y), 4), "inv", "no"),
    ("a product is no guard", (x > 0.25) * (1 / x), "div", "yes"),
    ("a jump in a branch", IF(x > 0.25, ca.sign(x), 1), "sign", "no"),
    ("a step in a branch", IF(AND(x > 0.25, x < 0.75), ca.floor(x), 1), "floor", "no"),
    ("a step that is met in a branch", IF(AND(x > 0.25, x < 1.25), ca.floor(x), 1), "floor", "yes"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "expression", "op", "reachable"), BEHIND, ids=[row[0] for row in BEHIND])
def test_what_a_guard_keeps_out_is_not_reached(name, expression, op, reachable):
    box = Box({"x": (-1, 2), "y": (-1, 1)})
    found = [one for one in reaches(scalar(expression), box) if one.operation.name == op]
    assert found and {one.reachable for one in found} == {reachable}
    for one in found:
        if one.point is not None:
            at = [float(one.point[name][0][0, 0]) for name in "xy"]
            made = read(scalar(expression))
            values = valued(made, at, DOUBLES)
            assert abs(values[made.nodes[one.operation.instruction].args[0]] % 1) < 1e-9  # the critical set is met


def test_continuity_across_a_guard_needs_its_sides_to_agree():
    box = Box({"x": (-1, 2), "y": (-1, 1)})
    assert continuous_on(scalar(IF(x > 0.25, 1 / x, 4)), box).proved
    assert not continuous_on(scalar(IF(x > 0.25, 1 / x, 5)), box).proved
    assert not continuous_on(scalar(IF(x > 0, 1 / x, 4)), box).proved
    assert not smooth_on(scalar(IF(x > 0.25, 1 / x, 4)), box).proved
    assert continuous_on(scalar(IF(x > 0, ca.sqrt(x), 0)), box).proved
    assert not continuous_on(scalar(IF(x > -0.5, ca.sqrt(x), 0)), box).proved


# ------------------------------------------------------------------ what it costs, and its parts


@pytest.fixture
def operated(monkeypatch):
    """Count operations on boxes."""
    seen: list[int] = []
    before = interval._operate
    monkeypatch.setattr(interval, "_operate", lambda graph, k, values: seen.append(k) or before(graph, k, values))
    return seen


def test_a_guard_that_is_decided_costs_nothing(operated):
    found = graph(IF(x > 0, IF(y > 0, ca.sqrt(x) + ca.sqrt(y), y), x))
    plain = sum(bool(found.nodes[i].args) for i in found.ancestors(found.targets()))
    decided, open_ = np.array([[1.0], [1.0]]), np.array([[-1.0], [-1.0]])
    evaluate(found, decided, 2 * decided, found.targets())
    assert len(operated) == plain
    evaluate(found, open_, 2 * decided, found.targets())
    assert len(operated) > 2 * plain


def test_guards_in_guards_cost_no_more_than_a_share(operated):
    """Twenty choices that each use the last one twice: every way through them would be a million."""
    value = x
    for i in range(20):
        value = IF(y > x - i, value + ca.sin(value), value * y)
    found = graph(value)
    low = np.array([[-1.0], [-30.0]])
    evaluate(found, low, -low, found.targets())
    assert len(operated) < 2 * (interval.EFFORT + 2) * len(found.nodes)


def test_what_is_left_of_boxes_is_closed_and_owned():
    found = graph(IF(ca.fabs(x) > 1, x, y))
    (condition,) = (i for i, node in enumerate(found.nodes) if node.op == "lt")
    low, high = np.array([[-2.0, 0.0, -0.5], [0.0, 0.0, 0.0]]), np.array([[3.0, 2.0, 0.5], [1.0, 1.0, 1.0]])
    parts = restricted(found, low, high, [(condition, True)], evaluate)
    assert sorted(zip(parts.owner, parts.lower[0], parts.upper[0], strict=True)) == [(0, -2, -1), (0, 1, 3), (1, 1, 2)]
    within = restricted(found, low, high, [(condition, False)], evaluate)
    assert list(zip(within.owner, within.lower[0], within.upper[0], strict=True)) == [
        (0, -1, 1), (1, 0, 1), (2, -0.5, 0.5)
    ]  # fmt: skip


def test_alternatives_beyond_the_limit_narrow_nothing():
    many = x > 9
    for i in range(6):
        many = OR(many, ca.fabs(x) > i)
    found = graph(IF(many, ca.sqrt(x + 20), 0))
    (guard,) = (node for node in found.nodes if node.op == "if_else_zero" and found.nodes[node.args[0]].op == "or")
    assert cases(found, guard.args[0], True) == ((),)
    low, high, undecided = ends(IF(many, ca.sqrt(x + 20), 0), (-10, 10))
    assert undecided is None and low <= 0 and high >= math.sqrt(30)


def test_an_end_that_is_no_number_narrows_nothing():
    found = graph(IF(x * y > 1, x, 0))
    (condition,) = (i for i, node in enumerate(found.nodes) if node.op == "lt")
    values = {i: Span(np.array([-np.inf]), np.array([np.inf])) for i in range(len(found.nodes))}
    for case in cases(found, condition, True):
        known, alive = contract(found, values, case, 1)
        assert alive.all() and not any(np.isnan(end).any() for span in known.values() for end in span)


def test_a_condition_counts_where_it_stands_on_every_way():
    found = graph(IF(x > 0, ca.exp(y), 0) + IF(x > 1, ca.exp(y), 1))
    (shared,) = (i for i, node in enumerate(found.nodes) if node.op == "exp")
    assert conditions_of(found, found.targets())[shared] == frozenset()
    nested = graph(IF(x > 0, IF(x > 1, ca.exp(y), 1), 0))
    (inner,) = (i for i, node in enumerate(nested.nodes) if node.op == "exp")
    assert len(conditions_of(nested, nested.targets())[inner]) == 2


def test_proofs_through_guards():
    f = scalar(IF(x > 0, ca.sqrt(x), -x))
    assert prove_bounds(f, Box({"x": (-1, 2), "y": 0}), lower=0.0).standing == "proved"
    beyond = prove_bounds(f, Box({"x": (-1, 2), "y": 0}), upper=1.4)
    assert beyond.standing == "refuted" and float(f(beyond.witness.point["x"][0], 0)) > 1.4
