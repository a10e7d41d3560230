"""The claims of the ato study: what they say of the study, and of cases made to say the opposite."""

from __future__ import annotations

import dataclasses

import casadi as ca
import control
import numpy as np
import pytest

from models.actuator import delayed
from models.quantity import InvalidValue
from models.transfer import Transfer
from studies.ato.claims import examine, f_continuous
from studies.ato.study import STUDY
from verification.checks.jump import find_jump
from verification.checks.linear_loop import critical_gain, incremental_pid
from verification.decide.verify import verify
from verification.enclosure.smoothness import continuous_everywhere
from workbench.contracts import settings
from workbench.contracts.verdict import Standing
from workbench.controllers.bp_fipid import BPFIPID
from workbench.controllers.fipid import FIPID
from workbench.controllers.parts.immune import stimulus
from workbench.trials.campaign import run

PROVED, SUPPORTED, REFUTED = Standing.PROVED, Standing.SUPPORTED, Standing.REFUTED


def standings(report):
    return {(v.claim.removeprefix("ato."), v.controller): v.standing for v in report.verdicts}


@pytest.fixture(scope="module", params=["step", "curve"])
def report(request):
    return request.param, verify(
        run(settings.changed(STUDY, {"curve": request.param == "curve"}), show_progress=False), show_progress=False
    )


def test_the_study_as_it_is(report):
    test, done = report
    found = standings(done)
    curve = test == "curve"
    expected = {
        ("relative_degree", None): PROVED,
        ("relative_degree.printed", None): REFUTED,
        ("f_continuous", "fipid"): REFUTED,
        ("f_continuous", "fipid-smooth"): PROVED,
        ("critical_gain", "fipid"): SUPPORTED,
        ("critical_gain", "bp-fipid"): SUPPORTED,
        ("critical_gain", "fixed-best"): REFUTED if curve else SUPPORTED,
        ("network_learns", "bp-fipid"): SUPPORTED if curve else REFUTED,
        ("better_than_fixed_gain", "bp-fipid"): REFUTED,
        ("better_than_fipid", "bp-fipid"): SUPPORTED if curve else REFUTED,
        ("jerk_limit", "fipid"): SUPPORTED if curve else REFUTED,
        ("jerk_limit", "bp-fipid"): SUPPORTED if curve else REFUTED,
        ("sign_of_slope", "bp-fipid"): REFUTED,
    }
    assert {key: found[key] for key in expected} == expected
    assert Standing.UNDECIDED not in found.values()
    assert done.conclusion and done.tables


def test_the_witness_of_a_wrong_sign_has_the_slope_of_the_delayed_sample(report):
    _, done = report
    (verdict,) = [one for one in done.verdicts if one.claim == "ato.sign_of_slope"]
    (slope,) = [value for name, value in verdict.witness.items() if name.startswith("dy(k+")]
    assert slope == pytest.approx(1 - np.exp(-0.2 / 2.1), rel=0.5) and slope > 0


def test_the_published_figures_stand_beside_ours(report):
    test, done = report
    published = [table for table in done.tables if table.title.startswith("Published")]
    assert bool(published) == (test == "curve")
    if published:
        cells = {row[0]: row for row in published[0].rows}
        assert float(cells["largest jerk, target curve (m/s^3)"][2]) == pytest.approx(0.0913, abs=2e-4)
        assert "0.0687" in cells["largest jerk, FIPID (m/s^3)"][3]
        assert all(row[3] for row in published[0].rows)


def test_the_witness_of_the_jump_replays(report):
    verdict = next(v for v in report[1].verdicts if v.claim == "ato.f_continuous" and v.controller == "fipid")
    assert verdict.witness["point (u, du)"][1] == 0.0
    values = [float(stimulus("rules", *map(ca.DM, side))) for side in verdict.witness["on both sides"]]
    assert values == verdict.witness["f there"] and abs(values[1] - values[0]) > 0.5


def test_claims_that_would_hold_elsewhere_hold():
    changes = {
        "curve": True,
        "draws": 3,
        "tune": False,
        "controllers": {
            "fipid": FIPID(K=0.05),
            "bp-fipid": BPFIPID(beta=0.005, f="smooth"),
            "bp-frozen": BPFIPID(beta=0.0, f="smooth"),
            "fixed-best": FIPID(K=0.1, eta=1.0),
        },
    }
    quick = settings.changed(STUDY, changes)
    found = standings(verify(run(quick, show_progress=False), show_progress=False))
    assert found["better_than_fixed_gain", "bp-fipid"] is SUPPORTED
    assert found["f_continuous", "bp-fipid"] is PROVED


def test_claims_that_hold_are_refuted_by_draws_that_break_them():
    done = run(settings.changed(STUDY, {"curve": True, "draws": 3, "tune": False}), show_progress=False)
    drawn = done.drawn.copy(deep=True)
    drawn["scores"].loc[{"controller": "bp-fipid", "draw": 2, "score": ["max_jerk", "gain_max"]}] = 9.0
    drawn["scores"].loc[{"controller": "bp-fipid", "score": ["ise", "iae", "itse", "itae"]}] = 1e9
    broken = dataclasses.replace(done, drawn=drawn)
    report = verify(broken, examine(broken), show_progress=False)
    found = standings(report)
    for claim in ("jerk_limit", "critical_gain", "network_learns", "better_than_fipid"):
        assert found[claim, "bp-fipid"] is REFUTED, claim
    (jerk,) = [v for v in report.verdicts if v.claim == "ato.jerk_limit" and v.controller == "bp-fipid"]
    assert (jerk.witness["draw"], jerk.witness["seed"]) == (2, 1)


def test_the_witness_of_a_draw_is_that_of_the_draw_run_alone(report):
    _, done = report
    study = done.campaign.study
    for claim in ("jerk_limit", "critical_gain"):
        (verdict,) = [v for v in done.verdicts if v.claim == f"ato.{claim}" and v.controller == "bp-fipid"]
        alone = run(dataclasses.replace(study, seed=verdict.witness["seed"], draws=1), show_progress=False)
        one, k = alone.data.sel(controller="bp-fipid", trial=1), verdict.witness["sample"]
        if claim == "jerk_limit":
            y = one["output"].values
            assert abs(y[k + 1] - 2 * y[k] + y[k - 1]) / 0.04 == pytest.approx(verdict.witness["jerk"], rel=1e-12)
        else:
            gain = float(one["p1"][k] - one["p2"][k] * one["f"][k])
            assert gain == pytest.approx(verdict.witness["p1 - p2 f"], rel=1e-12)


@pytest.mark.parametrize(("kind", "standing"), [("rules", REFUTED), ("smooth", PROVED)])
def test_continuity_of_the_stimulus(kind, standing):
    assert f_continuous(kind).standing is standing


def test_jumps_are_found_and_steep_slopes_are_none():
    assert find_jump(lambda x: float(x >= 0.3), (-1,), (1,)).size == 1.0
    assert find_jump(lambda x, y: np.tanh(1e5 * (x - 0.31)) + y, (-1, -1), (1, 1)) is None
    x = ca.SX.sym("x")
    assert continuous_everywhere(ca.Function("g", [x], [ca.tanh(x) * x + 1]))
    assert not continuous_everywhere(ca.Function("g", [x], [ca.if_else(x > 0, x, 1)]))


def test_critical_gain_against_the_phase_margin_route_and_a_simulation():
    plant = delayed(Transfer(numerator=(0.5,)), 1.0)
    loop = plant.linearised([0.0] * 6, [0.0]) * incremental_pid(0.3, 0.3, 0.2)
    found = critical_gain(loop)

    def error_after(gain):
        a, b = np.exp(-0.2), 0.5 * (1 - np.exp(-0.2))
        y, u, e = [0.0] * 10, [0.0] * 10, [0.0] * 10
        for _ in range(3000):
            y.append(a * y[-1] + b * u[-6])
            e.append(1 - y[-1])
            u.append(u[-1] + gain * (e[-1] - e[-2] + 0.3 * e[-1] + 0.3 * (e[-1] - 2 * e[-2] + e[-3])))
        return abs(e[-1]) + abs(e[-2]) + abs(e[-3])

    assert error_after(0.97 * found) < 1e-3 and error_after(1.03 * found) > 10
    omega = np.linspace(0.05, np.pi / 0.2, 200_000)[:-1]
    value = control.frequency_response(loop, omega).complex
    crossing = np.flatnonzero((value.imag[:-1] < 0) & (value.imag[1:] >= 0) & (value.real[1:] < 0))[0]
    assert found == pytest.approx(-1 / value.real[crossing], rel=1e-3)


def test_critical_gain_of_loops_without_one():
    assert critical_gain(control.ss(0.5, 0.1, 1, 0, 0.2)) == pytest.approx(15.0, rel=1e-9)
    assert critical_gain(control.ss(0.5, 0.0, 1, 0, 0.2)) == float("inf")
    with pytest.raises(InvalidValue, match="discrete-time"):
        critical_gain(control.tf([1], [1, 1]))
    with pytest.raises(InvalidValue, match="stable for small gains"):
        critical_gain(control.ss(1.5, 1, 1, 0, 0.2))
