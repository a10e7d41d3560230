"""Derivatives of plants against finite differences and by hand; python-control's view of them."""

from __future__ import annotations

import casadi as ca
import control
import numpy as np
import pytest

from models.actuator import Delayed
from models.line import FLAT, HILLY, Line
from models.metro_profile import MetroProfile, metro_speed
from models.plant import Plant, signals
from models.point_mass import PointMass
from models.quantity import InvalidValue, choice, declared, quantity, symbolised
from models.reference import Given
from models.switched_delay import SwitchedDelay
from models.transfer import Transfer


@declared
class Pendulum(Plant):
    """A pendulum with a wind, to have a disturbance and two outputs."""

    inputs = signals(torque="N m")
    states = signals(angle="rad", rate="rad/s")
    outputs = signals(angle="rad", speed="m/s")
    disturbances = signals(wind="N")
    length: float = quantity(default=0.7, unit="m", doc="length", above=0)
    mass: float = quantity(default=2.0, unit="kg", doc="mass", above=0)
    sampling_time: float = quantity(default=0.01, unit="s", doc="sampling time", above=0)

    def step(self, x, u, w, k):
        angle, rate = x
        moment = u.torque - 9.81 * self.mass * self.length * ca.sin(angle) + w.wind * self.length * ca.cos(angle)
        rate_next = rate + self.sampling_time * moment / (self.mass * self.length**2) + 1e-5 * ca.sin(0.1 * k)
        return angle + self.sampling_time * rate_next, rate_next

    def output(self, x):
        return x.angle, self.length * x.rate


POINTS = {
    "metro": (PointMass(), [60.0, 650.0], [5e4], [], 300),
    "metro on a slope's edge": (PointMass(), [72.0, 1140.0], [-2e5], [], 900),
    "flat": (PointMass(line="flat"), [10.0, 0.0], [1500.0], [], 0),
    "seconds": (PointMass(reading="seconds"), [60.0, 650.0], [5e4], [], 3000),
    "printed": (PointMass(reading="printed"), [60.0, 650.0], [5e4], [], 300),
    "pendulum": (Pendulum(), [0.4, -1.0], [3.0], [0.8], 7),
}


def difference(function, at, scale, share=1e-5):
    """Central differences of a function of a vector."""
    columns = []
    for index in range(len(at)):
        h = share * max(scale, abs(at[index]))
        up, down = np.array(at, float), np.array(at, float)
        up[index] += h
        down[index] -= h
        columns.append((function(up) - function(down)) / (2 * h))
    return np.stack(columns, axis=1) if columns else np.zeros((0, 0))


@pytest.mark.parametrize("of", ["x_next", "y_next"])
@pytest.mark.parametrize("case", POINTS)
def test_derivatives_equal_finite_differences(case, of):
    plant, x, u, w, k = POINTS[case]
    whole = plant.step_function() if of == "x_next" else plant.next_output_function()
    point = {"x": np.array(x), "u": np.array(u), "w": np.array(w)}
    for by in ("x", "u", "w"):
        if not point[by].size:
            continue
        exact = plant.derivative(by, of)
        assert exact.name_in() == ["x", "u", "w", "k"]
        assert exact.name_out() == [f"d{of}_d{by}"]
        rough = difference(lambda z, by=by: whole(*(point | {by: z}).values(), k).full().ravel(), point[by], 1.0)
        np.testing.assert_allclose(exact(*point.values(), k).full(), rough, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("case", POINTS)
def test_derivatives_by_parameters_equal_finite_differences(case):
    plant, x, u, w, k = POINTS[case]
    cls, fields = type(plant), symbolised(plant)
    assert fields.names
    for name, value in zip(fields.names, fields.values, strict=True):
        others = {f: getattr(plant, f) for f in ("reading", "line") if hasattr(plant, f)} | dict(
            zip(fields.names, fields.values, strict=True)
        )

        def moved(z, others=others, name=name):
            return cls(**(others | {name: float(z[0])})).step_function()(x, u, w, k).full().ravel()

        exact = plant.derivative(name)(x, u, w, k).full()
        np.testing.assert_allclose(exact, difference(moved, [value], 1e-3, 1e-3), rtol=1e-5, atol=1e-9, err_msg=name)


@pytest.mark.parametrize(
    ("reading", "factor", "twice"), [("metro", 3.6, 1.0), ("seconds", 3.6, 1.0), ("printed", 1.0, 350_000.0)]
)
def test_derivatives_by_hand(reading, factor, twice):
    plant, v, k = PointMass(reading=reading, line="flat"), 55.0, 1234
    swing = np.sin(0.0037 * k * (0.1 if reading == "seconds" else 1))
    drag = (25.17 + 2.5 * swing + 2 * (0.2864 + 0.04 * swing) * v) / twice
    gain = factor * 0.1 / 350_000
    by_u = plant.derivative("u")([v, 0], 0, [], k).full()
    by_x = plant.derivative("x")([v, 0], 0, [], k).full()
    np.testing.assert_allclose(by_u, [[gain], [0]], rtol=1e-14)
    np.testing.assert_allclose(by_x, [[1 - gain * drag, 0], [0.1 / factor, 1]], rtol=1e-14)


def test_derivative_of_unknown_name_is_refused():
    with pytest.raises(InvalidValue, match=r"derivative by x, u, w or one of: mass, .*got 'weight'"):
        PointMass().derivative("weight")
    with pytest.raises(InvalidValue, match="x_next"):
        PointMass().derivative("u", of="z")


@declared
class TwoTanks(Plant):
    """Two tanks in series, the first with a pump, the second with a valve that closes at sample 5."""

    inputs = signals(pump="m^3/s", valve="1")
    states = signals(first="m", second="m")
    outputs = signals(level="m", other=("m", "level of the first tank"))
    drain: float = quantity(default=0.25, unit="1", doc="share that flows on in a sample", above=0, below=1)
    sampling_time: float = quantity(default=1.0, unit="s", doc="sampling time", above=0)

    def step(self, x, u, w, k):
        on = self.drain * x.first
        return x.first - on + u.pump, x.second + 0.5 * on + ca.if_else(k < 5, 2.0 * u.valve, 0.0)

    def output(self, x):
        return x.second, x.first


@declared
class Cancelling(Plant):
    """A plant whose input stands in the next output and yet does not act there, or acts without a slope."""

    inputs = signals(u="1")
    states = signals(a="1", b="1")
    outputs = signals(a="1")
    form: str = choice(default="folded", options=("folded", "times 0", "cancels", "scaled", "stairs"), doc="how")
    sampling_time: float = quantity(default=1.0, unit="s", doc="sampling time", above=0)

    def step(self, x, u, w, k):
        through = {
            "folded": u.u - u.u,
            "times 0": u.u * 0,
            "cancels": (x.b + u.u) * (x.b - u.u) + u.u**2 - x.b**2,
            "scaled": (0.1 * x.b + 0.1 * u.u) ** 2 - 0.01 * u.u**2 - 0.02 * x.b * u.u,
            "stairs": ca.floor(u.u),
        }
        return x.b + through[self.form], u.u

    def output(self, x):
        return (x.a,)


PAST = Delayed(plant=TwoTanks(), dead_time=3.0)
SWITCHED = SwitchedDelay(plant=Transfer(), schedule=((0, 3), (10, 1), (20, 2)))
DEGREES = [
    ("train", PointMass(), {}, 1, 3.6 * 0.1 / 350_000),
    ("tanks in series", TwoTanks(), {}, 2, 0.125),
    ("tanks, other output", TwoTanks(), {"output": "other"}, 1, 1.0),
    ("tanks, other input", TwoTanks(), {"k": 4, "input": "valve"}, 1, 2.0),
    ("tanks, valve shut", TwoTanks(), {"k": 5, "input": "valve"}, None, None),
    ("tanks, the valve never moves the first", TwoTanks(), {"output": "other", "input": "valve"}, None, None),
    ("tanks, the valve at any sample", TwoTanks(), {"input": "valve"}, 1, 2.0),
    ("late tanks", PAST, {"k": 0}, 5, 0.125),
    ("late tanks, other output", PAST, {"k": 0, "output": "other"}, 4, 1.0),
    ("late tanks, valve opened in time", PAST, {"k": 1, "input": "valve"}, 4, 2.0),
    ("late tanks, valve opened too late", PAST, {"k": 2, "input": "valve"}, None, None),
    ("no dead time", Transfer(), {"k": 0}, 1, 1 - np.exp(-0.2)),
    ("one sample", Delayed(plant=Transfer(), dead_time=0.2), {"k": 0}, 2, 1 - np.exp(-0.2)),
    ("five samples", Delayed(plant=Transfer(), dead_time=1.0), {}, 6, 1 - np.exp(-0.2)),
    ("beyond the limit", Delayed(plant=Transfer(), dead_time=4.0), {"limit": 10}, None, None),
    ("at the limit", Delayed(plant=Transfer(), dead_time=4.0), {"limit": 21}, 21, 1 - np.exp(-0.2)),
    ("switched, long", SWITCHED, {"k": 0}, 4, 1 - np.exp(-0.2)),
    ("switched, short", SWITCHED, {"k": 10}, 2, 1 - np.exp(-0.2)),
    ("switched, sent while it shortens", SWITCHED, {"k": 9}, 2, 1 - np.exp(-0.2)),
    ("switched, last", SWITCHED, {"k": 25}, 3, 1 - np.exp(-0.2)),
    ("switched, at some sample", SWITCHED, {}, 2, None),
]


@pytest.mark.parametrize(("case", "plant", "asked", "degree", "slope"), DEGREES, ids=[row[0] for row in DEGREES])
def test_relative_degree(case, plant, asked, degree, slope):
    assert plant.relative_degree(**asked) == degree
    found = plant.first_effect(**asked)
    if degree is None:
        assert found is None
        return
    assert found.degree == degree
    if slope is not None:
        assert found.slope_at_rest == pytest.approx(slope, rel=1e-12) and found.shown
    # against trials of the compiled step, one of them with another input at sample k
    step, output = plant.step_function(), plant.output_function()
    row = [signal.name for signal in plant.outputs].index(asked.get("output", plant.outputs[0].name))
    column = [signal.name for signal in plant.inputs].index(asked.get("input", plant.inputs[0].name))
    start = asked.get("k", 10 if "some sample" in case else 0)
    seen = []
    for change in (0.0, 1.0):
        x, u, y = np.linspace(0.1, 0.9, len(plant.states)), np.full((len(plant.inputs), degree), 0.3), []
        u[column, 0] += change
        for i in range(degree):
            x = step(x, u[:, i], [], start + i)
            y.append(float(output(x)[row]))
        seen.append(np.array(y))
    change = seen[1] - seen[0]
    assert (change[:-1] == 0).all() and change[-1] != 0
    given = {"x": np.linspace(0.1, 0.9, len(plant.states)), "u": np.full((len(plant.inputs), degree), 0.3)}
    given |= {} if "k" in asked else {"k": start}
    assert float(found.slope(**given)["dy_du"]) == pytest.approx(change[-1], rel=1e-5)


@pytest.mark.parametrize(
    ("form", "degree", "shown"),
    [("folded", 2, True), ("times 0", 2, True), ("cancels", 1, False), ("scaled", 1, False), ("stairs", 1, True)],
)
def test_a_structural_degree_says_where_it_may_be_too_small(form, degree, shown):
    found = Cancelling(form=form).first_effect()
    assert (found.degree, found.shown) == (degree, shown)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"output": "speed"}, "output must be one of: level, other; got 'speed'"),
        ({"input": "force"}, "input must be one of: pump, valve; got 'force'"),
        ({"k": 1.5}, "k must be a whole number, or left out for every sample, got 1.5"),
        ({"k": True}, "k must be a whole number"),
    ],
)
def test_a_relative_degree_of_nothing_is_refused(asked, message):
    with pytest.raises(InvalidValue, match=message):
        TwoTanks().relative_degree(**asked)


def simpson(profile, front, length):
    """Average a piecewise constant profile over a train by a fine midpoint rule."""
    s = front - length + (np.arange(20_000) + 0.5) / 20_000 * length
    starts, values = np.array(profile.grade_starts_m), np.array(profile.grade_permille)
    return values[np.searchsorted(starts, s, side="right")].mean()


@pytest.mark.parametrize("front", [0, 300, 599, 601, 650, 740, 741, 1000, 1139, 1800, 2370, 3100, 3500])
def test_grades_are_averaged_over_the_train(front):
    mean = float(ca.DM(HILLY.mean_grade(ca.DM(front), 140.0)))
    assert mean == pytest.approx(simpson(HILLY, front, 140.0), abs=2e-3)
    force = float(ca.DM(PointMass().slope_force(ca.DM(front))))
    assert force == pytest.approx(350_000 * 9.81 * mean / 1000, rel=1e-12, abs=1e-9)


def test_lines_are_as_specified():
    at = [0, 599, 601, 1099, 1101, 1699, 1701, 2299, 2301, 2999, 3001, 9000]
    grades = [float(ca.DM(HILLY.grade(ca.DM(s)))) for s in at]
    assert grades == [0, 0, 6, 6, -4, -4, 3, 3, -8, -8, 0, 0]
    assert [float(ca.DM(FLAT.grade(ca.DM(s)))) for s in at] == [0] * len(at)
    with pytest.raises(InvalidValue, match="must rise"):
        Line(grade_starts_m=(2, 1), grade_permille=(0, 1, 2))


@pytest.mark.parametrize("case", ["metro", "seconds", "pendulum"])
def test_state_space_is_the_linearisation(case):
    plant, x, u, w, k = POINTS[case]
    linear = plant.linearised(x, u, w, k)
    assert isinstance(linear, control.StateSpace)
    assert linear.dt == plant.sampling_time
    assert linear.state_labels == [signal.name for signal in plant.states]
    assert linear.output_labels == [signal.name for signal in plant.outputs]
    assert linear.input_labels == [signal.name for signal in (*plant.inputs, *plant.disturbances)]
    step, output = plant.step_function(), plant.output_function()
    forced = np.array([*u, *w])
    split = len(u)
    a = difference(lambda z: step(z, u, w, k).full().ravel(), x, 1.0)
    b = difference(lambda z: step(x, z[:split], z[split:], k).full().ravel(), forced, 1.0)
    c = difference(lambda z: output(z).full().ravel(), x, 1.0)
    np.testing.assert_allclose(linear.A, a, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(linear.B, b, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(linear.C, c, rtol=1e-6, atol=1e-9)
    assert not linear.D.any()


@pytest.mark.parametrize("given", [np.array, list, tuple], ids=lambda kind: kind.__name__)
def test_a_point_may_be_given_as_any_row(given):
    plant, x, u, w, k = POINTS["pendulum"]
    assert w
    linear = plant.linearised(given(x), given(u), given(w), k)
    np.testing.assert_array_equal(linear.A, plant.linearised(x, u, w, k).A)
    still = plant.linearised(given(x), given(u), given([]), k)
    np.testing.assert_array_equal(still.A, plant.linearised(x, u, k=k).A)


def test_references_that_are_arrays_can_be_compared():
    one, same, other = (Given(values=np.array([0.0, 1.0, last])) for last in (2.0, 2.0, 3.0))
    assert one == same and one != other and hash(one) == hash(same)


def test_linearised_needs_a_full_point():
    with pytest.raises(InvalidValue, match=r"x must have 2 value\(s\), got 1"):
        PointMass().linearised([1.0], [0.0])


def test_reference_is_continuous_and_begins_and_ends_at_rest():
    k = np.array([338, 700, 1000, 1600])
    np.testing.assert_allclose(metro_speed(k + 1e-9), metro_speed(k), atol=1e-6)
    assert metro_speed(0) == pytest.approx(0, abs=1e-12)
    assert metro_speed(2000) == pytest.approx(0, abs=1e-12)
    assert metro_speed(np.arange(2001)).max() == pytest.approx(72.0)
    slow = MetroProfile().samples(PointMass(reading="seconds"))
    fast = MetroProfile().samples(PointMass())
    assert slow.shape == (1, 20_001)
    late = Delayed(plant=PointMass(reading="seconds"), dead_time=0.2)
    np.testing.assert_array_equal(MetroProfile().samples(late), slow)
    np.testing.assert_allclose(slow[0, ::10], fast[0], atol=1e-9)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"mass": 0}, r"mass must lie in \(0, ∞\) kg, got 0"),
        ({"mass": float("nan")}, "mass must be a finite number"),
        ({"mass": "heavy"}, "mass must be a number"),
        ({"mass": True}, "mass must be a number"),
        ({"mass": np.zeros(3)}, "mass must be a number"),
        ({"reading": "wrong"}, "reading must be one of metro | seconds | printed"),
        ({"line": [1, 2]}, "line must be one of hilly | flat"),
        ({"line": None}, "line must be one of hilly | flat"),
    ],
)
def test_ranges_are_checked_when_a_plant_is_made(fields, message):
    with pytest.raises(InvalidValue, match=message.replace("|", r"\|")):
        PointMass(**fields)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ((1, 2), r"must give 1 value\(s\) \(speed\), got shape \(2, 1\)"),
        ("abc", "got 'abc'"),
        (None, "got None"),
        (np.zeros((2, 2)), r"got shape \(2, 2\)"),
    ],
)
def test_a_step_of_the_wrong_shape_is_refused(given, message):
    @declared
    class Cart(Plant):
        inputs = signals(force="N")
        states = outputs = signals(speed="m/s")
        sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)

        def step(self, x, u, w, k):
            return given

        def output(self, x):
            return (x.speed,)

    with pytest.raises(InvalidValue, match=message):
        Cart().step_function()
