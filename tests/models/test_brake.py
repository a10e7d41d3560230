"""The braking train against closed forms and another integrator."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from models.brake import Brake, Halting, Motion
from models.braking_curve import BrakingCurve
from models.quantity import InvalidValue
from studies.stopping.brake_model import brake_model, reference_state

TAU, T, C = 0.4, 0.2, -1.07


def grade(s):
    return 12 if s < 150 else 28 if s < 300 else -6


def resistance(v, s):
    V = 3.6 * v
    return (5.4 + 0.0098 * V + 0.00163 * V * V) / 1000 + 9.81 * grade(s) / 1000


def closed_form(tau, T, c):
    phi = math.exp(-T / tau)
    A = np.array(
        [
            [phi, c * (1 - phi), 0, 0],
            [0, 1, 0, 0],
            [tau * (1 - phi), c * (T - tau * (1 - phi)), 1, 0],
            [tau * T - tau**2 * (1 - phi), c * (T * T / 2 - tau * T + tau**2 * (1 - phi)), T, 1],
        ]
    )
    return A, A[:, 1], np.array([0, 0, -T, -T * T / 2])


@pytest.mark.parametrize(("tau", "T", "c"), [(0.4, 0.2, -1.07), (0.9, 0.1, -0.8), (0.05, 0.5, -1.2)])
def test_sampled_model_is_the_closed_form(tau, T, c):
    brake = Brake(lag=tau, sampling_time=T, full_brake=c, dead_time=2 * T)
    for found, expected in zip(brake_model(brake), closed_form(tau, T, c), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-13)


def test_euler_model_is_the_paper_s():
    phi = math.exp(-T / TAU)
    A, b, E = brake_model(Brake(), "euler")
    np.testing.assert_allclose(A, [[phi, C * (1 - phi), 0, 0], [0, 1, 0, 0], [T, 0, 1, 0], [0, 0, T, 1]], atol=1e-14)
    np.testing.assert_allclose(b, [C * (1 - phi), 1, 0, 0], atol=1e-14)
    np.testing.assert_allclose(E, [0, 0, -T, 0], atol=1e-14)


def test_the_exact_model_carries_the_reference_and_euler_does_not():
    brake, curve = Brake(), BrakingCurve()
    for method, gap in (("zoh", 0.0), ("euler", T * T / 2 * 0.5)):
        A = brake_model(brake, method).A
        for k in (0, 7, 199, 230):
            missed = A @ reference_state(brake, curve, k) - reference_state(brake, curve, k + 1)
            np.testing.assert_allclose(missed, [0, 0, 0, gap], atol=1e-9)
    np.testing.assert_allclose(reference_state(brake, curve, 10), [-0.5, 0.5 / 1.07, 19.0, 39.0])
    assert (curve.stop_time, curve.stop_position) == (40.0, 400.0)
    speeds = curve.samples(brake)
    assert speeds.shape == (1, 201) and speeds[0, -1] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("start", [(-0.5, 20.0, 0.0), (-0.2, 12.0, 200.0), (-0.9, 5.0, 310.0), (0.0, 18.0, 149.0)])
def test_step_against_another_integrator(start):
    brake, commands = Brake(), [0.3, 0.9, 0.1, 0.6, 0.2]
    step = brake.step_function()
    x = np.array([*start, *reversed(commands)])
    motion = np.array(start)
    for now in (0.5, 0.7, 0.0):
        acting = commands[0]
        left = solve_ivp(
            lambda t, y, acting=acting: [(C * acting - y[0]) / TAU, y[0] - resistance(y[1], y[2]) - 0.02, y[1]],
            (0, T),
            motion,
            rtol=1e-10,
            atol=1e-12,
            max_step=0.001,
        )
        motion = left.y[:, -1]
        x = step(x, now, 0.02, 0).full().ravel()
        commands = [*commands[1:], now]
        crossing = start[2] < 150 < start[2] + 12  # a jump of the grade inside a fine step
        np.testing.assert_allclose(x[:3], motion, atol=2e-3 if crossing else 1e-7)
        np.testing.assert_allclose(x[3:], commands[::-1])


def test_blocks_replace_the_resistance_of_the_line():
    brake = Brake(blocks=(0.1, 0.2, -0.05), block_length=50.0)
    values = [float(brake.resistance(20.0, s)) for s in (-5, 0, 49.9, 50, 99.9, 100, 500)]
    np.testing.assert_allclose(values, [0.1, 0.1, 0.1, 0.2, 0.2, -0.05, -0.05])
    for v, s in ((20, 10), (5, 200), (0, 400)):
        assert float(Brake().resistance(v, s)) == pytest.approx(resistance(v, s))


def test_rates_and_dead_time():
    brake = Brake()
    at = brake.symbols()
    assert [str(name) for name in brake.rates(Motion(0, 0, 0), 0, 0)._fields] == ["acceleration", "speed", "position"]
    assert brake.relative_degree() == 6 and len(at["x"].elements()) == 8


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"dead_time": 0.5}, "dead_time must be a whole number of sampling_time = 0.2 s, got 0.5 s"),
        ({"sampling_time": 0.205, "dead_time": 0.0}, "sampling_time must be a whole number of fine_step = 0.01 s"),
        ({"lag": 0.0}, r"lag must lie in \(0, ∞\) s, got 0"),
        ({"full_brake": 1.0}, "full_brake must lie in"),
        ({"blocks": ()}, "blocks must hold at least one number, got none"),
        ({"blocks": (float("nan"),)}, "blocks must hold finite numbers only"),
    ],
)
def test_bad_brakes_are_told(change, message):
    with pytest.raises(InvalidValue, match=message):
        Brake(**change)


def stand_by_a_loop(a, v, s, commands, substeps=20, h=0.01):
    """Fine steps by a plain loop until the train stands: motion, running time and largest jerk of the sample."""
    acting, ran, jerk = commands[-1], 0.0, 0.0
    for _ in range(substeps):
        if v <= 0:
            break

        def rates(a, v, s):
            return (C * acting - a) / TAU, a - resistance(v, s), v

        k1 = rates(a, v, s)
        jerk = max(jerk, abs(k1[0]))
        k2 = rates(*(x + h / 2 * k for x, k in zip((a, v, s), k1, strict=True)))
        k3 = rates(*(x + h / 2 * k for x, k in zip((a, v, s), k2, strict=True)))
        k4 = rates(*(x + h * k for x, k in zip((a, v, s), k3, strict=True)))
        steps = [(p + 2 * q + 2 * r + w) / 6 for p, q, r, w in zip(k1, k2, k3, k4, strict=True)]
        after = [x + h * d for x, d in zip((a, v, s), steps, strict=True)]
        share = min(1.0, v / (v - after[1])) if after[1] <= 0 else 1.0
        a, v, s = (x + share * (y - x) for x, y in zip((a, v, s), after, strict=True))
        v, ran = 0.0 if share < 1 or v <= 0 else v, ran + share * h
    return a, v, s, ran, jerk


@pytest.mark.parametrize("speed", [20.0, 0.08, 0.05, 0.001, 0.0])
def test_a_train_halts_where_it_stands(speed):
    train, commands = Halting(), [0.2, 0.3, 0.4, 0.5, 0.6]
    step = train.step_function()
    x = step([-0.5, speed, 390.0, *commands, 3.0, 9.0], 0.1, 0, 0).full().ravel()
    a, v, s, ran, jerk = stand_by_a_loop(-0.5, speed, 390.0, commands)
    np.testing.assert_allclose(x[:3], [a, v, s], atol=1e-12)
    np.testing.assert_allclose(x[3:8], [0.1, *commands[:4]])
    np.testing.assert_allclose(x[8:], [3.0 + ran, jerk], atol=1e-12)
    assert bool(train.ended_at(ca.DM(x))) == (speed < 1) and (speed < 1) == (ran < T - 1e-9)
    if speed < 1:  # it stays where it stands
        again = step(x, 0.9, 0, 1).full().ravel()
        np.testing.assert_array_equal(again[:3], x[:3])
        assert again[8] == x[8] and again[9] == 0
        assert np.isfinite(train.derivative("x")(x, 0.1, 0, 0).full()).all()
    else:
        running = train.plant.step_function()([-0.5, speed, 390.0, *commands], 0.1, 0, 0).full().ravel()
        np.testing.assert_allclose(x[:3], running[:3], rtol=1e-14)


def test_signals_of_a_halting_train():
    train = Halting()
    assert [(one.name, one.unit, one.role) for one in train.outputs] == [
        ("speed", "m/s", "speed"),
        ("position", "m", "position"),
    ]
    assert [one.name for one in train.states if one.recorded] == [
        *("acceleration", "speed", "position"),
        *("running_time", "peak_jerk"),
    ]
    assert train.ends and train.relative_degree() == 6
