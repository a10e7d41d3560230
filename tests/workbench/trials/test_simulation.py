"""The engine: what differs from trial to trial, plans, draws, cases, settings of a study's own, going on."""

from __future__ import annotations

import dataclasses

import casadi as ca
import numpy as np
import plain_loop
import pytest
import xarray as xr

from models.actuator import Actuator, Lagged
from models.maglev import Maglev
from models.plant import Plant, signal, signals
from models.point_mass import PointMass
from models.quantity import InvalidValue, count, declared, part, quantity
from studies.metro.study import STUDY
from workbench import Study, load, run
from workbench.contracts import settings
from workbench.contracts.scenario import Between, From, NormalDisturbance, NormalNoise
from workbench.contracts.study import Inverse, composed
from workbench.contracts.trial_length import TrialLength
from workbench.controllers import ICFDL, PD
from workbench.trials.draws import of_draws
from workbench.trials.simulation import simulate

SHORT = 12 * np.sin(np.linspace(0, np.pi, 61)) ** 2


def study(**fields):
    """A short metro run with settings of its own."""
    made = dict(
        plant=PointMass(pulsation=0.1),
        reference=SHORT,
        controllers={"icfdl": ICFDL(), "pd": PD()},
        trials=4,
        trial_length=TrialLength(minimum=50),
        seed=3,
    )
    return Study(**(made | fields))


SCENARIOS = {
    "as it is": {},
    "noise": {"noise": NormalNoise(sigma=0.05)},
    "starts": {"initial": From(state=(0.3, 40.0), spread=(0.2, 10.0))},
    "another mass": {"truth": {"mass": 1.2}},
    "masses": {"truth": {"mass": Between(low=0.8, high=1.2)}},
    "masses and resistances": {"truth": {"mass": Between(low=0.8, high=1.2), "b0_mean": Between(low=0.5, high=2.0)}},
    "the swing of the resistance": {"truth": {"b0_swing": [1.0, 3.0, 0.1, 1.0], "pulsation": Between(low=0.5, high=2)}},
    "an actuator": {"actuator": Actuator(lag=0.3, delay=0.2, lower=-3e4, upper=5e4)},
    "an actuator and masses": {"actuator": Actuator(lag=0.3, delay=0.2), "truth": {"mass": Between(low=0.5, high=2.0)}},
    "a lag of its own behind another": {
        "plant": Lagged(plant=PointMass(), time_constant=0.5),
        "actuator": Actuator(lag=0.3),
        "truth": {"time_constant": Between(low=0.5, high=2.0)},
    },
    "one trial after the other": {"continues": True, "trial_length": TrialLength(law="fixed")},
    "shorter trials": {"trial_length": 40},
    "a plan": {"first_plan": 2.5e4},
}


@pytest.mark.parametrize("scenario", SCENARIOS)
@pytest.mark.parametrize("controller", ["icfdl", "pd"])
def test_it_equals_a_plain_loop(scenario, controller):
    made = study(**SCENARIOS[scenario])
    data = run(made, show_progress=False).data.sel(controller=controller)
    for trial, (u, y, x, mse, length) in enumerate(plain_loop.campaign(made, controller), 1):
        one = data.sel(trial=trial)
        assert int(data["trial_length"].sel(trial=trial)) == length
        for recorded, plain in ((one["output"], y[0]), (one["applied"][:-1], None), (one["input"][:-1], u[0])):
            if plain is None:
                assert int(np.isfinite(recorded.values).sum()) == length
                continue
            reached = np.isfinite(plain)
            np.testing.assert_allclose(recorded.values[reached], plain[reached], rtol=1e-10, atol=1e-9)
        np.testing.assert_allclose(one["mse"], mse[0], rtol=1e-11)
        np.testing.assert_allclose(one["state_position"].values[: length + 1], x[1], rtol=1e-10, atol=1e-10)


def test_what_differs_is_recorded_and_what_does_not_is_one_zero():
    made = study(truth={"mass": Between(low=0.8, high=1.2), "b1_mean": 1.5}, noise=NormalNoise(sigma=0.05))
    data = run(made, show_progress=False).data
    factors = data["truth_mass"].values
    assert data["truth_mass"].dims == ("trial",) and len(set(factors)) == 4 and (np.abs(factors - 1) <= 0.2).all()
    assert "truth_b1_mean" not in data and made.plant_that_runs.b1_mean == pytest.approx(1.5 * made.plant.b1_mean)
    assert made.plant.b1_mean == PointMass().b1_mean
    assert data["noise"].dims == ("trial", "sample") and run(study(), show_progress=False).data["noise"].dims == ()


def test_each_kind_has_a_stream_of_its_own():
    plain = study().inputs()
    for fields in SCENARIOS.values():
        others = study(**{**fields, "trial_length": TrialLength(minimum=50), "continues": False}).inputs()
        assert [one.length for one in others] == [one.length for one in plain]


def test_a_first_plan_of_the_inverse_follows_at_once():
    made = study(first_plan=Inverse(), trial_length=TrialLength(law="fixed"), trials=2)
    assert float(run(made, show_progress=False).data["mse"].max()) < 1e-20
    half = study(first_plan=Inverse(share=0.5), trial_length=TrialLength(law="fixed"), trials=1)
    np.testing.assert_allclose(half.plan, made.plan / 2)
    wrong = study(first_plan=Inverse(), truth={"mass": 1.3}, trials=1)
    assert float(run(wrong, show_progress=False).data["mse"].min()) > 1e-3, "the model is not the true plant"


def test_going_on_from_a_campaign_is_the_longer_campaign(tmp_path):
    fixed = TrialLength(law="fixed")
    whole = run(study(trials=7, trial_length=fixed), show_progress=False)
    first = run(study(trials=4, trial_length=fixed), show_progress=False)
    first.save(tmp_path / "first")
    for begun in (first, load(tmp_path / "first", study(trials=4, trial_length=fixed))):
        then = run(study(trials=3, trial_length=fixed), start=begun, show_progress=False)
        for name in ("output", "input", "mse", "ppd_estimate"):
            np.testing.assert_array_equal(then.data[name].values, whole.data[name].values[:, 4:])


def test_a_draw_is_the_campaign_of_its_seed():
    made = study(noise=NormalNoise(sigma=0.1), draws=5, seed=11)
    done = run(made, show_progress=False)
    assert done.drawn is not None and done.drawn["seed"].values.tolist() == [11, 12, 13, 14, 15]
    for draw in range(5):
        alone = run(dataclasses.replace(made, draws=1, seed=11 + draw), show_progress=False)
        np.testing.assert_array_equal(done.drawn["mse"].values[:, draw], alone.data["mse"].values)
        for name, row in alone.scores().items():
            for metric, value in row.items():
                drawn = of_draws(done.drawn, name, metric)[draw]
                assert drawn == value or (np.isnan(drawn) and value is None)
    last = of_draws(done.drawn, "pd", "mse_last")
    scores = done.scores()["pd"]
    assert scores["mse_last"] == np.median(last) and scores["mse_last_p10"] == np.quantile(last, 0.1)
    other = run(dataclasses.replace(made, draws=2), show_progress=False)
    np.testing.assert_array_equal(other.drawn["mse"].values, done.drawn["mse"].values[:, :2])


def test_draws_are_written_and_read(tmp_path):
    made = study(draws=3, noise=NormalNoise(sigma=0.1))
    done = run(made, show_progress=False)
    done.save(tmp_path / "out")
    again = load(tmp_path / "out", made)
    xr.testing.assert_identical(again.drawn, done.drawn.drop_attrs() if False else again.drawn)
    assert again.scores() == done.scores()
    (tmp_path / "out" / "draws.nc").unlink()
    with pytest.raises(InvalidValue, match=r"draws\.nc must hold the draws of run\.nc"):
        load(tmp_path / "out", made)


CASES = study(cases={"heavy": {"truth": {"mass": 1.3}}, "noisy": {"noise.sigma": 0.2, "trials": 2}})


def test_a_case_is_the_study_with_its_changes(tmp_path):
    noisy = settings.in_case(CASES, "noisy")
    assert noisy.case == "noisy" and noisy.trials == 2 and noisy.scenario.noise.bound(noisy.plant)[0] == np.inf
    heavy = settings.in_case(CASES, "heavy")
    assert heavy.plant_that_runs.mass == pytest.approx(1.3 * 350_000) and heavy.plant.mass == 350_000
    assert settings.in_case(CASES, "default") is CASES and settings.in_case(heavy, "heavy") is heavy
    with pytest.raises(InvalidValue, match="study is in its case 'heavy': give the study as it is declared"):
        settings.in_case(heavy, "default")
    with pytest.raises(InvalidValue, match="there is no case 'light' of study; its cases are: default, heavy, noisy"):
        settings.in_case(CASES, "light")
    done = run(heavy, show_progress=False)
    done.save(tmp_path / "out")
    again = load(tmp_path / "out", CASES)
    assert again.study.case == "heavy" and again.study.plant_that_runs.mass == pytest.approx(1.3 * 350_000)
    xr.testing.assert_identical(simulate(again.study, lambda total, label: _silent()), done.data.drop_attrs(deep=False))


def _silent():
    from workbench.trials.progress import silent

    return silent(0, "")


@declared
class Own:
    """Settings that shape several parts of a study at once."""

    length: int = count(default=40, doc="samples of the run", least=10)
    top: float = quantity(default=5.0, unit="km/h", doc="largest speed", above=0)
    plant: PointMass = part(default=PointMass(), doc="the train")


def compose(own, seed):
    reference = own.top * np.sin(np.linspace(0, np.pi, own.length + 1)) ** 2
    return {"plant": own.plant, "reference": reference, "controllers": {"pd": PD()}, "initial": (0.0, float(seed))}


MADE = composed(
    Own(), compose, name="made", trials=2, renamed={"speed": "top"}, gone={"periods": "set trials, in trials"}
)


def test_settings_of_its_own_are_set_like_the_study_s():
    paths = [row.path for row in settings.rows(MADE)]
    assert {"length", "top", "plant.mass", "trials", "seed", "noise.sigma"} <= set(paths)
    assert not any(path.startswith(("own", "controllers", "initial")) for path in paths)
    changed = settings.assigned(MADE, ["length=20", "plant.mass=1e5", "trials=3"])
    assert changed.horizon == 20 and changed.plant.mass == 1e5 and changed.trials == 3
    assert settings.assigned(MADE, ["speed=9"]).reference_samples.max() == pytest.approx(9)
    assert dataclasses.replace(MADE, seed=4).inputs()[0].x0.tolist() == [0.0, 4.0]
    again = settings.changed(MADE, settings.as_json(changed))
    assert again.horizon == 20 and again.plant == changed.plant


@pytest.mark.parametrize(
    ("assignment", "says"),
    [
        ("periods=3", "there is no setting 'periods' any more: set trials, in trials"),
        ("controllers.pd.kp=3", "there is no setting 'controllers'"),
        ("own.length=3", "there is no setting 'own'"),
        ("lenth=3", "did you mean length"),
        ("length=3", r"length must lie in \[10, ∞\), got 3"),
        ("plant.mass=0", r"plant.mass must lie in \(0, ∞\) kg, got 0"),
    ],
)
def test_slips_in_settings_are_answered(assignment, says):
    with pytest.raises(InvalidValue, match=says):
        settings.assigned(MADE, [assignment])


def test_references_are_settings():
    assert "reference.horizon" in [row.path for row in settings.rows(STUDY)]
    assert settings.assigned(STUDY, ["reference.horizon=300", "trial_length.minimum=200"]).horizon == 300


def test_a_truth_is_replaced_as_a_whole_or_set_by_its_path():
    heavy = settings.changed(study(truth={"mass": 1.1}), {"truth": {"mass": {"factor": 1.3}}})
    assert heavy.plant_that_runs.mass == pytest.approx(1.3 * 350_000)
    assert settings.assigned(study(), ["truth.mass=1.2"]).plant_that_runs.mass == pytest.approx(420_000)
    both = settings.assigned(study(truth={"mass": 1.1}), ["truth.b0_mean=2", "truth.mass.factor=1.5"])
    assert {name: one.range[0] for name, one in both.truth.items()} == {"mass": 1.5, "b0_mean": 2.0}
    moving = settings.changed(study(truth={"mass": 1.1}), {"truth": {"b0_mean": Between(low=0.5, high=2.0)}})
    assert list(moving.truth) == ["b0_mean"] and moving.plant_that_runs.mass == 350_000


@declared
class Buggy(Plant):
    """Coasts to a stand; a trial is over when it stands."""

    source = "ours"
    states = signals(speed=signal("m/s", "speed", domain=(-1, 50), role="speed"), place=("m", "position"))
    inputs = signals(brake=("m/s^2", "deceleration"))
    outputs = signals(speed=("m/s", "speed"))
    disturbances = signals(wind="m/s^2")
    sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)

    def step(self, x, u, w, k):
        v = x.speed + self.sampling_time * (w.wind - u.brake)
        return ca.fmax(v, 0), x.place + self.sampling_time * x.speed

    def output(self, x):
        return (x.speed,)

    def ended(self, x):
        return x.speed <= 0


@pytest.mark.parametrize("wind", [0.0, 0.2])
def test_a_trial_ends_by_the_plant_s_own_event(wind):
    made = Study(
        plant=Buggy(),
        reference=np.linspace(8, 0, 101),
        controllers={"pd": PD(kp=-0.05, kd=0.0, force_unit=1.0, initial_input=1.5)},
        trials=4,
        initial=(8.0, 0.0),
        disturbance=NormalDisturbance(sigmas=(wind,)),
    )
    data = run(made, show_progress=False).data
    assert data["trial_length"].dims == ("controller", "trial")
    for trial, (_, y, x, mse, length) in enumerate(plain_loop.campaign(made, "pd")):
        assert int(data["trial_length"][0, trial]) == length < 100
        one = data.isel(controller=0, trial=trial)
        assert int(np.isfinite(one["output"].values).sum()) == length + 1
        np.testing.assert_allclose(one["output"].values[: length + 1], y[0, : length + 1], atol=1e-12)
        np.testing.assert_allclose(one["state_place"].values[: length + 1], x[1], atol=1e-12)
        np.testing.assert_allclose(float(one["mse"]), mse[0], rtol=1e-12)


def test_a_second_input_is_no_longer_ignored():
    @declared
    class Two(Plant):
        source = "ours"
        states = signals(speed="m/s")
        inputs = signals(push="N", pull="N")
        outputs = signals(speed="m/s")
        sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)

        def step(self, x, u, w, k):
            return (x.speed + self.sampling_time * (u.push - u.pull),)

        def output(self, x):
            return (x.speed,)

    made = Study(plant=Two(), reference=np.ones(21), controllers={"icfdl": ICFDL()}, trials=2)
    with pytest.raises(InvalidValue, match=r"icfdl is for 1 output\(s\) and 1 .*, two has 1 \(speed\) and 2 \(push"):
        run(made, show_progress=False)


def test_several_outputs_of_one_input_have_axes_of_their_own():
    from models.station_runs import Shuttle
    from workbench.controllers.shuttle_pid import ShuttlePID

    made = Study(
        plant=Maglev(), reference=Shuttle(), controllers={"pid": ShuttlePID(model=Maglev())}, trials=1, continues=True
    )
    data = run(made, show_progress=False).data
    assert data["output"].dims == ("controller", "trial", "output_name", "sample")
    assert data["input"].dims == ("controller", "trial", "sample") and data["mse"].dims[-1] == "output_name"
    assert data["output_unit"].values.tolist() == ["m", "m/s"]
    for name in ("position", "speed"):
        np.testing.assert_array_equal(data["output"].sel(output_name=name), data[f"state_{name}"])
