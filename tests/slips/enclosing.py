"""Slips in the enclosure: intervals, branch and bound, normal forms, kinks and jumps, exact matrices."""

from __future__ import annotations

from fractions import Fraction

import casadi as ca
import numpy as np
from flint import arb, ctx

from slips.planting import Slip
from verification.enclosure import outward, outward_logic
from verification.enclosure.bounds import bound, prove_bounds, prove_positive
from verification.enclosure.box import Box
from verification.enclosure.breaks import break_at
from verification.enclosure.exact_schur import certifies
from verification.enclosure.interval import enclose, evaluate
from verification.enclosure.outward import Span
from verification.enclosure.rewriting import rewritten
from verification.enclosure.rounding import rounding
from verification.enclosure.smoothness import breaks_somewhere, continuous_on, reaches
from workbench.graph import Builder, Entry, Result, read

X, Y = ca.SX.sym("x"), ca.SX.sym("y")


def of_x(expression):
    return ca.Function("f", [X], [expression], ["x"], ["f"])


def of_both(expression):
    return ca.Function("f", [X, Y], [expression], ["x", "y"], ["f"])


def span(low, high):
    return Span(np.array([float(low)]), np.array([float(high)]))


def turning_points_are_seen():
    """Between the two doubles next to a turning point or a pole it is there, however far out."""
    for k in range(1, 3000):
        with ctx.workprec(200):
            quarter = arb.pi() * k / 2
            near = float(quarter.mid())
            low, high = (near, np.nextafter(near, np.inf)) if arb(near) < quarter else (np.nextafter(near, 0), near)
        between = span(low, high)
        if k % 2 == 0:
            assert (outward.cos(between).hi if k % 4 == 0 else -outward.cos(between).lo) == 1
        else:
            assert (outward.sin(between).hi if k % 4 == 1 else -outward.sin(between).lo) == 1
            assert outward.tan(between)[1].all()


def zero_has_no_power_below_zero():
    _, bad = outward.power(span(0, 1), span(-0.5, 0.5))
    assert bad.all()


def an_odd_magnitude_reaches_zero():
    assert enclose(of_x(ca.fabs(X)), Box({"x": (-1.0, 2.0)})).lower["f"][0, 0] <= 0


def negative_factors_are_corners():
    found = enclose(of_both(X * Y), Box({"x": (-2.0, 1.0), "y": (-1.0, 3.0)}))
    assert found.lower["f"][0, 0] <= -6 and found.upper["f"][0, 0] >= 3


def a_sign_turns_the_ends_of_the_other_factor():
    found = enclose(of_both(X * Y), Box({"x": (-2.0, -1.0), "y": (-1.0, 3.0)}))
    assert found.lower["f"][0, 0] <= -6 and found.upper["f"][0, 0] >= 2


def a_sum_is_rounded_outwards():
    found = outward.add(span(1, 1), span(2.0**-60, 2.0**-60))
    assert Fraction(found.lo[0]) <= 1 + Fraction(1, 2**60) <= Fraction(found.hi[0])


def touching_boxes_may_be_equal():
    found = outward_logic.less_equal(span(1, 2), span(0, 1))
    assert found.hi[0] == 1


def a_choice_takes_both_branches():
    found = enclose(of_x(ca.if_else(X > 0, 2, -1)), Box({"x": (-1.0, 1.0)}))
    assert found.lower["f"][0, 0] <= -1 and found.upper["f"][0, 0] >= 2


def a_branch_that_may_be_taken_may_fail():
    assert enclose(of_x(ca.if_else(X > 0, ca.log(X), 0)), Box({"x": (-1.0, 1.0)})).undecided


def one_of_two_boxes_may_fail():
    graph = rewritten(of_x(ca.sqrt(X)))
    (node,) = graph.targets()
    fault = evaluate(graph, np.array([[-1.0, 1.0]]), np.array([[1.0, 2.0]]), [node])[node].fault
    assert fault is not None and fault[0] >= 0


def trouble_of_the_first_entry_is_told():
    found = bound(of_x(ca.vertcat(ca.log(X), X)), Box({"x": (-1.0, 1.0)}), budget=64)
    assert found.reason is not None
    assert prove_bounds(of_x(ca.vertcat(ca.log(X), X)), Box({"x": (-1.0, 1.0)}), upper=2.0).standing != "proved"


def zero_is_not_positive():
    assert prove_positive(of_x(X**2), Box({"x": (0.0, 1.0)})).standing != "proved"


def a_valley_is_found():
    found = bound(of_x((X - 0.3) ** 2), Box({"x": (0.0, 1.0)}))
    assert found.lower <= 0 and found.upper >= 0.49


def a_smaller_one_falls():
    found = bound(of_both(ca.fmin(-X, X) + 0 * Y), Box({"x": (1.0, 2.0), "y": (0.0, 1.0)}))
    assert found.lower <= -2


def the_last_whole_number_counts():
    found = bound(of_both(X * Y), Box({"x": (0.0, 1.0), "y": (0.0, 9.0)}, whole=("y",)))
    assert found.upper >= 9


def halves_of_a_box_leave_no_gap():
    low, high = Box({"x": (0.0, 3.0)}).split()
    assert low["x"][1] >= high["x"][0]
    low, high = Box({"k": (0.0, 3.0)}, whole=("k",)).split()
    assert low["k"][1] + 1 == high["k"][0]


def one_condition_is_not_the_others_opposite():
    found = enclose(of_x(ca.if_else(X < 1, 1, 0) + ca.if_else(X <= 1, 1, 0)), Box({"x": (0.0, 0.5)}))
    assert found.lower["f"][0, 0] <= 2 <= found.upper["f"][0, 0]


def two_inputs_are_two_quantities():
    found = enclose(of_both(X - Y), Box({"x": (0.0, 1.0), "y": (0.0, 1.0)}))
    assert found.lower["f"][0, 0] <= -1 and found.upper["f"][0, 0] >= 1


def a_power_below_zero_keeps_its_pole():
    build = Builder(read(of_x(X)))
    powers = [build.operation("pow", 0, build.constant(n)) for n in (-3.0, 3.0)]
    both = build.operation("mul", *powers)
    assert enclose(build.built((Result("f", (1, 1), (Entry(0, 0, both),)),)), Box({"x": (-1.0, 1.0)})).undecided


def doubles_stay_within_what_they_round():
    f, box = of_x((X * X - 0.3) * 1e6), Box({"x": (0.5477, 0.5478)})
    most = rounding(f, box)["f"][0, 0]
    for x in np.linspace(0.5477, 0.5478, 300):
        true = (Fraction(x) ** 2 - Fraction(0.3)) * 10**6
        assert abs(Fraction(float(f(x))) - true) <= Fraction(float(most))


def sides_that_meet_are_no_break():
    f = read(of_x(ca.sign(X) * X))
    box = Box({"x": (-1.0, 1.0)})
    jumps = [one for one in reaches(f, box) if one.operation.kind == "jump" and one.reachable == "yes"]
    assert jumps and all(break_at(f, box, one) is None for one in jumps)


def a_difference_that_closes_is_no_break():
    f = read(of_x(ca.floor(X) * (X - 1)))
    box = Box({"x": (0.5, 1.5)})
    jumps = [one for one in reaches(f, box) if one.operation.kind == "jump" and one.reachable == "yes"]
    assert jumps and all(break_at(f, box, one) is None for one in jumps)


def what_is_not_excluded_is_not_continuous():
    f = of_x(ca.sign((X - 0.3714) ** 2 - 1e-9))
    assert not continuous_on(f, Box({"x": (0.0, 1.0)}), budget=1).proved


def a_pole_somewhere_is_a_break():
    assert breaks_somewhere(of_x(1 / X)) and breaks_somewhere(of_x(ca.sqrt(X)))


def all_three_sides_must_agree():
    assert not continuous_on(of_x(ca.if_else(X < 0, 1, 0)), Box({"x": (-1.0, 1.0)})).proved
    assert not continuous_on(of_x(ca.if_else(X > 0, 1, 0)), Box({"x": (-1.0, 1.0)})).proved


def a_logarithm_ends_at_zero():
    assert not continuous_on(of_x(ca.log(X)), Box({"x": (0.0, 1.0)})).proved


def a_difference_is_no_sum():
    assert not continuous_on(of_both(ca.if_else(X > 0, Y + 1, Y - 1)), Box({"x": (-1.0, 1.0), "y": (0.0, 1.0)})).proved


def what_grows_is_not_schur():
    assert not certifies([[Fraction(1)]], [[Fraction(2)]])


def the_unit_circle_is_not_inside():
    assert not certifies([[Fraction(1)]], [[Fraction(1)]])


SLIPS = (
    Slip(
        where="verification.enclosure.outward:_meets_lattice",
        stands="15 * 2.0**-53 * (1.0 +",
        slipped="0 * 2.0**-53 * (1.0 +",
        causes="a bound of sin or cos below 1 around its maximum, a tangent without its pole: PROVED",
        check=turning_points_are_seen,
    ),
    Slip(
        where="verification.enclosure.outward:power",
        stands="((lo == 0) & (exp_lo > 0))",
        slipped="(lo == 0)",
        causes="0 to the power -0.5 is enclosed by [0, 1]",
        check=zero_has_no_power_below_zero,
    ),
    Slip(
        where="verification.enclosure.outward:magnitude",
        stands="np.where(has_zero(a), 0.0, np.minimum(low, high))",
        slipped="np.minimum(low, high)",
        causes="|x| on [-1, 2] is at least 1",
        check=an_odd_magnitude_reaches_zero,
    ),
    Slip(
        where="verification.enclosure.outward:_corners",
        stands="[b.lo] if b.lo is b.hi else [b.lo, b.hi]",
        slipped="[b.lo]",
        causes="a product of two intervals without half of its corners",
        check=negative_factors_are_corners,
    ),
    Slip(
        where="verification.enclosure.outward:mul",
        stands="(a_minus | b_minus) & ~b_plus",
        slipped="b_minus & ~b_plus",
        causes="[-2, -1] [-1, 3] ends at 1",
        check=a_sign_turns_the_ends_of_the_other_factor,
    ),
    Slip(
        where="verification.enclosure.outward:_ends",
        stands="np.where(high_error <= 0, high, up(high))",
        slipped="high",
        causes="sums and products rounded to nearest at the upper end",
        check=a_sum_is_rounded_outwards,
    ),
    Slip(
        where="verification.enclosure.outward_logic:less_equal",
        stands="a.lo <= b.hi",
        slipped="a.lo < b.hi",
        causes="x <= y is false for boxes that touch, where it holds in one point",
        check=touching_boxes_may_be_equal,
    ),
    Slip(
        where="verification.enclosure.outward_logic:select",
        stands="np.where(no, b.hi, both.hi)",
        slipped="b.hi",
        causes="a branch that may be taken does not count for the upper bound",
        check=a_choice_takes_both_branches,
    ),
    Slip(
        where="verification.enclosure.interval:_inherited",
        stands="np.where(holds.hi == 0, -1, faults[1])",
        slipped="np.where(holds.lo == 0, -1, faults[1])",
        causes="a logarithm of what may be negative is enclosed, since its branch is not surely taken",
        check=a_branch_that_may_be_taken_may_fail,
    ),
    Slip(
        where="verification.enclosure.interval:_operate",
        stands="bad.any()",
        slipped="bad.all()",
        causes="the root of a number below zero is enclosed where another box of the batch is fine",
        check=one_of_two_boxes_may_fail,
    ),
    Slip(
        where="verification.enclosure.bounds:_extremum",
        stands="next((search.trouble for search in searches if search.trouble is not None), None)",
        slipped="searches[-1].trouble",
        causes="bounds of several entries are called known, and PROVED, where only the last one is",
        check=trouble_of_the_first_entry_is_told,
    ),
    Slip(
        where="verification.enclosure.bounds:prove_bounds",
        stands="value > level if strict else value >= level",
        slipped="value >= level",
        causes="x^2 is PROVED positive on [0, 1]",
        check=zero_is_not_positive,
    ),
    Slip(
        where="verification.enclosure.branch_and_bound:_lower_bounds",
        stands="use & (slopes.hi <= 0)",
        slipped="use & (slopes.lo <= 0)",
        causes="what falls and rises is held at one end: a minimum of 0.49 for one of 0",
        check=a_valley_is_found,
    ),
    Slip(
        where="verification.enclosure.slopes:_smaller",
        stands="outward_logic.less(a, b), outward_logic.less(b, a)",
        slipped="outward_logic.less(b, a), outward_logic.less(a, b)",
        causes="the smaller of -x and x is said to rise, its minimum is at the wrong end",
        check=a_smaller_one_falls,
    ),
    Slip(
        where="verification.enclosure.whole:_cases",
        stands="counts = upper - lower + 1",
        slipped="counts = upper - lower",
        causes="what happens at the last sample of a trial is not in the bound",
        check=the_last_whole_number_counts,
    ),
    Slip(
        where="verification.enclosure.box:Box.split",
        stands="middle + (name in self.whole)",
        slipped="middle + 1",
        causes="halves of a box with a gap of 1 between them: what is proved of both is not of the whole",
        check=halves_of_a_box_leave_no_gap,
    ),
    Slip(
        where="verification.enclosure.rewriting:Rewriter.node",
        stands="key = (op, args, float(value).hex(), coordinate)",
        slipped="key = (op, args, float(value).hex())",
        causes="x - y is x - x, and 0",
        check=two_inputs_are_two_quantities,
    ),
    Slip(
        where="verification.enclosure.rewriting:Rewriter.opposite",
        stands="first.args == second.args[::-1]",
        slipped="set(first.args) == set(second.args)",
        causes="x < 1 and x <= 1 are taken for opposites, and their sum for 1",
        check=one_condition_is_not_the_others_opposite,
    ),
    Slip(
        where="verification.enclosure.rewriting:Rewriter.power",
        stands=" and exponent.value > 0",
        slipped="",
        causes="x^-1 x is 1 at x = 0",
        check=a_power_below_zero_keeps_its_pole,
    ),
    Slip(
        where="verification.enclosure.rounding:rounding",
        stands="passed += steep * off[arg]",
        slipped="passed += off[arg]",
        causes="a funnel with rounding that doubles leave, where a slope is steep",
        check=doubles_stay_within_what_they_round,
    ),
    Slip(
        where="verification.enclosure.breaks:_apart",
        stands="gap = max(left[0] - right[1], right[0] - left[1])",
        slipped="gap = max(left[1] - right[0], right[1] - left[0])",
        causes="A1 of |u| u is REFUTED by a break where both sides meet",
        check=sides_that_meet_are_no_break,
    ),
    Slip(
        where="verification.enclosure.breaks:_closing",
        stands=" or gaps[-1] < _SHRUNK * gaps[0]",
        slipped="",
        causes="A1 is REFUTED by a difference that closes as the points come closer",
        check=a_difference_that_closes_is_no_break,
    ),
    Slip(
        where="verification.enclosure.smoothness:_judge",
        stands='if r.reachable == "no":',
        slipped='if r.reachable != "yes":',
        causes="a jump that the budget did not exclude counts as excluded: A1 PROVED",
        check=what_is_not_excluded_is_not_continuous,
    ),
    Slip(
        where="verification.enclosure.smoothness:breaks_somewhere",
        stands='found.kind == "kink" and not found.edge',
        slipped="found.kind",
        causes="every plant is continuous everywhere: the limit of learning PROVED behind a pole",
        check=a_pole_somewhere_is_a_break,
    ),
    Slip(
        where="verification.enclosure.switches:Switches._shown",
        stands="sides[0] == sides[1] == sides[2]",
        slipped="sides[1] == sides[2]",
        causes="a step that takes its upper value at the switch is continuous: A1 PROVED",
        check=all_three_sides_must_agree,
    ),
    Slip(
        where="verification.enclosure.critical_search:_clear",
        stands='level.lo > 0 if rule == "nonpositive" else level.lo >= 0',
        slipped="level.lo >= 0",
        causes="the logarithm is continuous on [0, 1]: A1 PROVED",
        check=a_logarithm_ends_at_zero,
    ),
    Slip(
        where="verification.enclosure.ring:added",
        stands="factor * coefficient",
        slipped="abs(factor) * coefficient",
        causes="y - 1 and y + 1 have one normal form: a jump counts as mended, A1 PROVED",
        check=a_difference_is_no_sum,
    ),
    Slip(
        where="verification.enclosure.exact_schur:certifies",
        stands="P[i][j] - _dot(",
        slipped="P[i][j] + _dot(",
        causes="every matrix is PROVED Schur",
        check=what_grows_is_not_schur,
    ),
    Slip(
        where="verification.enclosure.exact_schur:_positive_definite",
        stands="rows[i][i] <= 0",
        slipped="rows[i][i] < 0",
        causes="the identity is PROVED Schur",
        check=the_unit_circle_is_not_inside,
    ),
)
