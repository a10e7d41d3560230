"""Studies in a user's own file, on plants that are no trains: each runs, learns, and equals a plain loop."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import plain_loop
import pytest

from workbench import load, run
from workbench.contracts import settings
from workbench.trials.find import find

FOLDER = Path(__file__).parents[1] / "users"
FALLS = {
    "batch_reactor": 1e-3,
    "pendulum": 1e-4,
    "quadruple_tank": 1e-4,
    "robot_joint": 1e-4,
    "trolley": 1e-12,
    "two_tanks": 1e-4,
}
"""Last over first mean square error that each study stays below."""


def test_every_file_is_run():
    assert sorted(file.stem for file in FOLDER.glob("*.py")) == sorted(FALLS)


@pytest.mark.parametrize("name", FALLS)
def test_it_equals_a_plain_loop(name):
    study = settings.changed(find(str(FOLDER / f"{name}.py")), {"trials": 3})
    (controller,) = study.controllers
    data = run(study, show_progress=False).data.sel(controller=controller)
    for trial, (u, y, x, mse, length) in enumerate(plain_loop.campaign(study, controller), 1):
        one = data.sel(trial=trial)
        lengths = data["trial_length"].sel(trial=trial)
        assert int(lengths) == length
        for recorded, plain in ((one["output"], y), (one["input"], u)):
            got = np.atleast_2d(recorded.values)[:, : plain.shape[1]]
            scale = max(np.nanmax(np.abs(plain)), 1e-12)
            reached = np.isfinite(plain)
            np.testing.assert_allclose(got[reached] / scale, plain[reached] / scale, atol=1e-11)
        np.testing.assert_allclose(np.atleast_1d(one["mse"]), mse, rtol=1e-9)
        for i, signal in enumerate(study.plant.states):
            got = one[f"state_{signal.name}"].values[: length + 1]
            np.testing.assert_allclose(got, x[i], rtol=1e-9, atol=1e-9 * np.abs(x[i]).max())


@pytest.mark.parametrize("name", FALLS)
def test_it_learns_and_is_kept(name, tmp_path):
    study = find(str(FOLDER / f"{name}.py"))
    campaign = run(study, show_progress=False)
    mse = campaign.data["mse"].isel(controller=0)
    assert float((mse.isel(trial=-1) / mse.isel(trial=0)).max()) < FALLS[name]
    campaign.save(tmp_path / "out")
    again = load(tmp_path / "out", study)
    assert again.data.identical(campaign.data) and again.scores() == campaign.scores()


def test_several_channels_have_axes_and_units_of_their_own():
    data = run(settings.changed(find(str(FOLDER / "quadruple_tank.py")), {"trials": 2}), show_progress=False).data
    assert data["output"].dims == ("controller", "trial", "output_name", "sample")
    assert data["input"].dims == ("controller", "trial", "input_name", "sample")
    assert data["mse"].dims == ("controller", "trial", "output_name")
    assert list(data["output_name"].values) == ["lower_1", "lower_2"] and list(data["input_unit"].values) == ["V", "V"]
    assert data["reference"].dims == ("output_name", "sample")
    one = run(settings.changed(find(str(FOLDER / "trolley.py")), {"trials": 2}), show_progress=False).data
    assert one["output"].dims == ("controller", "trial", "sample") and one["mse"].dims == ("controller", "trial")
    assert "output_name" not in one.coords and float(one["time"][10]) == pytest.approx(1.0)


def test_what_a_trial_met_is_recorded():
    reactor = run(settings.changed(find(str(FOLDER / "batch_reactor.py")), {"trials": 2}), show_progress=False).data
    assert reactor["disturbance_leak"].dims == ("trial", "sample") and float(reactor["disturbance_leak"][0, 0]) == 0.001
    assert reactor["noise"].shape == () and float(reactor["noise"]) == 0
    assert int(reactor["trial_length"][0]) == 175 and bool(np.isnan(reactor["output"].values[0, 0, 176:]).all())
    starts = reactor["state_concentration"].values[0, :, 0]
    assert starts[0] != starts[1] and (np.abs(starts - 5) <= 0.25).all()
    joint = run(settings.changed(find(str(FOLDER / "robot_joint.py")), {"trials": 2}), show_progress=False).data
    assert joint["noise"].dims == ("trial", "sample") and float(np.nanstd(joint["noise"])) == pytest.approx(
        2e-3, rel=0.1
    )
    assert float(np.nanmax(np.abs(joint["applied"]))) <= 8.0


def test_a_law_that_fell_says_what_left_its_domain_and_what_it_was_not_made_for():
    tanks = find(str(FOLDER / "two_tanks.py"))
    from workbench.controllers import PD

    laws = {"pd": PD(kp=5.0, kd=4.0, initial_input=0.012)}
    fallen = settings.changed(tanks, {"controllers": laws, "trials": 40, "divergence_factor": 3.0})
    said = str(run(fallen, show_progress=False).data["stopped"].values[0])
    assert "diverged at trial" in said and "left its domain" in said and " at sample " in said
    assert "the plant's relative degree is 2, and PD learns from the error at k+1" in said
    trolley = settings.changed(find(str(FOLDER / "trolley.py")), {"controllers": {"pd": PD(kp=900.0, kd=0.0)}})
    said = str(run(trolley, show_progress=False).data["stopped"].values[0])
    assert "u(k) first reaches y(k+6)" in said


def test_a_law_for_one_channel_is_refused_on_several_in_one_line():
    from models.errors import InvalidValue
    from workbench.controllers import ICFDL

    tanks = settings.changed(find(str(FOLDER / "quadruple_tank.py")), {"controllers": {"icfdl": ICFDL()}})
    with pytest.raises(InvalidValue) as caught:
        run(tanks, show_progress=False)
    said = str(caught.value)
    assert (
        "icfdl is for 1 output(s) and 1 input(s), quadrupletank has 2 (lower_1, lower_2) and 2 (pump_1, pump_2)" in said
    )
    assert "\n" not in said
