"""The fold: streamed, as one symbolic Function, compiled, and through python-control."""

from __future__ import annotations

import dataclasses

import casadi as ca
import control
import numpy as np
import pytest

from models.metro_profile import MetroProfile
from models.point_mass import PointMass
from models.quantity import InvalidValue
from workbench.contracts.record import TrialInput
from workbench.controllers import CFDL, ICFDL, PD
from workbench.fold.fold import build, stream
from workbench.fold.machine_code import compiled, compiler

N, TRIALS = 80, 6
LENGTHS = (80, 71, 76, 73, 80, 78)
LAWS = {"icfdl": ICFDL(phi0=0.02), "pd": PD(), "cfdl": CFDL(phi0=0.02)}


def lengths_of(law):
    return (N,) * TRIALS if isinstance(law, CFDL) else LENGTHS


def plant(**fields):
    return PointMass(**fields)


def reference():
    return 20 * MetroProfile(horizon=N).samples(plant()) / 70


def streamed(law, trial=None, fold=None, values=None):
    fold = fold or build(plant(), law, N)
    inputs = [TrialInput(n, [0, 0], np.zeros((0, N)), np.zeros((1, N + 1))) for n in lengths_of(law)]
    return list(stream(fold, reference(), inputs, trial=trial, values=values))


def symbolic(fold, law, p):
    noise, w = np.zeros((1, (N + 1) * TRIALS)), np.zeros((0, N * TRIALS))
    return fold.campaign(TRIALS)(
        x0=[0, 0], length=ca.DM(lengths_of(law)).T, r=reference(), w=w, noise=noise, p=ca.DM(p)
    )


@pytest.mark.parametrize("name", LAWS)
def test_symbolic_campaign_equals_the_stream(name):
    law = LAWS[name]
    fold = build(plant(), law, N)
    whole, parts = symbolic(fold, law, fold.values), streamed(law, fold=fold)
    for key in ("u", "y", "mse"):
        side = np.hstack([np.atleast_2d(getattr(part, key)) for part in parts])
        np.testing.assert_allclose(whole[key].full(), side, rtol=1e-12, atol=1e-12)
    assert np.isnan(whole["y"].full()).sum() == sum(N - n for n in lengths_of(law))


@pytest.mark.parametrize("parameter", ["plant.mass", "plant.b1_mean", "law.initial_input", "law.force_unit"])
@pytest.mark.parametrize("name", LAWS)
def test_derivatives_through_the_campaign_equal_finite_differences(name, parameter):
    check_derivative(name, parameter)


@pytest.mark.parametrize(
    ("name", "parameter"),
    [(law, f"law.{field}") for law in ("icfdl", "cfdl") for field in ("lam", "rho", "phi0", "eta", "mu")]
    + [("pd", "law.kp"), ("pd", "law.kd")],
)
def test_derivatives_by_the_laws_parameters(name, parameter):
    check_derivative(name, parameter)


def check_derivative(name, parameter):
    """Forward and reverse mode against central differences, d mse_last / d parameter."""
    law = LAWS[name]
    fold = build(plant(), law, N)
    at = fold.parameters.index(parameter)
    function = fold.campaign(TRIALS)
    p = ca.MX.sym("p", len(fold.parameters))
    mse = symbolic(fold, law, fold.values)["mse"]
    last = function(
        x0=[0, 0],
        length=ca.DM(lengths_of(law)).T,
        r=reference(),
        w=np.zeros((0, N * TRIALS)),
        noise=np.zeros((1, (N + 1) * TRIALS)),
        p=p,
    )["mse"][-1]
    seed = ca.DM.zeros(len(fold.parameters))
    seed[at] = 1
    forward = float(ca.Function("f", [p], [ca.jtimes(last, p, seed)])(fold.values))
    reverse = ca.Function("g", [p], [ca.gradient(last, p)])(fold.values).full().ravel()[at]

    def moved(value):
        values = list(fold.values)
        values[at] = value
        return streamed(law, fold=fold, values=values)[-1].mse

    value = fold.values[at]
    h = 1e-5 * abs(value)
    rough = (moved(value + h) - moved(value - h)) / (2 * h)
    assert float(mse[-1]) == pytest.approx(moved(value), rel=1e-12)
    scale = abs(float(mse[-1]) / value)
    assert forward == pytest.approx(rough, rel=1e-4, abs=1e-7 * scale)
    assert reverse == pytest.approx(forward, rel=1e-9)


@pytest.mark.skipif(compiler() is None, reason="needs a C compiler")
@pytest.mark.parametrize("name", LAWS)
def test_virtual_machine_equals_compiled(name):
    law = LAWS[name]
    fold = build(plant(), law, N)
    for one, other in zip(streamed(law, compiled(fold.trial), fold), streamed(law, None, fold), strict=True):
        for key in ("u", "x", "y", "estimate", "mse"):
            np.testing.assert_allclose(getattr(one, key), getattr(other, key), rtol=1e-11, atol=1e-11, err_msg=key)


@pytest.mark.parametrize("reading", ["metro", "seconds", "printed"])
def test_python_control_agrees_with_the_fold(reading):
    train = plant(reading=reading)
    inputs = [TrialInput(N, [0, 0], np.zeros((0, N)), np.zeros((1, N + 1)))] * 3
    left = list(stream(build(train, PD(), N), reference(), inputs))[-1]
    system = train.to_control()
    assert isinstance(system, control.NonlinearIOSystem)
    assert (system.state_labels, system.input_labels, system.output_labels) == (
        ["speed", "position"],
        ["force"],
        ["speed"],
    )
    time = np.arange(N + 1) * train.sampling_time
    forces = np.append(left.u[0], left.u[0, -1])
    response = control.input_output_response(system, time, forces, [0.0, 0.0])
    np.testing.assert_allclose(np.atleast_2d(response.outputs), left.y, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(response.states, left.x, rtol=1e-12, atol=1e-12)


def test_the_state_is_frozen_after_the_end():
    left = streamed(PD())[1]
    assert np.isnan(left.y[0, LENGTHS[1] + 1 :]).all() and np.isfinite(left.y[0, : LENGTHS[1] + 1]).all()
    assert (left.x[:, LENGTHS[1] :] == left.x[:, LENGTHS[1]][:, None]).all()
    expected = np.nansum((reference() - left.y)[0, 1:] ** 2) / LENGTHS[1]
    assert left.mse == pytest.approx(expected, rel=1e-13)


def test_functions_have_names():
    fold = build(plant(), PD(), N)
    assert fold.trial.name() == "trial_pointmass_pd"
    assert fold.trial.name_in() == ["memory_u", "memory_timetable", "x0", "length", "r", "w", "noise", "p"]
    assert fold.campaign(2).name_out() == ["u", "y", "mse", "estimate"]
    assert fold.parameters[0] == "plant.mass" and "law.kp" in fold.parameters


def test_a_learning_that_changes_shapes_is_refused():
    class Shrinking(PD):
        def learn(self, memory, trial):
            return memory._replace(u=memory.u[:-1])

    with pytest.raises(InvalidValue, match=r"Shrinking.learn must keep the shape of u, \(1, 80\); got \(1, 79\)"):
        build(plant(), Shrinking(), N)


def test_another_value_needs_no_new_function():
    law = ICFDL(phi0=0.02)
    fold, other = build(plant(), law, N), dataclasses.replace(law, lam=1e-4)
    reused = streamed(law, fold=fold, values=fold.values_of(other))
    for one, two in zip(reused, streamed(other), strict=True):
        assert one.mse == two.mse
