"""Scales of a task: the exact slope at the relative degree, units of speed, and what a law makes of them."""

from __future__ import annotations

import dataclasses

import casadi as ca
import numpy as np
import pytest

from models.actuator import Actuator, Delayed
from models.expression import as_expression
from models.metro_profile import MetroProfile
from models.plant import Plant, signal, signals
from models.point_mass import PointMass
from models.quantity import InvalidValue, count, declared, given, quantity
from models.vehicle import Vehicle
from workbench.contracts.law import Task
from workbench.contracts.settings import rows
from workbench.contracts.study import Study
from workbench.controllers.parts.scales import scales
from workbench.controllers.pid import PID
from workbench.design.library import LIBRARY
from workbench.trials.campaign import run

SPEEDS = {"m/s": 1.0, "km/h": 3.6, "mm/s": 1000.0}
"""How many of a unit one m/s is."""


@declared
class Tank(Plant):
    """x+ = a x + b u^power, y = 2 x."""

    states = signals(level="m")
    inputs = signals(valve="1")
    outputs = signals(seen="V")
    a: float = quantity(default=0.9, unit="1", doc="decay")
    b: float = quantity(default=0.05, unit="m", doc="slope")
    power: int = count(default=1, doc="power of the input")
    sampling_time: float = quantity(default=0.5, unit="s", doc="sampling time", above=0)

    def step(self, x, u, w, k):
        return (self.a * x.level + self.b * u.valve**self.power * (1 if self.power == 1 else x.level),)

    def output(self, x):
        return (2 * x.level,)


def task(plant, largest=4.0):
    reference = np.array([np.linspace(0, -largest, 31)])
    return Task(as_expression(ca.DM(reference)), as_expression(ca.DM(plant.sampling_time)), model=plant)


@pytest.mark.parametrize(
    ("plant", "step", "decay"),
    [
        (Tank(), 1 / 0.1, 0.9),
        (Tank(b=-0.05), -1 / 0.1, 0.9),
        (Delayed(plant=Tank(), dead_time=1.5), 1 / 0.1, 0.9),
        (PointMass(), 350_000 / 0.36, 1 - 0.36 / 350_000 * (25.17 + 2 * 0.2864 * 2.0)),
    ],
    ids=["plain", "negative", "behind dead time", "a mass"],
)
def test_scales_are_those_of_the_equations(plant, step, decay):
    found = scales(task(plant))
    assert found.step == pytest.approx(step) and found.rate == pytest.approx(step * plant.sampling_time)
    assert found.largest == 4.0 and found.decay == pytest.approx(decay, rel=1e-12)


def test_the_slope_is_that_of_finite_differences():
    plant = Delayed(plant=Tank(), dead_time=1.0)
    step, out, h = plant.step_function(), plant.output_function(), 1e-6

    def third(u):
        x = [0.3, 0.0, 0.0]
        for k in range(3):
            x = step(x, u if k == 0 else 0.0, [], k)
        return float(out(x))

    assert 1 / scales(task(plant)).step == pytest.approx((third(h) - third(-h)) / (2 * h))


def test_a_plant_whose_input_does_nothing_is_refused():
    with pytest.raises(InvalidValue, match=r"valve of tank must reach seen within 30 samples.*no effect"):
        scales(task(Tank(b=0.0, power=0)))
    with pytest.raises(InvalidValue, match="a slope that is finite and not 0, got 0"):
        scales(task(Tank(power=2)))


@declared
class Wagon(Vehicle):
    """A mass whose speed is told in a unit of choice, behind limits."""

    unit: str = given(default="m/s", doc="unit of the speed")
    mass: float = quantity(default=1000.0, unit="kg", doc="mass", above=0)
    sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)
    states = signals(v="m/s")
    inputs = signals(force="N")

    @property
    def outputs(self):
        return signals(speed=signal(self.unit, "speed", role="speed"))

    def step(self, x, u, w, k):
        return (x.v + self.sampling_time / self.mass * (u.force - self.resistance_at(x.v)),)

    def output(self, x):
        return (SPEEDS.get(self.unit, 1.0) * x.v,)

    def resistance_at(self, speed):
        return 50 * speed


@pytest.mark.parametrize("name", [name for name, make in LIBRARY.items() if make().estimator is None])
@pytest.mark.parametrize("unit", ["km/h", "mm/s"])
def test_a_law_does_the_same_in_every_unit_of_speed(name, unit):
    """A law of the library that is scaled for a plant gives the same force whatever the speed is counted in.

    Not so the laws with an estimate: their mu and eps are absolute, in the input that makes one output unit a second.
    """
    forces = []
    for one in ("m/s", unit):
        plant, factor = Wagon(unit=one), SPEEDS[one]
        reference = factor * 10 * np.sin(np.linspace(0, 2, 41))
        study = Study(
            plant=plant,
            reference=reference,
            controllers={"pid": PID()},
            trials=3,
            actuator=Actuator(lower=-2e4, upper=2e4),
        )
        law = LIBRARY[name]().scaled_for(study.task())
        done = run(dataclasses.replace(study, controllers={"law": law}), show_progress=False)
        forces.append(done.data["input"].values)
    largest = np.nanmax(np.abs(forces[0]))
    assert largest > 0
    np.testing.assert_allclose(forces[1], forces[0], rtol=1e-6, atol=1e-6 * largest)


def test_channels_are_scaled_by_their_mean():
    import control

    system = control.ss(np.diag([0.9, 0.8]), np.diag([0.2, 0.05]), np.eye(2), 0, 0.1)
    study = Study(plant=Plant.from_control(system), reference=np.ones((2, 9)), controllers={"pid": PID()})
    found = scales(study.task())
    assert found.step == pytest.approx(np.sqrt(5 * 20)) and found.rate == pytest.approx(0.1 * np.sqrt(5 * 20))
    assert found.decay == pytest.approx(np.sqrt(0.9 * 0.8)) and found.largest == pytest.approx(1.0)
    assert PID().scaled_for(study.task()).input_unit == found.rate


def test_ranges_hold_what_a_scaled_law_begins_with():
    limits = Actuator(lower=-450e3, upper=450e3)
    study = Study(plant=PointMass(), reference=MetroProfile(horizon=50), controllers={"pid": PID()}, actuator=limits)
    for name, make in LIBRARY.items():
        law = make().scaled_for(study.task())
        ranges = law.ranges(study.task())
        first = {row.path: row.value for row in rows(law)}
        assert law.stepped or ranges
        assert all(low <= first[at] <= high for at, (low, high) in ranges.items()), name
