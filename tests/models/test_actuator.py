"""Actuator wrappers against plain loops: an integrator behind each shows the input that acted."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np
import pytest

from models.actuator import Actuator, Delayed, Lagged, RateLimited, Saturated, delayed
from models.plant import Plant, signals
from models.point_mass import PointMass
from models.quantity import InvalidValue, declared, quantity
from workbench.contracts.record import TrialInput
from workbench.controllers import ICFDL
from workbench.fold.fold import build, stream

COMMANDS = np.random.default_rng(3).normal(0, 5, 60)


@declared
class Sum(Plant):
    states = signals(total="1")
    inputs = signals(force="N")
    outputs = signals(total="1")
    sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)

    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        return (x.total + u.force,)

    def output(self, x: Any) -> Any:
        return (x.total,)


def late(commands):
    return [0.0] * 3 + list(commands[:-3])


def lagged(commands):
    out, value = [], 0.0
    for command in commands:
        fine = [command + (value - command) * math.exp(-(i + 0.5) / 1000 * 0.1 / 0.4) for i in range(1000)]
        out.append(sum(fine) / 1000)
        value = command + (value - command) * math.exp(-0.1 / 0.4)
    return out


def cut(commands):
    return [min(max(c, -4.0), 2.0) for c in commands]


def slow(commands):
    out, value = [], 0.0
    for command in commands:
        value += min(max(command - value, -0.7), 0.7)
        out.append(value)
    return out


CASES = [
    (Delayed(plant=Sum(), samples=3), late),
    (delayed(Sum(), 0.3), late),
    (Lagged(plant=Sum(), time_constant=0.4), lagged),
    (Saturated(plant=Sum(), lower=-4, upper=2), cut),
    (RateLimited(plant=Sum(), rate=7), slow),
    (Actuator().wrapped(Sum()), list),
    (
        Actuator(lag=0.4, delay=0.3, lower=-4, upper=2, rate=7).wrapped(Sum()),
        lambda c: lagged(late(slow(cut(c)))),
    ),
]


@pytest.mark.parametrize(("plant", "oracle"), CASES)
def test_the_input_that_acts_is_that_of_a_plain_loop(plant, oracle):
    step = plant.step_function()
    x = ca.DM.zeros(len(plant.states))
    acted, told = [], []
    for command in COMMANDS:
        told.append(float(plant.applied_input(x, ca.DM(command), 0)))
        after = step(x, command, [], 0)
        acted.append(float(after[0] - x[0]))
        x = after
    np.testing.assert_allclose(acted, oracle(COMMANDS), rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(told, acted, rtol=1e-9, atol=1e-9)


def test_the_fold_runs_a_wrapped_plant_as_it_runs_the_bare_one():
    reference = np.linspace(0, 10, 31)[None, :]
    inputs = [TrialInput(30, np.zeros(2), np.zeros((0, 30)), np.zeros((1, 31)))] * 3
    bare = list(stream(build(PointMass(), ICFDL(), 30), reference, inputs))
    plant = Delayed(plant=PointMass(), samples=2)
    wider = [one._replace(x0=np.zeros(4)) for one in inputs]
    late = list(stream(build(plant, ICFDL(), 30), reference, wider))
    assert np.abs(late[0].y[0, 2:] - bare[0].y[0, 2:]).max() > 0
    longer = list(stream(build(Saturated(plant=PointMass(), upper=1e9), ICFDL(), 30), reference, inputs))
    np.testing.assert_allclose(longer[-1].y, bare[-1].y, rtol=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: delayed(Sum(), 0.25), r"delay must be a multiple of the sampling time of 0\.1 s"),
        (lambda: delayed(Sum(), -0.1), "delay must be a multiple"),
        (lambda: Actuator(delay=0.25).wrapped(Sum()), r"actuator\.delay must be a multiple"),
        (lambda: Actuator(lag=-1), r"lag must lie in \[0, ∞\) s, got -1"),
        (lambda: Saturated(plant=Sum(), lower=2, upper=1), "lower must lie below upper"),
        (lambda: RateLimited(plant=Sum(), rate=0), "rate must lie in"),
        (lambda: Lagged(plant=Sum(), time_constant=0), "time_constant must lie in"),
        (lambda: Delayed(plant=Sum(), samples=0), "samples must lie in"),
    ],
)
def test_bad_actuators_are_refused_in_one_line(make, message):
    with pytest.raises(InvalidValue, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_derivatives_go_through_the_wrappers():
    plant = Lagged(plant=PointMass(), time_constant=0.4)
    slope = plant.derivative("u")
    h, x, u = 10.0, [20.0, 500.0, 1e5], 2e5
    step = plant.step_function()
    numeric = (step(x, u + h, [], 0) - step(x, u - h, [], 0)) / (2 * h)
    np.testing.assert_allclose(slope(x, u, [], 0), numeric, rtol=1e-6)
    assert float(plant.derivative("time_constant")(x, u, [], 0)[2]) != 0
