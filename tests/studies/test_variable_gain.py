"""The variable-gain study against a plain replay and the figures that it is known for."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models.quantity import InvalidValue
from studies.variable_gain.study import STUDY, Start
from workbench.contracts import settings
from workbench.trials.campaign import run


def campaign(*assignments, case=""):
    return run(settings.assigned(settings.in_case(STUDY, case), assignments), show_progress=False)


def overlap(a, b, c, d):
    return max(0.0, min(b, d) - max(a, c))


def resistance(s, v):
    kmh, sign = 3.6 * abs(v), v / math.sqrt(v * v + 0.05**2)
    total = (2.031 + 0.0622 * kmh + 0.001807 * kmh**2) * sign
    for a, b, grade in ((200, 500, 8), (500, 900, -12), (900, 1200, 5)):
        total += grade * overlap(s - 100, s, a, b) / 100
    for a, b, radius in ((300, 600, 450), (950, 1150, 600)):
        total += 600 / radius * overlap(s - 100, s, a, b) / 100 * sign
    total += 0.00013 * 400 * sign if 600 <= s < 1000 else 0.0
    return 9.81e-3 * total


def trial(s, v, forces):
    rows = [(s, v)]
    for force in forces:
        for _ in range(2):
            h = 0.05
            k1 = v, force - resistance(s, v)
            k2 = v + h / 2 * k1[1], force - resistance(s + h / 2 * k1[0], v + h / 2 * k1[1])
            k3 = v + h / 2 * k2[1], force - resistance(s + h / 2 * k2[0], v + h / 2 * k2[1])
            k4 = v + h * k3[1], force - resistance(s + h * k3[0], v + h * k3[1])
            s += h / 6 * (k1[0] + 2 * k2[0] + 2 * k3[0] + k4[0])
            v += h / 6 * (k1[1] + 2 * k2[1] + 2 * k3[1] + k4[1])
        rows.append((s, v))
    return rows


@pytest.mark.parametrize("name", ["variable", "fixed"])
def test_recorded_trials_replay(name):
    data = campaign("trials=4").data.sel(controller=name)
    r_s, r_v = data["reference"].values.tolist()
    n = len(r_s) - 1
    forces = [(r_v[i + 1] - r_v[i]) / 0.1 for i in range(n)]
    start = [0.8, 0.3]
    for i in range(4):
        rows = trial(*start, forces)
        np.testing.assert_allclose(data["input"][i, :-1], forces, atol=1e-8)
        np.testing.assert_allclose(data["output"][i].sel(output_name="position"), [s for s, _ in rows], atol=1e-6)
        np.testing.assert_allclose(data["output"][i].sel(output_name="speed"), [v for _, v in rows], atol=1e-8)
        e = [r_v[j] - rows[j][1] for j in range(n + 1)]
        mean = sum(map(abs, e)) / (n + 1)
        for j in range(n):
            lam = 1.0 if name == "fixed" else 0.3 + 0.7 / (1 + math.exp(-5 * (abs(e[j]) / mean - 1)))
            if name == "variable":
                assert data["law_learning_gain"][i, j] == pytest.approx(lam, abs=1e-8)
            forces[j] += lam * (e[j + 1] - e[j]) / 0.1
        start = [start[0] + 0.6 * (r_s[0] - start[0]), start[1] + 0.6 * (r_v[0] - start[1])]


def test_the_defaults_converge_and_the_initial_error_shrinks_by_two_fifths():
    done = campaign()
    for scores in done.scores().values():
        assert scores["max_position_error_first"] == pytest.approx(428, abs=1)
        assert scores["max_speed_error_first"] == pytest.approx(7.5, abs=0.1)
        assert scores["max_position_error_last"] < 0.01
        assert scores["max_speed_error_last"] < 5e-4
        assert scores["initial_position_ratio"] == pytest.approx(0.4, abs=1e-9)
    start = done.data["error"].sel(output_name="position").isel(sample=0).values[:, :12]
    np.testing.assert_allclose(start[:, 1:] / start[:, :-1], 0.4, atol=1e-9)


def test_without_initial_learning_the_speed_error_stays():
    for scores in campaign(case="without-initial-learning").scores().values():
        assert scores["max_speed_error_last"] == pytest.approx(0.30, abs=0.01)
        assert scores["max_position_error_last"] > 10
        assert scores["trials_to_tolerance"] is None


@pytest.mark.parametrize(("mismatch", "diverges"), [("2.1", True), ("1.9", False), ("0.5", False)])
def test_a_gain_that_is_too_large_is_caught_early(mismatch, diverges):
    done = campaign(f"gain_mismatch={mismatch}")
    at = done.scores()["fixed"]["diverged_at_trial"]
    assert (at is not None) is diverges
    if diverges:
        assert at < 15 and "slope grew" in str(done.data["stopped"].sel(controller="fixed").values)


def test_noise_alone_is_no_divergence_and_smoothing_helps():
    rough = campaign(case="noise").scores()["variable"]
    smooth = campaign(case="noise-smoothed").scores()["variable"]
    assert rough["diverged_at_trial"] is None
    assert smooth["max_speed_error_last"] < rough["max_speed_error_last"] / 3


def test_random_starts_come_from_the_seed():
    one, again, other = (
        campaign("trials=2", "initial.random_sigma=1", f"seed={seed}").data["error"][0, 0, 0, 0] for seed in (1, 1, 2)
    )
    assert one == again and one != other
    each = campaign("trials=9", "initial.trial_sigma=1", case="without-initial-learning").data["error"][0, :, 0, 0]
    assert np.unique(each).size == 9


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("controllers.fixed.lam=-1", r"controllers\.fixed\.lam must lie in \(0, ∞\), got -1"),
        ("controllers.variable.lam_min=0", r"controllers\.variable\.lam_min must lie in \(0, 1\]"),
        ("gain_mismatch=0", r"input_gain must lie in \(0, ∞\)"),
        ("initial_learning=false", "there is no setting 'initial_learning' any more: each law has its own"),
        ("plant.length=2000", "length must be at most that of the line"),
        ("plant.sampling_time=0.3", "the running time must be a multiple of the sampling time"),
        ("reference.distance=100", "speed must be reached within the distance"),
        ("initial.random_sigma=-1", "random_sigma must lie in"),
        ("initial.angle=1", "there is no setting"),
    ],
)
def test_bad_input_is_refused_in_one_line(assignment, message):
    with pytest.raises(InvalidValue, match=message) as caught:
        run(settings.assigned(STUDY, [assignment, "trials=1"]), show_progress=False)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("assignment", "path", "value"),
    [
        ("noise.speed_sigma=0.02", "noise.sigma", 0.02),
        ("gain_mismatch=1.5", "truth.input_gain.factor", 1.5),
        ("initial.position=2", "initial.position", 2.0),
        ("controllers.fixed.initial_learning=false", "controllers.fixed.initial_learning", False),
    ],
)
def test_old_settings_have_a_new_path(assignment, path, value):
    now = settings.as_json(settings.assigned(STUDY, [assignment]))
    for name in path.split("."):
        now = now[name]
    assert now == value


@pytest.mark.parametrize("case", STUDY.cases)
def test_every_case_runs(case):
    done = campaign("trials=3", case=case)
    assert done.data.attrs["case"] == case
    assert all(row["max_speed_error_last"] is not None for row in done.scores().values())
    assert settings.as_json(settings.in_case(STUDY, case)) != settings.as_json(STUDY)


def test_the_mismatch_is_that_of_the_plant_that_runs_and_the_watch_sees_it():
    study = settings.in_case(STUDY, "mismatch")
    assert study.plant.input_gain == 1.0 and study.plant_that_runs.input_gain == 2.1


def test_a_smoothing_that_is_too_short_is_refused_for_that_law():
    done = campaign("controllers.variable.smoothing_s=0.1", "trials=2")
    assert "smoothing_s must be 0 or above" in str(done.data["stopped"].sel(controller="variable").values)
    assert done.scores()["variable"]["max_position_error_last"] is None
    assert done.scores()["fixed"]["max_position_error_last"] is not None
    assert done.figures()["errors_by_trial"]() is not None


def test_every_figure_draws(tmp_path):
    campaign("trials=3").save(tmp_path)
    assert len(list((tmp_path / "figures").glob("*.png"))) == 8


@pytest.mark.parametrize(
    ("fields", "bound"),
    [
        ({}, [[0.8, 0.8], [0.3, 0.3]]),
        ({"position": -1.0, "speed": 0.0}, [[-1.0, -1.0], [0.0, 0.0]]),
        ({"random_sigma": 0.1}, [[-math.inf, math.inf]] * 2),
        ({"trial_sigma": 0.1}, [[-math.inf, math.inf]] * 2),
    ],
)
def test_starts_are_bounded_where_nothing_is_drawn(fields, bound):
    assert Start(**fields).bound(STUDY.plant).tolist() == bound
