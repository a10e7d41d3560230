"""Integrators against solutions in closed form, CasADi's CVODES and their own orders; plants in continuous time."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from models import Plant, declared, part, quantity, signals
from models.actuator import Delayed
from models.brake import Brake
from models.discretise import RK4, Euler, GaussLegendre, Integrator
from models.maglev import Maglev
from models.metro_line import MetroLine
from models.point_mass import PointMass
from models.quantity import InvalidValue

ORDERS = [
    (lambda n: Euler(substeps=n), 1, (8, 16)),
    (lambda n: RK4(substeps=n), 4, (64, 128)),
    (lambda n: GaussLegendre(points=1, substeps=n), 2, (8, 16)),
    (lambda n: GaussLegendre(points=2, substeps=n), 4, (8, 16)),
    (lambda n: GaussLegendre(points=3, substeps=n, newton=8), 6, (4, 8)),
]


@pytest.mark.parametrize(("method", "order", "substeps"), ORDERS)
@pytest.mark.parametrize(
    ("slope", "exact"),
    [
        (lambda x, t: t - x, 2 * np.exp(-0.8) - 0.2),
        (lambda x, t: ca.cos(3 * t) * x**2, 1 / (1 - np.sin(2.4) / 3)),
    ],
)
def test_integrators_have_their_order(method, order, substeps, slope, exact):
    """Substeps twice as fine make the error against the solution of x(0) = 1 at 0.8 s 2^order times smaller."""
    coarse, fine = (abs(float(method(n).advance(slope, ca.DM(1.0), 0.0, 0.8)) - exact) for n in substeps)
    assert coarse < 0.3
    assert np.log2(coarse / fine) == pytest.approx(order, abs=0.4)


def cvodes(slope, x, t, step):
    z, s = ca.SX.sym("z", x.numel()), ca.SX.sym("s")
    options = {"abstol": 1e-13, "reltol": 1e-13}
    return ca.integrator("oracle", "cvodes", {"x": z, "t": s, "ode": slope(z, s)}, t, t + step, options)(x0=x)["xf"]


def oscillator(x, t):
    return ca.vertcat(x[1], 5 * (1 - x[0] ** 2) * x[1] - x[0] + ca.sin(t))


def stiff(x, t):
    return ca.vertcat(-2000 * (x[0] - ca.cos(t)), x[0] - x[1] ** 3)


@pytest.mark.parametrize(
    ("slope", "x", "method", "tolerance"),
    [
        (oscillator, [1.5, -0.3], RK4(substeps=40), 1e-6),
        (oscillator, [1.5, -0.3], GaussLegendre(points=3, substeps=8, newton=5), 1e-7),
        (oscillator, [1.5, -0.3], GaussLegendre(points=2, substeps=40, newton=4), 1e-6),
        (stiff, None, GaussLegendre(points=3, substeps=32), 1e-5),
        (stiff, None, GaussLegendre(points=1, substeps=200), 1e-5),
    ],
)
@pytest.mark.parametrize("t", [0.0, 2.0])
def test_integrators_give_what_cvodes_gives(slope, x, method, tolerance, t):
    x = [np.cos(t), 0.5] if slope is stiff else x  # what decays at once is over
    expected = cvodes(slope, ca.DM(x), t, 0.4)
    np.testing.assert_allclose(method.advance(slope, ca.DM(x), t, 0.4), expected, rtol=tolerance, atol=tolerance)


def test_what_is_stiff_is_lost_on_an_explicit_method():
    gone = RK4(substeps=4).advance(stiff, ca.DM([1.01, 0.5]), 0.0, 0.4)
    assert not np.abs(np.array(gone)).max() < 1e6
    assert np.abs(np.array(GaussLegendre(substeps=4).advance(stiff, ca.DM([1.01, 0.5]), 0.0, 0.4))).max() < 2


@pytest.mark.parametrize("method", [Euler(substeps=2), RK4(), GaussLegendre(points=2), GaussLegendre(points=3)])
def test_symbols_of_both_kinds_and_numbers_give_the_same(method):
    at = ca.DM([1.2, 0.3])
    numbers = method.advance(oscillator, at, 0.5, 0.1)
    assert isinstance(numbers, ca.DM)
    for kind in (ca.SX, ca.MX):
        x, h = kind.sym("x", 2), kind.sym("h")
        f = ca.Function("f", [x, h], [method.advance(oscillator, x, 0.5, h)])
        np.testing.assert_allclose(f(at, 0.1), numbers, rtol=1e-12)


@pytest.mark.parametrize(
    ("method", "phrase"),
    [
        (Euler(), "explicit Euler, one step a sample"),
        (RK4(substeps=2), "fourth-order Runge-Kutta, two steps a sample"),
        (RK4(substeps=20), "fourth-order Runge-Kutta, 20 steps a sample"),
        (
            GaussLegendre(points=3),
            "Gauss-Legendre collocation of order 6 solved by 3 Newton step(s), one step a sample",
        ),
    ],
)
def test_an_integrator_says_what_it_is(method, phrase):
    assert method.phrase == phrase


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: RK4(substeps=0), "substeps must lie in"),
        (lambda: Euler(substeps=1.5), "substeps must be a whole number"),
        (lambda: GaussLegendre(points=4), r"points must lie in \[1, 3\], got 4"),
        (lambda: GaussLegendre(newton=0), "newton must lie in"),
    ],
)
def test_bad_integrators_are_refused(make, message):
    with pytest.raises(InvalidValue, match=message):
        make()


@declared
class Tank(Plant):
    """A tank with a valve that ages; its level is dh/dt = (q - c(t) sqrt(h) + w) / A."""

    states = outputs = signals(level="m")
    inputs = signals(inflow="m^3/s")
    disturbances = signals(rain="m^3/s")
    area: float = quantity(default=2.0, unit="m^2", doc="area", above=0)
    sampling_time: float = quantity(default=0.5, unit="s", doc="sampling time", above=0)
    integrator: Integrator = part(default=RK4(substeps=4), doc="how the equation is integrated")

    def rhs(self, x, u, w, t):
        return ((u.inflow - (0.5 + 0.1 * t) * ca.sqrt(x.level) + w.rain) / self.area,)

    def output(self, x):
        return (x.level,)


@pytest.mark.parametrize("integrator", [RK4(substeps=4), GaussLegendre(newton=4), Euler(substeps=4000)])
@pytest.mark.parametrize("k", [0, 7])
def test_a_plant_in_continuous_time_is_integrated_over_each_sample(integrator, k):
    plant = Tank(integrator=integrator)
    expected = cvodes(lambda h, t: (0.3 - (0.5 + 0.1 * t) * ca.sqrt(h) + 0.05) / 2.0, ca.DM(1.4), 0.5 * k, 0.5)
    tolerance = 1e-4 if isinstance(integrator, Euler) else 1e-7
    np.testing.assert_allclose(plant.step_function()(1.4, 0.3, 0.05, k), expected, rtol=tolerance)
    slope = plant.slope(ca.DM(1.4), ca.DM(0.3), ca.DM(0.05), 0.5 * k)
    assert float(slope) == pytest.approx((0.35 - (0.5 + 0.05 * k) * 1.4**0.5) / 2)


@pytest.mark.parametrize(
    ("plant", "continuous"),
    [
        (Tank(), True),
        (Maglev(), True),
        (MetroLine(), True),
        (Brake(), True),
        (PointMass(), False),
        (Delayed(plant=Tank(), dead_time=0.5), False),
    ],
)
def test_a_plant_says_whether_it_is_given_in_continuous_time(plant, continuous):
    assert plant.continuous is continuous
    columns = (ca.SX.sym("z", len(named)) for named in (plant.states, plant.inputs, plant.disturbances))
    if continuous:
        assert plant.slope(*columns, 0).shape == (len(plant.states), 1)
    else:
        with pytest.raises(InvalidValue, match=f"{type(plant).__name__} gives its step"):
            plant.slope(*columns, 0)


def test_neither_or_both_of_step_and_rhs_are_refused_when_the_class_is_made():
    with pytest.raises(TypeError, match=r"^Still must give step\(x, u, w, k\) or rhs\(x, u, w, t\), got neither$"):

        class Still(Plant):
            def output(self, x):
                return (x.level,)

    with pytest.raises(TypeError, match=r"^Twice must give .*, got both$"):

        class Twice(Tank):
            def step(self, x, u, w, k):
                return x.vector


def test_a_right_hand_side_of_the_wrong_shape_is_refused():
    class Wide(Tank):
        def rhs(self, x, u, w, t):
            return x.level, x.level

    with pytest.raises(InvalidValue, match=r"Wide\.rhs must give 1 value\(s\) \(level\), got shape \(2, 1\)"):
        Wide().step_function()
