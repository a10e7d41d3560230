"""Tuning by a grid against running every value by itself."""

from __future__ import annotations

import numpy as np
import pytest

from models.plant import Signal
from models.quantity import InvalidValue, declared, quantity
from models.transfer import Transfer
from workbench.contracts import settings
from workbench.contracts.law import Decision, Law
from workbench.contracts.study import Study
from workbench.controllers.pid import PID
from workbench.design.grid import Grid
from workbench.trials.campaign import run

N, VALUES = 40, (0.5, 2.0, 4.0, 400.0)
PLANT = Transfer(
    numerator=(1.0,),
    denominator=(1.0, 1.0),
    sampling_time=0.1,
    input_signal=Signal("heat", "kW", "heating power"),
    output_signal=Signal("level", "K", "temperature"),
)


@declared
class Stepped(Law):
    """A gain, decided in numbers."""

    source = "ours, 2026"
    gain: float = quantity(default=1.0, unit="kW/K", doc="gain")

    def start(self, task):
        return ()

    def decide(self, memory, state, seen):
        return Decision(np.array([self.gain * (1.0 - seen.y[0])])), state


def squared(study, left):
    return float(np.mean((study.reference_samples[0] - left.y[0]) ** 2))


def grid(**fields):
    return Grid(
        **{"controllers": ("pid",), "field": "kp", "values": VALUES, "metric": squared, "name": "mse", **fields}
    )


def study(**fields):
    laws = {"pid": PID(kp=1.0, ki=0.0, kd=0.0), "other": PID(kp=1.0, ki=0.0, kd=0.0), "stepped": Stepped()}
    return Study(plant=PLANT, reference=np.ones(N + 1), controllers=laws, trials=2, **fields)


def alone(name, field, value):
    one = settings.changed(study(), {"controllers": {name: {field: value}}})
    left = run(one, show_progress=False).data
    return left.isel(trial=-1).sel(controller=name)


@pytest.mark.parametrize(("name", "field"), [("pid", "kp"), ("stepped", "gain")])
def test_the_metric_of_every_value_is_that_of_a_run_with_it_and_the_least_one_runs(name, field):
    done = run(study(tuning=grid(controllers=(name,), field=field)), show_progress=False)
    expected = []
    for value in VALUES:
        one = alone(name, field, value)
        gone = np.isfinite(one["diverged_at_trial"])
        expected.append(np.nan if gone else float(((1 - one["output"]) ** 2).mean()))
    assert np.isfinite(expected[:-1]).all()
    found = done.data["grid_mse"].sel(tuned=name)
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    best = VALUES[int(np.nanargmin(expected))]
    assert getattr(done.tuned_laws()[name], field) == best and done.tuned_laws()["other"].kp == 1.0
    np.testing.assert_array_equal(
        done.data["output"].sel(controller=name).isel(trial=-1), alone(name, field, best)["output"]
    )
    assert getattr(done.runner(name).law, field) == best
    assert done.data["grid"].attrs["units"] and done.data["grid_mse"].attrs["long_name"]


def test_a_grid_of_values_that_all_diverge_refuses_the_law():
    done = run(study(tuning=grid(values=(4000.0, 5000.0))), show_progress=False)
    assert "no value of kp in the grid" in str(done.data["stopped"].sel(controller="pid").values)
    assert done.scores()["other"]["mse_last"] is not None


def test_what_is_not_there_is_not_tuned_and_a_wrong_field_is_said():
    done = run(study(tuning=grid(controllers=("absent",))), show_progress=False)
    assert "grid_mse" not in done.data
    with pytest.raises(InvalidValue, match=r"the grid's field must be one of controllers\.pid, got 'size'"):
        run(study(tuning=grid(field="size")), show_progress=False)
    with pytest.raises(InvalidValue, match="grid must hold at least one value"):
        grid(values=())


def test_a_tuned_run_is_loaded_with_the_laws_that_it_had(tmp_path):
    from workbench.trials.campaign import load

    done = run(study(name="heater", tuning=grid()), show_progress=False)
    done.record(tmp_path)
    again = load(tmp_path, done.study)
    assert again.tuned_laws()["pid"].kp == done.tuned_laws()["pid"].kp != 1.0
