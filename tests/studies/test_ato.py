"""The ato study against a plain NumPy loop of plant and laws, and what it must show."""

from __future__ import annotations

import functools
import json

import casadi as ca
import numpy as np
import pytest

from models.quantity import InvalidValue
from models.raised_cosine import RaisedCosines
from models.transfer import Transfer
from studies.ato.scores import indices
from studies.ato.study import STUDY, own
from workbench.contracts import settings
from workbench.contracts.law import Task
from workbench.controllers.bp_fipid import BPFIPID, Acting
from workbench.controllers.fipid import FIPID
from workbench.controllers.pd import PD
from workbench.trials.campaign import load, run
from workbench.trials.draws import draw_of, of_draws
from workbench.trials.find import find

AXIS = np.linspace(-1, 1, 101)


def sign_shape(x):
    """Return the S-shaped membership on [-1, 1]."""
    if x <= -1:
        return 0.0
    if x >= 1:
        return 1.0
    return 2 * ((x + 1) / 2) ** 2 if x <= 0 else 1 - 2 * ((x - 1) / 2) ** 2


RISE = np.where(AXIS <= 0.5, 2 * np.clip(AXIS, 0, 1) ** 2, 1 - 2 * (AXIS - 1) ** 2)
FALL = RISE[::-1]
HAT = 1 - np.abs(AXIS)


def f_rules(u, du):
    pu, pd = sign_shape(u), sign_shape(du)
    nu, nd = 1 - pu, 1 - pd
    degrees = np.maximum.reduce(
        [
            np.minimum(min(pu, pd), FALL),
            np.minimum(max(min(pu, nd), min(nu, pd)), HAT),
            np.minimum(min(nu, nd), RISE),
        ]
    )
    return AXIS[degrees >= degrees.max() - 1e-13].mean()


def f_smooth(u, du):
    return -(np.tanh(2 * u) + np.tanh(2 * du)) / 2


def cosine(t, begin, end, low, high):
    return (high - low) * (1 - np.cos(np.pi * np.clip((t - begin) / (end - begin), 0, 1))) / 2


def loop(test, f, gains=None, weights=None, beta=0.0, alpha=0.001):
    """Run plant and law sample by sample, counted from 1 like the paper; return y, u, p1, p2."""
    n = 200 if test == "step" else 2175
    t = np.arange(n) * 0.2
    r = np.ones(n)
    if test == "curve":
        r = cosine(t, 0, 50, 0, 26) + cosine(t, 294, 312, 26, 20) + cosine(t, 362, 432, 20, 0)
    a = np.exp(-0.2)
    U, Y, E, P = {}, {0: 0.0}, {}, []
    if weights:
        W2, W3 = (np.array(W) for W in weights)
        D2, D3 = np.zeros_like(W2), np.zeros_like(W3)
    for k in range(1, n + 1):
        d = 4 if test == "curve" and (1470 <= k <= 1560 or k >= 1810) else 5
        Y[k] = a * Y[k - 1] + 0.5 * (1 - a) * U.get(k - 1 - d, 0.0)
        E[k] = e = r[k - 1] - Y[k]
        e1, e2, u1, u2 = E.get(k - 1, 0.0), E.get(k - 2, 0.0), U.get(k - 1, 0.0), U.get(k - 2, 0.0)
        bracket = e - e1 + 0.3 * e + 0.3 * (e - 2 * e1 + e2)
        p1, p2 = gains or (0, 0)
        if weights:
            x = np.array([r[k - 1], Y[k], e, 1.0])
            o = np.tanh(W2 @ x)
            p1, p2 = p = (1 + np.tanh(W3 @ o)) / 2
        ff = f(u1, u1 - u2)
        U[k] = u1 + (p1 - p2 * ff) * bracket
        if test == "step" and k in (100, 110):
            U[k] += 0.1
        P.append((p1, p2))
        if weights and beta:
            s = np.sign((Y[k] - Y[k - 1]) * (U[k] - u1))
            d3 = e * s * np.array([bracket, -ff * bracket]) * 2 * p * (1 - p)
            d2 = (1 - o**2) * (W3.T @ d3)
            D3 = alpha * D3 + beta * np.outer(d3, o)
            D2 = alpha * D2 + beta * np.outer(d2, x)
            W3, W2 = W3 + D3, W2 + D2
    keys = range(1, n + 1)
    return np.array([Y[k] for k in keys]), np.array([U[k] for k in keys]), np.array(P)


def drawn(seed):
    rng = np.random.default_rng(seed)
    return rng.uniform(-0.5, 0.5, (5, 4)), rng.uniform(-0.5, 0.5, (2, 5))


@functools.cache
def campaign(test, seeds=20):
    return run(settings.changed(STUDY, {"curve": test == "curve", "draws": seeds}), show_progress=False)


@functools.cache
def one_draw(test, draw):
    """Return the record of one draw, counted from 1, run alone."""
    return run(draw_of(campaign(test).study, draw - 1), show_progress=False).data.isel(trial=0)


CASES = [
    ("fipid", 1, f_rules, {"gains": (0.3, 0.24)}),
    ("fipid-smooth", 1, f_smooth, {"gains": (0.3, 0.24)}),
    *(("bp-fipid", seed, f_rules, {"weights": drawn(seed - 1), "beta": 0.001}) for seed in (1, 2, 17)),
    ("bp-frozen", 3, f_rules, {"weights": drawn(2)}),
]


@pytest.mark.parametrize("test", ["step", "curve"])
@pytest.mark.parametrize(("name", "seed", "f", "law"), CASES)
def test_recorded_runs_replay(test, name, seed, f, law):
    one = one_draw(test, seed).sel(controller=name)
    y, u, p = loop(test, f, **law)
    np.testing.assert_allclose(one["output"][:-1], y, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(one["input"][:-1], u, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(one["p1"][:-1], p[:, 0], rtol=1e-9)
    np.testing.assert_allclose(one["p2"][:-1], p[:, 1], rtol=1e-9)


def test_the_step_shows_what_it_must():
    scores = campaign("step").scores()
    assert scores["fipid"]["ise"] == pytest.approx(2.56, rel=0.02)
    assert scores["bp-fipid"]["share_better_all_four"] >= 0.7
    assert scores["bp-fipid"]["ise"] == pytest.approx(scores["bp-frozen"]["ise"], rel=0.01)
    for index in ("ise", "iae", "itse", "itae"):
        assert scores["fixed-best"][index] <= scores["bp-fipid"][index]
    for name in scores:
        assert scores[name]["settling_time"] < 15 and scores[name]["recovery_time"] < 15


def test_the_curve_shows_what_it_must():
    scores = campaign("curve").scores()
    assert scores["bp-fipid"]["share_better_all_four"] >= 0.95
    assert scores["bp-fipid"]["ise"] <= 0.75 * scores["bp-frozen"]["ise"]
    for index in ("ise", "iae", "itse", "itae"):
        assert scores["fixed-best"][index] <= scores["bp-fipid"][index]
    assert scores["fipid"]["rise_time"] is None


def test_the_disturbance_stays_in_the_input():
    calm = run(settings.changed(STUDY, {"disturbance": 0.0, "draws": 1}), show_progress=False).data
    disturbed = campaign("step").data
    difference = (disturbed["input"].isel(trial=0) - calm["input"].isel(trial=0)).sel(controller="fipid").values
    assert np.abs(difference[:99]).max() == 0
    assert difference[99] == pytest.approx(0.1) and difference[100] == pytest.approx(0.1, rel=0.05)


def test_fixed_best_is_the_best_of_its_grid():
    data = campaign("step").data
    assert data["grid_ise"].values[0].min() == float(data["ise"].sel(controller="fixed-best", trial=1))
    best = float(data["grid"][int(np.argmin(data["grid_ise"].values[0]))])
    y, _, _ = loop("step", f_rules, gains=(best, best))
    assert indices(np.ones(200), y, 0.2)["ise"] == pytest.approx(float(data["grid_ise"].min()), rel=1e-9)
    changes = {"tune": False, "draws": 1, "controllers": {"fixed-best": FIPID(K=0.7, eta=1.0)}}
    fixed = settings.changed(STUDY, changes)
    assert run(fixed, show_progress=False).scores()["fixed-best"]["ise"] == pytest.approx(2.085, rel=1e-3)


def test_a_draw_is_the_campaign_of_a_seed_of_its_own():
    drawn = campaign("step", 3).drawn
    assert list(drawn["seed"].values) == [0, 1, 2] and list(drawn["draw"].values) == [1, 2, 3]
    for draw in (1, 2):
        alone = run(settings.assigned(STUDY, ["draws=1", f"seed={draw}"]), show_progress=False).scores()
        for name in ("bp-fipid", "fipid"):
            assert of_draws(drawn, name, "ise")[draw] == alone[name]["ise"]
    assert len(set(of_draws(drawn, "bp-fipid", "ise"))) == 3 and len(set(of_draws(drawn, "fipid", "ise"))) == 1


def test_learning_follows_the_gradient():
    """One step of the weights is -beta times the finite difference of e^2/2 through u, the plant's slope being s."""
    law = BPFIPID(alpha=0.0, beta=0.01)
    W2, W3 = drawn(4)
    r, y, before = 1.0, 0.3, {"u": 0.2, "u_1": 0.15, "e": 0.8, "e_1": 0.9, "y": 0.2}

    def acted(W2, W3):
        zeros = (ca.DM.zeros(20), ca.DM.zeros(10))
        state = Acting(**before, p1=0, p2=0, f=0, W2=ca.DM(W2.ravel()), W3=ca.DM(W3.ravel()), W2_change=zeros[0],
                       W3_change=zeros[1])  # fmt: skip
        memory = law.start(_task(law))._replace(added=ca.DM(0))
        return law.act(memory, state, ca.DM(r), ca.DM(r), ca.DM(y))

    u, after = acted(W2, W3)
    s = np.sign((y - before["y"]) * (float(u) - before["u"]))
    for name, W in (("W2_change", W2), ("W3_change", W3)):
        expected = []
        for index in range(W.size):
            shifted = []
            for h in (1e-6, -1e-6):
                moved = W.copy()
                moved.ravel()[index] += h
                shifted.append(float(acted(*((moved, W3) if name == "W2_change" else (W2, moved)))[0]))
            du_dw = (shifted[0] - shifted[1]) / 2e-6
            expected.append(0.01 * (r - y) * s * du_dw)
        np.testing.assert_allclose(np.asarray(getattr(after, name)).ravel(), expected, rtol=1e-5, atol=1e-10)


def _task(law):
    return Task(ca.DM.ones(1, 3), 0.2, chance=ca.DM(law.chance(0)))


def test_given_weights_are_used():
    W2, W3 = drawn(7)
    given = BPFIPID(W2=tuple(W2.ravel()), W3=tuple(W3.ravel()))
    study = settings.changed(STUDY, {"draws": 1, "controllers": {"given": given}})
    y, _, _ = loop("step", f_rules, weights=(W2, W3), beta=0.001)
    data = run(study, show_progress=False).data
    np.testing.assert_allclose(data["output"][0, 0, :-1], y, rtol=1e-9, atol=1e-9)


def test_units_of_the_law_scale_a_plant_of_another_scale():
    changes = {
        "draws": 1,
        "plant": {"gain": 1e-3},
        "controllers": {"fipid": FIPID(input_unit=1000.0)},
        "disturbance": 100.0,
    }
    scaled = settings.changed(STUDY, changes)
    ours = run(scaled, show_progress=False).data["output"].values[0, 0]
    np.testing.assert_allclose(ours, campaign("step").data["output"].sel(controller="fipid")[0], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("controllers.bp-fipid.W2=[1,2,3]", "W2 must hold 5 x 4 = 20 weights"),
        ("controllers.bp-fipid.W3=[1,2,3]", "W3 must hold 2 x 5 = 10 weights"),
        ("controllers.bp-fipid.beta=-0.1", r"beta must lie in \[0"),
        ("controllers.bp-fipid.alpha=1", r"alpha must lie in \[0, 1\)"),
        ("controllers.mpc.horizon=3", "there is no setting 'controllers.mpc'"),
        ("traction_delay=0.9", "traction_delay must be a multiple of the sampling time of 0.2 s"),
        ("braking_delay=0.05", "braking_delay must be a multiple"),
        ("test=curve", "there is no setting 'test' any more: the step is the study as declared; run the case curve"),
        ("curve=7", "curve must be true or false"),
        ("seeds=0", "draws must lie in"),
        ("grid=[]", "grid must hold at least one gain"),
    ],
)
def test_bad_settings_are_refused(assignment, message):
    with pytest.raises(InvalidValue, match=message.replace("|", r"\|")):
        settings.assigned(STUDY, [assignment])


def test_a_law_that_cannot_be_disturbed_is_refused():
    with pytest.raises(InvalidValue, match=r"controllers\.pd must have a field added"):
        settings.changed(STUDY, {"draws": 1, "controllers": {"pd": PD()}})
    on_the_curve = settings.changed(STUDY, {"draws": 1, "curve": True, "controllers": {"pd": PD()}})
    assert run(on_the_curve, show_progress=False).scores()["pd"]["gain_max"] is None


def test_what_is_added_must_be_one_number_a_sample():
    changes = {"draws": 1, "curve": True, "controllers": {"short": FIPID(added=(0.1,) * 5), "fipid": FIPID()}}
    done = run(settings.changed(STUDY, changes), show_progress=False)
    stopped = str(done.data["stopped"].sel(controller="short").values)
    assert "added must hold N = 2175 numbers, one a sample, or none; got 5" in stopped


@pytest.mark.parametrize(
    "assignment",
    ["seeds=7", "disturbance=0.2", "traction_delay=0.8", "braking_delay=1", "grid=[0.5,0.6]", "tune=false",
     "plant.denominator=[2,1]", "controllers.fipid.K=0.4", "seed=3"],
)  # fmt: skip
def test_settings_keep_their_paths(assignment):
    path, _, value = assignment.partition("=")
    now = settings.as_json(settings.assigned(STUDY, [assignment]))
    for name in {"seeds": "draws"}.get(path, path).split("."):
        now = now[name]
    assert now == json.loads(value)


@pytest.mark.parametrize("case", STUDY.cases)
def test_every_case_runs(case):
    study = settings.changed(settings.in_case(STUDY, case), {"draws": 2, "grid": [0.5, 0.6]})
    done = run(study, show_progress=False)
    assert done.data.attrs["case"] == case
    assert all(row["ise"] is not None for row in done.scores().values())


def test_a_run_is_saved_and_loaded(tmp_path):
    done = campaign("curve", 2)
    done.save(tmp_path)
    again = load(tmp_path)
    assert own(again.study).curve and again.scores() == done.scores()
    assert find("ato") is STUDY


def test_indices_of_a_known_run():
    y = np.array([0.0, 0.5, 1.0, 1.2, 1.0, 1.0, 1.1, 1.0])
    found = indices(np.ones(8), y, 0.5, kicks=(7,))
    assert found["ise"] == pytest.approx(0.5 * (1 + 0.25 + 0.04 + 0.01))
    assert found["iae"] == pytest.approx(0.5 * (1 + 0.5 + 0.2 + 0.1))
    assert found["itse"] == pytest.approx(0.25 * (1 + 2 * 0.25 + 4 * 0.04 + 7 * 0.01))
    assert found["itae"] == pytest.approx(0.25 * (1 + 2 * 0.5 + 4 * 0.2 + 7 * 0.1))
    assert found["rise_time"] == pytest.approx(0.5 * (1.8 - 0.2))
    assert found["settling_time"] == pytest.approx(2.0) and found["peak_time"] == pytest.approx(1.5)
    assert found["overshoot_percent"] == pytest.approx(20.0) and found["recovery_time"] == pytest.approx(0.5)
    assert found["max_jerk"] == pytest.approx(0.4 / 0.25)
    assert found["energy_index"] == pytest.approx((0.25 + 0.5 + 0.24 + 0.2 + 0.11 + 0.1) / (6.8 * 0.5))


@pytest.mark.parametrize(
    ("moves", "message"),
    [((), "at least one"), (((1, 0, 0, 1),), "ends after"), (((0, 5, 0, 1), (4, 6, 1, 2)), "follow"),
     (((0, 5, 0, 1), (6, 7, 2, 3)), "follow")],
)  # fmt: skip
def test_bad_profiles_are_refused(moves, message):
    with pytest.raises(InvalidValue, match=message):
        RaisedCosines(horizon=10, moves=moves)


def test_figures_are_drawn():
    from matplotlib import pyplot

    for test in ("step", "curve"):
        for draw in campaign(test).figures().values():
            figure = draw()
            assert all(axes.has_data() and axes.get_ylabel() is not None for axes in figure.axes)
            pyplot.close(figure)
    assert Transfer(numerator=(0.5,)).sampling_time == 0.2
