"""The maglev study against a plain replay, and the figures that it is known for."""

from __future__ import annotations

import dataclasses
import math

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import butter, filtfilt

from models.maglev import Maglev
from models.quantity import InvalidValue
from studies.maglev.study import STUDY
from workbench.contracts import settings
from workbench.contracts.law import Task, Trial
from workbench.controllers.palc_filtered import FilteredPALC
from workbench.controllers.parts.shuttle_force import late_by
from workbench.trials.campaign import run

M, G, N, TS = 90_000.0, 9.81, 3, 0.01


def campaign(*assignments, case="", only=()):
    study = settings.assigned(settings.in_case(STUDY, case), assignments)
    if only:
        study = dataclasses.replace(study, controllers={name: study.controllers[name] for name in only})
    return run(study, show_progress=False)


@pytest.fixture(scope="module")
def defaults():
    return campaign()


def overlap(a, b, c, d):
    return max(0.0, min(b, d) - max(a, c))


def drag(v):
    a = math.sqrt(v * v + 0.0025)
    return (1.652 + 0.572 * N) * v * a + 1000 * N * (0.1 * math.sqrt(a) + 0.02 * a**0.7) * v / a


def line_resistance(x, v):
    lo, hi = x - 22.5, x + 22.5
    grade = (30 * overlap(lo, hi, 800, 1100) - 20 * overlap(lo, hi, 1250, 1400)) / 45 / 1000
    curve = 0.6 / 100 * overlap(lo, hi, 300, 600) / 45
    return M * G * (grade + curve * v / math.sqrt(v * v + 0.0025))


def rhs(x, v, force):
    return v, (force - drag(v) - line_resistance(x, v)) / M


def step(x, v, force):
    h = TS
    a = rhs(x, v, force)
    b = rhs(x + h / 2 * a[0], v + h / 2 * a[1], force)
    c = rhs(x + h / 2 * b[0], v + h / 2 * b[1], force)
    d = rhs(x + h * c[0], v + h * c[1], force)
    return x + h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + d[0]), v + h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + d[1])


@pytest.mark.parametrize("name", ["pid", "palc"])
def test_recorded_periods_replay(name, defaults):
    data = defaults.data.sel(controller=name)
    r_x, r_v = data["reference"].values.tolist()
    y_x, y_v = (data["output"].sel(output_name=output).values for output in ("position", "speed"))
    assert data["applied"].identical(data["input"].assign_attrs(data["applied"].attrs).rename("applied"))
    n, x, v, integral, d_hat = len(r_x) - 1, 0.0, 0.0, 0.0, [0.0] * 17800
    for period in range(3):
        for k in range(n):
            e_x, e_v = x - r_x[k], v - r_v[k]
            if name == "palc" and period:
                d_hat[k] -= 0.2 * M * (e_v + 0.22 * e_x)
            u = M * (r_v[k + 1] - r_v[k]) / TS + drag(v) - M * ((0.4 + 0.22) * e_v + 0.4 * 0.22 * e_x)
            u += d_hat[k] if name == "palc" else -0.01 * M * integral
            integral += e_x * TS
            if k % 500 == 0:
                assert float(data["input"][period, k]) == pytest.approx(u, abs=1e-3)
                assert float(y_x[period, k]) == pytest.approx(x, abs=1e-8)
                assert float(y_v[period, k]) == pytest.approx(v, abs=1e-8)
                assert float(data["line_resistance"][period, k]) == pytest.approx(line_resistance(x, v), abs=1e-4)
            x, v = step(x, v, u)


def test_one_sample_is_that_of_an_adaptive_integrator():
    plant = Maglev()
    for x0, v0, force in ((0.0, 0.0, 5e4), (420.0, 29.0, 1e4), (950.0, -20.0, -4e4), (1580.0, 0.0, -9e4)):
        exact = solve_ivp(lambda t, y, f=force: rhs(y[0], y[1], f), (0, TS), [x0, v0], rtol=1e-11, atol=1e-13).y[:, -1]
        got = plant.step_function()([x0, v0], force, 0, 0).full().ravel()
        np.testing.assert_allclose(got, exact, rtol=0, atol=2e-7)


def test_derivatives_are_finite_everywhere_and_at_rest():
    plant = Maglev()
    for by in ("x", "u", "w", "mass"):
        slope = plant.derivative(by)
        for x in (0.0, 300.0, 777.5, 950.0, 1580.0):
            for v in (0.0, 1e-9, -1e-9, 30.0):
                assert np.isfinite(slope([x, v], 0.0, 0.0, 0).full()).all()


def test_the_published_errors_are_reached(defaults):
    scores = defaults.scores()
    pid, palc = scores["pid"], scores["palc"]
    errors = np.abs(defaults.data["error"].sel(controller="palc", output_name="position").values).max(axis=1)
    assert 2.9 < pid["max_position_error_last"] < 3.2
    assert (np.diff(errors) < 0).all()
    assert errors[4] < 0.7 and errors[16] < 0.045
    assert pid["max_position_error_last"] / palc["max_position_error_last"] > 60
    assert pid["itae_last"] / palc["itae_last"] > 100
    assert -1.5 < palc["energy_change_percent"] < 0
    assert pid["learned_resistance_rms_error"] is None and palc["learned_resistance_rms_error"] < 1000


def test_scores_are_what_plain_loops_count(defaults):
    one = defaults.data.sel(controller="palc").isel(trial=-1)
    x, e = (one[name].sel(output_name="position").values for name in ("output", "error"))
    u, r = one["input"].values, one["reference"].sel(output_name="position").values
    used = sum(max(u[k] * (x[k + 1] - x[k]), 0.0) for k in range(17800)) / 3.6e6
    itae = sum(k * TS * abs(e[k]) * TS for k in range(17801))
    scores = defaults.scores()["palc"]
    assert scores["energy_kwh_last"] == pytest.approx(used, rel=1e-12)
    assert scores["itae_last"] == pytest.approx(itae, rel=1e-3)
    e_v = one["error"].sel(output_name="speed").values
    graded = [abs(e_v[k]) for k in range(17801) if 800 <= r[k] < 1100 or 1250 <= r[k] < 1400]
    assert scores["max_speed_error_grade"] == pytest.approx(max(graded), rel=1e-12)


def test_halving_the_step_changes_little(defaults):
    fine = campaign("plant.sampling_time=0.005", only=["palc"]).scores()["palc"]["max_position_error_last"]
    assert fine == pytest.approx(defaults.scores()["palc"]["max_position_error_last"], rel=0.02)


def test_lag_and_dead_time_break_palc_and_not_the_filtered_law():
    done = campaign("trials=40", case="lagging", only=["palc", "palc-filtered"])
    palc, filtered = np.abs(done.data["error"].sel(output_name="position").values).max(axis=2)
    assert palc[16] > 10 and palc[39] > 1000
    assert (filtered[16:] < 0.5).all() and filtered[39] < 0.25
    assert not done.data["applied"].equals(done.data["input"]) and done.data.sizes["trial"] == 40


def test_a_flat_line_leaves_nothing_to_learn():
    scores = campaign("trials=3", case="flat").scores()
    assert all(row["max_position_error_last"] < 1e-3 for row in scores.values())
    assert scores["palc"]["max_speed_error_curve"] is None and scores["palc"]["max_speed_error_grade"] is None


@pytest.mark.parametrize(
    ("case", "low", "high"),
    [
        ("period-100-ms-too-long", 0.1, 0.25),
        ("period-100-ms-too-short", 0.05, 0.25),
        ("period-1-s-too-long", 0.6, 1.2),
    ],
)
def test_a_wrong_period_costs_what_it_shifts(case, low, high):
    for row in campaign(case=case, only=["palc", "palc-filtered"]).scores().values():
        assert low < row["max_position_error_last"] < high


def test_noise_has_the_density_asked_for():
    study = settings.assigned(settings.in_case(STUDY, "noisy"), ["trials=2"])
    w = np.concatenate([one.w for one in study.inputs()], axis=1)
    assert w.shape == (1, 35600)
    assert w.var() * TS == pytest.approx(1e6, rel=0.03)
    assert not study.scenario.disturbance.repeats and np.isinf(study.scenario.disturbance.bound(study.plant)).all()
    assert STUDY.scenario.disturbance.repeats and not STUDY.scenario.disturbance.bound(STUDY.plant).any()


def test_a_saturated_force_is_what_acts_and_is_not_learned_from():
    done = campaign("trials=3", case="limited")
    acted, told = done.data["applied"].values, done.data["input"].values
    np.testing.assert_array_equal(acted[..., :-1], np.clip(told, -95000, 95000)[..., :-1])
    assert (np.abs(told[..., :-1]) > 95000).any()


def test_a_limit_of_the_law_s_own_is_learned_from_like_the_actuator_s():
    def learned(*assignments, case="", **fields):
        laws = {"palc-filtered": dataclasses.replace(STUDY.controllers["palc-filtered"], **fields)}
        study = settings.assigned(settings.in_case(STUDY, case), [*assignments, "trials=4"])
        done = run(dataclasses.replace(study, controllers=laws), show_progress=False)
        return done.data["law_line_resistance"].values

    first = learned(case="limited")
    np.testing.assert_array_equal(learned(case="limited", limit=2e5), first)
    np.testing.assert_array_equal(learned("actuator.lower=-95000", "actuator.upper=95000"), first)
    free, half = learned(), learned("actuator.upper=95000")
    assert not np.array_equal(free, first) and not np.array_equal(half, first) and not np.array_equal(half, free)


@pytest.mark.parametrize("late", [0, 2, -2])
def test_what_a_wrong_period_reads(late):
    before, now = ca.DM(range(10, 15)).T, ca.DM(range(20, 25)).T
    expected = {0: [20, 21, 22, 23, 24], 2: [13, 14, 20, 21, 22], -2: [22, 23, 24, 20, 21]}[late]
    np.testing.assert_array_equal(late_by(late, before, now).full()[0], expected)


def test_the_filtered_law_learns_with_lead_filter_and_freezing():
    rng, n = np.random.default_rng(5), 400
    model = Maglev(sampling_time=0.1)
    task = Task(ca.DM.zeros(2, n + 1), ca.DM(0.1), model=model)
    law = FilteredPALC(limit=9.0, lead_s=0.3, q_cutoff_hz=0.7).ready_for(task)
    y, u, d_hat = rng.normal(size=(2, n + 1)), rng.normal(0, 6, (1, n)), rng.normal(size=(1, n))
    memory = law.start(task)._replace(d_hat=ca.DM(d_hat))
    trial = Trial(ca.DM.zeros(2, n + 1), ca.DM(y), ca.DM(-y), ca.DM(u), ca.DM.ones(1, n + 1), ())
    got = law.learn(memory, trial)
    x = ca.MX.sym("x")
    learned = ca.Function("learned", [x], [got.d_hat + 0 * x])(0).full()[0]
    free = np.abs(u[0]) < 9
    s = y[1, :-1] + 0.22 * y[0, :-1]
    raw = d_hat[0] - 0.2 * M * np.where(free & np.roll(free, -3), np.roll(s, -3), 0)
    b, a = butter(2, 0.7 / 5)
    wide = np.concatenate([raw[-40:], raw, raw[:40]])
    np.testing.assert_allclose(learned[30:-30], filtfilt(b, a, wide, padlen=0)[70:-70], atol=0.02 * np.abs(raw).max())


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("controllers.palc.gamma=-0.2", r"controllers\.palc\.gamma must lie in \(0, ∞\) 1/s, got -0\.2"),
        ("controllers.palc.alpha=0", r"controllers\.palc\.alpha must lie in"),
        ("plant.sampling_time=0.03", "the period must be a multiple of the sampling time"),
        ("plant.line.curve_radii_m=[0]", "curve_radii_m must be above 0 m"),
        ('plant.line={"curve_starts_m":[0,50],"curve_ends_m":[60,90],"curve_radii_m":[9,9]}', "without overlap"),
        ("plant.length=2000", "length must be at most that of the line, 1580 m"),
        ("period_error=0.1", r"there is no setting 'period_error' any more: set controllers\.palc\.late"),
        ("controllers.palc.late=0.5", r"controllers\.palc\.late must be a whole number"),
        ("actuator.delay=0.005", r"actuator\.delay must be a multiple of the sampling time"),
        ("actuator.lag=-1", r"actuator\.lag must lie in"),
        ("force_limit=95000", "there is no setting 'force_limit' any more: set actuator.lower and actuator.upper"),
        ("noise.force_psd=-1", r"disturbance\.force_psd must lie in"),
        ("line=steep", r"plant\.line must be one of paper \| flat"),
        ("reference.speed=60", "speed must be reached within the distance"),
        ("periods=0", "trials must lie in"),
    ],
)
def test_bad_input_is_refused_in_one_line(assignment, message):
    with pytest.raises(InvalidValue, match=message) as caught:
        settings.assigned(STUDY, [assignment])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("assignment", "path", "value"),
    [
        ("periods=3", "trials", 3),
        ("line=flat", "plant.line", "flat"),
        ("noise.force_psd=10", "disturbance.force_psd", 10.0),
        ("plant.line.curve_radii_m=[200]", "plant.line.curve_radii_m", [200.0]),
        ("controllers.palc.late=-10", "controllers.palc.late", -10),
    ],
)
def test_old_settings_have_a_new_path(assignment, path, value):
    now = settings.as_json(settings.assigned(STUDY, [assignment]))
    for name in path.split("."):
        now = now[name]
    assert now == value


@pytest.mark.parametrize("case", STUDY.cases)
def test_every_case_runs(case):
    study = settings.in_case(STUDY, case)
    done = run(settings.changed(study, {"trials": 2}), show_progress=False)
    assert done.data.attrs["case"] == case and study.plant_that_runs is not None
    assert all(row["max_position_error_last"] < 10 for row in done.scores().values())
    fields = {path: value for path, value in STUDY.cases[case].items()}
    assert fields and settings.as_json(study) != settings.as_json(STUDY)


def test_the_laws_are_told_the_train_as_it_is_believed_to_be():
    heavy = settings.assigned(STUDY, ["truth.mass=1.2", "trials=1"])
    assert heavy.law("palc").model.mass == M and heavy.true_plant.mass == pytest.approx(1.2 * M)
    done = run(heavy, show_progress=False)
    x, v = (done.data["output"].sel(controller="pid", trial=1, output_name=one).values for one in ("position", "speed"))
    d = done.data["line_resistance"].sel(controller="pid", trial=1).values
    for k in range(0, 17801, 1000):
        assert d[k] == pytest.approx(1.2 * line_resistance(x[k], v[k]), abs=1e-4)


@pytest.mark.parametrize("field", ["q_cutoff_hz=80", "lead_s=200"])
def test_a_filter_or_lead_that_does_not_fit_is_refused_for_that_law(field):
    done = campaign(f"controllers.palc-filtered.{field}", "trials=1")
    assert field.split("=")[0] in str(done.data["stopped"].sel(controller="palc-filtered").values)
    assert done.scores()["palc-filtered"]["max_position_error_last"] is None


def test_every_figure_draws(defaults):
    from matplotlib import pyplot

    drawn = {name: draw() for name, draw in defaults.figures().items()}
    assert len(drawn) == 11
    assert all(axes.get_xlabel() or axes.get_shared_x_axes() for figure in drawn.values() for axes in figure.axes)
    pyplot.close("all")
