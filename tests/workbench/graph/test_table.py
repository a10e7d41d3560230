"""Lookup tables, against CasADi's virtual machine bit for bit, straight lines, and finite differences."""

from __future__ import annotations

import math
import struct
from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

from workbench.graph import (
    RATIONALS,
    Graph,
    Lookup,
    Table,
    Unreadable,
    call,
    evaluate,
    from_json,
    jacobian,
    read,
    to_json,
)
from workbench.graph.smooth import breakpoints
from workbench.graph.symbolic import function
from workbench.graph.table import value


def bits(value: float) -> bytes:
    """The bits of a double; every NaN is one."""
    return b"nan" if math.isnan(value) else struct.pack("<d", value)


RNG = np.random.default_rng(1)
ONE, TWO = np.sort(RNG.normal(size=6)), np.sort(RNG.normal(size=5))
EVEN = np.linspace(-1, 2, 6)


def interpolant(kind, axes, outputs=1, **options):
    count = outputs * math.prod(map(len, axes))
    return ca.interpolant("table", kind, [list(axis) for axis in axes], RNG.normal(size=count).tolist(), options)


TABLES = {
    "linear": interpolant("linear", [ONE]),
    "linear, by division": interpolant("linear", [EVEN], lookup_mode=["exact"]),
    "linear, by halving": interpolant("linear", [ONE], lookup_mode=["binary"]),
    "linear, two axes": interpolant("linear", [ONE, TWO], outputs=2),
    "linear, two axes, mixed": interpolant("linear", [EVEN, TWO], lookup_mode=["exact", "binary"]),
    "linear, three axes": interpolant("linear", [ONE, TWO, EVEN]),
    "cubic": interpolant("bspline", [ONE]),
    "cubic, by halving": interpolant("bspline", [ONE], lookup_mode=["binary"]),
    "cubic, two axes": interpolant("bspline", [ONE, TWO], outputs=2),
    "quadratic": interpolant("bspline", [ONE], degree=[2]),
    "quadratic and cubic": interpolant("bspline", [ONE, TWO], degree=[2, 3]),
}


def points(axes: int) -> list[list[float]]:
    rng = np.random.default_rng(2)
    grids = [ONE, TWO, EVEN][:axes]
    drawn = [rng.normal(0, 1.5, axes).tolist() for _ in range(200)]
    drawn += [[float(rng.choice(grid)) for grid in grids] for _ in range(60)]
    return drawn + [[special] * axes for special in (math.nan, math.inf, -math.inf, 1e300, -0.0)]


@pytest.mark.parametrize("name", TABLES)
def test_the_doubles_are_those_of_the_virtual_machine(name):
    table = TABLES[name]
    graph = read(table)
    assert from_json(to_json(graph)) == graph
    symbols = function(graph)
    for at in points(table.numel_in(0)):
        expected = [bits(entry) for entry in table(at).full().ravel().tolist()]
        assert [bits(entry) for entry in call(graph, {"x": at})["f"].ravel().tolist()] == expected, at
        assert [bits(entry) for entry in symbols(at).full().ravel().tolist()] == expected, at


@pytest.mark.parametrize("name", TABLES)
def test_slopes_agree_with_casadi_and_with_differences(name):
    table = TABLES[name]
    axes = table.numel_in(0)
    slope, theirs = jacobian(read(table), "f", "x"), table.jacobian()
    for at in points(axes):
        if max(map(abs, at)) < 1e3:  # false of NaN
            found = call(slope, {"x": at})["df_dx"]
            assert found == pytest.approx(theirs(at, 0).full(), rel=1e-10, abs=1e-12)
    inside = np.random.default_rng(3).uniform(-0.4, 0.4, (40, axes))
    compared = 0
    for at in inside:
        if any(np.min(np.abs(grid - entry)) < 1e-4 for grid, entry in zip([ONE, TWO, EVEN], at, strict=False)):
            continue
        found = call(slope, {"x": at})["df_dx"]
        for axis in range(axes):
            step = 1e-6 * np.eye(axes)[axis]
            difference = (table(at + step).full() - table(at - step).full()).ravel() / 2e-6
            assert found[:, axis] == pytest.approx(difference, rel=1e-5, abs=1e-5)
            compared += 1
    assert compared > 20


def test_a_linear_table_is_straight_in_rationals():
    table = read(ca.interpolant("t", "linear", [[0.0, 1.0, 3.0]], [0.0, 2.0, 3.0], {}))
    node = table.output("f").entries[0].node
    for at, expected in ((Fraction(1, 3), Fraction(2, 3)), (Fraction(2), Fraction(5, 2)), (Fraction(-1), Fraction(-2))):
        assert evaluate(table, [at], RATIONALS)[node] == expected
    slope = jacobian(table, "f", "x")
    assert evaluate(slope, [Fraction(2)], RATIONALS)[slope.output("df_dx").entries[0].node] == Fraction(1, 2)


def test_a_cubic_spline_reproduces_a_cubic_in_rationals():
    knots = tuple(map(float, (0, 0, 0, 0, 1, 2, 3, 3, 3, 3)))
    greville = [sum(map(Fraction, knots[i + 1 : i + 4])) / 3 for i in range(6)]
    line = Table(name="t", kind="bspline", grid=(knots,), values=tuple(map(float, greville)), outputs=1, degrees=(3,),
                 search=(0,))  # fmt: skip
    for at in (Fraction(1, 3), Fraction(5, 7), Fraction(2), Fraction(29, 10)):
        assert abs(value(line, Lookup(0, 0, (0,)), [at], Fraction) - at) < Fraction(1, 10**15)
        assert abs(value(line, Lookup(0, 0, (1,)), [at], Fraction) - 1) < Fraction(1, 10**14)
        assert abs(value(line, Lookup(0, 0, (2,)), [at], Fraction)) < Fraction(1, 10**13)
    assert value(line, Lookup(0, 0, (4,)), [Fraction(1)], Fraction) == 0


def test_splines_inside_other_functions_are_lookups():
    m = ca.MX.sym("m")
    knots, coefficients = [[0.0, 0, 0, 0, 2, 3, 3, 3, 3]], ca.DM([0.0, 1, 4, 9, 3])

    def spline(at: ca.MX) -> ca.MX:
        return ca.bspline(at, coefficients, knots, [3], 1)

    inner = ca.Function("inner", [m], [spline(m) + TABLES["linear"](m)])
    outer = ca.Function("outer", [m], [inner(ca.sin(m)) * spline(2 * m) + inner(m)], ["m"], ["f"])
    graph = read(outer)
    assert sum(node.op == "lookup" for node in graph.nodes) == 5 and len(graph.tables) <= 5
    for at in np.random.default_rng(0).normal(1, 1, 100).tolist():
        assert bits(call(graph, {"m": at})["f"][0, 0]) == bits(float(outer(at)))


def test_a_piecewise_linear_function_is_read_as_its_comparisons():
    x = ca.SX.sym("x")
    f = ca.Function("f", [x], [ca.pw_lin(x, ca.DM([0, 1, 2, 3]), ca.DM([0, 1, 4, 9]))], ["x"], ["f"])
    graph = read(f)
    slope = jacobian(graph, "f", "x")
    for at, expected in ((0.5, 1.0), (1.5, 3.0), (2.5, 5.0), (7.0, 5.0)):
        assert call(graph, {"x": at})["f"][0, 0] == float(f(at))
        assert call(slope, {"x": at})["df_dx"][0, 0] == expected


@pytest.mark.parametrize(
    ("name", "orders", "where", "kind"),
    [
        ("linear", 0, ONE[1:-1], "kink"),
        ("linear", 1, ONE[1:-1], "jump"),
        ("linear", 2, [], ""),
        ("cubic", 0, [ONE[0], ONE[-1]], "jump"),
    ],
)
def test_breakpoints(name, orders, where, kind):
    graph = read(TABLES[name])
    for done in range(orders):
        graph = jacobian(graph, "d" * done + "f" + "_dx" * done, "x")
    found = [
        (at, what)
        for place, node in enumerate(graph.nodes)
        if node.op == "lookup"
        for _, at, what in breakpoints(graph, place)
    ]
    jumps = [at for at, what in found if what == kind]
    assert jumps == pytest.approx(list(where))


def test_breakpoints_are_where_the_table_breaks():
    """A spline jumps to zero beyond its knots, and nowhere else; its third derivative jumps at every knot."""
    table = TABLES["cubic"]
    graph = read(table)
    (place,) = [place for place, node in enumerate(graph.nodes) if node.op == "lookup"]
    for _, at, kind in breakpoints(graph, place):
        size = abs(float(table(at + 1e-9)) - float(table(at - 1e-9)))
        assert (size > 1e-3) == (kind == "jump"), at


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"kind": "cubic"}, "must be linear or a bspline"),
        ({"grid": ((0.0, 2.0, 1.0),)}, "ascending points"),
        ({"grid": ((0.0, math.nan, 1.0),)}, "ascending points"),
        ({"grid": ((0.0,),), "values": (1.0,)}, "at least"),
        ({"values": (1.0, 2.0)}, r"must have 1 x \[3\] values, got 2"),
        ({"degrees": (1, 1)}, "for every axis"),
    ],
)
def test_numbers_that_are_no_table(changes, said):
    fields = {"name": "t", "kind": "linear", "grid": ((0.0, 1.0, 2.0),), "values": (0.0, 1.0, 4.0), "outputs": 1,
              "degrees": (1,), "search": (0,)}  # fmt: skip
    Table(**fields)
    with pytest.raises(ValueError, match=said):
        Table(**{**fields, **changes})


@pytest.mark.parametrize(
    "lookup", [Lookup(1, 0, (0,)), Lookup(-1, 0, (0,)), Lookup(0, 1, (0,)), Lookup(0, 0, (0, 0)), Lookup(0, 0, (-1,))]
)
def test_lookups_of_nothing(lookup):
    table = read(TABLES["linear"]).tables
    Graph(name="g", inputs=(), outputs=(), nodes=(), tables=table, lookups=(Lookup(0, 0, (2,)),))
    with pytest.raises(ValueError, match="a lookup of g must"):
        Graph(name="g", inputs=(), outputs=(), nodes=(), tables=table, lookups=(lookup,))


def test_numbers_that_are_read_wrongly_are_refused(monkeypatch):
    import workbench.graph.reading as module

    right = module._Stored.rows

    def rows(self, field):
        scale = 1.5 if field == "Interpolant::values" else 1.0
        return [[scale * number for number in row] for row in right(self, field)]

    monkeypatch.setattr(module._Stored, "rows", rows)
    with pytest.raises(Unreadable, match=r"cannot be read with CasADi .* they give .* where CasADi gives"):
        read(TABLES["linear"])


def test_a_spline_whose_derivatives_casadi_keeps_is_read_all_the_same():
    table = interpolant("bspline", [ONE])
    before = read(table)
    table.jacobian().jacobian()
    assert read(table) == before
