"""A1 (df/du exists and is continuous), and slopes that are enclosed: what must be proved, refuted, and neither."""

from __future__ import annotations

from fractions import Fraction
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from models.plant import Plant, signal, signals
from models.quantity import declared, quantity
from verification.checks import assumptions
from verification.checks.continuity import continuous_slope, replay
from verification.checks.delayed import delayed_box, delayed_output, delayed_slope
from verification.checks.domain import described, domain
from verification.checks.lipschitz import lipschitz
from verification.checks.row_sums import slope_bounds
from verification.checks.slope import slope
from verification.enclosure.bounds import bound
from verification.enclosure.box import Box
from workbench.contracts.finding import Standing, plain
from workbench.evidence.trajectory import Trajectories
from workbench.graph import RATIONALS, evaluate, read

PROVED, REFUTED, UNDECIDED = Standing.PROVED, Standing.REFUTED, Standing.UNDECIDED
N = 20
NOTHING = (np.zeros(0), np.zeros(0))


def plant_of(equation, *, states=1, output=0, flows=False, **named) -> Plant:
    """A plant x+ = equation(x, u, k) of one input, x a number or a tuple; ``flows`` makes it dx/dt."""
    x_signals = signals(**(named or {f"x{i}": "1" for i in range(states)}))

    def step(self, x, u, w, k):
        values = tuple(x)
        found = equation(values[0] if states == 1 else values, u.u, k)
        return found if isinstance(found, tuple) else (found,)

    members = {
        "__annotations__": {"sampling_time": float},
        "__doc__": "A small plant.",
        "source": "made for tests, 2026",
        "sampling_time": quantity(default=1.0, unit="s", doc="sampling time", above=0),
        "states": x_signals,
        "inputs": signals(u="1"),
        "outputs": signals(y="1"),
        "rhs" if flows else "step": step,
        "output": lambda self, x: (tuple(x)[output],),
    }
    return declared(type("Small", (Plant,), members))()


def box(states=1, x=(-1.0, 1.0), u=(-1.0, 2.0)) -> Box:
    return Box({"x": tuple(np.full(states, end) for end in x), "u": u, "w": NOTHING, "k": (0, N - 1)}, whole=("k",))


STANDINGS = [
    # equation, A1
    ("periodic gain", lambda x, u, k: x + ca.cos(2 * ca.pi * k) * u, PROVED),
    ("gain by remainder", lambda x, u, k: x + (1 + ca.fmod(k, 2)) * u, PROVED),
    ("gain by choice of k", lambda x, u, k: x + ca.if_else(k < 10, 1, 2) * u, PROVED),
    ("gain in steps of k", lambda x, u, k: x + ca.floor(k / 5) * u, PROVED),
    ("pole between samples", lambda x, u, k: x + u / (k - 3.5), PROVED),
    ("pole at a sample", lambda x, u, k: x + u / (k - 3), REFUTED),
    ("square of the positive part", lambda x, u, k: ca.fmax(u, 0) ** 2, PROVED),
    ("u times its size", lambda x, u, k: u * ca.fabs(u), PROVED),
    ("cube of the size", lambda x, u, k: ca.fabs(u) ** 3, PROVED),
    ("choice of a square", lambda x, u, k: ca.if_else(u > 0, u**2, 0), PROVED),
    ("positive part times u", lambda x, u, k: ca.fmax(u, 0) * u, PROVED),
    ("negative part, squared", lambda x, u, k: ca.fmin(u - x, 0) ** 2, PROVED),
    ("pieces of equal slope", lambda x, u, k: ca.if_else(u > 1, u**2, 2 * u - 1), PROVED),
    ("Huber's loss", lambda x, u, k: ca.if_else(ca.fabs(u) < 1, u**2 / 2, ca.fabs(u) - 0.5), PROVED),
    ("a tiny kink", lambda x, u, k: ca.if_else(u > 0, u**2 + 1e-9 * u, 0), REFUTED),
    ("a tiny jump", lambda x, u, k: ca.if_else(u > 0, u**2 + 1e-12, 0), REFUTED),
    ("kink elsewhere", lambda x, u, k: u * ca.fabs(u - 0.1), REFUTED),
    ("size", lambda x, u, k: ca.fabs(u) ** 1.0, REFUTED),
    ("root of the size", lambda x, u, k: ca.fabs(u) ** 0.5, REFUTED),
    ("size to 0.9", lambda x, u, k: ca.fabs(u) ** 0.9, REFUTED),
    ("f jumps in x", lambda x, u, k: 0.5 * x + 2 * ca.sign(x - 0.3) + u, PROVED),
    ("gain jumps in x", lambda x, u, k: 0.5 * x + ca.if_else(x > 0.3, 2, 1) * u, REFUTED),
    ("gain is kinked in x", lambda x, u, k: 0.5 * x + (1 + ca.fabs(x)) * u, PROVED),
    ("f jumps along u", lambda x, u, k: x + u + 0.1 * ca.floor(4 * u), REFUTED),
    ("f jumps where x meets u", lambda x, u, k: x + ca.if_else(x > u, 0.1, 0.2), REFUTED),
    ("f jumps where k meets u", lambda x, u, k: x + u + ca.if_else(4 * u > k - 6, 0.1, 0.2), REFUTED),
    ("f jumps where k never meets u", lambda x, u, k: x + u + ca.if_else(u / 9 > k - 6.5, 0.1, 0.2), PROVED),
    ("no value in part of the box", lambda x, u, k: x + ca.log(u), REFUTED),
    ("no value at one u", lambda x, u, k: x + 1 / u, REFUTED),
    ("pole in a branch not taken", lambda x, u, k: ca.if_else(ca.fabs(u) > 1e-8, ca.sin(u) / u, 1), UNDECIDED),
    (
        "quotients that grow to an end",
        lambda x, u, k: x + u - ca.fabs(u - 0.5) ** 1.1 + ca.exp(2 * ca.log(ca.fabs(u - 0.5))),
        UNDECIDED,
    ),
    ("a pole that a factor mends", lambda x, u, k: ca.exp(2 * ca.log(ca.fabs(u))), UNDECIDED),
]


LINEAR = ca.interpolant("linear", "linear", [[-2.0, -0.5, 0.25, 1.0, 3.0]], [0.0, 1.0, 0.5, 2.0, 1.0])
STRAIGHT = ca.interpolant("straight", "linear", [[-1.0, 0.5, 4.0]], [-2.0, 1.0, 8.0])
CUBIC = ca.interpolant("cubic", "bspline", [[-2.0, -0.5, 0.25, 1.0, 3.0]], [0.0, 1.0, 0.5, 2.0, 1.0])
POLYGON = ca.interpolant("polygon", "bspline", [[-2.0, -0.5, 0.25, 1.0, 3.0]], [0.0, 1.0, 0.5, 2.0, 1.0],
                         {"degree": [1]})  # fmt: skip
SHORT = ca.interpolant("short", "bspline", [[-0.5, 0.0, 0.25, 0.5]], [1.0, 1.0, 1.0, 1.0])
SURFACE = ca.interpolant("surface", "linear", [[-2.0, 0.0, 2.0], [-1.0, 0.5, 3.0]],
                         [0.0, 1.0, 0.5, 2.0, 1.0, -1.0, 0.25, 0.5, 3.0])  # fmt: skip


def pieces(at: ca.SX) -> ca.SX:
    """Straight pieces whose slopes are doubles: 2 before 1/4, then -1, then 1/2."""
    return ca.pw_lin(at, ca.DM([-1, 0.25, 0.75, 2.75]), ca.DM([-2, 0.5, 0, 1]))


TABLED = [
    # equation, A1
    ("a table of the state", lambda x, u, k: LINEAR(x) + u, PROVED),
    ("a gain from a table of the state", lambda x, u, k: x + LINEAR(x) * u, PROVED),
    ("a gain from a table of the sample", lambda x, u, k: x + LINEAR(k / 10) * u, PROVED),
    ("a table of state and sample", lambda x, u, k: SURFACE(ca.vertcat(x, k / 10)) * u, PROVED),
    ("a table of the input", lambda x, u, k: x + LINEAR(u), REFUTED),
    ("a table of state and input", lambda x, u, k: SURFACE(ca.vertcat(x, u)), REFUTED),
    ("a table of the input between two points", lambda x, u, k: x + LINEAR(0.5 + u / 10), PROVED),
    ("a table whose points lie on one line", lambda x, u, k: x + STRAIGHT(u), PROVED),
    ("a spline of the input", lambda x, u, k: x + CUBIC(u), PROVED),
    ("a spline of the first degree", lambda x, u, k: x + POLYGON(u), REFUTED),
    ("a spline that ends within the box", lambda x, u, k: x + SHORT(u), REFUTED),
    ("pieces of the state", lambda x, u, k: pieces(x) + u, PROVED),
    ("a gain from pieces of the state", lambda x, u, k: x + pieces(x) * u, PROVED),
    ("pieces of the input", lambda x, u, k: x + pieces(u), REFUTED),
    ("pieces of the input, one of them", lambda x, u, k: x + pieces(0.5 + u / 10), PROVED),
    ("a pole that a guard keeps out", lambda x, u, k: x + u * ca.if_else(x > 0.25, 1 / x, 4), PROVED),
    ("a root that a guard keeps in its domain", lambda x, u, k: u + ca.if_else(x > 0, ca.sqrt(x), 0), PROVED),
    ("a guard that leaves the root's slope", lambda x, u, k: x + ca.if_else(u > 0, ca.sqrt(u), 0), REFUTED),
    ("a guarded slope that breaks off", lambda x, u, k: x + ca.if_else(u > 0, ca.log(1 + u), 0), REFUTED),
    ("what is left of a division", lambda x, u, k: x + ca.remainder(u, 1.5), REFUTED),
]


@pytest.mark.parametrize(
    ("name", "equation", "standing"), STANDINGS + TABLED, ids=[row[0] for row in STANDINGS + TABLED]
)
def test_a1(name, equation, standing):
    plant, at = plant_of(equation), box()
    found = continuous_slope(plant, at)
    if standing is UNDECIDED:
        assert found.standing is not REFUTED  # it is continuous, and need not be shown to be
        return
    assert found.standing is standing, found
    assert found.margin is None or np.isfinite(found.margin)
    if standing is REFUTED:
        _inside(found.witness["point"], at)
        _replay(plant, found)


def _inside(point, at):
    """The witness is a point of the box, at a whole k."""
    for name, values in point.items():
        low, high = (end.ravel() for end in at[name])
        assert np.all(low <= np.array(values)) and np.all(np.array(values) <= high), (name, values)
    assert float(point["k"][0]).is_integer()


def _replay(plant, found):
    """Values of the plant itself show what the witness says."""
    f, witness = delayed_output(plant, 1), found.witness
    point = witness["point"]

    def value(u, x):
        return float(f(x, u, [], point["k"], np.zeros((1, 0)), np.zeros((0, 0))))

    again = replay(plant, 1, plain(witness))
    assert again < 0 and (found.margin is None or again == pytest.approx(found.margin, rel=1e-2))
    x, u = point["x"][0], point["u"][0]
    if "across" in witness:
        step, along = witness["step"], (0.0, 1.0) if witness["across"].startswith("u") else (1.0, 0.0)
        if witness["of"] == "f":
            left, right = (value(u + side * step * along[1], x + side * step * along[0]) for side in (-1, 1))
            assert abs(right - left) >= -found.margin * (1 - 1e-6) - 4 * step
        else:
            slopes = [
                (value(u + side * step * along[1] + h, x + side * step * along[0])
                 - value(u + side * step * along[1] - h, x + side * step * along[0])) / (2 * h)
                for side in (-1, 1) for h in (step / 2,)
            ]  # fmt: skip
            assert slopes[0] == pytest.approx(witness["slope_left"], abs=1e-5)
            assert slopes[1] == pytest.approx(witness["slope_right"], abs=1e-5)
    elif "quotients" in witness:
        ratios = [abs(value(u + step, x) - value(u, x)) / abs(step) for step in witness["steps"]]
        assert ratios == pytest.approx(witness["quotients"], rel=1e-6) and ratios[-1] > 8 * ratios[0]
    else:
        assert not np.isfinite(value(u, x))


def test_a_kink_at_the_edge_of_the_box_is_not_refuted_by_a_point_outside():
    found = continuous_slope(plant_of(lambda x, u, k: ca.fabs(u)), box(u=(0.0, 2.0)))
    assert found.standing is UNDECIDED and "continuity of df/du" in found.method
    at_edge = continuous_slope(plant_of(lambda x, u, k: x + ca.floor(u)), box(u=(0.5, 1.0)))
    assert at_edge.standing is UNDECIDED


def test_what_is_said_of_f_where_it_jumps_in_x():
    found = continuous_slope(plant_of(lambda x, u, k: 0.5 * x + 2 * ca.sign(x - 0.3) + u), box())
    assert found.standing is PROVED and "f itself is not shown to be continuous in x" in found.method
    plain = continuous_slope(plant_of(lambda x, u, k: 0.5 * x + u), box())
    assert "f itself" not in plain.method and "whole k in [0, 19]" in plain.method


def test_a_mended_switch_is_named():
    found = continuous_slope(plant_of(lambda x, u, k: u * ca.fabs(u)), box())
    assert "switches whose sides agree" in found.method and "sign(u)" in found.method


def test_sign_and_bounds_at_whole_k():
    """A gain of 1 at every whole k is positive; between samples it is not."""
    plant = plant_of(lambda x, u, k: 0.5 * x + ca.cos(2 * ca.pi * k) * u)
    assert assumptions.sign_partial(plant, SimpleNamespace(degree=1, increment=False), box()).standing is PROVED
    found = slope_bounds(plant, box())
    assert found.reason is None and found.gain_low == pytest.approx(1) == found.gain_high
    turned = plant_of(lambda x, u, k: 0.5 * x + (0.5 - ca.fmod(k, 2)) * u)
    refuted = assumptions.sign_partial(turned, SimpleNamespace(degree=1, increment=False), box())
    assert refuted.standing is REFUTED and refuted.witness["point"]["k"][0] % 2 == 1
    assert refuted.witness["slope"] == pytest.approx(-0.5)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_the_last_step_of_a_delayed_output_is_one_of_the_trial(degree):
    """A plant that has no value from k = N on: its output d samples later is asked for at k up to N - d only."""
    plant = plant_of(lambda x, u, k: (u * ca.sqrt(N - 1 - k), x[0], x[1])[:3], states=3, output=degree - 1)
    assert delayed_box(box(3), degree)["k"][1][0, 0] == N - degree
    delayed = plant_of(lambda x, u, k: (u, x[0], x[1] * ca.sqrt(N - 1 - k)), states=3, output=2)
    assert continuous_slope(delayed, box(3), 3).standing is PROVED
    late = Box({**box(3), "k": (0, N)}, whole=("k",))
    assert continuous_slope(delayed, late, 3).standing is not PROVED
    assert continuous_slope(plant, box(3), degree).standing is PROVED


# ------------------------------------------------------------------ domains


def trajectories(x, u):
    """One trial of given states, shape (nx, N + 1), and inputs (N,)."""
    x, u = np.asarray(x, dtype=float), np.asarray(u, dtype=float)
    nothing = np.full((1, u.size), np.nan)
    return Trajectories(x[None], u[None], x[:1], np.array([u.size]), nothing, np.zeros((1, 0, u.size)))


LEVELS = [
    # domain, recorded levels, range that is expected, said
    ("cut below", (0, None), (0.0, 2.0), (0.0, 2.1), "cut to its domain"),
    ("cut above", (None, 2), (0.0, 2.0), (-0.1, 2.0), "cut to its domain"),
    ("cut at both ends", (0.5, 1.5), (0.0, 2.0), (0.5, 1.5), "cut to its domain"),
    ("wide enough", (-9, 9), (0.0, 2.0), (-0.1, 2.1), None),
    ("none", None, (0.0, 2.0), (-0.1, 2.1), None),
    ("beyond", (5, 9), (0.0, 2.0), (-0.1, 2.1), "beyond its domain"),
]


@pytest.mark.parametrize(("name", "limits", "met", "expected", "said"), LEVELS, ids=[row[0] for row in LEVELS])
def test_the_box_ends_where_signals_do(name, limits, met, expected, said):
    plant = plant_of(lambda x, u, k: x + u, level=signal("m", "level", domain=limits))
    at = domain(plant, trajectories(np.linspace(*met, N + 1)[None], np.linspace(0, 1, N)))
    assert [end[0, 0] for end in at["x"]] == pytest.approx(expected)
    assert at.whole == ("k",) and [end[0, 0] for end in at["k"]] == [0, N - 1]
    text = described(plant, at)
    assert (said in text) if said else ("domain" not in text)


def test_what_has_no_meaning_beyond_a_domain_is_proved_within():
    """A tank empties with the root of its level: there is none below 0, and the recorded level comes near."""
    plant = plant_of(lambda x, u, k: x - 0.1 * ca.sqrt(x) + u, level=signal("m", "level", domain=(0, None)))
    taken = trajectories(np.linspace(0.001, 2.0, N + 1)[None], np.linspace(0, 1, N))
    assert continuous_slope(plant, domain(plant, taken)).standing is PROVED
    unlimited = plant_of(lambda x, u, k: x - 0.1 * ca.sqrt(x) + u)
    assert continuous_slope(unlimited, domain(unlimited, taken)).standing is REFUTED  # no value below 0


# ------------------------------------------------------------------ constants

CANCELLING = {
    "1e16 u + u - 1e16 u": lambda x, u: ((1e16 * u - u) - 1e16 * u) + 0.5 * u,
    "a number that is left over": lambda x, u: (0.1 + 0.2 - 0.3) * 1e17 * u - 0.5 * u,
    "of a state": lambda x, u: ((1e16 * x - x) - 1e16 * x) + 0.5 * x + u,
    "a quotient": lambda x, u: ((1e16 * u - u) - 1e16 * u) / 3 + u / 7,
    "squares": lambda x, u: ((1e16 * u**2 - u**2) - 1e16 * u**2) + 0.5 * u**2 + x,
    "a product of constants": lambda x, u: (1e-17 + (u - x) * 0.1) * 0.3 - 0.03 * u,
}


@pytest.mark.parametrize("name", CANCELLING)
@pytest.mark.parametrize("by", ["x", "u"])
def test_enclosures_of_slopes_hold_the_exact_derivative(name, by):
    """The derivative in rationals of the doubles as written: of the whole graph, by its definition for polynomials."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    f = read(ca.Function("f", [x, u], [CANCELLING[name](x, u)], ["x", "u"], ["y"]))
    found = bound(slope(f, "y", by), Box({"x": (-1, 1), "u": (-1, 1)}))
    (entry,) = f.outputs[0].entries

    def value(at):
        return evaluate(f, at, RATIONALS)[entry.node]

    for at in ((Fraction(0), Fraction(0)), (Fraction(1, 3), Fraction(-1, 2)), (Fraction(-1), Fraction(1))):
        step = [Fraction(0), Fraction(0)]
        step["xu".index(by)] = Fraction(1, 8)
        ahead, behind = ([a + side * b for a, b in zip(at, step, strict=True)] for side in (1, -1))
        exact = (value(ahead) - value(behind)) / Fraction(1, 4)  # exact for polynomials up to the second degree
        assert Fraction(found.lower) <= exact <= Fraction(found.upper)
        assert found.upper - found.lower < 10


@pytest.mark.parametrize("name", CANCELLING)
def test_a_lipschitz_constant_is_above_the_exact_slope(name):
    plant = plant_of(lambda x, u, t: CANCELLING[name](x, u), flows=True)
    turned = plant_of(lambda x, u, t: CANCELLING[name](u, x), flows=True)
    for one, equation in ((plant, CANCELLING[name]), (turned, lambda a, b: CANCELLING[name](b, a))):
        found = lipschitz(one, [-1.0], [1.0], (-1.0, 0.0, 1.0))
        assert found.standing is PROVED
        x, u = ca.SX.sym("x"), ca.SX.sym("u")
        f = read(ca.Function("f", [x, u], [equation(x, u)], ["x", "u"], ["y"]))
        (entry,) = f.outputs[0].entries
        values = [evaluate(f, [at, Fraction(0)], RATIONALS)[entry.node] for at in (Fraction(-1), Fraction(1))]
        assert Fraction(found.bound) >= abs(values[1] - values[0]) / 2


def test_slopes_of_delayed_outputs_are_exact():
    plant = plant_of(lambda x, u, k: (((1e16 * u - u) - 1e16 * u) + 0.5 * u, x[0]), states=2, output=1)
    found = bound(delayed_slope(read(delayed_output(plant, 2))), delayed_box(box(2), 2))
    assert found.lower <= -0.5 <= found.upper
