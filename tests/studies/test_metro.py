"""The metro study's cases, settings and figures; its numbers are tested by its claims and by plain loops."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib import pyplot

from models.quantity import InvalidValue
from studies.metro.study import STUDY
from workbench.contracts import settings
from workbench.trials.campaign import load, run


def short(case, **changes):
    study = settings.in_case(STUDY, case)
    study = settings.changed(study, {"trials": 4, **changes})
    return run(study, show_progress=False)


@pytest.mark.parametrize("case", STUDY.cases)
def test_every_case_runs_and_meets_what_it_says(case, tmp_path):
    done = short(case, trials=40 if case == "limited" else 4)  # the force comes to its limits later
    data, plant = done.data, done.study.plant_that_runs
    assert data.attrs["case"] == case
    assert all(row["mse_last"] is not None for name, row in done.scores().items() if name != "cfdl")
    starts = data["state_position"].sel(controller="icfdl", sample=0).values
    assert (len(set(starts.tolist())) > 1) is (case == "starts-differ")
    assert (len(plant.states) > 2) is (case == "lagging")
    assert ("truth_mass" in data) is (case == "trips-differ")
    limits = plant.input_limits
    assert bool(np.isfinite(float(limits.upper))) is (case == "limited")
    if case == "limited":
        applied = data["applied"].values
        assert np.nanmax(np.abs(applied)) == 420_000.0 < np.nanmax(np.abs(data["input"].values))
    if case == "longer-than-the-run":
        many = done.study.scenario.trial_length.draw(2000, 4000, np.random.default_rng(0))
        assert (many == 2000).mean() == pytest.approx(0.51, abs=0.03)  # 2000 to 2050 of 1951 to 2050
    done.record(tmp_path)
    again = load(tmp_path)
    assert settings.as_json(again.study) == settings.as_json(done.study)


def test_old_settings_have_a_new_path_and_unknown_ones_are_one_line():
    assert settings.assigned(STUDY, ["noise.speed_sigma=0.05"]).noise.sigma == 0.05
    for assignment in ("noise.speed=1", "plant.mass=heavy", "trial_length.law=often"):
        with pytest.raises(InvalidValue) as caught:
            settings.assigned(STUDY, [assignment])
        assert "\n" not in str(caught.value)


def test_every_figure_draws():
    drawn = {name: draw() for name, draw in short("").figures().items()}
    assert {"reference", "resistance", "sensitivity_force_unit", "tracking_icfdl"} <= set(drawn)
    assert all(axes.has_data() and axes.get_ylabel() for figure in drawn.values() for axes in figure.axes)
    pyplot.close("all")
