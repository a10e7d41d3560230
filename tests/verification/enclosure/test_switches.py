"""Functions that are continuous, or have a continuous slope, though operations in them jump; and those just beyond."""

from __future__ import annotations

from fractions import Fraction

import casadi as ca
import pytest

from verification.checks.slope import slope
from verification.enclosure.box import Box
from verification.enclosure.breaks import break_at
from verification.enclosure.ring import Atoms, NoForm, Ring, number
from verification.enclosure.smoothness import continuous_on, reaches, smooth_on
from verification.enclosure.switches import Switches
from workbench.graph import Graph, evaluate, read
from workbench.graph.arithmetic import RATIONALS

x, u, k = (ca.SX.sym(name) for name in "xuk")
BOX = Box({"x": (-1, 1), "u": (-1, 2), "k": (0, 9)}, whole=("k",))


def graph(expression) -> Graph:
    return read(ca.Function("f", [x, u, k], [expression], ["x", "u", "k"], ["y"]))


CONTINUOUS = [
    # expression, whether it is continuous, whether its slope in u is
    ("square of the positive part", ca.fmax(u, 0) ** 2, True, True),
    ("square of the negative part", ca.fmin(u, 0) ** 2, True, True),
    ("positive part times u", ca.fmax(u, 0) * u, True, True),
    ("u times its size", u * ca.fabs(u), True, True),
    ("cube of the size", ca.fabs(u) ** 3, True, True),
    ("size to 3/2", ca.fabs(u) ** 1.5, True, True),
    ("positive part to 3/2", ca.fmax(u, 0) ** 1.5, True, True),
    ("choice of a square", ca.if_else(u > 0, u**2, 0), True, True),
    ("choice, closed", ca.if_else(u >= 0, u**2, 0), True, True),
    ("sign and square", ca.sign(u) * u**2, True, True),
    ("truth of a number", ca.if_else(u, u**2, 0), True, True),
    ("pieces of equal slope", ca.if_else(u > 1, u**2, 2 * u - 1), True, True),
    ("pieces through a function", ca.if_else(u > 0, ca.exp(u) - 1 - u, 0), True, True),
    ("sine and its tangent", ca.if_else(u > 0, ca.sin(u), u), True, True),
    ("a level of several inputs", ca.if_else(2 * u > x + k, (2 * u - x - k) ** 2 * x, 0), True, True),
    ("a product as level", ca.fmax(x * u, 0) ** 2, True, True),
    ("two switches", u * ca.fabs(u) + ca.fmax(u - 1, 0) ** 2, True, True),
    ("a switch in a switch", ca.if_else(u > 0, ca.if_else(u > 1, u**2 + (u - 1) ** 2, u**2), 0), True, True),
    ("both conditions", ca.if_else(ca.logic_and(u > 0, x > 0), (u * x) ** 2, 0), True, True),
    ("Huber's loss", ca.if_else(ca.fabs(u) < 1, u**2 / 2, ca.fabs(u) - 0.5), True, True),
    ("a tiny kink", ca.if_else(u > 0, u**2 + 1e-9 * u, 0), True, False),
    ("a tiny jump", ca.if_else(u > 0, u**2 + 1e-12, 0), False, True),
    ("an ulp of a jump", ca.if_else(u > 0.1, (u - 0.1) ** 2 + 2.0**-1000, 0), False, True),
    ("a kink elsewhere", u * ca.fabs(u - 0.1), True, False),
    ("the size", ca.fabs(u), True, False),
    ("the size to the first", ca.fabs(u) ** 1.0, True, False),
    ("the root of the size", ca.fabs(u) ** 0.5, True, False),
    ("size to 0.9", ca.fabs(u) ** 0.9, True, False),
    ("pieces of other slope", ca.if_else(u > 1, u**2, u), True, False),
    ("pieces that miss by rounding", ca.if_else(u > 0.1, u**2, 0.2 * u - 0.01), False, True),
    ("a point by itself", ca.if_else(u == 0, 1, u), False, False),
    ("a level that jumps", ca.if_else(u * ca.sign(x) > 0, (u * ca.sign(x)) ** 2, 0), False, False),
    ("a level that jumps, under a factor", x * ca.if_else(u + ca.sign(x) > 0, (u + ca.sign(x)) ** 2, 0), False, False),
    ("vanishes on another line", ca.if_else(u > x, u**2, 0), False, False),
    ("vanishes on a line of two", ca.if_else(x * u > 0, u, 0), False, False),
    ("other factor has a pole", ca.if_else(u > 0, u**2 / (u - 0.5), 0), False, False),
    ("signed zero", ca.copysign(u**2, u), False, False),  # not shown: the sign of -0 is no switch
    ("steps are no switch", ca.floor(u) * ca.sin(ca.pi * u), False, False),
]  # fmt: skip


@pytest.mark.parametrize(("name", "expression", "value", "slopes"), CONTINUOUS, ids=[row[0] for row in CONTINUOUS])
def test_continuity_of_a_function_and_of_its_slope(name, expression, value, slopes):
    f = graph(expression)
    assert continuous_on(f, BOX).proved == value
    found = continuous_on(slope(f, "y", "u"), BOX)
    assert found.proved == slopes
    if found.mended:
        assert all(one.kind == "jump" for one in found.mended) and not smooth_on(f, BOX).proved


@pytest.mark.parametrize(
    ("name", "expression"), [(row[0], row[1]) for row in CONTINUOUS if row[2] and row[3]], ids=lambda one: str(one)[:20]
)
def test_what_is_mended_is_met_from_both_sides(name, expression):
    """An oracle: the values of slopes a step to either side of every switch differ by no more than steps allow."""
    f = graph(expression)
    slopes = slope(f, "y", "u")
    switches = Switches(slopes)
    for node, place in ((n, i) for i, n in enumerate(slopes.nodes) if n.op in ("lt", "le", "sign")):
        switch = switches.of(place)
        if switch is None:
            continue
        for at in (Fraction(0), Fraction(1), Fraction(1, 2)):
            for state in (Fraction(1, 3), Fraction(-1, 3), Fraction(0)):
                step = Fraction(1, 10**9)
                try:
                    values = [
                        evaluate(slopes, [state, at + side * step, Fraction(0)], RATIONALS)[
                            slopes.outputs[0].entries[0].node
                        ]
                        for side in (-1, 0, 1)
                    ]
                except ValueError:
                    return  # an operation that rationals do not have
                assert max(values) - min(values) <= 20 * step, (node, at)


def test_sides_are_the_graph_where_the_level_has_that_sign():
    kinks = ca.fmax(u - x, 0.25) - 2 * ca.fmin(u, x + 0.25) + ca.fabs(0.25 + x - u)
    jumps = ca.if_else(u - x > 0.25, u**2, ca.sign(2 * u - 2 * x - 0.5) * x) + ca.if_else(0.25 + x >= u, 3, 0)
    f = graph(kinks + jumps)
    switches = Switches(f)
    switch = switches.of(next(i for i, node in enumerate(f.nodes) if node.op == "lt"))
    assert len(switch.nodes) == sum(node.op in ("lt", "le", "sign", "fabs", "fmin", "fmax") for node in f.nodes)
    assert len(switch.nodes) > 5
    (entry,) = f.outputs[0].entries
    for state, given in ((0.0, 1.0), (0.5, 0.75), (0.5, 0.0), (-1.0, -0.75), (0.25, 0.5)):
        at = [Fraction(state), Fraction(given), Fraction(0)]
        level = at[1] - at[0] - Fraction(1, 4)
        own = (level > 0) - (level < 0)
        side = switches.side(switch, -own)  # the level is normalised so that the coefficient of x is 1
        assert evaluate(side, at, RATIONALS)[entry.node] == evaluate(f, at, RATIONALS)[entry.node]


def test_normal_forms_hold_in_rationals():
    """A form, evaluated term by term, is the graph's value in rational arithmetic."""
    f = graph((0.1 * x - u) ** 3 / 0.7 + k * (x - 2 * u) * x - (u + 1) ** 2 + ca.fmax(0.5, 0.25) * x)
    (entry,) = f.outputs[0].entries
    form = Ring(Atoms(f.coordinates)).forms(f, [entry.node])[entry.node]
    for at in ((Fraction(1, 3), Fraction(2, 7), Fraction(5)), (Fraction(0), Fraction(-1), Fraction(3))):
        total = Fraction(0)
        for product, coefficient in form.terms.items():
            for variable, power in product:
                coefficient *= at[variable] ** power
            total += coefficient
        assert total == evaluate(f, list(at), RATIONALS)[entry.node]


def test_what_has_no_form_says_so():
    ring = Ring(Atoms(1))
    with pytest.raises(NoForm, match="no number"):
        number(float("inf"))
    with pytest.raises(NoForm, match="no inverse"):
        ring.arithmetic().operations["inv"](number(0))
    with pytest.raises(NoForm, match="negative power"):
        ring.arithmetic().operations["pow"](number(0), number(-1))
    with pytest.raises(NoForm, match="everywhere or nowhere"):
        Ring(Atoms(1), number(1))
    wide = graph(sum(u**i * x**j for i in range(8) for j in range(8)) ** 12)
    with pytest.raises(NoForm, match="terms"):
        Ring(Atoms(3)).forms(wide, [wide.outputs[0].entries[0].node])


BREAKS = [
    # expression, coordinate along which it breaks off, left, right
    ("a jump in u", ca.if_else(u > 0.25, 2, 1) + u, "u", 1.25, 2.25),
    ("a jump in x, falling", ca.if_else(x > 0.25, 1, 2) + u * 0, "x", 2, 1),
    ("turned", ca.if_else(0.25 > x, 2, 1), "x", 2, 1),
    ("a sign", ca.sign(0.25 - u) * 3, "u", 3, -3),
    ("a step", ca.floor(4 * u + 0.5), "u", 0, 1),
    ("a tiny jump", 1e-12 * ca.sign(u), "u", -1e-12, 1e-12),
    ("a step that is mended", ca.floor(u / 2) * u, None, 0, 0),
    ("a switch that is mended", ca.if_else(u > 0, u**2, 0), None, 0, 0),
    ("a point by itself", ca.if_else(u == 0, 1, 0), None, 0, 0),  # both sides agree
    ("touched from one side", ca.if_else(u**2 > 0, 1, 2), None, 0, 0),  # both sides agree, the point does not
    ("a ramp where the level is zero", ca.if_else(ca.fmax(u, 0) + ca.fmin(u + 1e-13, 0) > 0, 1,
        ca.if_else(ca.fmax(u, 0) + ca.fmin(u + 1e-13, 0) < 0, 0, 1 + u / 1e-13)), None, 0, 0),
]  # fmt: skip


@pytest.mark.parametrize(("name", "expression", "across", "left", "right"), BREAKS, ids=[row[0] for row in BREAKS])
def test_breaks_are_shown_on_both_sides(name, expression, across, left, right):
    f = graph(expression)
    reached = [reach for reach in reaches(f, BOX) if reach.reachable == "yes" and reach.operation.kind == "jump"]
    assert reached
    found = [one for one in (break_at(f, BOX, reach) for reach in reached) if one is not None]
    if across is None:
        assert not found
        return
    assert found[0].across == across and 0 < found[0].gap <= abs(right - left) + 1e-9
    assert found[0].gap == pytest.approx(abs(right - left), abs=1e-5 * abs(right - left))
    if "step" not in name:
        assert found[0].left[0] <= left <= found[0].left[1] and found[0].right[0] <= right <= found[0].right[1]
    assert found[0].proved == ("step" not in name)
    others = tuple({"x", "u"} - {across})
    assert all(break_at(f, BOX, reach, others) is None for reach in reached)


def test_no_break_beyond_the_box():
    f = graph(ca.sign(u - 2) + ca.sign(x + 1))
    assert [reach.reachable for reach in reaches(f, BOX)] == ["yes", "yes"]
    assert all(break_at(f, BOX, reach) is None for reach in reaches(f, BOX))
