"""The claims of the ato study: what they say of the study, and of cases made to say the opposite."""

from __future__ import annotations

import dataclasses

import casadi as ca
import control
import numpy as np
import pytest

from models.actuator import delayed
from models.brake import Brake, Halting
from models.quantity import InvalidValue
from models.transfer import Transfer
from studies.ato import effects, outcomes, stimulus
from studies.ato.claims import examine
from studies.ato.study import BRAKING, STUDY, own
from verification.checks.jump import find_jump
from verification.checks.linear_loop import critical_gain, incremental_pid
from verification.decide.judge import ContradictionWarning, judge
from verification.decide.verify import verify
from verification.enclosure.smoothness import continuous_everywhere
from workbench.contracts import settings
from workbench.contracts.claim import expected_of
from workbench.contracts.finding import Grounds, Standing, plain
from workbench.controllers.bp_fipid import BPFIPID
from workbench.controllers.fipid import FIPID
from workbench.controllers.parts import immune
from workbench.trials.campaign import run

PROVED, SUPPORTED, REFUTED, UNDECIDED = (Standing(name) for name in ("PROVED", "SUPPORTED", "REFUTED", "UNDECIDED"))


def standings(report):
    return {(v.claim.removeprefix("ato."), v.controller): v.standing for v in report.verdicts}


@pytest.fixture(scope="module", params=["step", "curve"])
def report(request):
    study = settings.in_case(STUDY, "curve") if request.param == "curve" else STUDY
    return request.param, verify(run(study, show_progress=False), show_progress=False)


def test_the_study_as_it_is(report):
    test, done = report
    found = standings(done)
    curve = test == "curve"
    expected = {
        ("relative_degree", None): PROVED,
        ("relative_degree.dead_time", None): REFUTED if curve else PROVED,
        ("relative_degree.printed", None): REFUTED,
        ("f_continuous", "fipid"): REFUTED,
        ("f_continuous", "fipid-smooth"): PROVED,
        ("critical_gain", "fipid"): SUPPORTED,
        ("critical_gain", "bp-fipid"): SUPPORTED,
        ("critical_gain", "fixed-best"): REFUTED if curve else SUPPORTED,
        ("network_learns", "bp-fipid"): SUPPORTED if curve else REFUTED,
        ("better_than_fixed_gain", "bp-fipid"): REFUTED,
        ("better_than_fipid", "bp-fipid"): SUPPORTED if curve else REFUTED,
        **({("jerk_limit", name): SUPPORTED for name in ("fipid", "bp-fipid")} if curve else {}),
        ("sign_of_slope", "bp-fipid"): REFUTED,
    }
    assert {key: found[key] for key in expected} == expected
    assert [(v.label, v.controller, v.standing) for v in done.verdicts if v.departs or v.expected is None] == []
    learning = {"ato.error_falls", "ato.estimate_useful"}  # one trial: nothing is learned from trial to trial
    assert {one.claim for one in done.not_made} == learning | (set() if curve else {"ato.jerk_limit"})
    assert done.conclusion and done.tables


def first_outputs(test):
    """Return by k after how many samples u(k) is first in y, 0 for never: the dead times of the paper, plainly."""
    n = 2175 if test == "curve" else 200
    short = [first - 2 <= j < last - 1 for first, last in BRAKING for j in range(n + 20)]
    late = [4 if test == "curve" and (short[j] or short[n + 20 + j]) else 5 for j in range(n + 20)]
    arrives = {}
    for j in range(n + 20):
        arrives.setdefault(j - late[j], j + 1 - (j - late[j]))
    return [arrives.get(k, 0) for k in range(n)], late[:n]


def test_every_input_is_followed_by_a_plain_loop(report):
    test, done = report
    wanted, late = first_outputs(test)
    found = effects.effects(done.campaign.study)
    assert found.degrees.tolist() == wanted and found.told
    assert own(done.campaign.study).dead_times.tolist() == late
    if test == "curve":
        assert [wanted[k] for k in (0, 1463, 1464, 1500, 1555)] == [6, 0, 5, 5, 6]
    for k in (0, 1463, 1464, 1500, 1555) if test == "curve" else (0, 77):
        assert effects.seen_after(done.campaign.study.plant_that_runs, k)[0] == wanted[k]
        assert found.slope(k) == pytest.approx(0.5 * (1 - np.exp(-0.2)) if wanted[k] else 0, rel=1e-12)


def test_the_samples_at_which_a_dead_time_says_nothing(report):
    test, done = report
    (verdict,) = [v for v in done.verdicts if v.claim == "ato.relative_degree.dead_time"]
    wanted, late = first_outputs(test)
    broken = [k for k, d in enumerate(late) if k + 1 + d <= len(late) and wanted[k] != d + 1]
    assert -verdict.margin == len(broken) and bool(broken) == (test == "curve")
    proved = [v for v in done.verdicts if v.claim.startswith("ato.relative_degree") and v.standing is PROVED]
    assert all(v.held.tries > 100 and v.held.margin >= 0 for v in proved) and proved
    if broken:
        assert verdict.witness["k"] == broken and {1463, 1464, 1555} <= set(broken)
        assert verdict.replayed == verdict.margin and "1463" in verdict.method
        sound = {**plain(verdict.witness), "dead time at k": [wanted[k] - 1 for k in broken]}
        assert effects.by_dead_time_margin(done.campaign.study, sound) == 0


class Bare:
    """As much of a study as is asked for where inputs are followed."""

    def __init__(self, plant, horizon=20):
        self.plant_that_runs, self.horizon = plant, horizon


def test_a_degree_that_the_plant_does_not_have_is_contradicted(report):
    study = report[1].campaign.study
    finding = effects.nothing_next(study)
    assert effects.held_by_pulses(study, finding).margin == 0
    boasting = dataclasses.replace(finding, bound=finding.bound + 1)
    held = effects.held_by_pulses(study, boasting)
    assert held.margin == -1 and effects.seen_after(study.plant_that_runs, held.witness["k"])[0] == finding.bound


def test_a_plant_without_dead_time_turns_the_claims_about():
    bare = Bare(Transfer(numerator=(0.5,)))
    printed, repaired = effects.something_next(bare), effects.nothing_next(bare)
    assert printed.standing is PROVED and printed.margin == pytest.approx(0.5 * (1 - np.exp(-0.2)))
    assert repaired.standing is REFUTED and repaired.margin == 0
    assert effects.nothing_next_margin(bare, plain(repaired.witness)) == 0
    assert effects.something_next_margin(bare, plain(printed.witness)) == pytest.approx(printed.margin)


def test_derivatives_that_change_with_the_state_decide_nothing():
    bare = Bare(Halting(plant=Brake(dead_time=0.0)), horizon=4)
    assert effects.something_next(bare).standing is UNDECIDED


def test_the_printed_derivative_is_zero_where_it_is_replayed(report):
    _, done = report
    (verdict,) = [v for v in done.verdicts if v.claim == "ato.relative_degree.printed"]
    assert verdict.margin == verdict.replayed == 0 and isinstance(verdict.witness["k"], int)


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
    values = [float(immune.stimulus("rules", *map(ca.DM, side))) for side in verdict.witness["on both sides"]]
    assert values == verdict.witness["f there"] and abs(values[1] - values[0]) > 0.5
    assert verdict.replayed == verdict.margin == pytest.approx(stimulus.LEAST - abs(values[1] - values[0]), abs=1e-6)
    calm = {**plain(verdict.witness), "point (u, du)": [0.2, 0.25]}
    assert stimulus.jump_margin("rules", calm) > 0 and stimulus.jump_margin("smooth", plain(verdict.witness)) > 0


def test_what_is_proved_continuous_is_what_the_law_ran(report):
    _, done = report
    (verdict,) = [v for v in done.verdicts if v.claim == "ato.f_continuous" and v.controller == "fipid-smooth"]
    assert verdict.held.tries == done.campaign.study.horizon and verdict.held.margin > 0
    data = done.campaign.data.copy(deep=True)
    data["f"].loc[{"controller": "fipid-smooth", "sample": 40}] += 1e-3
    claims = examine(dataclasses.replace(done.campaign, data=data)).claims
    (claim,) = [c for c in claims if c.name == "ato.f_continuous" and c.controller == "fipid-smooth"]
    with pytest.warns(ContradictionWarning):
        assert judge(claim).standing is UNDECIDED


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


def quick(**metrics):
    """Return the claims on the curve test whose record says other metrics of bp-fipid, and their campaign."""
    done = run(settings.changed(STUDY, {"curve": True, "draws": 3, "tune": False}), show_progress=False)
    drawn = done.drawn.copy(deep=True)
    for name, (draws, value) in metrics.items():
        drawn["scores"].loc[{"controller": "bp-fipid", "draw": draws, "score": name.split(",")}] = value
    claims = examine(dataclasses.replace(done, drawn=drawn))
    return {c.name.removeprefix("ato."): c for c in claims.claims if c.controller == "bp-fipid"}, done, claims


ALL = [1, 2, 3]


def test_claims_that_hold_are_refuted_by_draws_that_break_them():
    made, _, _ = quick(**{"max_jerk,gain_max": (2, 9.0), "ise,iae,itse,itae": (ALL, 1e9)})
    for claim in ("jerk_limit", "critical_gain", "network_learns", "better_than_fipid"):
        assert made[claim].check().standing is REFUTED, claim
    jerk = made["jerk_limit"].check()
    assert (jerk.witness["draw"], jerk.witness["seed"], jerk.margin) == (2, 1, pytest.approx(0.75 - 9.0))
    for claim in ("jerk_limit", "critical_gain", "better_than_fipid"):  # the draws run again are better than they say
        verdict = judge(made[claim])
        assert verdict.standing is UNDECIDED and "did not refute the claim when it was replayed" in verdict.method


def test_a_law_that_fell_supports_nothing():
    made, _, examination = quick(ise=(2, np.nan))
    verdicts = [judge(claim) for name, claim in made.items() if name != "f_continuous"]
    assert {v.standing for v in verdicts} == {UNDECIDED} and len(verdicts) == 6
    said = " ".join([*(v.method for v in verdicts), *examination.conclude(verdicts)])
    assert "did not reach the end of its run in 1 of 3 draw(s)" in said and "nan" not in said and "inf" not in said


def test_draws_are_counted_in_words_and_margins_are_those_of_the_worst():
    made, done, _ = quick(wrong_sign_share=(ALL, 0.0))
    jerk, better = made["jerk_limit"].check(), made["better_than_fipid"].check()
    for finding in (jerk, better):
        assert finding.grounds is Grounds.TRIES and finding.tries == 3
        assert "0 of 3" in finding.method and "at most 63.2 % at 95 % confidence" in finding.method
    y = [
        run(dataclasses.replace(done.study, seed=seed, draws=1), show_progress=False).data["output"]
        for seed in range(3)
    ]
    largest = max(float(np.abs(np.diff(one.sel(controller="bp-fipid").values[0, :-1], 2)).max()) / 0.04 for one in y)
    assert jerk.margin == pytest.approx(0.75 - largest, rel=1e-9)
    study, gain = done.study, made["critical_gain"].check()
    assert 0 < better.margin == pytest.approx(outcomes.better_in_all_margin(study, "fipid", plain(better.witness)))
    assert jerk.margin == pytest.approx(outcomes.small_jerk_margin(study, "bp-fipid", plain(jerk.witness)))
    assert gain.margin == pytest.approx(outcomes.below_critical_margin(study, "bp-fipid", plain(gain.witness)))
    assert outcomes.right_sign_margin(study, {"seed": 0}) < 0
    assert made["sign_of_slope"].check().standing is SUPPORTED  # no sign was recorded as wrong


def test_a_gain_is_held_against_every_dead_time():
    late = settings.changed(STUDY, {"curve": True, "braking_delay": 2.0})
    law = late.controllers["fipid"]
    assert outcomes.loop_gain(late, law) < outcomes.loop_gain(settings.changed(STUDY, {"curve": True}), law)
    assert outcomes.loop_gain(settings.changed(STUDY, {"curve": True}), law) == outcomes.loop_gain(STUDY, law)


@pytest.mark.parametrize("case", ["default", "curve"])
def test_every_claim_is_expected_somehow(case):
    study = settings.changed(STUDY, {"curve": case == "curve", "draws": 1, "tune": False})
    made = examine(run(study, show_progress=False))
    assert [c.name for c in made.claims if not expected_of(made.expectations, c.name, c.controller, case)] == []


def test_the_witness_of_a_draw_is_that_of_the_draw_run_alone(report):
    _, done = report
    study = done.campaign.study
    for claim in ("jerk_limit", "critical_gain") if report[0] == "curve" else ("critical_gain",):
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
    assert stimulus.f_continuous(kind).standing is standing


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
