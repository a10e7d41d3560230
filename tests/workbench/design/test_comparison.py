"""Comparing laws on one plant: the table, its metrics against plain loops, and what is refused."""

from __future__ import annotations

import csv
import dataclasses
import functools
import json
from typing import NamedTuple

import numpy as np
import pytest
from typer.testing import CliRunner

from models.actuator import Actuator
from models.metro_profile import MetroProfile
from models.point_mass import PointMass
from models.quantity import InvalidValue, declared
from studies.rail.scores import RIDE
from workbench.cli import app
from workbench.contracts import settings
from workbench.contracts.law import Channels, Law
from workbench.contracts.scenario import Between, NormalNoise
from workbench.contracts.study import Measures, Study, composed
from workbench.contracts.trial_length import TrialLength
from workbench.controllers.icfdl import ICFDL
from workbench.controllers.pid import PID
from workbench.design.comparison import comparison
from workbench.design.library import LIBRARY
from workbench.design.search import Search, believed, met
from workbench.design.table import compare, save, settled, table, times
from workbench.trials import find as studies
from workbench.trials.campaign import load, run
from workbench.trials.replay import replayed
from workbench.trials.simulation import Runner

SMALL = Study(
    name="small",
    plant=PointMass(),
    reference=MetroProfile(horizon=120),
    controllers={"mine": PID(kp=2.0, input_unit=1e5)},
    trials=3,
    compared=(RIDE,),
    actuator=Actuator(lower=-450e3, upper=450e3, rate=500e3),
    noise=0.05,
    truth={"mass": 1.1},
)
QUICK = ["trials=4", "budget=5"]
LAWS = [*(name for name, make in LIBRARY.items() if not make().stepped), "mine"]


@functools.cache
def quick():
    return compare(SMALL, None, QUICK, show_progress=False)


def test_every_law_is_in_the_table():
    rows = table(quick())
    assert [row[0] for row in rows[1:]] == LAWS
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
    common = ["law", "MSE, mean over trials ((km/h)^2)", "final MSE ((km/h)^2)", "trials needed"]
    assert list(rows[0]) == [*common, *columns, "solves", "told", "learns on", "note"]
    own = ["mse", "trials_needed", *metrics, "solves", "evaluations"]
    assert [name for name in scores if name in own] == own and scores["mse_last"] == scores["mse"]
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
    done = compare(SMALL, ["pid"], ["trials=4", "budget=1", "noise.sigma=0"], show_progress=False)
    law = done.tuned_laws()["pid"]
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
    np.testing.assert_allclose(one["applied"][:-1], forces, rtol=1e-9)
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
    scores = dataclasses.replace(quick(), data=data).scores()
    assert scores["cfdl"]["trials_needed"] == 3 and scores["icfdl"]["trials_needed"] is None
    assert scores["icfdl"]["mse_last"] is None


def test_tuning_beats_the_defaults_on_the_nominal_plant():
    spent = quick().data["tuning_mse"]
    assert spent.sizes["evaluation"] == 5
    for name in quick().data["controller"].values:
        assert float(spent.sel(controller=name).min()) <= float(spent.sel(controller=name)[0])
        found = json.loads(str(quick().data["tuned"].sel(controller=name).values))
        law = quick().study.controllers[str(name)]
        ranges = law.ranges(quick().study.task(law))
        assert set(found) == set(ranges) and all(low <= found[at] <= high for at, (low, high) in ranges.items())


class Refusing(PID):
    def refusal(self, task):
        return "it needs a position"


def test_a_law_that_does_not_suit_the_plant_is_told_why():
    study = dataclasses.replace(SMALL, controllers={"fussy": Refusing()})
    done = compare(study, ["pid", "fussy"], QUICK, show_progress=False)
    rows = {row[0]: row for row in table(done)}
    assert rows["fussy"][-1] == "does not suit: it needs a position" and rows["fussy"][1] == "-"
    assert rows["pid"][-1] == "" and set(settled(done).study.controllers) == {"pid"}
    with pytest.raises(InvalidValue, match="no controller suits this study: it needs a position"):
        compare(study, ["fussy"], QUICK, show_progress=False)


@pytest.mark.parametrize(
    ("laws", "assignments", "message"),
    [
        (["pidd"], [], "there is no law 'pidd' to compare; did you mean pid"),
        (["xyz"], [], "the laws are: pid"),
        ([], [], "at least one law"),
        (["pid"], ["budget=0"], "budget must lie in"),
        (["pid"], ["tuning.budget=1.5"], "tuning.budget must be"),
        (["pid"], ["truth.mass.factor=-1"], "mass must"),
        (["pid"], ["truth.weight.factor=1"], "truth.weight"),
        (["pid"], ["actuator.delay=0.15"], "multiple of the sampling time"),
        (["pid"], ["noise.sigma=-1"], "sigma must lie in"),
        (["pid"], ["laws.pid.law.kp=-1"], "kp must lie in"),
    ],
)
def test_bad_input_is_refused(laws, assignments, message):
    with pytest.raises(InvalidValue, match=message):
        compare(SMALL, laws, assignments, show_progress=False)


def test_what_is_no_study_is_refused():
    with pytest.raises(InvalidValue, match="compare takes a Study"):
        comparison(PointMass())


class Boasting(PID):
    def ranges(self, task):
        return {"kq": (0.1, 1.0)}


def test_ranges_name_settings():
    study = dataclasses.replace(SMALL, controllers={"boasting": Boasting()})
    with pytest.raises(InvalidValue, match="Boasting has no number 'kq' to tune"):
        compare(study, ["boasting"], QUICK, show_progress=False)


def test_laws_that_decide_in_numbers_are_compared_where_they_are_named(joint, tmp_path):
    limits = ["--set", "actuator.lower=-20", "--set", "actuator.upper=20", "--set", "budget=3", "--set", "trials=2"]
    asked = ["compare", str(joint), "--laws", "rmpc,pid", *limits, "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(app, asked)
    assert done.exit_code == 0, done.output
    header, rmpc, pid = csv.reader((tmp_path / "out" / "table.csv").read_text().splitlines())
    told, solves, least = header.index("told"), header.index("solves"), header.index("final MSE ((rad)^2)")
    assert rmpc[told] == "reference, limits, model, state, delay" and rmpc[solves] == str(2 * 60)
    assert float(rmpc[least]) < 0.1 and float(pid[least]) < 0.1
    loose = CliRunner().invoke(app, ["compare", str(joint), "--laws", "rmpc", "--out", str(tmp_path / "loose")])
    assert loose.exit_code != 0 and "a tube needs limits of torque" in str(loose.exception)


def test_dead_time_and_lag_are_options():
    done = compare(SMALL, ["pid"], [*QUICK, "actuator.delay=0.3", "actuator.lag=0.4"], show_progress=False)
    assert np.allclose(done.data["applied"].values[..., :3], 0.0)
    assert table(done)[1][1] != table(quick())[1][1]


def test_the_built_in_study_compares_the_laws_of_the_library():
    study = studies.find("same-plant")
    assert isinstance(study.tuning, Search) and set(study.controllers) == {*LIBRARY} - {
        "palc-filtered",
        "rmpc",
        "rsmpc",
    }
    for path in ("laws.pid.law.kp=3", "controllers.pid.kp=3"):
        assert settings.assigned(study, [path]).controllers["pid"].kp == 3.0
    changed = settings.assigned(study, ["laws.palc.law.law.alpha=2", "budget=7", "noise.speed_sigma=0.1"])
    assert changed.controllers["palc"].law.alpha == 2.0 and changed.tuning.budget == 7 and changed.noise.sigma == 0.1
    with pytest.raises(InvalidValue, match=r"mass_off_percent.*set truth\.mass\.factor"):
        settings.assigned(study, ["mass_off_percent=0"])
    assert [*comparison(study, ["palc-filtered", "pid"]).controllers] == ["palc-filtered", "pid"]


def test_a_comparison_is_saved_and_loaded(tmp_path):
    save(quick(), tmp_path, {"pid": 1.0})
    again = load(tmp_path, comparison(SMALL))
    assert again.scores() == quick().scores() and table(again) == table(quick())
    with (tmp_path / "times.csv").open() as file:
        assert list(csv.reader(file)) == [["law", "time per sample (us)"], ["pid", "1.0"]]


def test_a_loaded_comparison_is_tuned_again_and_must_agree(tmp_path):
    study = comparison(SMALL, ["pid", "palc", "icfdl"])
    run(settings.assigned(study, QUICK), show_progress=False).save(tmp_path)
    replayed(load(tmp_path, study))
    edited = load(tmp_path, study)
    edited.data["tuning_mse"][0, 3] += 1e-12
    with pytest.raises(InvalidValue, match="tuning_mse"):
        replayed(edited)


def test_times_are_measured():
    measured = times(quick(), repeats=2)
    assert set(measured) == set(LAWS) and all(value > 0 for value in measured.values())
    assert "time per sample (us)" in table(quick(), measured)[0]


def test_the_figure_is_drawn():
    from matplotlib import pyplot

    figure = quick().figures()["comparison"]()
    assert all(axes.has_data() and axes.get_ylabel() for axes in figure.axes)
    pyplot.close(figure)


def test_a_comparison_takes_the_scenario_of_its_study():
    lengths = TrialLength(law="uniform", minimum=60)
    study = dataclasses.replace(
        SMALL, trial_length=lengths, noise=0.3, truth={"mass": Between(low=0.9, high=1.2)}, seed=5, trials=2
    )
    compared = comparison(study)
    assert compared.scenario == study.scenario and compared.actuator == study.actuator and compared.seed == 5
    assert "cfdl" not in compared.controllers and "icfdl" in compared.controllers  # one refuses varying lengths
    done = compare(study, ["cfdl", "icfdl"], ["budget=2"], show_progress=False)
    assert "does not suit: cfdl needs fixed trial lengths" in table(done)[1][-1]
    assert done.data["trial_length"].values.tolist() == [one.length for one in study.inputs()]


def test_tuning_never_sees_the_true_plant_nor_its_noise():
    study = comparison(SMALL, ["pid"])
    tuned = believed(study)
    assert tuned.plant_that_runs == SMALL.actuator.wrapped(PointMass())
    assert study.plant_that_runs == SMALL.actuator.wrapped(PointMass(mass=350_000.0 * 1.1))
    assert not np.allclose(met(study)[0].noise, study.inputs()[0].noise) and tuned.tuning is None
    far = dataclasses.replace(SMALL, truth={"mass": 3.0})
    found = [compare(one, ["pid"], QUICK, show_progress=False).data["tuned"].values for one in (SMALL, far)]
    assert found[0] == found[1]


def test_what_tuning_minimises_is_the_mean_of_the_last_five_trials():
    done = compare(SMALL, ["pid", "icfdl"], ["trials=8", "budget=3"], show_progress=False)
    alone = dataclasses.replace(believed(done.study), scorers=(), drawings=None)
    tuned = dataclasses.replace(alone, controllers=dict(done.tuned_laws()))
    for name, judged in (("pid", slice(0, 5)), ("icfdl", slice(3, 8))):  # a law that learns has all trials
        spent = done.data["tuning_mse"].sel(controller=name).values
        for study, cost in ((alone, spent[0]), (tuned, spent.min())):
            mse = [float(left.mse[0]) for left in Runner(study, name).trials(met(done.study))]
            assert cost == pytest.approx(np.mean(mse[judged]), rel=1e-12)


class Drawn(NamedTuple):
    gain: object


@declared
class Chancy(Law):
    """A proportional law whose gain is drawn."""

    source = "a test"

    def chance(self, seed):
        return 1e5 * np.random.default_rng(seed).uniform(0.5, 5.0, 1)

    def start(self, task):
        return Drawn(task.chance)

    def act(self, memory_k, state, r, r_next, y):
        return memory_k.gain * (r - y), state


def test_a_law_starts_with_the_same_chance_when_it_is_tuned():
    study = dataclasses.replace(SMALL, controllers={"chancy": Chancy()}, truth={}, noise=0.0)
    done = compare(study, ["chancy"], ["budget=3"], show_progress=False)
    assert done.data["tuning_mse"].values.min() == pytest.approx(done.scores()["chancy"]["mse_last"], rel=1e-12)


def test_laws_of_the_study_keep_their_settings_and_come_first():
    own = {"mine": PID(kp=7.0, input_unit=10.0), "icfdl": ICFDL(force_unit=50.0)}
    study = dataclasses.replace(SMALL, controllers=own)
    every = comparison(study).controllers
    assert [*every] == LAWS and every["mine"] == own["mine"] and every["icfdl"] == own["icfdl"]
    assert [*comparison(study, ["mine", "pid"]).controllers] == ["mine", "pid"]
    assert every["pid"].input_unit == pytest.approx(350_000 / 3.6)
    task = study.task()
    for name in ("kp", "ki", "kd"):  # the same inputs are tried, whatever the law counts them in
        theirs, scaled = own["mine"].ranges(task)[name], every["pid"].ranges(task)[name]
        assert np.multiply(theirs, 10.0) == pytest.approx(np.multiply(scaled, every["pid"].input_unit))


def test_a_study_with_settings_of_its_own_is_compared():
    from models.quantity import declared, quantity

    @declared
    class Level:
        sigma: float = quantity(default=0.1, unit="km/h", doc="noise of the whole study", least=0)

    def compose(own, seed):
        return {"noise": NormalNoise(sigma=own.sigma), "controllers": {"only": PID(kp=own.sigma)}}

    study = composed(Level(), compose, plant=PointMass(), reference=MetroProfile(horizon=60), trials=2)
    done = compare(study, ["only", "pid"], ["sigma=0.2", "budget=2"], show_progress=False)
    assert done.study.scenario.noise.sigma == 0.2 and list(done.scores()) == ["only", "pid"]
    assert done.data["noise"].std() == pytest.approx(0.2, rel=0.3)


JOINT = """
import casadi as ca
import numpy as np
from models.plant import Plant, signal, signals
from models.quantity import declared, quantity
from workbench import Study
from workbench.controllers.pid import PID


@declared
class Joint(Plant):
    states = signals(angle=signal("rad", "joint angle", role="angle"), rate=("rad/s", "joint rate"))
    inputs = signals(torque=signal("N m", "motor torque", role="torque"))
    outputs = signals(angle=signal("rad", "joint angle", role="angle"))
    inertia: float = quantity(default=0.5, unit="kg m^2", doc="inertia", above=0)
    sampling_time: float = quantity(default=0.02, unit="s", doc="sampling time", above=0)

    def rhs(self, x, u, w, t):
        return x.rate, (u.torque - 0.8 * x.rate - 2.0 * ca.sin(x.angle)) / self.inertia

    def output(self, x):
        return (x.angle,)


study = Study(
    name="joint", plant=Joint(), reference=0.5 * (1 - np.cos(np.linspace(0, 6, 61))), trials=5,
    controllers={"mine": PID(kp=20.0, ki=1.0, kd=2.0)},
)
"""


@pytest.fixture
def joint(tmp_path):
    file = tmp_path / "joint.py"
    file.write_text(JOINT)
    return file


def test_a_joint_is_compared_in_its_own_units(joint, tmp_path):
    asked = [
        "compare",
        str(joint),
        "--laws",
        "pid,icfdl,mine,palc",
        "--set",
        "budget=8",
        "--out",
        str(tmp_path / "out"),
    ]
    done = CliRunner().invoke(app, asked)
    assert done.exit_code == 0, done.output
    header, *rows = csv.reader((tmp_path / "out" / "table.csv").read_text().splitlines())
    assert header == [
        "law",
        "MSE, mean over trials ((rad)^2)",
        "final MSE ((rad)^2)",
        "trials needed",
        "solves",
        "told",
        "learns on",
        "note",
    ]
    by_law = {row[0]: dict(zip(header, row, strict=True)) for row in rows}
    assert float(by_law["pid"]["final MSE ((rad)^2)"]) < 1e-2
    assert [by_law[name]["learns on"] for name in ("pid", "icfdl", "mine")] == ["-", "output", "-"]
    assert by_law["icfdl"]["told"] == "reference, plan" and by_law["pid"]["told"] == "reference"
    assert by_law["palc"]["note"].endswith("needs a plant that measures a speed, nothing else")
    assert "jerk" not in done.output and "km/h" not in done.output


def test_dead_time_is_no_refusal_but_noted(joint, tmp_path):
    late = ["--set", "actuator.delay=0.04", "--set", "budget=3", "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(app, ["compare", str(joint), "--laws", "pid,icfdl", *late])
    assert done.exit_code == 0, done.output
    _, pid, icfdl = csv.reader((tmp_path / "out" / "table.csv").read_text().splitlines())
    assert pid[-1] == "" and icfdl[-1] == "learns from the error at k+1, u(k) first reaches y(k+3)"


class Both(PID):
    """A PID on each of two channels."""

    channels = Channels(outputs=2, inputs=2)

    def ranges(self, task):
        return {"kp": (0.1, 10.0)}

    def act(self, memory_k, state, r, r_next, y):
        return self.kp * (r - y), state


def two_by_two(**fields):
    import control

    from models.plant import Plant

    a, b = np.diag([0.9, 0.8]), np.diag([0.2, 0.1])
    system = control.ss(a, b, np.eye(2), 0, 0.1)
    plant = Plant.from_control(system, outputs=["level", "heat"], units={"level": "m", "heat": "K"})
    reference = np.vstack([np.ones(41), 5 * np.sin(np.arange(41))])
    return Study(plant=plant, reference=reference, controllers={"both": Both()}, trials=2, **fields)


def test_several_outputs_are_compared_by_their_weights():
    with pytest.raises(
        InvalidValue, match=r"units m, K have no common error: give the study weights=\(\.\.\., \.\.\.\)"
    ):
        compare(two_by_two(), show_progress=False)
    for weights in ((1.0,), (1.0, -1.0), (0.0, 0.0), (1.0, np.nan)):
        with pytest.raises(InvalidValue, match="weights must be one an output"):
            compare(two_by_two(weights=weights), show_progress=False)
    found = {}
    for weights in ((1.0, 0.0), (0.0, 1.0), (2.0, 0.5)):
        done = compare(two_by_two(weights=weights), None, ["budget=10"], show_progress=False)
        assert list(done.study.controllers) == ["pid", "pd-ilc", "both"]  # the library's that are for two outputs
        rows = table(done)
        assert rows[0][1:3] == ("MSE, mean over trials (weighed)", "final MSE (weighed)")
        mse = done.data["mse"].sel(controller="both").isel(trial=-1).values
        assert done.scores()["both"]["mse_last"] == pytest.approx(np.dot(weights, mse))
        e = done.data["error"].sel(controller="both").isel(trial=-1).values
        np.testing.assert_allclose(mse, (e[:, 1:] ** 2).mean(axis=1))
        nominal = done.data["tuning_mse"].sel(controller="both").values
        assert nominal.min() == pytest.approx(np.dot(weights, mse))  # without noise or departures both plants agree
        found[weights] = json.loads(str(done.data["tuned"].sel(controller="both").values))["kp"]
    assert found[1.0, 0.0] != found[0.0, 1.0]
    done.figures()["comparison"]()


def test_the_command_compares(tmp_path):
    study = tmp_path / "mine.py"
    study.write_text(
        "from models.point_mass import PointMass\n"
        "from models.metro_profile import MetroProfile\n"
        "from workbench.controllers.cfdl import CFDL\n"
        "from workbench import Study\n"
        "study = Study(plant=PointMass(), reference=MetroProfile(horizon=120), controllers={'cfdl': CFDL()})\n"
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
