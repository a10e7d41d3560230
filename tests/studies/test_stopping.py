"""The stopping study: its outcomes, an independent replay, scores by plain loops, what it writes, bad settings."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from models.quantity import InvalidValue
from studies.stopping.record import predicted_errors
from studies.stopping.settings import own
from workbench.contracts.settings import assigned, in_case
from workbench.trials.campaign import load, run
from workbench.trials.find import find

STUDY = find("stopping")
OWN = own(STUDY)
TAU, T, C, H = 0.4, 0.2, -1.07, 0.01


@pytest.fixture(scope="module")
def campaign():
    return run(STUDY, show_progress=False)


def outcome(*settings):
    done = run(assigned(STUDY, settings), show_progress=False)
    return done, done.scores()


def test_laws_are_named_as_documented(campaign):
    kinds = [f"{kind}-n{N}" for kind in ("rmpc", "rsmpc", "offset-free") for N in (3, 5, 8, 10, 15)]
    assert list(campaign.data["controller"].values) == ["pid", "ideal-mpc", *kinds]
    for name, variable in campaign.data.variables.items():
        assert {"units", "long_name"} <= set(variable.attrs) or name == "controller", name


def test_configuration_a_stops_as_the_notes_expect(campaign):
    scores = campaign.scores()
    error = {name: row["stop_error_cm"] for name, row in scores.items()}
    assert all(15 <= error[f"rmpc-n{N}"] <= 30 for N in OWN.lengths) and error["rmpc-n15"] < error["rmpc-n3"]
    assert all(abs(error[f"rsmpc-n{N}"]) <= 50 for N in OWN.lengths)
    assert abs(error["ideal-mpc"]) < 0.5
    assert all(abs(error[f"offset-free-n{N}"]) < 1 for N in OWN.lengths)
    for N, most in ((3, 0.6), (5, 0.3), (10, 0.15), (15, 0.15)):
        assert scores[f"rsmpc-n{N}"]["updates"] <= most * scores[f"rmpc-n{N}"]["updates"]
    assert all(row["infeasible"] == 0 for row in scores.values())


def test_the_euler_model_stops_short():
    scores = outcome("model=euler", "horizons=[3]")[1]
    assert -6 < scores["ideal-mpc"]["stop_error_cm"] < -4


def test_configuration_b_is_the_same_for_every_horizon():
    scores = outcome("config=B")[1]
    errors = [scores[f"rmpc-n{N}"]["stop_error_cm"] for N in OWN.lengths]
    assert max(errors) - min(errors) < 0.01


def replay(commands, start, speed=20.0):
    """Integrate the train by plain loops under recorded commands and return positions and the stop."""
    a, v, s = start, speed, 0.0
    held = 0.5 / 1.07 if start else 0.0
    line, positions = [held] * 5, []
    for u in commands:
        positions.append(s)
        line.append(u)
        acting = line.pop(0)

        def rates(a, v, s, acting=acting):
            V = 3.6 * v
            g = 12 if s < 150 else 28 if s < 300 else -6
            return (C * acting - a) / TAU, a - (5.4 + 0.0098 * V + 0.00163 * V * V + 9.81 * g) / 1000, v

        for _ in range(20):
            k1 = rates(a, v, s)
            k2 = rates(*(x + H / 2 * k for x, k in zip((a, v, s), k1, strict=True)))
            k3 = rates(*(x + H / 2 * k for x, k in zip((a, v, s), k2, strict=True)))
            k4 = rates(*(x + H * k for x, k in zip((a, v, s), k3, strict=True)))
            steps = [(p + 2 * q + 2 * r + w) / 6 for p, q, r, w in zip(k1, k2, k3, k4, strict=True)]
            after = [x + H * d for x, d in zip((a, v, s), steps, strict=True)]
            if after[1] <= 0:
                share = v / (v - after[1])
                return positions, s + share * (after[2] - s)
            a, v, s = after
    return positions, math.nan


@pytest.mark.parametrize("name", ["pid", "rmpc-n3", "rsmpc-n15", "offset-free-n8"])
def test_recorded_commands_replay(campaign, name):
    one = campaign.data.sel(controller=name)
    commands = one["command"].dropna("sample").values
    positions, place = replay(commands.tolist(), -0.5)
    np.testing.assert_allclose(one["position"].dropna("sample"), positions, atol=1e-8)
    assert place == pytest.approx(float(one["stop_position"]), abs=1e-7)


def test_pid_commands_by_a_plain_loop(campaign):
    one = campaign.data.sel(controller="pid")
    total, before = 0.0, None
    for k, (v, u) in enumerate(zip(one["speed"].values, one["command"].values, strict=True)):
        if np.isnan(v):
            break
        error = v - (20 - 0.5 * k * T)
        slope = 0.0 if before is None else (error - before) / T
        total, before = total + error * T, error
        assert u == pytest.approx(min(max(0.5 / 1.07 + 0.7 * error + 0.2 * total + 0.2 * slope, 0), 1), abs=1e-12)


def test_recorded_plans_are_those_of_the_law(campaign):
    study = campaign.study
    for name in ("rmpc-n3", "rmpc-n15"):
        one, law = campaign.data.sel(controller=name), study.controllers[name]
        errors = predicted_errors(study, one)
        for k in (0, 1, 40, 90, 150, 199):
            plan = law.plan(errors[k])
            assert plan.du[0] == pytest.approx(float(one["increment"][k]), abs=1e-8)
            assert plan.J == pytest.approx(float(one["cost"][k]), rel=1e-7, abs=1e-9)


def test_holds_are_kept(campaign):
    one = campaign.data.sel(controller="rsmpc-n15")
    du, qps, hold = (one[name].dropna("sample").values for name in ("increment", "qps", "hold"))
    assert (du[qps == 0] == 0).all() and (qps > 0).sum() < 0.2 * du.size
    k = 0
    while k < du.size:
        assert qps[k] > 0 and 1 <= hold[k] <= 14
        k += int(hold[k])


def test_scores_by_plain_loops(campaign):
    for name, row in campaign.scores().items():
        one = campaign.data.sel(controller=name)
        error, changes, last = [], [], 0.5 / 1.07
        for k, (v, u) in enumerate(zip(one["speed"].values.tolist(), one["command"].values.tolist(), strict=True)):
            if v != v:
                break
            error.append(v - (20 - 0.5 * k * T))
            changes.append(abs(u - last))
            last = u
        assert row["rms_speed_error"] == pytest.approx(math.sqrt(sum(e * e for e in error) / len(error)))
        assert row["max_speed_error"] == pytest.approx(max(map(abs, error)))
        assert row["switches"] == sum(change > 1e-3 for change in changes)
        assert row["total_variation"] == pytest.approx(sum(changes))
        assert row["stop_error_cm"] == pytest.approx(100 * (float(one["stop_position"]) - 400))


def test_an_infeasible_sample_is_recorded_with_its_reason():
    done, scores = outcome("config=B", "start=cold", "horizons=[3]")
    one = done.data.sel(controller="rmpc-n3")
    assert scores["rmpc-n3"]["infeasible"] == 6 and one["infeasible"].values[:6].sum() == 6
    assert str(one["stopped"].values).startswith("sample 0: 'u <= ") and "misses by" in str(one["stopped"].values)
    assert np.isfinite(scores["rmpc-n3"]["stop_error_cm"])


def test_a_random_resistance_lies_inside_w_and_is_repeated():
    seeded = assigned(STUDY, ["resistance.seed=4"])
    blocks = np.array(seeded.plant.plant.blocks)
    assert blocks.size == 60 and (blocks >= -0.06).all() and (blocks <= 0.30).all()
    assert seeded.plant == assigned(STUDY, ["resistance.seed=4"]).plant
    assert seeded.plant == assigned(STUDY, ["resistance.seed=1", "seed=3"]).plant != assigned(seeded, ["seed=1"]).plant
    line = STUDY.plant.plant
    assert line.blocks is None and float(line.resistance(0.0, 350.0)) < 0
    steeper = assigned(STUDY, ["grade.last=3"]).plant.plant
    assert float(steeper.resistance(0.0, 350.0)) == pytest.approx(0.0054 + 9.81 * 3 / 1000)


def test_what_a_run_writes(tmp_path):
    done, _ = outcome("horizons=[3, 5]")
    done.save(tmp_path)
    design = json.loads((tmp_path / "design.json").read_text())
    assert {"A", "b", "E", "K", "P", "spectral_radius", "x_z", "rmpc", "rsmpc"} <= set(design)
    held = 0.5 / 1.07
    np.testing.assert_allclose(design["x_z"], [1 - held, held, 2 - 0.06, 2 - 0.3, 12 - 0.03, 12 - 0.15], atol=1e-12)
    np.testing.assert_allclose(design["rmpc"][0], design["x_z"])
    A, b, K, E = (np.array(design[name]) for name in ("A", "b", "K", "E"))
    A_cl, A_l = A + np.outer(b, K), np.linalg.matrix_power(A, 5)
    assert design["spectral_radius"] == pytest.approx(max(abs(np.linalg.eigvals(A_cl)))) and len(design["rmpc"]) == 5

    def offsets(maps):
        h = np.array(design["x_z"])
        for m in maps:
            push = np.array(design["H"]) @ m @ A_l @ E
            h = h - np.maximum(0.30 * push, -0.06 * push)
        return h

    power = np.linalg.matrix_power
    for i in range(5):
        np.testing.assert_allclose(design["rmpc"][i], offsets([power(A_cl, j) for j in range(i)]), atol=1e-10)
    for M in range(1, 5):
        assert len(design["rsmpc"][str(M)]) == M + 5
        for i in range(M + 5):
            held_part = [power(A_cl, max(i - M, 0)) @ power(A, j) for j in range(min(i, M))]
            after = [power(A_cl, j) for j in range(max(i - M, 0))]
            np.testing.assert_allclose(design["rsmpc"][str(M)][i], offsets(held_part + after), atol=1e-10)
    again = load(tmp_path)
    assert again.settings == done.settings and again.scores() == done.scores()
    assert {path.name for path in (tmp_path / "figures").glob("*.png")} >= {"tube.png", "updates.png", "stop_error.png"}


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("config=C", "config must be one of A | B, got 'C'"),
        ("model=rk4", "model must be one of zoh | euler"),
        ("start=tepid", "start must be one of warm | cold"),
        ("beta=0.9", r"beta must lie in \[1, ∞\), got 0.9"),
        ("horizons=[1]", "horizons must be whole numbers from 2 to 60, got 1"),
        ("horizons=[3, 4.5]", "horizons must be whole numbers from 2 to 60, got 4.5"),
        ("horizons=[1e9]", "horizons must be whole numbers from 2 to 60, got 1e"),
        ("curve.speed=1e9", "the reference must stop within 10000 samples, got 10000000000: raise curve.deceleration"),
        ("brake.fine_step=1e-5", r"fine_step must be at least 0.0002 s \(sampling_time / 1000\), got 1e-05 s"),
        ("horizons=[3, 3]", r"horizons must differ, got \[3, 3\]"),
        ("horizons=[]", "horizons must name at least one horizon, got none"),
        ("disturbance.low=0.5", "low must be at most high, got low 0.5 and high 0.3"),
        ("resistance.seed=-1", "seed must lie in"),
        ("grade.last=1000", "last must lie in"),
        ("brake.dead_time=0", "brake.dead_time must be at least one sample, got 0 s"),
        ("speed=3", "there is no setting 'speed'"),
    ],
)
def test_bad_settings_are_told(setting, message):
    with pytest.raises(InvalidValue, match=message):
        assigned(STUDY, [setting])


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("disturbance.high=0.4", "beyond 's >= -12' by 3.3"),
        ("disturbance.high=20", "over 5 samples of delay are empty: 'v <= 2' and 'v >= -2' cannot both hold"),
        ("curve.deceleration=1.2", "the command that holds the reference, 1.121, must lie inside"),
    ],
)
def test_a_design_without_room_is_told(setting, message):
    with pytest.raises(InvalidValue, match=message):
        run(assigned(STUDY, [setting]), show_progress=False)


def test_a_train_that_never_stops_has_no_stopping_error():
    done, scores = outcome("horizons=[3]", "brake.blocks=[-1.2]")
    assert all(row["stop_error_cm"] is None for row in scores.values())
    assert done.data["stop_time"].isnull().all() and done.data.sizes["sample"] == OWN.most_samples + 1


def test_old_names_stand_beside_the_common_ones(campaign):
    data = campaign.data
    for old, new in {
        "speed": data["output"].sel(output_name="speed"),
        "position": data["state_position"],
        "command": data["input"],
        "hold": data["law_hold"],
        "cost": data["law_cost"],
    }.items():
        new = new.isel(trial=0)
        assert data[old].dims == ("controller", "sample")
        one = data[old].sel(controller="rmpc-n5").values
        ran = ~np.isnan(one)
        np.testing.assert_array_equal(one[ran], new.sel(controller="rmpc-n5").values[ran])
    stood = data["trial_length"].isel(trial=0)
    end = data["output"].isel(trial=0).sel(sample=stood)
    assert (end.sel(output_name="speed") == 0).all()
    np.testing.assert_array_equal(end.sel(output_name="position"), data["stop_position"])
    assert (data["speed"].notnull().sum("sample") == stood).all()
    assert ((data["stop_time"] <= stood * T) & (data["stop_time"] > (stood - 1) * T)).all()


def test_draws_of_the_random_case_are_campaigns_of_other_seeds():
    study = assigned(in_case(STUDY, "random"), ["horizons=[3]", "draws=3"])
    drawn = run(study, show_progress=False)
    for draw in range(3):
        alone = run(assigned(STUDY, ["horizons=[3]", f"resistance.seed={draw}"]), show_progress=False).scores()
        for name, row in alone.items():
            found = float(drawn.drawn["scores"].sel(controller=name, score="stop_error_cm")[draw])
            assert found == row["stop_error_cm"], (draw, name)


@pytest.mark.parametrize("case", ["random", "B", "euler", "cold"])
def test_cases_are_the_settings_that_they_name(case):
    changed, expected = (
        in_case(STUDY, case),
        {
            "random": ["resistance.seed=0"],
            "B": ["config=B"],
            "euler": ["model=euler"],
            "cold": ["start=cold"],
        }[case],
    )
    assert changed.own == assigned(STUDY, expected).own != OWN and changed.plant == assigned(STUDY, expected).plant
