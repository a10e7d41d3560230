"""A trial in single precision is what a plain loop over float32 numbers gives, bit for bit."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from learning_laws import Plan, Planned, Second
from small_plants import small

from models.quantity import InvalidValue, declared
from workbench.contracts.scenario import NormalNoise
from workbench.contracts.study import Study
from workbench.controllers.parts.rows import known
from workbench.controllers.rmpc import RMPC
from workbench.fold.single import in_single
from workbench.trials.simulation import ready, ready_in_single, runner_in_single

F = np.float32
SAMPLES, TRIALS = 40, 12
REFERENCE = np.linspace(0.0, 1.3, SAMPLES + 1) ** 2


def study(plant, **changes):
    fields = {"plant": plant, "reference": REFERENCE, "controllers": {"law": Planned(gain=0.3)}, "trials": TRIALS}
    return Study(**{**fields, **changes})


def linear(x, u):
    return F(0.7) * x[0] + F(0.2) * x[1] + F(0.5) * u, F(0.6) * x[1] - F(0.2) * x[0] + F(0.3) * u


def tenth(x, u):
    return (F(0.1) * x[0] + u,)


def rational(x, u):
    return ((x[0] + u) / (F(1.3) + x[0] * x[0]),)


PLANTS = {
    "two states": (Second(), linear),
    "a constant that is no float32": (small("tenth", lambda x, u, k: (0.1 * x[0] + u,)), tenth),
    "a quotient": (small("rational", lambda x, u, k: ((x[0] + u) / (1.3 + x[0] * x[0]),)), rational),
}


def plainly(step, states, noise, gain=0.3):
    """Return the outputs of every trial, (trials, N + 1), and their mean square errors, in float32 throughout."""
    r, gain = REFERENCE.astype(F), F(gain)
    u, rows, errors = np.full(SAMPLES, F(0.1)), [], []
    for one in noise:
        x, y = (F(0),) * states, [F(0)]
        for k in range(SAMPLES):
            x = step(x, u[k])
            y.append(x[0])
        y = np.array(y)
        total = F(0)
        for error in (r - y)[1:]:
            total = F(total + error * error)
        rows.append(y)
        errors.append(total / F(SAMPLES))
        u = u + gain * (r - (y + one.astype(F)))[1:]
    return np.array(rows), np.array(errors)


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("name", PLANTS)
def test_it_is_a_loop_in_float32(name, noise):
    plant, step = PLANTS[name]
    made = study(plant, noise=NormalNoise(sigma=noise))
    inputs = made.inputs()
    left = list(runner_in_single(made, "law").trials(inputs))
    drawn = [np.broadcast_to(one.noise, (1, SAMPLES + 1))[0] for one in inputs]
    outputs, errors = plainly(step, len(plant.states), drawn)
    assert np.array_equal([one.y[0] for one in left], outputs)
    assert np.array_equal([one.mse[0] for one in left], errors)
    doubles = [one.mse[0] for one in ready(made, made.controllers)["law"].trials(inputs)]
    assert not np.array_equal(doubles, errors) and np.allclose(doubles, errors, rtol=1e-3)


@pytest.mark.parametrize("function", [ca.sin, ca.exp, ca.sqrt, lambda x: x**1.7])
def test_a_function_of_the_library_is_rounded_once(function):
    plant = small("library", lambda x, u, k: (0.0 * x[0] + function(u + 1.0),))
    made = study(plant, trials=1)
    (left,) = runner_in_single(made, "law").trials(made.inputs())
    argument = float(F(F(0.1) + F(1.0)))
    assert left.y[0, 1] == F(float(function(ca.DM(argument))))


def test_numbers_that_no_float32_holds_become_infinite_and_nan_stays():
    made = study(small("huge", lambda x, u, k: (1e30 * u * 1e30,)), trials=1)
    (left,) = runner_in_single(made, "law").trials(made.inputs())
    assert np.isinf(left.y[0, 1:]).all()


@declared
class Tenth(Planned):
    """It learns with a gain that is written into its equations."""

    def learn(self, memory, trial):
        return Plan(memory.u + 0.1 * known(trial.reached, trial.e)[1:])


def test_constants_between_trials_are_rounded_too():
    made = study(Second(), controllers={"law": Tenth()})
    of_loop, _ = plainly(linear, 2, [np.zeros(SAMPLES + 1)] * TRIALS, gain=0.1)
    left = list(runner_in_single(made, "law").trials(made.inputs()))
    assert np.array_equal([one.y[0] for one in left], of_loop)


def test_quantities_are_inputs_still_and_the_fold_in_doubles_is_as_it_was():
    made = study(Second())
    runner = ready(made, made.controllers)["law"]
    before, single = runner.fold.trial, in_single(runner.fold)
    assert runner.fold.trial is before and single.trial is not before
    assert single.parameters == runner.fold.parameters
    again = Planned(gain=0.5)
    other = study(Second(), controllers={"law": again})
    values = runner.fold.values_of(again)
    moved = [one.mse[0] for one in runner_in_single(made, "law").trials(made.inputs(), values=values)]
    assert moved == [one.mse[0] for one in runner_in_single(other, "law").trials(made.inputs())]


def test_a_law_that_decides_sample_by_sample_has_none(monkeypatch):
    assert RMPC.stepped
    with monkeypatch.context() as patched:
        patched.setattr(Planned, "stepped", True)
        assert ready_in_single(study(Second()), {"law": Planned()}) == {}


def test_without_a_compiler_there_is_one_line(monkeypatch):
    made = study(Second())
    fold = ready(made, made.controllers)["law"].fold
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(InvalidValue, match="C compiler is needed"):
        in_single(fold)
