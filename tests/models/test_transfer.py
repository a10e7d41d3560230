"""Transfer-function plants and dead times against analytic responses and plain loops."""

from __future__ import annotations

import control
import flint
import numpy as np
import pytest
from scipy import signal

from models.actuator import delayed
from models.quantity import InvalidValue
from models.switched_delay import SwitchedDelay
from models.transfer import Transfer


def response(plant, inputs):
    step, output = plant.step_function(), plant.output_function()
    x, left = np.zeros(len(plant.states)), []
    for k, u in enumerate(inputs):
        left.append(float(output(x)))
        x = step(x, u, [], k)
    return np.array([*left, float(output(x))])


T = np.arange(41) * 0.2
ANALYTIC = [
    ((0.5,), (1.0, 1.0), 0.5 * (1 - np.exp(-T))),
    ((3.0,), (2.0, 4.0), 0.75 * (1 - np.exp(-2 * T))),
    ((1.0,), (1.0, 3.0, 2.0), 0.5 - np.exp(-T) + 0.5 * np.exp(-2 * T)),
    ((1.0,), (1.0, 0.0, 0.0), T**2 / 2),
    ((0.0, 1.0), (1.0, 0.0), T),
]


@pytest.mark.parametrize(("numerator", "denominator", "expected"), ANALYTIC)
def test_step_response_is_analytic(numerator, denominator, expected):
    plant = Transfer(numerator=numerator, denominator=denominator, sampling_time=0.2)
    np.testing.assert_allclose(response(plant, np.ones(40)), expected, rtol=1e-10, atol=1e-10)


def test_any_held_input_gives_what_scipy_gives():
    numerator, denominator = [1.0, 2.0], [1.0, 1.2, 4.0, 0.5]
    inputs = np.random.default_rng(3).normal(size=60)
    plant = Transfer.of(control.TransferFunction(numerator, denominator), sampling_time=0.1, gain=2.0)
    a, b, c, _, _ = signal.cont2discrete(signal.tf2ss(numerator, denominator), 0.1)
    x, expected = np.zeros((3, 1)), []
    for u in [*inputs, 0.0]:
        expected.append(2.0 * float((c @ x).item()))
        x = a @ x + b * u
    np.testing.assert_allclose(response(plant, inputs), expected, rtol=1e-9, atol=1e-12)


def test_gain_has_a_sensitivity():
    slope = Transfer(numerator=(0.5,), gain=3.0).derivative("gain", of="y_next")
    x, u = 0.7, -1.2
    a = np.exp(-0.2)
    assert float(slope(x, u, [], 0)) == pytest.approx(0.5 * (a * x + (1 - a) * u), rel=1e-12)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"numerator": (1.0, 0.0), "denominator": (1.0, 1.0)}, "lower degree"),
        ({"denominator": (0.0, 0.0)}, "not 0"),
        ({"sampling_time": 0.0}, "sampling_time must lie in"),
        ({"numerator": "half"}, "row of numbers"),
        ({"denominator": (1e-16, 1.0, 1.0)}, "poles at most 1e.06 times as fast as the sampling, got one 2e.15 times"),
        ({"denominator": (1e-300, 1.0, 1.0)}, "leave the leading coefficient 1e-300 out"),
        ({"denominator": (5e-324, 1.0, 1.0)}, "got one inf times"),
        ({"denominator": (1.0, 0.0, 1e30)}, "poles at most"),
        ({"denominator": (1.0, 1.0), "sampling_time": 1.1e6}, "poles at most"),
        ({"denominator": (1.0, -4000.0)}, r"grow by finite factors a sample, got one by exp\(800\)"),
    ],
)
def test_bad_transfer_functions_are_refused(fields, message):
    with pytest.raises(InvalidValue, match=message):
        Transfer(**fields)


def exact_steps(numerator, denominator, sampling_time, samples):
    """Return the step response from the exponential of the controllable form with 700 digits."""
    before, flint.ctx.prec = flint.ctx.prec, 2400
    try:
        n = len(denominator) - 1
        flow = [[flint.arb(0)] * (n + 1) for _ in range(n + 1)]
        for j in range(n):
            flow[0][j] = -flint.arb(denominator[j + 1]) / flint.arb(denominator[0]) * flint.arb(sampling_time)
        for i in range(1, n):
            flow[i][i - 1] = flint.arb(sampling_time)
        flow[0][n] = flint.arb(sampling_time)
        step = flint.arb_mat(flow).exp()
        read = [flint.arb(0)] * (n - len(numerator)) + [flint.arb(one) / flint.arb(denominator[0]) for one in numerator]
        x, left = flint.arb_mat([[flint.arb(0)]] * n + [[flint.arb(1)]]), []
        for _ in range(samples + 1):
            left.append(float(sum((read[i] * x[i, 0] for i in range(n)), flint.arb(0)).mid()))
            x = step * x
        return np.array(left)
    finally:
        flint.ctx.prec = before


NEAR = [
    ((1.0, 1.0), 0.2),
    ((1.0, 2.0, 3.0), 0.2),
    ((1.0, 0.5, 0.3, 2.0), 0.2),
    ((1e-3, 0.01, 1.0), 1e-3),
    ((9.0, 1.0), 7.0),
]


@pytest.mark.parametrize(("share", "accurate"), [(1.001e-6, 1e-7), (1e-4, 1e-9), (1e-2, 1e-11)])
@pytest.mark.parametrize(("slow", "sampling_time"), NEAR)
def test_a_fast_pole_near_the_limit_is_accurate(slow, sampling_time, share, accurate):
    denominator = (share * sampling_time * slow[0], *slow)  # one pole at about -1/(share sampling_time)
    plant = Transfer(numerator=(1.0,), denominator=denominator, sampling_time=sampling_time)
    exact = exact_steps((1.0,), denominator, sampling_time, 40)
    assert np.abs(response(plant, np.ones(40)) - exact).max() < accurate * np.abs(exact).max()
    if share < 1e-5:
        with pytest.raises(InvalidValue, match="leave the leading coefficient"):
            Transfer(denominator=(0.9 * share * sampling_time * slow[0], *slow), sampling_time=sampling_time)


def test_the_exact_steps_are_those_of_an_analytic_response():
    np.testing.assert_allclose(exact_steps((0.5,), (1.0, 1.0), 0.2, 40), 0.5 * (1 - np.exp(-T)), rtol=1e-14)


def test_a_discrete_system_is_refused():
    with pytest.raises(InvalidValue, match="continuous"):
        Transfer.of(control.TransferFunction([1], [1, 0.5], 0.1))


def delay_of(k, schedule):
    return [delay for first, delay in schedule if first <= k][-1]


SCHEDULES = [((0, 5),), ((0, 5), (10, 4), (20, 5)), ((0, 1),), ((0, 1), (7, 3)), ((0, 2), (3, 5), (4, 1), (30, 4))]


@pytest.mark.parametrize("schedule", SCHEDULES)
def test_switched_delay_is_a_plain_loop(schedule):
    inputs = np.random.default_rng(5).normal(size=50)
    plant = SwitchedDelay(plant=Transfer(numerator=(0.5,)), schedule=schedule)
    a, y = np.exp(-0.2), [0.0]
    acted = []
    for k in range(50):
        due = k - delay_of(k, schedule)
        acted.append(inputs[due] if due >= 0 else 0.0)
        y.append(a * y[-1] + 0.5 * (1 - a) * acted[-1])
    np.testing.assert_allclose(response(plant, inputs), y, rtol=1e-10, atol=1e-12)
    step, x = plant.step_function(), np.zeros(len(plant.states))
    for k, u in enumerate(inputs):
        assert float(plant.applied_input(x, u, k)) == acted[k]
        x = step(x, u, [], k).full().ravel()


def test_a_constant_schedule_is_a_delay():
    inputs = np.random.default_rng(6).normal(size=30)
    bare = Transfer(numerator=(0.5,))
    switched = SwitchedDelay(plant=bare, schedule=((0, 5),))
    np.testing.assert_allclose(response(switched, inputs), response(delayed(bare, 1.0), inputs), rtol=0, atol=0)


@pytest.mark.parametrize("schedule", [(), ((1, 5),), ((0, 5), (0, 4)), ((0, 0),), ((0, 1.5),)])
def test_bad_schedules_are_refused(schedule):
    with pytest.raises(InvalidValue, match="schedule"):
        SwitchedDelay(plant=Transfer(), schedule=schedule)


def test_a_schedule_may_be_given_in_seconds():
    plant = Transfer()
    assert SwitchedDelay.in_seconds(plant, [(0, 1.0), (2.0, 0.8)]).schedule == ((0, 5), (10, 4))
    for schedule, what in (([(0, 0.5)], "dead times"), ([(0, 0.2), (0.5, 0.4)], "instants")):
        with pytest.raises(InvalidValue, match=f"schedule's {what} must be a multiple of the sampling time of 0.2 s"):
            SwitchedDelay.in_seconds(plant, schedule)
