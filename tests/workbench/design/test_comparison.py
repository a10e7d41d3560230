"""Comparing laws on one plant: the table, its metrics against plain loops, and what is refused."""

from __future__ import annotations

import csv
import dataclasses
import functools
import json

import numpy as np
import pytest
from typer.testing import CliRunner

from models.metro_profile import MetroProfile
from models.point_mass import PointMass
from models.quantity import InvalidValue
from studies.rail.scores import RIDE
from workbench.cli import app
from workbench.contracts.study import Measures
from workbench.controllers.cfdl import CFDL
from workbench.controllers.pid import PID
from workbench.design.candidates import MAKERS, Candidate, candidates, scale_of
from workbench.design.comparison import Comparison, comparison
from workbench.design.table import compare, save, table, times
from workbench.trials import find as studies
from workbench.trials import settings
from workbench.trials.campaign import load
from workbench.trials.length import TrialLength
from workbench.trials.study import TrialStudy

SMALL = TrialStudy(
    name="small",
    plant=PointMass(),
    reference=MetroProfile(horizon=120),
    controllers={"cfdl": CFDL()},
    trials=3,
    compared=(RIDE,),
)
QUICK = ["trials=4", "budget=5"]


@functools.cache
def quick():
    return compare(SMALL, None, QUICK, show_progress=False)


def test_every_law_is_in_the_table():
    rows = table(quick())
    assert [row[0] for row in rows[1:]] == list(MAKERS)
    assert len({len(row) for row in rows}) == 1
    assert all(row[-1] == "" for row in rows[1:])


def largest(study, data):
    return {
        str(name): {"largest": float(data["output"].sel(controller=name).max())} for name in data["controller"].values
    }


OWN = Measures({"largest": "largest output (V)", "missing": "missing (1)"}, largest)


@pytest.mark.parametrize(
    ("compared", "columns", "metrics"),
    [
        ((), [], []),
        ((RIDE,), ["jerk (m/s^3)", "energy (kWh)", "force peak (N)"], ["max_jerk", "energy_kwh", "force_peak"]),
        ((OWN,), ["largest output (V)", "missing (1)"], ["largest"]),
    ],
    ids=["nothing", "a ride", "a user's own"],
)
def test_only_what_a_study_declares_is_measured_beyond_the_common_metrics(compared, columns, metrics):
    study = dataclasses.replace(SMALL, compared=compared)
    done = compare(study, ["pid"], ["trials=1", "budget=1"], show_progress=False)
    rows, scores = table(done), done.scores()["pid"]
    common = ["law", "MSE, mean over trials", "final MSE", "trials needed"]
    assert list(rows[0]) == [*common, *columns, "solves", "note"]
    assert list(scores) == ["mse", "mse_last", "trials_needed", *metrics, "solves", "evaluations"]
    assert list(rows[1][4 : 4 + len(metrics)]) == [f"{scores[metric]:.6g}" for metric in metrics]
    if compared == (OWN,):
        assert scores["largest"] == float(done.data["output"].values.max()) and rows[1][5] == "-"


def test_the_table_regenerates_bit_for_bit(tmp_path):
    again = compare(SMALL, None, QUICK, show_progress=False)
    save(quick(), tmp_path / "a", {"pid": 1.0})
    save(again, tmp_path / "b", {"pid": 2.0})
    for name in ("table.csv", "scores.json"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    other = compare(SMALL, ["pid"], [*QUICK, "seed=7"], show_progress=False)
    assert table(other)[1] != table(quick())[1]


def test_metrics_are_those_of_a_plain_loop():
    """PID with its default gains on the heavier train, behind limits and a rate limit."""
    done = compare(SMALL, ["pid"], ["trials=4", "budget=1", "noise.speed_sigma=0"], show_progress=False)
    law = done.study.tuned_laws(done.data)["pid"]
    one = done.data.sel(controller="pid").isel(trial=-1)
    reference = done.data["reference"].values
    mass, ts, v, s, before, integral, last = 385_000.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0
    speeds, forces = [0.0], []
    for k in range(120):
        e = reference[k] - v
        integral += ts * e
        command = law.input_unit * (law.kp * e + law.ki * integral + law.kd * (e - last) / ts)
        last = e
        force = min(max(command, -450e3), 450e3)
        force = before + min(max(force - before, -50e3), 50e3)
        before = force
        swing = np.sin(0.0037 * k)
        fb = 2977 + 275 * swing + (25.17 + 2.5 * swing) * v + (0.2864 + 0.04 * swing) * v * v
        v, s = v + 3.6 * ts / mass * (force - fb), s + ts * v / 3.6
        speeds.append(v)
        forces.append(force)
    assert s < 600  # no grade is met
    np.testing.assert_allclose(one["output"], speeds, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(one["applied_force"][:-1], forces, rtol=1e-9)
    scores = done.scores()["pid"]
    speeds = np.array(speeds) / 3.6
    assert scores["mse_last"] == pytest.approx(np.mean((reference[1:] - 3.6 * speeds[1:]) ** 2))
    assert scores["max_jerk"] == pytest.approx(np.abs(np.diff(speeds, 2)).max() / 0.01)
    assert scores["force_peak"] == pytest.approx(max(map(abs, forces)))
    work = sum(max(f * (a + b) / 2, 0) * ts for f, a, b in zip(forces, speeds, speeds[1:], strict=False))
    assert scores["energy_kwh"] == pytest.approx(work / 3.6e6)
    assert scores["trials_needed"] == 1 and scores["solves"] == 0 and scores["evaluations"] == 1


def test_trials_needed_is_read_from_the_mse():
    data = quick().data.copy(deep=True)
    data["mse"].loc[{"controller": "cfdl"}] = [9.0, 3.0, 1.05, 1.0]
    data["mse"].loc[{"controller": "icfdl"}] = [9.0, 1.0, 1.05, np.nan]
    scores = quick().study.scores(data)
    assert scores["cfdl"]["trials_needed"] == 3 and scores["icfdl"]["trials_needed"] is None
    assert scores["icfdl"]["mse_last"] is None


def test_tuning_beats_the_defaults_on_the_nominal_plant():
    spent = quick().data["tuning_mse"]
    assert spent.sizes["evaluation"] == 5
    for name in quick().data["controller"].values:
        assert float(spent.sel(controller=name).min()) <= float(spent.sel(controller=name)[0])
        found = json.loads(str(quick().data["tuned"].sel(controller=name).values))
        assert set(found) == set(quick().study.laws[str(name)].ranges)


def test_a_law_that_does_not_suit_the_plant_is_told_why():
    class Refusing(PID):
        def refusal(self, study):
            return "it needs a position"

    one = comparison(SMALL, ["pid"])
    laws = {**one.laws, "fussy": Candidate(law=Refusing(), ranges={})}
    done = compare(dataclasses.replace(one, laws=laws), ["pid", "fussy"], QUICK, show_progress=False)
    rows = {row[0]: row for row in table(done)}
    assert rows["fussy"][-1] == "does not suit: it needs a position" and rows["fussy"][1] == "-"
    with pytest.raises(InvalidValue, match="no law suits this plant: fussy: it needs a position"):
        compare(dataclasses.replace(one, laws=laws), ["fussy"], QUICK, show_progress=False)


@pytest.mark.parametrize(
    ("laws", "assignments", "message"),
    [
        (["pidd"], [], "there is no law 'pidd' to compare; did you mean pid"),
        (["xyz"], [], "the laws are: pid"),
        ([], [], "at least one law"),
        (["pid"], ["budget=0"], "budget must lie in"),
        (["pid"], ["mass_off_percent=-100"], "mass_off_percent must lie in"),
        (["pid"], ["actuator.delay=0.15"], "multiple of the sampling time"),
        (["pid"], ["noise.speed_sigma=-1"], "speed_sigma must lie in"),
        (["pid"], ["laws.pid.law.kp=-1"], "kp must lie in"),
    ],
)
def test_bad_input_is_refused(laws, assignments, message):
    with pytest.raises(InvalidValue, match=message):
        compare(SMALL, laws, assignments, show_progress=False)


def test_studies_of_another_kind_are_refused():
    with pytest.raises(InvalidValue, match="compare takes a study made of trials"):
        comparison(studies.find("ato"))


def test_ranges_name_settings():
    with pytest.raises(InvalidValue, match="has no number 'kq' to tune"):
        Candidate(law=PID(), ranges={"kq": (0.1, 1.0)})


def test_scales_follow_the_plant():
    scale = scale_of(PointMass(), [[52.0]])
    assert scale.step == pytest.approx(350_000 / 0.36) and scale.rate == pytest.approx(350_000 / 3.6)
    assert scale.output == 2.0
    assert set(candidates(PointMass(), [[52.0]])) == set(MAKERS)


def test_dead_time_and_lag_are_options():
    done = compare(SMALL, ["pid"], [*QUICK, "actuator.delay=0.3", "actuator.lag=0.4"], show_progress=False)
    assert np.allclose(done.data["applied_force"].values[..., :3], 0.0)
    assert table(done)[1][1] != table(quick())[1][1]


def test_the_built_in_study_compares_all_laws():
    study = studies.find("same-plant")
    assert isinstance(study, Comparison) and set(study.laws) == set(MAKERS)
    assert settings.assigned(study, ["laws.pid.law.kp=3"]).laws["pid"].law.kp == 3.0


def test_a_comparison_is_saved_and_loaded(tmp_path):
    save(quick(), tmp_path, {"pid": 1.0})
    again = load(tmp_path, comparison(SMALL))
    assert again.scores() == quick().scores() and table(again) == table(quick())
    with (tmp_path / "times.csv").open() as file:
        assert list(csv.reader(file)) == [["law", "time per sample (us)"], ["pid", "1.0"]]


def test_times_are_measured():
    measured = times(quick(), repeats=2)
    assert set(measured) == set(MAKERS) and all(value > 0 for value in measured.values())
    assert "time per sample (us)" in table(quick(), measured)[0]


def test_the_figure_is_drawn():
    from matplotlib import pyplot

    figure = quick().figures()["comparison"]()
    assert all(axes.has_data() and axes.get_ylabel() for axes in figure.axes)
    pyplot.close(figure)


def test_the_command_compares(tmp_path):
    study = tmp_path / "mine.py"
    study.write_text(
        "from models.point_mass import PointMass\n"
        "from models.metro_profile import MetroProfile\n"
        "from workbench.controllers.cfdl import CFDL\n"
        "from workbench.trials.study import TrialStudy\n"
        "study = TrialStudy(plant=PointMass(), reference=MetroProfile(horizon=120), controllers={'cfdl': CFDL()})\n"
    )
    asked = ["compare", str(study), "--laws", "pid, increment", "--set", "trials=3", "--set", "budget=3"]
    done = CliRunner().invoke(app, [*asked, "--out", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    assert "increment" in done.output and "final MSE" in done.output
    for name in ("table.csv", "times.csv", "run.nc", "scores.json"):
        assert (tmp_path / "out" / name).is_file()
    checked = CliRunner().invoke(app, [*asked, "--out", str(tmp_path / "out"), "--verify"])
    assert checked.exit_code == 0, checked.output
    assert "whose proof applies" in checked.output and (tmp_path / "out" / "report.html").is_file()
    told = CliRunner().invoke(app, [*asked, "--out", str(tmp_path / "out"), "--json", "--seed", "3"])
    assert set(json.loads(told.stdout)["scores"]) == {"pid", "increment"}


def test_varying_lengths_do_not_enter_a_comparison():
    varying = dataclasses.replace(SMALL, trial_length=TrialLength(law="uniform"))
    assert comparison(varying, ["cfdl"]).study({"cfdl": CFDL()}, true=True, seed=0).trial_length.law == "fixed"
