"""The checks of tubes and predictive laws: each stands where it should and is refuted where it should."""

from __future__ import annotations

import dataclasses
from fractions import Fraction

import numpy as np
import pytest
from brake_tubes import brake_tube

from studies.stopping import claims
from studies.stopping import outcomes as stopping_outcomes
from studies.stopping.design import Control
from studies.stopping.settings import own
from verification.checks import predictive as predictive_checks
from verification.checks import tube as tube_checks
from verification.checks.feasibility import simulate
from verification.decide.verify import judge
from verification.enclosure.exact_schur import proved_schur
from workbench.contracts.settings import assigned
from workbench.contracts.verdict import Standing
from workbench.controllers.rmpc import RMPC
from workbench.controllers.rsmpc import RSMPC
from workbench.predictive.quadratic_program import Infeasible
from workbench.sets import Polytope
from workbench.trials.campaign import run
from workbench.trials.find import find

STUDY = find("stopping")


def twisted(tube, **values):
    """A tube with parts replaced after it was checked: what a wrong design would be."""
    wrong = dataclasses.replace(tube)
    for name, value in values.items():
        wrong.__dict__[name] = value
    return wrong


@pytest.mark.parametrize("check", ["schur", "lyapunov", "lmi20", "tube_inside", "rpi"])
def test_sound_tubes_pass(tube, check):
    finding = getattr(tube_checks, check)(tube)
    assert finding.standing is (Standing.PROVED if check == "schur" else Standing.SUPPORTED), finding
    assert finding.margin > 0


WRONG = {
    "schur": lambda tube: twisted(tube, A_cl=1.1 * tube.A_cl),
    "lyapunov": lambda tube: twisted(tube, P=0.99 * tube.P),
    "lmi20": lambda tube: twisted(tube, P=0.9 * tube.P),
    "tube_inside": lambda tube: twisted(tube, Sigma=Polytope(H=tube.Sigma.H, h=0.3 * tube.Sigma.h)),
    "rpi": lambda tube: twisted(tube, Sigma=tube.X_z),
}


@pytest.mark.parametrize("check", sorted(WRONG))
def test_wrong_tubes_are_refuted(brake_a, check):
    finding = getattr(tube_checks, check)(WRONG[check](brake_a))
    assert finding.standing is Standing.REFUTED and finding.margin < 0 and finding.witness


def test_a_witness_of_rpi_leaves_the_set(brake_a):
    witness = tube_checks.rpi(twisted(brake_a, Sigma=brake_a.X_z)).witness
    after = brake_a.A_cl @ witness["e"] + witness["w"]
    assert brake_a.X_z.contains(witness["e"], tolerance=1e-7)
    assert brake_a.X_z.violation(after) == pytest.approx(witness["leaves by"], abs=1e-7)


def test_exact_schur():
    half, one = Fraction(1, 2), Fraction(1)
    assert proved_schur([[half, Fraction(5)], [Fraction(0), -half]])
    assert not proved_schur([[one, Fraction(0)], [Fraction(0), half]])
    assert not proved_schur([[half, one], [-one, half]])  # modulus 1.118


def test_hurwitz_rejects_a_good_gain_and_accepts_one_with_negative_poles(brake_a):
    finding = tube_checks.hurwitz_as_printed(brake_a)
    assert finding.standing is Standing.REFUTED and finding.witness["spectral radius"] < 1
    assert tube_checks.hurwitz_as_printed(twisted(brake_a, A_cl=-0.5 * np.eye(4))).standing is Standing.SUPPORTED


def test_horizon27_names_the_holds_that_fail(brake_a):
    assert tube_checks.horizon27(brake_a, 8).standing is Standing.SUPPORTED
    finding = tube_checks.horizon27(brake_a, 15)
    assert finding.standing is Standing.REFUTED and finding.witness["M"] == 12 and "M = 12, 13, 14" in finding.method
    assert not brake_a.Sigma.contains(finding.witness["point of the tube"])


def test_tightening(tube):
    finding = tube_checks.tightening_sound(tube, 3, holds=(2,), sequences=5)
    assert finding.standing is Standing.SUPPORTED
    assert finding.margin < 1e-8  # the extreme sequences attain the support: the bounds are not looser than needed
    blind = dataclasses.replace(tube, ignore_delay=True)
    refuted = tube_checks.tightening_sound(blind, 3, sequences=5)
    assert refuted.standing is Standing.REFUTED and refuted.margin < -1e-3


@pytest.mark.parametrize("N", [3, 8])
def test_costs(brake_a, N):
    short, long = RMPC(tube=brake_a, N=N), RSMPC(tube=brake_a, N=N)
    assert predictive_checks.nominal_decrease(short, runs=4, steps=10).standing is Standing.SUPPORTED
    assert predictive_checks.suboptimality(long, runs=2, steps=200).standing is Standing.SUPPORTED
    for check, law in (
        (predictive_checks.disturbed_decrease, short),
        (predictive_checks.disturbed_suboptimality, long),
    ):
        finding = check(law)
        assert finding.standing is Standing.REFUTED and finding.margin < 0


def test_a_decrease_that_fails_is_seen(brake_a):
    law = RMPC(tube=twisted(brake_a, P=0.2 * brake_a.P), N=3)  # violates (19)
    finding = predictive_checks.nominal_decrease(law, runs=8)
    assert finding.standing is Standing.REFUTED
    plan = law.plan(finding.witness["e"])
    assert plan.J == pytest.approx(finding.witness["J"])


def test_a_cost_that_was_promised_too_low_is_seen(brake_a):
    class Boasting(RSMPC):
        def plan(self, e, M):
            plan = super().plan(e, M)
            return plan._replace(J=0.1 * plan.J)

    finding = predictive_checks.suboptimality(Boasting(tube=brake_a, N=5, beta=1.0), runs=2, steps=100)
    assert finding.standing is Standing.REFUTED and finding.witness["spent"] > finding.witness["beta J"]


def test_no_plan_leaves_a_check_undecided(brake_a):
    class Lost(RMPC):
        def plan(self, e):
            return Infeasible(reason="lost", shortfall=1.0)

    assert predictive_checks.nominal_decrease(Lost(tube=brake_a, N=3), runs=1).standing is Standing.UNDECIDED


@pytest.mark.parametrize("control", ["index_off_by_one", "ignore_delay"])
def test_negative_controls_are_refuted_and_replay(control):
    true, tube = brake_tube(), brake_tube(**{control: True})
    law = RMPC(tube=tube, N=15)
    finding = predictive_checks.recursive_feasibility(law, true.plant, true.bounds, runs=40)
    assert finding.standing is Standing.REFUTED and finding.margin < 0
    witness = finding.witness
    again = simulate(law, true.plant, true.bounds, np.array(witness["e"]), disturb=np.array(witness["w"]))
    assert again.infeasible_at == witness["infeasible at sample"]
    assert again.violation == pytest.approx(witness["beyond a bound by"])


def test_a_range_that_is_too_small_is_seen(brake_a):
    law = RMPC(tube=brake_tube(low=-0.01, high=0.05), N=3)
    finding = predictive_checks.recursive_feasibility(law, brake_a.plant, brake_a.bounds, runs=30)
    assert finding.standing is Standing.REFUTED


@pytest.fixture(scope="module")
def small():
    return run(assigned(STUDY, ["horizons=[3, 5]"]), show_progress=False)


def test_all_of_w_refutes_rmpc_with_a_witness_that_replays(small):
    study = small.study
    finding = stopping_outcomes.robustly_within(study, "rmpc-n3", 2)
    assert finding.standing is Standing.REFUTED
    replayed = assigned(study, [finding.witness["setting"]])
    again = stopping_outcomes.stop(replayed, replayed.controllers["rmpc-n3"])
    assert again.error_cm == pytest.approx(finding.witness["stop_error_cm"]) and abs(again.error_cm) > 50
    assert stopping_outcomes.robustly_within(study, "offset-free-n3", 1).standing is Standing.SUPPORTED


def test_standings_of_a_campaign(small):
    examination = claims.examine(small)
    wanted = ("tightened_bounds", "stop_within_50cm", "comfort", "fewer_switches", "horizon27")
    verdicts = [judge(c) for c in examination.claims if c.name.removeprefix("stopping.") in wanted]
    by = {(v.claim.removeprefix("stopping."), v.controller): v.standing for v in verdicts}
    assert {s for (name, _), s in by.items() if name == "comfort"} == {Standing.REFUTED}
    assert {s for (name, _), s in by.items() if name != "comfort"} == {Standing.SUPPORTED}
    names = {claim.name.removeprefix("stopping.") for claim in examination.claims}
    listed = "schur lyapunov lmi20 tube_inside rpi horizon27 tightening_sound nominal_decrease suboptimality32 "
    listed += "recursive_feasibility stop_within_50cm comfort fewer_switches hurwitz_as_printed"
    assert set(listed.split()) <= names
    text = " ".join(examination.conclude(verdicts))
    assert "RMPC stops" in text and "nan" not in text
    full = claims.examine(small, full=True)
    assert any(claim.name.endswith("config_B") for claim in full.claims)


def test_checks_of_a_run_see_what_is_wrong(small):
    data = small.data.copy(deep=True)
    data["stop_position"].loc["rmpc-n3"] = 400.51
    data["bound_excess"].loc[{"controller": "rmpc-n5"}] = 0.2
    data["increment"].loc[{"controller": "rsmpc-n3"}] = 0.1
    data["infeasible"].loc[{"controller": "rsmpc-n5", "sample": 4}] = 1
    data["stop_position"].loc["pid"] = np.nan
    wrong = dataclasses.replace(small, data=data)
    by = {(c.name.removeprefix("stopping."), c.controller): c for c in claims.examine(wrong).claims}
    for key in (
        ("stop_within_50cm", "rmpc-n3"),
        ("stop_within_50cm", "pid"),
        ("tightened_bounds", "rmpc-n5"),
        ("tightened_bounds", "rsmpc-n5"),
        ("fewer_switches", "rsmpc-n3"),
    ):
        verdict = judge(by[key])
        assert verdict.standing is Standing.REFUTED and verdict.witness, key


def test_a_negative_control_of_the_study_reaches_the_claim():
    study = assigned(STUDY, ["tube.ignore_delay=true", "horizons=[3]"])
    finding = claims._feasible(study, own(study), "rmpc", 3, 30)
    assert finding.standing is Standing.REFUTED
    assert (
        claims._feasible(study, dataclasses.replace(own(study), tube=Control()), "rmpc", 3, 30).standing
        is Standing.SUPPORTED
    )


@pytest.mark.slow
@pytest.mark.parametrize("config", ["A", "B"])
@pytest.mark.parametrize("kind", ["rmpc", "rsmpc"])
def test_every_setting_stays_feasible(config, kind):
    study = assigned(STUDY, [f"config={config}"])
    for N in own(study).lengths:
        assert claims._feasible(study, own(study), kind, N, 200).standing is Standing.SUPPORTED
