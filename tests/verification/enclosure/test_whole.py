"""Boxes with whole numbers in them: what is bounded, proved and refuted holds at whole numbers, and only there."""

from __future__ import annotations

import math
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest

from verification.enclosure.bounds import bound, prove_bounds, prove_positive
from verification.enclosure.box import Box
from verification.enclosure.rewriting import rewritten
from verification.enclosure.smoothness import continuous_on, reaches, smooth_on
from verification.enclosure.whole import LIMIT, Sets, tabulated

x, u, k = (ca.SX.sym(name) for name in "xuk")
N = 30
LONG = 20_000


def function(expression):
    return ca.Function("f", [x, u, k], [expression], ["x", "u", "k"], ["f"])


def box(n=N, **ranges):
    return Box({"x": (0, 1), "u": (-1, 1), "k": (0, n - 1), **ranges}, whole=("k",))


def sampled(expression, n, points=41):
    """Least and largest value on a grid of x and u and at every whole k: an oracle from outside."""
    f = function(expression)
    grid = np.stack(np.meshgrid(np.linspace(0, 1, points), np.linspace(-1, 1, points)), -1).reshape(-1, 2)
    found = np.concatenate([f(grid[:, :1].T, grid[:, 1:].T, one).full().ravel() for one in range(n)])
    return found.min(), found.max()


BOUNDED = {
    "a period that is whole": ca.cos(2 * ca.pi * k) * u,
    "remainder": ca.fmod(k, 2),
    "remainder and state": (x * x - x) * (2 * ca.fmod(k, 2) - 1),
    "choice by k": ca.if_else(k < 10, x, 2 + u * u),
    "steps of k": ca.floor(k / 5) * x - u,
    "k and x decide": ca.if_else(x < k - 10.5, u, 2 * u),
    "pole between two samples": u / (k - 3.5),
    "pole in a branch not taken": ca.if_else(k == 3, 0, u / (k - 3)),
    "root of what is never negative": ca.sqrt(ca.fabs(k - 3.5) - 0.5) * u,
    "slow and fast": (1 + 0.5 * ca.sin(k) + 0.1 * x**2) * u + 0.001 * x * k,
    "as good as random": ca.fmod(k * k * 7919, 104729) * u / 1e5 + ca.fmod(k * 31, 97) * x * x - x * u,
    "no k": x * u - u,
    "exact cancellation": (u * k) - 2 * (u * (k / 2)) + x,
}


@pytest.mark.parametrize("name", BOUNDED)
@pytest.mark.parametrize("slopes", [True, False])
def test_bounds_hold_every_whole_value_and_are_met_by_one(name, slopes):
    expression = BOUNDED[name]
    found = bound(function(expression), box(), budget=1200, tolerance=1e-2, slopes=slopes)
    low, high = sampled(expression, N)
    assert found.lower <= low and high <= found.upper
    if slopes:
        assert found.reason is None
        assert found.upper - found.lower <= high - low + 0.05 + 0.02 * max(abs(low), abs(high))
    for attained in (found.attained_min, found.attained_max):
        at = attained.point.midpoint()
        assert attained.point.whole == ("k",) and float(at["k"][0, 0]).is_integer()
        value = float(function(expression)(at["x"], at["u"], at["k"]))
        assert attained.lower - 1e-12 <= value <= attained.upper + 1e-12


@pytest.mark.parametrize("name", [one for one in BOUNDED if one not in ("as good as random", "exact cancellation")])
def test_many_samples_cost_no_budget(name):
    """The bounds of a short range hold in a long one, with no more than a few boxes of the budget for it."""
    found = bound(function(BOUNDED[name]), box(LONG), budget=1200, tolerance=1e-2)
    assert found.reason is None, found
    low, high = sampled(BOUNDED[name], N)
    assert found.lower <= low and high <= found.upper


def test_a_gain_that_is_whole_in_period_is_not_refuted_between_samples():
    gain = function(ca.cos(2 * ca.pi * k))
    found = prove_positive(gain, box())
    assert found.standing == "proved" and found.lower == pytest.approx(1, abs=1e-9)
    between = prove_positive(gain, Box(dict(box())))
    at = between.witness.point.midpoint()["k"][0, 0]
    assert between.standing == "refuted" and not float(at).is_integer()


@pytest.mark.parametrize(
    ("expression", "upper", "standing"),
    [
        (ca.fmod(k, 2), 1, "proved"),
        (ca.fmod(k, 2), 0.999, "refuted"),
        (ca.sin(ca.pi * k / 2) * u, 1, "proved"),
        (ca.if_else(k < N - 1, u, 2 * u), 1, "refuted"),  # at the last sample only
        (ca.if_else(k == 17, u + 1, u), 1.5, "refuted"),  # at one in the middle
        (ca.if_else(k == 17.5, u + 1, u), 1.5, "proved"),  # at none
        (u * k, N - 1, "proved"),
        (u * k, N - 1.001, "refuted"),
    ],
)
def test_proofs_and_their_witnesses_are_at_whole_numbers(expression, upper, standing):
    found = prove_bounds(function(expression), box(), upper=upper)
    assert found.standing == standing, found
    if standing == "refuted":
        at = found.witness.point.midpoint()
        assert float(at["k"][0, 0]).is_integer()
        assert float(function(expression)(at["x"], at["u"], at["k"])) > upper


def test_what_is_not_defined_at_a_whole_number_is_not_proved():
    found = bound(function(u / (k - 3)), box())
    assert not math.isfinite(found.lower) and "the divisor may be zero" in found.reason
    assert not math.isfinite(bound(function(u * ca.log(k)), box()).lower)
    assert math.isfinite(bound(function(u * ca.log(k)), box(k=(1, 9))).lower)


def test_more_whole_numbers_than_are_told_apart():
    wide = box(8 * LIMIT)
    found = bound(function(u * k + ca.fmod(k, 2)), wide, tolerance=1e-3)
    assert found.lower <= 2 - 8 * LIMIT and found.upper >= 8 * LIMIT
    assert float(found.attained_max.point.midpoint()["k"][0, 0]).is_integer()
    refuted = prove_bounds(function(u * k), wide, upper=7.0 * LIMIT)
    assert refuted.standing == "refuted" and float(refuted.witness.point.midpoint()["k"][0, 0]).is_integer()


def test_several_whole_inputs():
    p = ca.SX.sym("p", 2)
    f = ca.Function("f", [p, u], [ca.fmod(p[0], 2) * u + ca.fmod(p[1], 3)], ["p", "u"], ["f"])
    found = bound(f, Box({"p": ([0, 1], [200, 201]), "u": (-1, 1)}, whole=("p",)))
    assert found.lower == -1 and found.upper == 3


SMOOTH = [
    # expression, continuous in x and u, infinitely differentiable in them
    ("remainder", ca.fmod(k, 2) * u, True, True),
    ("choice by k", ca.if_else(k < 10, u, 2 * u), True, True),
    ("steps of k", ca.floor(k / 5) * u, True, True),
    ("sign of k", ca.sign(k - 5) * u, True, True),
    ("size of k", ca.fabs(k - 5) * u, True, True),
    ("larger of two", ca.fmax(k, 10) * u, True, True),
    ("truth of k", ca.if_else(k, u, 2 * u), True, True),
    ("pole at a sample", u / (k - 3), False, False),
    ("pole between two", u / (k - 3.5), True, True),
    ("remainder by zero", ca.fmod(5, k) * u, False, False),
    ("root of what is negative", ca.sqrt(k - 3.5) * u, False, False),
    ("root of zero", ca.sqrt(k) * u, True, True),
    ("root in a state", ca.sqrt(x) * k, True, False),
    ("k and x decide", ca.if_else(x < k - 10.5, u, 2 * u), False, False),
    ("k and x decide nowhere", ca.if_else(x < 10 * k + 5, u, 2 * u), True, True),
    ("kink by k and u", ca.fabs(u - k + 5), True, False),
    ("kink by k and u nowhere", ca.fabs(2 * u - 5 * k + 2.5), True, True),
    ("steps of k and u", ca.floor(k + 0.3 * u + 0.5), True, True),
    ("steps of k and u met", ca.floor(k + 0.3 * u), False, False),
    ("a jump of a reading of k", ca.sign(u - ca.fmod(k, 2) - 3), True, True),
    ("a jump of a reading of k met", ca.sign(u - ca.fmod(k, 2) + 0.5), False, False),
]  # fmt: skip


@pytest.mark.parametrize(("name", "expression", "continuous", "smooth"), SMOOTH, ids=[row[0] for row in SMOOTH])
@pytest.mark.parametrize("n", [N, LONG])
def test_whole_numbers_make_no_kink_and_no_jump_but_poles(name, expression, continuous, smooth, n):
    f = function(expression)
    assert continuous_on(f, box(n)).proved == continuous
    assert smooth_on(f, box(n)).proved == smooth
    for reach in reaches(f, box(n)):
        if reach.point is not None:
            at = reach.point.midpoint()
            assert reach.point.whole == ("k",) and float(at["k"][0, 0]).is_integer()
            assert np.isfinite(at["k"]).all() and 0 <= at["k"][0, 0] <= n - 1


@pytest.mark.parametrize("level", [k - 2.5 + 0.1 * x, k - 2.5 + 1.9 * (x - x * x)])
def test_a_sign_change_between_two_samples_is_no_zero(level):
    """At k = 2 the level is negative everywhere, at k = 3 positive: it is continuous in x, and zero nowhere."""
    (found,) = reaches(function(ca.sign(level)), box())
    assert found.reachable == "no"


def test_a_zero_at_one_sample_of_many_that_are_hard_to_exclude():
    """At the last sample alone the level is zero somewhere; the terms in x cancel, which intervals do not see."""
    nothing = 200 * (x - x * x) - 200 * x + 200 * x * x
    (found,) = reaches(function(ca.sign(LONG - 1 - k + 0.4 - 1.9 * (x - x * x) + nothing)), box(LONG))
    assert found.reachable != "no"


def test_sets_of_cases_are_split_into_all_of_their_cases():
    graph = rewritten(function(u * ca.fmod(k * k * 7919, 104729) + x * ca.log(k) + ca.if_else(k < 9, 0, x * k)))
    at = box(3000)
    f = function(u)
    table = tabulated(graph, *at.coordinates(f), at.whole_coordinates(f), graph.targets())
    sets, seen = Sets(table), []
    waiting = [sets.all]
    while waiting:
        which = waiting.pop()
        members = sets.members(which)
        low, high = (end[:, 0] for end in sets.ends(np.array([which])))
        assert np.all(low <= table.lower[:, members].min(axis=1))
        assert np.all(high >= table.upper[:, members].max(axis=1))
        if members.size > 1:
            halves = sets.split(which, len(seen) % table.readings)
            assert sum(sets.members(half).size for half in halves) == members.size
            waiting += halves
        else:
            seen += members.tolist()
    assert sorted(seen) == list(range(table.cases)) and table.cases > 2900


def test_some_cases_of_many_have_a_pole():
    """Samples from 100 on meet the pole somewhere in x, those before do not."""
    expression = u / (x - (k - 100) / 100 + 0.005)
    for n, bounded in ((100, True), (200, False), (3000, False)):
        found = bound(function(expression), box(n), budget=800, tolerance=0.1)
        assert math.isfinite(found.lower) == bounded and math.isfinite(found.upper) == bounded


def test_continuity_along_some_inputs():
    jumps_in_x = function(0.5 * x + 2 * ca.sign(x - 0.3) + u)
    assert not continuous_on(jumps_in_x, box()).proved
    assert continuous_on(jumps_in_x, box(), along=("u",)).proved
    assert not continuous_on(jumps_in_x, box(), along=("x",)).proved
    assert not continuous_on(function(ca.sign(x + u)), box(), along=("u",)).proved
    assert not continuous_on(function(u / (x - 0.3)), box(), along=("u",)).proved  # no value at x = 0.3
    with pytest.raises(ValueError, match="along must name inputs"):
        continuous_on(jumps_in_x, box(), along=("v",))


def test_a_box_of_whole_numbers_keeps_them():
    whole = box()
    left, right = whole.split()
    seen = [left, right, *left.split(), *right.split()]
    assert all(one.whole == ("k",) for one in seen)
    only = Box({"k": (0, 7)}, whole=("k",))
    halves = [only]
    while not all(one.is_point for one in halves):
        halves = [half for one in halves for half in (one.split() if not one.is_point else (one,))]
        ends = sorted((one["k"][0][0, 0], one["k"][1][0, 0]) for one in halves)
        assert all(a[1] + 1 == b[0] for a, b in pairwise(ends))
    assert [float(one.midpoint()["k"][0, 0]) for one in halves] == list(range(8))
    assert str(only) == "k in 0..7" and only != Box({"k": (0, 7)}) and only == Box({"k": (0, 7)}, whole=("k", "k"))
    assert Box({"k": (0, 1)}, whole=("k",)).midpoint()["k"][0, 0] in (0, 1)
    f = function(u)
    assert whole.whole_coordinates(f).tolist() == [False, False, True]
    assert Box.from_coordinates(f, *whole.coordinates(f), whole.whole) == whole


@pytest.mark.parametrize(
    ("ranges", "whole", "sentence"),
    [
        ({"k": (0, 2.5)}, ("k",), "whole numbers below"),
        ({"k": (0, 2.0**60)}, ("k",), "whole numbers below"),
        ({"k": (0, 2)}, ("n",), "whole must name ranges"),
        ({"k": (0, 2)}, "k", "a tuple of names"),
    ],
)
def test_bad_whole_ranges_are_refused(ranges, whole, sentence):
    with pytest.raises(ValueError, match=sentence):
        Box(ranges, whole=whole)
