"""Slips in what reads tables that a graph spells out, and in slopes behind guards."""

from __future__ import annotations

from fractions import Fraction

import casadi as ca

from slips.planting import Slip
from verification.checks.slope import slope
from verification.enclosure.bounds import bound
from verification.enclosure.box import Box
from verification.enclosure.interval import enclose
from verification.enclosure.pieces import along, quantities
from verification.enclosure.smoothness import breaks_somewhere, continuous_on
from verification.enclosure.tables import with_tables
from workbench.graph import Graph, read

X = ca.SX.sym("x")
BOX = Box({"x": (-3.0, 3.0)})


def spelt(expression) -> Graph:
    return read(ca.Function("f", [X], [expression], ["x"], ["y"]))


def table():
    return ca.pw_lin(X, ca.DM([-8, -0.3, 0.1, 0.45, 9]), ca.DM([0, 0.2, 0.1, 0.4, -0.3]))


def jumps(*expressions):
    for one in expressions:
        assert not continuous_on(with_tables(spelt(one)), BOX).proved, one


def a_step_under_slopes_that_cancel_is_a_jump():
    jumps((1e9 * X + ca.if_else(X > 0.3, 1e-7, 0)) - 999999999 * X)


def a_step_on_a_small_slope_is_a_jump():
    jumps(1e-9 * X + ca.if_else(X > 0.3, 1e-22, 0))


def a_step_on_a_large_number_is_a_jump():
    jumps(1e9 + ca.if_else(X > 0.3, 3e-5 + 1e-7, 1e-4 * X))


def a_point_by_itself_is_a_jump():
    jumps(table() + ca.if_else(X == 0.1, 1, 0))


def a_step_to_the_right_of_a_point_is_a_jump():
    jumps(table() + ca.if_else(X > 0.2, 1e-12, 0))


def a_table_holds_both_of_its_sides():
    f = spelt(table())
    (quantity,) = quantities(f)
    pieces = along(f, quantity)[f.outputs[0].entries[0].node]
    for i, point in enumerate(pieces.points):
        held = enclose(with_tables(f), Box({"x": (float(point), float(point))}))
        low, high = (Fraction(end["y"][0, 0]) for end in (held.lower, held.upper))
        assert all(low <= line.at(point) <= high for line in pieces.lines[i : i + 2])


def a_guard_keeps_the_chain():
    found = bound(slope(spelt(ca.if_else(X > 0, ca.sin(-3 * X), 0)), "y", "x"), Box({"x": (0.1, 0.2)}))
    assert found.upper < 0


def a_guard_that_lets_a_pole_in_is_broken():
    assert breaks_somewhere(spelt(ca.if_else(X > -1, (X + 1) / X, 0)))
    assert breaks_somewhere(spelt(1 / (X - 1e300))) and not breaks_somewhere(spelt(ca.if_else(X > 1, ca.log(X), 0)))


SLIPS = (
    Slip(
        where="verification.enclosure.tables:_allowed",
        stands="return min(",
        slipped="return max(",
        causes="a step that slopes of 1e9 hide, and take away again, is a table: A2.lifted PROVED across a jump",
        check=a_step_under_slopes_that_cancel_is_a_jump,
    ),
    Slip(
        where="verification.enclosure.tables:_before",
        stands="{place, *node.args}",
        slipped="{place}",
        causes="the part of a jump that is no jump by itself is read as a table: A2.lifted PROVED across a jump",
        check=a_step_under_slopes_that_cancel_is_a_jump,
    ),
    Slip(
        where="verification.enclosure.tables:_beside",
        stands=", pieces.lines[i + 1].at(point)",
        slipped="",
        causes="what lies to the right of a breakpoint is not asked for: a step there is continuous, A2.lifted PROVED",
        check=a_step_to_the_right_of_a_point_is_a_jump,
    ),
    Slip(
        where="verification.enclosure.tables:_rise",
        stands="+ line.aside",
        slipped="+ line.aside + abs(line.level)",
        causes="a step on a large number counts as its rounding: A2.lifted PROVED across a jump",
        check=a_step_on_a_large_number_is_a_jump,
    ),
    Slip(
        where="verification.enclosure.pieces:Line.times",
        stands="steep=size * self.steep",
        slipped="steep=self.steep",
        causes="a step on a slope of 1e-9 counts as the rounding of a slope of 1: A2.lifted PROVED across a jump",
        check=a_step_on_a_small_slope_is_a_jump,
    ),
    Slip(
        where="verification.enclosure.pieces:Pieces.parts",
        stands="values.append(self.values[piece])",
        slipped="values.append(self.lines[piece].at(point))",
        causes="a value that stands by itself is not seen: the output counts as continuous there",
        check=a_point_by_itself_is_a_jump,
    ),
    Slip(
        where="verification.enclosure.lookups:_numbers",
        stands="_around(entry + off)[1]",
        slipped="_around(entry)[1]",
        causes="a table's largest value is that of its points, though its pieces rise above",
        check=a_table_holds_both_of_its_sides,
    ),
    Slip(
        where="workbench.graph.derivative:_times",
        stands='"if_else_zero", condition, _times(build, inner, b))',
        slipped='"if_else_zero", condition, inner)',
        causes="behind a guard the chain rule ends: a falling branch has a positive slope, A4.partial PROVED",
        check=a_guard_keeps_the_chain,
    ),
    Slip(
        where="verification.enclosure.everywhere:ends",
        stands="np.where(real, LARGEST, upper)",
        slipped="np.where(real, 0.0, upper)",
        causes="a pole to the right is out of reach of all real numbers: the limit of learning PROVED behind it",
        check=a_guard_that_lets_a_pole_in_is_broken,
    ),
    Slip(
        where="verification.enclosure.smoothness:_shut_out",
        stands="return not bool(question.unclear(lower, upper).any())",
        slipped="return bool(conditions)",
        causes="whatever stands behind a guard is defined everywhere: the limit of learning PROVED past a pole",
        check=a_guard_that_lets_a_pole_in_is_broken,
    ),
)
