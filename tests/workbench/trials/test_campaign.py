"""What a run records, writes and reads back."""

from __future__ import annotations

import dataclasses
import json
import os

import h5py
import numpy as np
import pytest
import xarray as xr

from models.metro_profile import MetroProfile
from models.point_mass import PointMass
from models.quantity import InvalidValue
from studies.metro.study import STUDY
from workbench.contracts import settings
from workbench.contracts.study import Study, Sweep
from workbench.contracts.trial_length import TrialLength
from workbench.controllers import ICFDL, PD
from workbench.trials.campaign import figure_file, load, run

SMALL = dataclasses.replace(
    STUDY, trials=12, sweeps=(Sweep(field="force_unit", values=(1.0, 1000.0), controllers=("icfdl", "pd"), unit="N"),)
)
METRICS = {
    "mse_trial_1",
    "mse_trial_50",
    "mse_trial_100",
    "mse_last",
    "mse_always_reached_last",
    "mse_max",
    "max_abs_error_last",
    "max_abs_input_n",
    "max_abs_accel_mps2",
    "diverged_at_trial",
}


@pytest.fixture(scope="module")
def small():
    return run(SMALL, show_progress=False)


def test_dataset_is_as_designed(small):
    data = small.data
    assert {d: data.sizes[d] for d in ("controller", "trial", "sample")} == {
        "controller": 4,
        "trial": 12,
        "sample": 2001,
    }
    assert list(data["controller"].values) == ["cfdl", "icfdl", "pd", "increment"]
    assert int(data["trial"][0]) == 1 and int(data["sample"][0]) == 0
    for name, dims in {
        "reference": ("sample",),
        "output": ("controller", "trial", "sample"),
        "error": ("controller", "trial", "sample"),
        "input": ("controller", "trial", "sample"),
        "applied": ("controller", "trial", "sample"),
        "state_speed": ("controller", "trial", "sample"),
        "state_position": ("controller", "trial", "sample"),
        "noise": (),
        "time": ("sample",),
        "ppd_estimate": ("controller", "trial", "sample"),
        "trial_length": ("trial",),
        "mse": ("controller", "trial"),
    }.items():
        assert data[name].dims == dims
    for name in data.variables:
        assert "units" in data[name].attrs and data[name].attrs["long_name"], name
    assert data["ppd_estimate"].attrs["units"] == "(km/h)/(N)"
    icfdl, pd = (data.sel(controller=name) for name in ("icfdl", "pd"))
    assert np.isnan(icfdl["input"][:, -1]).all() and np.isfinite(icfdl["input"][:, :-1]).all()
    assert np.isfinite(icfdl["ppd_estimate"][:, :-1]).all() and np.isnan(pd["ppd_estimate"]).all()
    ends = data["trial_length"].values[:, None]
    missing = np.broadcast_to(data["sample"].values > ends, icfdl["output"].shape)
    for name in ("output", "error"):
        assert (np.isnan(icfdl[name].values) == missing).all()
    np.testing.assert_array_equal(icfdl["error"], data["reference"].values - icfdl["output"].values)
    assert set(data.attrs) == {"study", "version", "settings"}


def test_mse_is_over_samples_1_to_the_end(small):
    for trial in small.data["trial"].values:
        one = small.data.sel(controller="pd", trial=trial)
        end = int(one["trial_length"])
        expected = sum(float(e) ** 2 for e in one["error"].values[1 : end + 1]) / end
        assert float(one["mse"]) == pytest.approx(expected, rel=1e-12)


def test_scores_from_the_record(small):
    scores = small.scores()
    assert set(scores) == {"cfdl", "icfdl", "pd", "increment"}
    for name, row in scores.items():
        assert METRICS <= set(row)
        if name == "cfdl":
            assert all(value is None for value in row.values())
            continue
        one = small.data.sel(controller=name)
        end = int(one["trial_length"][-1])
        assert row["mse_trial_1"] == float(one["mse"][0]) and row["mse_last"] == float(one["mse"][-1])
        assert row["mse_trial_50"] is None and row["mse_trial_100"] is None and row["diverged_at_trial"] is None
        assert row["mse_always_reached_last"] == pytest.approx(float((one["error"][-1, 1:1901] ** 2).mean()))
        assert row["mse_max"] == float(one["mse"].max())
        assert row["max_abs_error_last"] == float(abs(one["error"][-1, : end + 1]).max())
        applied = [np.abs(one["input"].values[i, : int(end)]).max() for i, end in enumerate(one["trial_length"].values)]
        assert row["max_abs_input_n"] == max(applied)
        accel = np.diff(one["output"].values, axis=1) / 3.6 / 0.1
        assert row["max_abs_accel_mps2"] == pytest.approx(np.nanmax(np.abs(accel)), rel=1e-12)


def test_written_and_loaded(small, tmp_path):
    folder = small.save(tmp_path / "deep" / "run")
    assert sorted(path.name for path in folder.iterdir()) == ["figures", "provenance.json", "run.nc", "scores.json"]
    figures = {path.name for path in (folder / "figures").iterdir()}
    names = {
        "reference",
        "trial_lengths",
        "resistance",
        "tracking_icfdl",
        "tracking_pd",
        "tracking_increment",
        "mse",
        "sensitivity_force_unit",
    }
    assert figures == {f"{name}.{kind}" for name in names for kind in ("svg", "png")}
    again = load(folder, SMALL)
    xr.testing.assert_identical(again.data, small.data)
    assert again.settings == small.settings
    content = json.loads((folder / "scores.json").read_text())
    assert content == {"study": "metro", "settings": small.settings, "scores": small.scores()}
    with h5py.File(folder / "run.nc") as file:  # netCDF-4 is HDF5: any other program reads it
        assert {"reference", "output", "mse", "controller", "trial", "sample"} <= set(file)


@pytest.mark.parametrize(
    "changes",
    [
        [],
        ["plant.reading=printed", "plant.line=flat", "seed=7"],
        ["trial_length.law=table", "trial_length.probabilities=[0.25,0.75]", "plant.mass=123456.789"],
        ["trial_length.law=fixed", "controllers.cfdl.phi0=0.01", "noise.speed_sigma=0.1"],
        ["plant.line.grade_starts_m=[100]", "plant.line.grade_permille=[0,1.1]", "controllers.icfdl.lam=1e-4"],
    ],
)
def test_settings_are_complete_enough_to_run_again(changes, tmp_path):
    study = settings.assigned(dataclasses.replace(STUDY, trials=4, sweeps=()), changes)
    first = run(study, show_progress=False)
    first.save(tmp_path)
    again = run(dataclasses.replace(load(tmp_path).study, sweeps=()), show_progress=False)
    xr.testing.assert_identical(again.data, first.data)  # bit by bit


def test_seeds():
    def mse(seed):
        return run(dataclasses.replace(SMALL, sweeps=(), trials=5, seed=seed), show_progress=False).data

    assert mse(1).equals(mse(1))
    assert not np.array_equal(mse(1)["trial_length"], mse(2)["trial_length"])


def test_noise_does_not_change_the_trial_lengths():
    noisy = settings.assigned(SMALL, ["noise.speed_sigma=0.5"])
    assert [one.length for one in noisy.inputs()] == [one.length for one in SMALL.inputs()]
    assert any(one.noise.any() for one in noisy.inputs())


def test_the_sweep_records_the_last_mse(small):
    swept = small.data["sweep_force_unit_mse_last"]
    assert float(swept.sel(sweep_force_unit_controller="pd", sweep_force_unit=1.0)) == float(
        small.data["mse"].sel(controller="pd")[-1]
    )
    assert swept.sel(sweep_force_unit_controller="pd", sweep_force_unit=1000.0).isnull()  # diverged


def test_figures_draw_what_they_are_named_for(small):
    from matplotlib import pyplot as plt

    from studies.metro.scores import slope_resistance

    for name, draw in small.figures().items():
        (axes,) = draw().axes
        assert axes.lines or axes.collections, name
        assert axes.get_xlabel() and "(" in axes.get_ylabel(), name
        plt.close("all")
    resistance = slope_resistance(SMALL, small.data)
    assert list(resistance["run"].values) == ["run along the reference", "icfdl, trial 12"]
    assert float(resistance.max()) == pytest.approx(9.81 * 0.006)
    assert float(resistance.min()) == pytest.approx(-9.81 * 0.008)


def test_figures_of_a_run_in_which_everything_diverged_at_once():
    from matplotlib import pyplot as plt

    study = settings.assigned(SMALL, ["plant.mass=1", "trials=3"])
    done = run(study, show_progress=False)
    assert all(row["mse_last"] is None for row in done.scores().values())
    for draw in done.figures().values():
        draw()
        plt.close("all")


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_a_run_cut_short_is_refused(small, tmp_path, share):
    small.save(tmp_path)
    whole = (tmp_path / "run.nc").read_bytes()
    (tmp_path / "run.nc").write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InvalidValue, match=r"must be a complete netCDF-4 file, .*: run the study again") as caught:
        load(tmp_path)
    assert "\n" not in str(caught.value)


def test_other_things_that_are_no_run(tmp_path):
    with pytest.raises(InvalidValue, match=r"existing run.nc, got .*: run the study first"):
        load(tmp_path)
    xr.Dataset({"a": ("x", [1.0])}).to_netcdf(tmp_path / "run.nc", engine="h5netcdf")
    with pytest.raises(InvalidValue, match="it is no run of the workbench"):
        load(tmp_path)
    own = Study(plant=PointMass(), reference=MetroProfile(horizon=50), controllers={"pd": PD()}, name="own", trials=2)
    run(own, show_progress=False).save(tmp_path / "own")
    with pytest.raises(
        InvalidValue, match=r"a run of 'own', which is not built in: give it, as in load\(path, study\)"
    ):
        load(tmp_path / "own")
    assert load(tmp_path / "own", own).settings["trials"] == 2


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"reference": [0.0, np.nan, 1.0, 2.0]}, "reference must be finite at every sample, got nan at sample 1"),
        ({"reference": [0.0, 1.0]}, "N at least 2; got"),
        ({"reference": np.zeros((2, 50))}, r"reference must have 1 row\(s\), one an output of pointmass, got 2"),
        ({"reference": "fast"}, "reference must be an array of numbers"),
        ({"trial_length": TrialLength(minimum=60)}, "below the horizon of 50 samples, got 60"),
        ({"controllers": {}}, "at least one controller"),
        ({"controllers": {"pd": 3}}, "controllers.pd must be a Law, made with its settings as in .*; got 3"),
        ({"controllers": {"pd": PD}}, "controllers.pd must be a Law, made with its settings as in .*; got <class"),
        ({"controllers": {"a/b": PD()}}, "names of letters, digits"),
        ({"name": "../x"}, "name must be letters"),
        ({"plant": PointMass}, "plant must be a Plant"),
        ({"plant": 3}, "plant must be a Plant"),
        ({"trials": 0}, r"trials must lie in \[1, 100000\], got 0"),
        ({"trials": 99_999, "reference": np.ones(2001)}, "samples that a run may record"),
        ({"seed": -1}, "seed must lie in"),
    ],
)
def test_parts_that_do_not_fit_are_refused(fields, message):
    parts = {"plant": PointMass(), "reference": np.ones(51), "controllers": {"icfdl": ICFDL()}}
    with pytest.raises(InvalidValue, match=message):
        Study(**(parts | fields))


def test_what_fails_half_way_leaves_no_folder_but_the_run(tmp_path):
    def broken(study, data):
        return {"bad": lambda: 1 / 0}

    done = run(dataclasses.replace(SMALL, sweeps=(), trials=2, drawings=broken), show_progress=False)
    with pytest.raises(InvalidValue, match=r"test_campaign\.py, line .*: return .*ZeroDivisionError") as caught:
        done.save(tmp_path / "out")
    (draft,) = tmp_path.iterdir()
    assert caught.value.__notes__ == [f"the run is kept in {draft}"] and draft.name.startswith(".out.draft-")
    xr.testing.assert_identical(load(draft, SMALL).data, done.data)


def test_names_of_figures_become_names_of_files():
    names = ["mse", "a/b", "小车", "x" * 300, "x" * 301, "小" * 100]
    files = [figure_file(name) for name in names]
    assert files[:3] == ["mse", "a_b", "小车"] and len(set(files)) == len(names)
    assert all(len(os.fsencode(file)) <= 200 for file in files)
