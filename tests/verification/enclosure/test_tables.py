"""Tables that a graph spells out: what is read as one, what stays a jump, and that the ends hold what is written."""

from __future__ import annotations

from fractions import Fraction

import casadi as ca
import numpy as np
import pytest

from verification.checks.slope import slope
from verification.enclosure.bounds import bound
from verification.enclosure.box import Box
from verification.enclosure.interval import enclose
from verification.enclosure.pieces import along, quantities
from verification.enclosure.smoothness import breaks_somewhere, continuous_on
from verification.enclosure.tables import misses, told, with_tables
from workbench.graph import Graph, evaluate, from_json, read, to_json
from workbench.graph.arithmetic import RATIONALS

x, u = ca.SX.sym("x"), ca.SX.sym("u")
IF = ca.if_else
BOX = Box({"x": (-3.0, 3.0), "u": (-2.0, 2.0)})
GRID, VALUES = [-8.0, -0.3, 0.1, 0.45, 9.0], [0.0, 0.2, 0.1, 0.4, -0.3]


def graph(expression) -> Graph:
    return read(ca.Function("f", [x, u], [expression], ["x", "u"], ["y"]))


def table(at, grid=GRID, values=VALUES):
    return ca.pw_lin(at, ca.DM(grid), ca.DM(values))


SPELT = [
    # name, expression, tables that are read, whether the function is continuous in x and u
    ("a table of x", table(x) + u, 1, True),
    ("a table under a line", 0.7 * x + table(x) + u, 1, True),
    ("a table as a gain", u * (1 + table(x)), 1, True),
    ("a table of a sum", table(x + u), 1, True),
    ("a table of a curve", table(ca.sin(x) + u), 1, True),
    ("two tables", table(x) + table(u), 2, True),
    ("a table of a table", table(table(x) + u), 2, True),
    ("one table, twice", table(x) * u + table(x), 2, True),
    ("choices that miss by rounding", IF(x > 0.3, 0.7 * (x - 0.3) + 0.3 * 0.1, 0.1 * x), 1, True),
    ("choices that meet", IF(x > 0.3, 3 * x, x + 0.6), 0, True),  # in rationals too: nothing is to be read
    ("tables that meet", table(x, [-1, 0, 1, 2], [0, 1, 3, 0]), 0, True),
    ("one piece", table(x, [-1, 0.3], [0, 0.7]), 0, True),
    ("a table and a jump", table(x) + IF(x > 0.2, 1e-12, 0), 0, False),
    ("a table and a jump at its point", table(x) + IF(x >= 0.1, 1e-12, 0), 0, False),
    ("a table that jumps", IF(x > 0.1, table(x) + 1e-9, table(x)), 0, False),
    ("steps", ca.pw_const(x, ca.DM([0.1, 0.3]), ca.DM([1, 2, 3])), 0, False),
    ("a tiny step", IF(x > 0.3, 1e-30, 0), 0, False),
    ("a tiny step on a large number", 1e9 + IF(x > 0.3, 1e-7, 0), 0, False),
    ("a step on another's slope", 1e9 * u + IF(x > 0.3, 1e-12, 0), 0, False),
    ("a step under slopes that cancel", (1e9 * x + IF(x > 0.3, 1e-7, 0)) - 999999999 * x, 0, False),
    ("a table with flat pieces", table(x, [-1.0, 0.3, 0.7, 1.1], [0.1, 0.1, 0.8, 0.8]) + u, 1, True),
    ("a table and another's jump", table(x) + IF(u > 0.2, 1e-12, 0), 1, False),
    ("a table as a choice", IF(table(x) > 0.15, u * (table(x) - 0.15), 0), 2, False),  # not shown
    ("a table about zero", table(x, [-0.7, 0.0, 0.9], [0.3, 0.1, 0.8]) + u, 1, True),
    ("curves that miss by rounding", IF(x > 0.1, x**2, 0.2 * x - 0.01), 0, False),
    ("a point by itself", IF(x == 0.3, 1, 0.1 * x), 0, False),
    ("a table behind a jump", table(ca.sign(x)), 1, False),
    ("a table of what ends", table(ca.sqrt(x)), 1, False),
    ("a guard that jumps by a table", IF(table(x) > 0.15, u, -u), 1, False),
]  # fmt: skip


@pytest.mark.parametrize(("name", "expression", "tables", "continuous"), SPELT, ids=[row[0] for row in SPELT])
def test_what_is_read_as_a_table(name, expression, tables, continuous):
    found = with_tables(graph(expression))
    assert len(found.lookups) == tables and len(found.tables) == tables
    assert continuous_on(found, BOX).proved == continuous
    if tables:
        assert not continuous_on(graph(expression), BOX).proved, "or there was nothing to read"
        assert 0 < misses(found) < 1e-14 and "by rounding" in told(found)
    else:
        assert found == graph(expression) and misses(found) == 0 and told(found) == ""
    if continuous and tables:
        assert breaks_somewhere(found) == ""


def _near(expression) -> list[Fraction]:
    """Return points: every number of a graph, points close to it, and any others."""
    numbers = [Fraction(node.value) for node in graph(expression).nodes if node.op == "const" and abs(node.value) < 9]
    close = Fraction(1, 10**9)
    return [one + side * close for one in numbers for side in (-1, 0, 1)] + [Fraction(k, 7) for k in range(-30, 30, 4)]


def _value(of: Graph, at: Fraction, given: Fraction) -> Fraction:
    return evaluate(of, [at, given], RATIONALS)[of.outputs[0].entries[0].node]


STRAIGHT = [row for row in SPELT if not any(word in row[0] for word in ("curve", "ends"))]


@pytest.mark.parametrize(("name", "expression"), [row[:2] for row in STRAIGHT], ids=[row[0] for row in STRAIGHT])
def test_pieces_are_what_the_graph_comes_to(name, expression):
    """An oracle: the graph itself, evaluated in rationals."""
    whole = graph(expression)
    for quantity in quantities(whole):
        for place, pieces in along(whole, quantity).items():
            for at in _near(expression):
                values = evaluate(whole, [at, Fraction(1, 3)], RATIONALS)
                lines, there = pieces.parts(sorted({*pieces.points, values[quantity]}))
                where = sorted({*pieces.points, values[quantity]}).index(values[quantity])
                assert there[where] == values[place], (place, at)
                assert len(lines) == len(there) + 1


ONE = [row for row in SPELT if row[2] and "curve" not in row[0] and "ends" not in row[0]]


@pytest.mark.parametrize(("name", "expression"), [row[:2] for row in ONE], ids=[row[0] for row in ONE])
@pytest.mark.parametrize("by", ["x", "u"])
def test_enclosures_hold_what_is_written(name, expression, by):
    """What the pieces themselves come to lies in the enclosure of the table, and so do their slopes."""
    whole = graph(expression)
    read_, step = with_tables(whole), Fraction(1, 2**20)
    slopes = slope(read_, "y", by)
    for at in (-2.5, -0.25, 0.0625, 0.125, 0.375, 0.5, 2.75):
        here, given = Fraction(at), Fraction(3, 8)
        moved = (here + step, given) if by == "x" else (here, given + step)
        ends = [Box({"x": (at, float(far[0])), "u": (0.375, float(far[1]))}) for far in ((here, given), moved)]
        value = _value(whole, here, given)
        held = enclose(read_, ends[0])
        assert Fraction(float(held.lower["y"][0, 0])) <= value <= Fraction(float(held.upper["y"][0, 0]))
        over, rise = enclose(slopes, ends[1]), (_value(whole, *moved) - value) / step
        if "jump" not in name and "gain" not in name:
            assert Fraction(float(over.lower["slope"][0, 0])) <= rise <= Fraction(float(over.upper["slope"][0, 0]))


def test_slopes_of_a_table_are_those_between_its_points():
    f = with_tables(graph(0.7 * x + table(x) + u))
    rises = 0.7 + np.diff(VALUES) / np.diff(GRID)
    found = bound(slope(f, "y", "x"), BOX)
    assert found.lower == pytest.approx(rises.min(), abs=1e-15) and found.lower <= rises.min()
    assert found.upper == pytest.approx(rises.max(), abs=1e-15) and found.upper >= rises.max()


def test_what_tables_are_spread_by_is_kept():
    f = with_tables(graph(u * table(x)))
    assert from_json(to_json(f)) == f and f.tables[0].spread
    with pytest.raises(ValueError, match="must be linear to have a spread"):
        type(f.tables[0])(name="t", kind="linear", grid=((0.0, 1.0),), values=(0.0, 1.0), outputs=1, degrees=(1,),
                          search=(0,), spread=(-1.0, 0.0))  # fmt: skip


def test_a_table_of_many_points_is_read():
    grid = np.linspace(-3.1, 3.3, 60)
    f = with_tables(graph(table(x, grid.tolist(), np.sin(grid).tolist()) + u))
    assert len(f.tables) == 1 and len(f.tables[0].values) == 60 and continuous_on(f, BOX).proved


def _drawn(rng: np.random.Generator, depth: int) -> ca.SX:
    """Return pieces under comparisons, at random: tables, choices, sizes, sums and multiples of one another."""
    number = float(rng.choice([0.1, 0.3, -0.7, 0.25, 1.0, -0.5, 0.45, 1e-3]))
    if not depth:
        return [x, x, u, ca.SX(number)][int(rng.integers(4))]
    inner = _drawn(rng, depth - 1)
    kind = int(rng.integers(8))
    if kind == 0:
        grid = np.unique(rng.choice([-1.1, -0.7, -0.3, 0.1, 0.3, 0.45, 0.9], 6))
        return table(inner, grid.tolist(), rng.choice([0.1, 0.3, -0.7, 0.25], grid.size).tolist())
    if kind == 1:
        return IF(inner > number, 0.7 * (inner - number) + number * 0.3, 0.3 * inner)
    if kind == 2:
        return IF(inner > number, _drawn(rng, depth - 1), _drawn(rng, depth - 1))
    others = (inner + _drawn(rng, depth - 1), number * inner, ca.fabs(inner), ca.fmax(inner, number), inner - 0.1 * x)
    return others[kind - 3]


def test_random_pieces_are_held_and_do_not_jump_where_that_is_proved():
    """An oracle: the graph as it is written, in rationals, at breakpoints and beside them."""
    rng, read_as_tables = np.random.default_rng(3), 0
    for _ in range(150):
        whole = graph(_drawn(rng, int(rng.integers(1, 4))))
        found = with_tables(whole)
        if not found.tables:
            continue
        read_as_tables += 1
        numbers = [node.value for node in whole.nodes if node.op == "const" and abs(node.value) < 2]
        continuous = continuous_on(found, BOX).proved
        for at, given in rng.choice([*numbers, 0.123, -0.777], (6, 2)).tolist():
            value = _value(whole, Fraction(at), Fraction(given))
            held = enclose(found, Box({"x": (at, at), "u": (given, given)}))
            assert Fraction(held.lower["y"][0, 0]) <= value <= Fraction(held.upper["y"][0, 0])
            for side in (Fraction(-1, 10**30), Fraction(1, 10**30)):
                for moved in ((Fraction(at) + side, Fraction(given)), (Fraction(at), Fraction(given) + side)):
                    assert not continuous or abs(_value(whole, *moved) - value) < 1e-14
    assert read_as_tables > 30
