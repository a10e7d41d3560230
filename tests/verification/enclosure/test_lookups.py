"""Lookup tables in intervals: values, slopes and breakpoints against exact rationals, and what is refused."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise, product

import casadi as ca
import numpy as np
import pytest
from random_graphs import random_table

from verification.enclosure.bounds import bound, prove_bounds
from verification.enclosure.box import Box
from verification.enclosure.interval import enclose, evaluate
from verification.enclosure.lookups import breaks, enclosed, jumps, unreadable
from verification.enclosure.outward import Span
from verification.enclosure.rewriting import rewritten
from verification.enclosure.rounding import rounding
from verification.enclosure.slopes import gradient
from verification.enclosure.smoothness import breaks_somewhere, continuous_on, nonsmooth_operations, reaches, smooth_on
from workbench.graph import Lookup, Table, read
from workbench.graph.table import value

GRID, VALUES = [-2.0, -0.5, 0.25, 1.0, 3.0], [0.0, 1.0, 0.5, 2.0, 1.0]
BOXES = 16


def linear(grid=(tuple(GRID),), values=tuple(VALUES), search=0) -> Table:
    return Table(name="table", kind="linear", grid=grid, values=values, outputs=1, degrees=(1,) * len(grid),
                 search=(search,) * len(grid))  # fmt: skip


def spline(knots, values, degree) -> Table:
    return Table(name="table", kind="bspline", grid=(tuple(knots),), values=tuple(values), outputs=1, degrees=(degree,),
                 search=(0,))  # fmt: skip


def plain(order: int = 0) -> Lookup:
    return Lookup(0, 0, (order,))


def span(low: float, high: float) -> Span:
    return Span(np.array([low]), np.array([high]))


RANGES = [
    # table, order, box, the exact range
    ("within a piece", linear(), 0, (0.25, 1.0), 0.5, 2.0),
    ("over a breakpoint below", linear(), 0, (-0.5, 1.0), 0.5, 2.0),
    ("over a breakpoint above", linear(), 0, (0.625, 2.0), 1.25, 2.0),
    ("at a point", linear(), 0, (0.625, 0.625), 1.25, 1.25),
    ("at a breakpoint", linear(), 0, (0.25, 0.25), 0.5, 0.5),
    ("before the grid", linear(), 0, (-5.0, -3.5), -2.0, -1.0),
    ("beyond the grid", linear(), 0, (5.0, 7.0), -1.0, 0.0),
    ("across the grid", linear(), 0, (-5.0, 7.0), -2.0, 2.0),
    ("slope of a piece", linear(), 1, (0.25, 0.75), 2.0, 2.0),
    ("slope at the right end of a piece", linear(), 1, (0.5, 1.0), -0.5, 2.0),
    ("slope at a breakpoint is the right one", linear(), 1, (1.0, 1.0), -0.5, -0.5),
    ("slope before the grid", linear(), 1, (-9.0, -8.0), 2 / 3, 2 / 3),
    ("slope beyond the grid", linear(), 1, (8.0, 9.0), -0.5, -0.5),
    ("second derivative", linear(), 2, (-9.0, 9.0), 0.0, 0.0),
    ("searched by division", linear(((0.0, 1.0, 2.0),), (0.0, 2.0, 1.0), 1), 0, (0.5, 3.0), 0.0, 2.0),
    ("searched by halving", linear(search=2), 0, (-5.0, 7.0), -2.0, 2.0),
    ("degree zero", spline([0, 1, 2], [3, 5], 0), 0, (0.0, 0.5), 3.0, 3.0),
    ("degree zero, both", spline([0, 1, 2], [3, 5], 0), 0, (0.5, 1.5), 3.0, 5.0),
    ("beyond the knots", spline([0, 1, 2], [3, 5], 0), 0, (0.5, 2.5), 0.0, 5.0),
    ("far beyond the knots", spline([0, 1, 2], [3, 5], 0), 0, (2.5, 3.5), 0.0, 0.0),
    ("degree one", spline([0, 0, 1, 2, 2], [1, 4, 2], 1), 0, (0.5, 1.5), 2.5, 4.0),
    ("a parabola", spline([0, 0, 0, 1, 1, 1], [0, 0, 1], 2), 0, (0.0, 1.0), 0.0, 1.0),
    ("a part of a parabola", spline([0, 0, 0, 1, 1, 1], [0, 0, 1], 2), 0, (0.5, 0.75), 0.25, 0.5625),
    ("its slope", spline([0, 0, 0, 1, 1, 1], [0, 0, 1], 2), 1, (0.5, 0.75), 1.0, 1.5),
    ("a derivative too far", spline([0, 0, 1, 1], [0, 1], 1), 2, (-1.0, 1.5), 0.0, 0.0),
]


@pytest.mark.parametrize(("name", "table", "order", "box", "low", "high"), RANGES, ids=[row[0] for row in RANGES])
def test_ranges_of_tables(name, table, order, box, low, high):
    found = enclosed(table, plain(order), [span(*box)])
    assert low - 1e-15 <= float(found.lo.min()) <= low and high <= float(found.hi.max()) <= high + 1e-15
    if float(low).is_integer() and float(high).is_integer():
        assert (float(found.lo[0]), float(found.hi[0])) == (low, high)  # no rounding where none is needed


def _boxes(rng: np.random.Generator, table: Table) -> list[Span]:
    found = []
    for points in table.grid:
        ends = np.where(rng.random((2, BOXES)) < 0.5, rng.choice(points, (2, BOXES)), rng.uniform(-3, 3, (2, BOXES)))
        ends[1] = np.where(rng.random(BOXES) < 0.2, ends[0], ends[1])
        found.append(Span(*np.sort(ends, axis=0)))
    return found


def _points(rng: np.random.Generator, table: Table, boxes: list[Span], i: int) -> list[list[float]]:
    """Return points of a box: its ends, breakpoints and points beside them, and any others."""
    found = []
    for _ in range(8):
        at = []
        for points, box in zip(table.grid, boxes, strict=True):
            low, high = float(box.lo[i]), float(box.hi[i])
            near = float(np.clip(rng.choice(points), low, high))
            at.append([low, high, near, float(np.clip(np.nextafter(near, rng.choice([-9, 9])), low, high)),
                       float(rng.uniform(low, high))][rng.integers(5)])  # fmt: skip
        found.append(at)
    return found


@pytest.mark.parametrize("axes", [1, 2, 3])
def test_random_tables_hold_their_exact_values_and_difference_quotients(axes):
    rng = np.random.default_rng(axes)
    quotients = 0
    for _ in range(60 // axes):
        table = random_table(rng, axes)
        assert unreadable(table) == ""
        lookup = Lookup(0, 0, tuple(rng.choice([0, 0, 1, 2], axes).tolist()))
        boxes = _boxes(rng, table)
        low, high = (np.broadcast_to(end, BOXES) for end in enclosed(table, lookup, boxes))
        broken = np.broadcast_to(jumps(table, lookup, boxes), BOXES)
        slopes = [enclosed(table, lookup._replace(orders=tuple(order + (a == axis) for a, order in
                  enumerate(lookup.orders))), boxes) for axis in range(axes)]  # fmt: skip
        for i in range(BOXES):
            points = _points(rng, table, boxes, i)
            values = [value(table, lookup, [Fraction(x) for x in at], Fraction) for at in points]
            assert all(Fraction(low[i]) <= one <= Fraction(high[i]) for one in values), (table, lookup, points)
            if broken[i]:
                continue
            for (p, one), (q, other) in pairwise(zip(points, values, strict=True)):
                reach = [
                    [Fraction(float(np.broadcast_to(end, BOXES)[i])) * (Fraction(a) - Fraction(b)) for end in slope]
                    for slope, a, b in zip(slopes, p, q, strict=True)
                ]
                assert sum(map(min, reach)) <= one - other <= sum(map(max, reach)), (table, lookup, p, q)
                quotients += 1
    assert quotients > 500


@pytest.mark.parametrize("kind", ["linear", "bspline"])
def test_values_of_casadis_own_tables_lie_within(kind):
    """CasADi's doubles, at thousands of points of boxes that cross the grid; a linear table goes on beyond it."""
    rng = np.random.default_rng(7)
    surface = rng.uniform(-1, 1, 25)
    tables = [ca.interpolant("one", kind, [GRID], VALUES), ca.interpolant("two", kind, [GRID, GRID], surface)]
    for table in tables:
        axes = table.size1_in(0)
        x = ca.MX.sym("x", axes)
        f = ca.Function("f", [x], [table(x)], ["x"], ["f"])
        for _ in range(12):
            ends = np.sort(rng.uniform(-3.5, 4.5, (2, axes)), axis=0)
            found = enclose(f, Box({"x": (ends[0], ends[1])}))
            low, high = float(found.lower["f"][0, 0]), float(found.upper["f"][0, 0])
            values = np.array([float(f(at)) for at in rng.uniform(*ends, (100, axes))])
            assert found.undecided is None and np.all(low - 1e-12 <= values) and np.all(values <= high + 1e-12)


def test_a_spline_is_bounded_by_its_coefficients_and_closer_on_small_boxes():
    f = ca.Function("f", [x := ca.MX.sym("x")], [ca.interpolant("s", "bspline", [GRID], VALUES)(x)], ["x"], ["f"])
    at = np.linspace(-2, 3, 5001)
    values = np.array([float(f(one)) for one in at])
    found = bound(f, Box({"x": (-2, 3)}))
    assert found.reason is None
    assert (
        found.lower <= values.min() <= found.lower + 1e-5 and found.upper - 1e-5 <= values.max() <= found.upper + 1e-9
    )
    assert prove_bounds(f, Box({"x": (-2, 3)}), upper=float(values.max()) - 0.01).standing == "refuted"


def test_a_surface_is_bounded_to_the_tolerance():
    rng = np.random.default_rng(1)
    numbers = rng.integers(-8, 9, 12) / 4
    table = ca.interpolant("t", "linear", [[0.0, 1.0, 2.0, 4.0], [0.0, 1.0, 2.0]], numbers)
    f = ca.Function("f", [x := ca.MX.sym("x", 2)], [table(x)], ["x"], ["f"])
    found = bound(f, Box({"x": ([0, 0], [4, 2])}))
    assert found.reason is None
    assert found.lower == pytest.approx(numbers.min(), abs=1e-6) and found.upper == pytest.approx(
        numbers.max(), abs=1e-6
    )


# ------------------------------------------------------------------ where tables are not smooth

MX = ca.MX.sym("x")


def of(table: ca.Function, inner=MX) -> ca.Function:
    return ca.Function("f", [MX], [table(inner)], ["x"], ["f"])


LINEAR = ca.interpolant("lin", "linear", [GRID], VALUES)
CUBIC = ca.interpolant("cubic", "bspline", [GRID], VALUES)
BROKEN = ca.interpolant("broken", "bspline", [GRID], VALUES, {"degree": [1]})
STRAIGHT = ca.interpolant("straight", "linear", [[-1.0, 0.5, 4.0]], [-2.0, 1.0, 8.0])
SMOOTHNESS = [
    # function, box, continuous, smooth
    ("within a piece", of(LINEAR), (0.3, 0.9), True, True),
    ("over a breakpoint", of(LINEAR), (0.3, 1.5), True, False),
    ("beyond the grid", of(LINEAR), (3.5, 9.0), True, True),
    ("over the grid's end", of(LINEAR), (2.0, 9.0), True, True),
    ("up to a breakpoint", of(LINEAR), (0.3, 1.0), True, False),
    ("an argument that keeps away", of(LINEAR, MX**2 + 1.5), (-9.0, 9.0), True, True),
    ("points on one line", of(STRAIGHT), (-9.0, 9.0), True, True),
    ("a cubic spline within its knots", of(CUBIC), (-2.0, 3.0), True, False),
    ("between two knots", of(CUBIC), (1.25, 2.5), True, True),
    ("a spline's end", of(CUBIC), (-2.0, 3.5), False, False),
    ("a spline's start", of(CUBIC), (-2.5, 3.0), False, False),
    ("outside of a spline", of(CUBIC), (3.5, 9.0), True, True),
    ("a spline of degree one", of(BROKEN), (-2.0, 3.0), True, False),
]


@pytest.mark.parametrize(("name", "f", "box", "continuous", "smooth"), SMOOTHNESS, ids=[row[0] for row in SMOOTHNESS])
def test_smoothness_of_tables(name, f, box, continuous, smooth):
    assert continuous_on(f, Box({"x": box})).proved == continuous
    assert smooth_on(f, Box({"x": box})).proved == smooth


def test_breakpoints_are_listed_and_reached_where_they_lie():
    f = of(LINEAR)
    listed = nonsmooth_operations(f)
    assert [one.kind for one in listed] == ["kink"] * 3 and all("lookup" == one.name for one in listed)
    for point, one in zip(GRID[1:-1], reaches(f, Box({"x": (-9, 9)})), strict=True):
        assert one.reachable == "yes" and repr(point) in one.operation.expression
        assert float(one.point["x"][0][0, 0]) == pytest.approx(point, abs=1e-12)
    assert breaks_somewhere(f) == "" and "a jump of lookup" in breaks_somewhere(of(CUBIC))


def test_slopes_hold_both_sides_of_a_kink_and_say_nothing_across_a_jump():
    for f, low, high, usable in (
        (of(LINEAR), 0.5, 1.5, True),
        (of(CUBIC), 2.0, 3.0, True),
        (of(CUBIC), 2.0, 3.5, False),
    ):
        found = rewritten(f)
        (node,) = found.targets()
        ends = np.array([[low]]), np.array([[high]])
        slopes = gradient(found, node, evaluate(found, *ends, [node]), (1, 1))
        assert np.isfinite([slopes.lo, slopes.hi]).all() == usable
        if usable:
            at = np.linspace(low, high, 200)
            quotients = np.diff([float(f(one)) for one in at]) / np.diff(at)
            assert float(slopes.lo[0, 0]) - 1e-9 <= quotients.min() and quotients.max() <= float(slopes.hi[0, 0]) + 1e-9


def test_breaks_of_derivatives():
    table, cubic = linear(), spline([0, 0, 0, 0, 1, 2, 2, 2, 2], [0, 1, 0, 2, 1], 3)
    assert {one.kind for one in breaks(table, plain())} == {"kink"}
    assert {one.kind for one in breaks(table, plain(1))} == {"jump"} and breaks(table, plain(2)) == ()
    kinds = {order: {one.kind for one in breaks(cubic, plain(order)) if one.point == 1} for order in range(5)}
    assert kinds == {0: {"kink"}, 1: {"kink"}, 2: {"kink"}, 3: {"jump"}, 4: set()}
    surface = linear(((0.0, 1.0, 2.0), (0.0, 1.0)), (0.0, 1.0, 2.0, 0.0, 1.0, 3.0))
    assert [(one.axis, one.point) for one in breaks(surface, Lookup(0, 0, (0, 0)))] == [(0, 1.0)]
    level = linear(((0.0, 1.0, 2.0), (0.0, 1.0)), (0.0, 1.0, 2.0, 0.0, 1.0, 2.0))
    assert breaks(level, Lookup(0, 0, (0, 0))) == ()


REFUSED = [
    ("a point twice", linear(((0.0, 1.0, 1.0, 2.0),), (0.0, 1.0, 2.0, 3.0)), "has a point twice"),
    ("loose knots", spline([0, 1, 2, 3, 4, 5], [1, 2, 3, 4], 1), "first and its last knot degree + 1 times"),
    ("uneven division", linear(((0.0, 0.1, 0.3),), (0.0, 1.0, 2.0), 1), "not evenly spaced as doubles"),
    ("no number", linear(((0.0, 1.0),), (0.0, float("nan"))), "values that are not finite"),
    ("an endless grid", linear(((0.0, float("inf")),), (0.0, 1.0)), "points that are not finite"),
]


@pytest.mark.parametrize(("name", "table", "why"), REFUSED, ids=[row[0] for row in REFUSED])
def test_tables_without_a_meaning_are_refused(name, table, why):
    assert why in unreadable(table)


def test_a_refused_table_is_a_sentence():
    loose = ca.Function.bspline("loose", [[0.0, 1.0, 2.0, 3.0, 4.0, 5.0]], [1.0, 2.0, 3.0, 4.0], [1], 1)
    f = of(loose)
    assert "first and its last knot" in enclose(f, Box({"x": (1, 2)})).undecided
    assert "first and its last knot" in bound(f, Box({"x": (1, 2)})).reason
    assert "first and its last knot" in continuous_on(f, Box({"x": (1, 2)})).reason


def test_rounding_of_a_table_is_not_claimed():
    assert np.isinf(rounding(of(LINEAR), Box({"x": (0.3, 0.9)}))["f"]).all()
    assert read(of(LINEAR)).lookups


def test_rounding_at_a_step_is_not_claimed_where_its_argument_is_off():
    """0.1 + 0.2 is off by some rounding: beside a whole number its floor may be another one."""
    x = ca.SX.sym("x")
    for jumping in (ca.floor(x * 3), ca.sign(x * 3 - 3), ca.fmod(x * 3, 1), ca.remainder(x * 3, 2), x * 3 < 3):
        f = ca.Function("f", [x], [jumping], ["x"], ["f"])
        assert np.isinf(rounding(f, Box({"x": (1.0, 1.1)}))["f"]).all()
    steady = ca.Function("f", [x], [ca.floor(x * 3)], ["x"], ["f"])
    assert rounding(steady, Box({"x": (1.1, 1.2)}))["f"].max() == 0


def test_every_corner_of_a_box_lies_within_on_all_searches():
    for search, (low, high) in product((0, 1, 2), ((-1.0, 0.5), (0.5, 4.5), (2.0, 2.0))):
        table = linear(((0.0, 1.0, 2.0, 3.0),), (1.0, -1.0, 2.0, 0.0), search)
        found = enclosed(table, plain(), [span(low, high)])
        for at in np.linspace(low, high, 31):
            exact = value(table, plain(), [Fraction(float(at))], Fraction)
            assert Fraction(float(found.lo[0])) <= exact <= Fraction(float(found.hi[0]))
