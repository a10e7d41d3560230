"""Plants of python-control's systems against its own responses."""

from __future__ import annotations

import casadi as ca
import control
import numpy as np
import pytest

from models import Plant, Signal
from models.discretise import GaussLegendre
from models.quantity import InvalidValue

T, N = 0.25, 20
INPUTS = np.random.default_rng(8).normal(size=(2, N))


def response(plant, inputs, x):
    step, output, seen = plant.step_function(), plant.output_function(), []
    for k, u in enumerate(inputs.T):
        seen.append(output(x).full().ravel())
        x = step(x, u, [], k)
    return np.array([*seen, output(x).full().ravel()]).T


def held(system, inputs, x):
    """The outputs of a continuous system, its inputs held over each sample: responses of constants in a row."""
    seen = []
    for u in inputs.T:
        found = control.forced_response(system, [0.0, T], np.repeat(u[:, None], 2, axis=1), x, return_x=True)
        seen.append(found[1].reshape(system.noutputs, 2)[:, 0])
        x = found[2][:, -1]
    return np.array([*seen, system.C @ x]).T


A = np.array([[0.0, 1.0, 0.0], [-4.0, -0.4, 0.3], [0.0, 0.2, -2.0]])
B, C = np.array([[0.0, 0.0], [1.0, 0.5], [0.0, 2.0]]), np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.5]])
MIMO = control.StateSpace(A, B, C, np.zeros((2, 2)))
TRANSFERS = control.TransferFunction(
    [[[1.0], [2.0, 1.0]], [[0.0], [3.0]]], [[[1.0, 1.0], [1.0, 0.4, 4.0]], [[1.0], [0.5, 1.0]]]
)


@pytest.mark.parametrize("x", [np.zeros(3), np.array([0.3, -1.0, 0.5])])
def test_a_continuous_state_space_is_held(x):
    plant = Plant.from_control(MIMO, sampling_time=T)
    assert plant.sampling_time == T and not plant.continuous
    np.testing.assert_allclose(response(plant, INPUTS, x), held(MIMO, INPUTS, x), rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("system", [MIMO, TRANSFERS])
def test_steps_of_each_input_are_those_of_forced_response(system):
    plant, t = Plant.from_control(system, sampling_time=T), np.arange(N + 1) * T
    for j in range(2):
        steps = np.zeros((2, N + 1))
        steps[j] = 1.0
        for i in range(2):
            one = control.TransferFunction(TRANSFERS.num[i][j], TRANSFERS.den[i][j])
            of = one if system is TRANSFERS else control.StateSpace(A, B[:, [j]], C[[i]], 0)
            expected = np.ravel(control.forced_response(of, t, steps[j])[1])
            found = response(plant, steps[:, :N], np.zeros(len(plant.states)))[i]
            np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize(
    ("system", "sampling_time"),
    [
        (control.StateSpace(0.2 * A, B, C, np.zeros((2, 2)), T), None),
        (control.StateSpace(0.2 * A, B, C, np.zeros((2, 2)), T), T),
        (control.StateSpace(0.2 * A, B, C, np.zeros((2, 2)), True), T),
    ],
)
def test_a_discrete_state_space_is_taken_as_it_is(system, sampling_time):
    plant = Plant.from_control(system, sampling_time=sampling_time)
    t = np.arange(N + 1) * (1 if system.dt is True else T)
    inputs = np.concatenate([INPUTS, np.zeros((2, 1))], axis=1)
    expected = control.forced_response(system, t, inputs, [0.1, 0.2, 0.3])[1]
    np.testing.assert_allclose(response(plant, INPUTS, np.array([0.1, 0.2, 0.3])), expected, rtol=1e-12, atol=1e-13)


def test_a_discrete_transfer_function_is_taken_as_it_is():
    system = control.TransferFunction([0.5, 0.2], [1.0, -1.2, 0.5], T)
    plant = Plant.from_control(system)
    expected = control.forced_response(system, np.arange(N + 1) * T, np.append(INPUTS[0], 0.0))[1]
    np.testing.assert_allclose(response(plant, INPUTS[:1], np.zeros(2))[0], np.ravel(expected), rtol=1e-10, atol=1e-12)


def swing(t, x, u, params):
    return np.array([x[1], u[0] - params["g"] * np.sin(x[0]) - 0.1 * x[1] + 0.2 * np.cos(t)])


def swing_in_casadi(t, x, u, params):
    return ca.vertcat(x[1], u[0] - params["g"] * ca.sin(x[0]) - 0.1 * x[1] + 0.2 * ca.cos(t))


def mapped(t, x, u, params):
    return [0.9 * x[0] + 0.1 * u[0] * x[1], 0.5 * x[1] + 0.01 * t]


@pytest.mark.parametrize("function", [swing, swing_in_casadi])
@pytest.mark.parametrize("outputs", [None, lambda t, x, u, params: np.array([params["g"] * x[0]])])
def test_a_continuous_nonlinear_system_is_integrated(function, outputs):
    number = {"outputs": 2} if outputs is None else {"outputs": 1}
    system = control.nlsys(swing, outputs, inputs=1, states=2, params={"g": 9.81}, **number)
    own = (
        system
        if function is swing
        else control.nlsys(
            lambda t, x, u, params: function(t, x, u, params), outputs, inputs=1, states=2, params={"g": 9.81}, **number
        )
    )
    plant = Plant.from_control(own, sampling_time=0.05, integrator=GaussLegendre(points=3, newton=5))
    assert plant.continuous
    t = np.linspace(0, 1, 21)
    expected = control.input_output_response(
        system, t, np.full(21, 0.7), [0.5, 0.0], solve_ivp_kwargs={"rtol": 1e-10, "atol": 1e-11}
    ).outputs
    found = response(plant, np.full((1, 20), 0.7), np.array([0.5, 0.0]))
    np.testing.assert_allclose(found, np.atleast_2d(expected), rtol=1e-6, atol=1e-7)


def test_a_discrete_nonlinear_system_is_taken_as_it_is():
    system = control.nlsys(mapped, None, inputs=1, states=2, outputs=2, dt=T)
    plant = Plant.from_control(system)
    t = np.arange(N + 1) * T
    expected = control.input_output_response(system, t, np.append(INPUTS[0], 0.0), [0.5, 0.2]).outputs
    np.testing.assert_allclose(response(plant, INPUTS[:1], np.array([0.5, 0.2])), expected, rtol=1e-12, atol=1e-13)


def test_there_and_back_is_the_same():
    plant = Plant.from_control(MIMO, sampling_time=T)
    again = Plant.from_control(plant.linearised([0, 0, 0], [0, 0]))
    assert [again.A, again.B, again.C] == [plant.A, plant.B, plant.C]


def test_signals_are_named():
    plant = Plant.from_control(MIMO, sampling_time=T)
    names = [[one.name for one in named] for named in (plant.states, plant.inputs, plant.outputs)]
    assert names == [["x_0", "x_1", "x_2"], ["u_0", "u_1"], ["y_0", "y_1"]]
    speed = Signal("speed", "m/s", "how fast", role="speed")
    plant = Plant.from_control(
        MIMO, sampling_time=T, states=("a", speed, "b"), inputs=("f", "g"), outputs=("y", "z"), units={"f": "N"}
    )
    assert plant.states[1] == speed and plant.inputs[0] == Signal("f", "N") and plant.inputs[1].unit == "1"
    named = control.StateSpace(A, B, C, np.zeros((2, 2)), inputs=["f", "g"], outputs=["y", "z"], states=["a", "b", "c"])
    assert [one.name for one in Plant.from_control(named, sampling_time=T).inputs] == ["f", "g"]


ONE = {"inputs": 1, "states": 1, "outputs": 1}
REFUSED = [
    (control.StateSpace(A, B, C, np.eye(2)), {"sampling_time": T}, r"D that is not 0 \(direct feed-through\)"),
    (control.TransferFunction([1, 2], [1, 1]), {"sampling_time": T}, r"strictly proper, got degree 1 over 1 from u"),
    (MIMO, {}, "sampling_time must be given for a system in continuous time"),
    (MIMO, {"sampling_time": -1.0}, r"sampling_time must lie in \(0, ∞\) s, got -1.0"),
    (MIMO, {"sampling_time": "fast"}, r"sampling_time must lie in \(0, ∞\) s, got 'fast'"),
    (control.StateSpace(A, B, C, 0, T), {"sampling_time": 0.1}, r"that of the system, 0\.25 s, got 0\.1: leave it out"),
    (control.StateSpace(A, B, C, 0, True), {}, "sampling_time must be given"),
    (control.StateSpace(A, B, C, 0, None), {"sampling_time": T}, "must have a time base"),
    (MIMO, {"sampling_time": T, "states": ("a",)}, r"states must be 3 name\(s\), got \('a',\)"),
    (MIMO, {"sampling_time": T, "inputs": "ab"}, r"inputs must be 2 name\(s\), got 'ab'"),
    (MIMO, {"sampling_time": T, "units": {"force": "N"}}, "units must name signals of the system, got force"),
    ("1/s", {}, "must be python-control's StateSpace, TransferFunction or NonlinearIOSystem, got str"),
    (
        control.nlsys(lambda t, x, u, p: x if x[0] > 0 else u, None, **ONE, dt=T),
        {},
        "the update function must work on CasADi symbols",
    ),
    (
        control.nlsys(lambda t, x, u, p: [float(x[0])], None, **ONE, dt=T),
        {},
        "the update function must (give the same for|work on) CasADi symbols",
    ),
    (
        control.nlsys(lambda t, x, u, p: x, lambda t, x, u, p: x + u, **ONE, dt=T),
        {},
        r"one that the input reaches at once \(direct feed-through\)",
    ),
    (control.nlsys(lambda t, x, u, p: x, lambda t, x, u, p: x + t, **ONE, dt=T), {}, "one that depends on time"),
    (control.nlsys(lambda t, x, u, p: [x[0], 1], None, **ONE, dt=T), {}, r"must give 1 value\(s\), got shape \(2, 1\)"),
]


@pytest.mark.parametrize(("system", "asked", "message"), REFUSED)
def test_what_is_no_plant_is_refused_in_one_line(system, asked, message):
    with pytest.raises(InvalidValue, match=message) as caught:
        Plant.from_control(system, **asked)
    assert "\n" not in str(caught.value)
