"""Actuator wrappers against plain loops: an integrator behind each shows the input that acted."""

from __future__ import annotations

import copy
import math
import pickle
from typing import Any

import casadi as ca
import numpy as np
import pytest

from models.actuator import Actuator, Delayed, Lagged, RateLimited, Saturated, delayed
from models.plant import Plant, signals
from models.point_mass import PointMass
from models.quantity import InvalidValue, declared, quantity, rebuilt, symbolised
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
    (Delayed(plant=Sum(), dead_time=0.3), late),
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
    plant = Delayed(plant=PointMass(), dead_time=0.2)
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
        (lambda: Delayed(plant=Sum(), dead_time=0), r"dead_time must lie in \(0, ∞\) s, got 0"),
        (lambda: Delayed(plant=Sum(), dead_time=0.25), r"dead_time must be a multiple of the sampling time of 0\.1 s"),
        (
            lambda: Delayed(plant=Sum(), samples=3),
            r"Delayed takes dead_time in seconds, got samples=3: give dead_time = samples \* sampling_time",
        ),
        (
            lambda: Delayed(plant=Sum(sampling_time=ca.SX.sym("T")), dead_time=0.3),
            "dead_time shapes the equations: give the sampling time as a number",
        ),
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


def test_a_dead_time_keeps_its_samples_while_the_sampling_time_is_a_symbol():
    plant = Delayed(plant=PointMass(), dead_time=0.3)
    assert plant.samples == 3 and Delayed(plant=Sum(sampling_time=0.05), dead_time=0.3).samples == 6
    symbolic = symbolised(plant)
    assert "plant.sampling_time" in symbolic.names and symbolic.thing.samples == 3
    assert [one.name for one in symbolic.thing.states] == [one.name for one in plant.states]
    moved = rebuilt(plant, {"dead_time": 0.5})
    assert moved.samples == 5 and len(moved.states) == 7 and copy.copy(moved) == pickle.loads(pickle.dumps(moved))
    with pytest.raises(InvalidValue, match="dead_time shapes the equations"):
        rebuilt(symbolic.thing, {"dead_time": 0.5})
    slope = plant.derivative("plant.sampling_time")([20.0, 500.0, 1e5, 0, 0], 2e5, [], 0)
    assert float(slope[1]) == pytest.approx(20 / 3.6)


@declared
class Sums(Plant):
    states = outputs = signals(one="1", two="1")
    inputs = signals(push="N", pull="N")
    sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)

    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        return x.one + u.push, x.two + u.pull

    def output(self, x: Any) -> Any:
        return x.vector


def moved(commands, rate):
    out, value = [], 0.0
    for command in commands:
        value += min(max(command - value, -rate * 0.1), rate * 0.1)
        out.append(value)
    return out


def clipped(commands, lower, upper):
    return [min(max(c, lower), upper) for c in commands]


PER_INPUT = [
    ({"lower": (-1, -2), "upper": (3.0, 0.5)}, lambda a, b: (clipped(a, -1, 3), clipped(b, -2, 0.5))),
    ({"lower": [-1, -2]}, lambda a, b: (clipped(a, -1, math.inf), clipped(b, -2, math.inf))),
    ({"lower": np.array([-1, -2]), "upper": 1}, lambda a, b: (clipped(a, -1, 1), clipped(b, -2, 1))),
    ({"upper": (None, 0.5)}, lambda a, b: (list(a), clipped(b, -math.inf, 0.5))),
    ({"rate": (7, 30)}, lambda a, b: (moved(a, 7), moved(b, 30))),
    ({"rate": (None, 30)}, lambda a, b: (list(a), moved(b, 30))),
    (
        {"rate": (7, 30), "lower": -1, "delay": 0.1},
        lambda a, b: (
            [0.0, *moved(clipped(a, -1, math.inf), 7)[:-1]],
            [0.0, *moved(clipped(b, -1, math.inf), 30)[:-1]],
        ),
    ),
]


@pytest.mark.parametrize(("fields", "oracle"), PER_INPUT)
def test_limits_may_differ_by_input(fields, oracle):
    plant = Actuator(**fields).wrapped(Sums())
    step, x, acted = plant.step_function(), ca.DM.zeros(len(plant.states)), []
    commands = np.stack([COMMANDS, COMMANDS[::-1]])
    for command in commands.T:
        told = plant.applied_input(x, ca.DM(command), 0)
        after = step(x, command, [], 0)
        acted.append((after[:2] - x[:2]).full().ravel())
        np.testing.assert_allclose(np.array(told).ravel(), acted[-1], atol=1e-9)
        x = after
    np.testing.assert_allclose(np.array(acted).T, oracle(*commands), atol=1e-9)


@pytest.mark.parametrize(
    ("plant", "limits"),
    [
        (Saturated(plant=Sums(), lower=(-1, -2), upper=4), ([-1, -2], [4, 4], [np.inf, np.inf])),
        (Saturated(plant=Sums(), lower=(None, -2)), ([-np.inf, -2], [np.inf] * 2, [np.inf] * 2)),
        (
            Saturated(plant=Saturated(plant=Sums(), upper=(1, 5)), upper=3.0),
            ([-np.inf] * 2, [1, 3], [np.inf] * 2),
        ),
        (
            Saturated(plant=RateLimited(plant=Sums(), rate=(2, 3)), upper=(3.0, 1)),
            ([-np.inf] * 2, [3, 1], [2, 3]),
        ),
        (RateLimited(plant=RateLimited(plant=Sums(), rate=(2, 3)), rate=2.5), ([-np.inf] * 2, [np.inf] * 2, [2, 2.5])),
    ],
)
def test_limits_are_told_by_input(plant, limits):
    told = [np.broadcast_to(np.array(ca.DM(one)).ravel(), 2) for one in plant.input_limits]
    np.testing.assert_array_equal(told, limits)
    half = [np.broadcast_to(np.array(ca.DM(one)).ravel(), 2) for one in plant.input_limits.scaled(2.0)]
    np.testing.assert_array_equal(half, np.array(limits) / 2)


def test_a_row_of_one_is_a_number():
    assert Saturated(plant=Sum(), lower=(-1,), upper=(2,)).input_limits == (-1.0, 2.0, math.inf)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Saturated(plant=Sums(), lower=(1, 2, 3)), r"lower must be one number, or one an input \(2\), got 3"),
        (lambda: RateLimited(plant=Sums(), rate=(1,)), r"rate must be one number, or one an input \(2\), got 1"),
        (lambda: Saturated(plant=Sums(), lower=(0, 3), upper=(1, 2)), "lower must lie below upper"),
        (lambda: Saturated(plant=Sums(), lower=(0, 3), upper=2), "lower must lie below upper"),
        (lambda: Actuator(lower=("a", 1)), r"lower\[0\] must be a number in \(-∞, ∞\) or null, got 'a'"),
        (lambda: Actuator(rate=(1, 0)), r"rate\[1\] must lie in \(0, ∞\) or null input units/s, got 0"),
        (lambda: Actuator(lower=()), "lower must be a number in .*got an empty row"),
        (lambda: Actuator(lag=(1, 2)), "lag must be a number in"),
        (lambda: Actuator(lower=np.zeros((2, 2))), "lower must be a number in"),
    ],
)
def test_bad_limits_by_input_are_refused(make, message):
    with pytest.raises(InvalidValue, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)
