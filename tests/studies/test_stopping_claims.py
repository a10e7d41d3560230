"""The checks of tubes and predictive laws: each stands where it should and is refuted where it should."""

from __future__ import annotations

import dataclasses
import re
from fractions import Fraction
from functools import partial

import numpy as np
import pytest
from brake_tubes import brake_tube

from models.quantity import InvalidValue
from studies.stopping import claims
from studies.stopping import outcomes as stopping_outcomes
from studies.stopping.design import Control
from studies.stopping.design_claims import _certified, design_claims
from studies.stopping.published import EXPECTED
from studies.stopping.settings import own
from verification.certificates.recheck import Recheck
from verification.checker.folder import answers
from verification.checks import exact_tube
from verification.checks import predictive as predictive_checks
from verification.checks import tube as tube_checks
from verification.checks.feasibility import simulate
from verification.decide.judge import Judge, judge
from verification.decide.verify import verify
from verification.enclosure.exact_schur import certifies, proved_radius, proved_schur
from workbench.contracts.claim import NotCertified, Role, expected_of
from workbench.contracts.finding import Grounds, Standing, plain
from workbench.contracts.settings import assigned, in_case
from workbench.contracts.verdict import DEFAULT
from workbench.controllers.rmpc import RMPC
from workbench.controllers.rsmpc import RSMPC, Selection
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
    assert finding.standing is Standing.PROVED and finding.grounds is Grounds.ALGEBRA, finding
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
    wrong = twisted(brake_a, Sigma=brake_a.X_z)
    finding = tube_checks.rpi(wrong)
    witness = finding.witness
    assert tube_checks.rpi_margin(wrong, plain(witness)) == pytest.approx(finding.margin) and finding.margin < 0
    with pytest.raises(InvalidValue, match="the witness must lie in Sigma"):
        tube_checks.rpi_margin(wrong, {**witness, "e": 10 * witness["e"]})
    after = brake_a.A_cl @ witness["e"] + witness["w"]
    assert brake_a.X_z.contains(witness["e"], tolerance=1e-7)
    assert brake_a.X_z.violation(after) == pytest.approx(witness["leaves by"], abs=1e-7)


def test_exact_schur():
    half, one = Fraction(1, 2), Fraction(1)
    assert proved_schur([[half, Fraction(5)], [Fraction(0), -half]])
    assert not proved_schur([[one, Fraction(0)], [Fraction(0), half]])
    assert not proved_schur([[half, one], [-one, half]])  # modulus 1.118
    assert proved_radius([[one + Fraction(1, 10**30)]]) is None  # 1.0 as a double


def test_a_certificate_proves_only_what_decreases():
    half, zero, one, two = Fraction(1, 2), Fraction(0), Fraction(1), Fraction(2)
    unit = [[one, zero], [zero, one]]
    assert certifies(unit, [[half, zero], [zero, -half]])
    assert not certifies(unit, [[two, zero], [zero, half]])
    assert not certifies(unit, [[one, zero], [zero, half]])  # on the circle
    assert not certifies([[-one, zero], [zero, -one]], [[two, zero], [zero, two]])  # P - M'PM > 0 without P > 0


@pytest.mark.parametrize("seed", range(6))
def test_a_proved_radius_lies_between_the_true_one_and_1(seed):
    M = np.random.default_rng(seed).normal(size=(3, 3))
    M *= (0.3 + 0.1 * seed) / np.abs(np.linalg.eigvals(M)).max()
    bound = proved_radius([[Fraction(entry) for entry in row] for row in M.tolist()])
    assert bound is not None and 0.3 + 0.1 * seed - 1e-12 <= bound < 1


def test_schur_says_how_far_the_radius_is_proved_to_be_from_1(tube):
    finding = tube_checks.schur(tube)
    assert finding.grounds is Grounds.ALGEBRA and finding.bound == pytest.approx(1 - finding.margin)
    assert np.abs(np.linalg.eigvals(tube.A_cl)).max() < finding.bound
    assert tube_checks.held_by_powers(tube, finding).margin > 0
    assert tube_checks.held_by_powers(tube, dataclasses.replace(finding, bound=0.9 * finding.bound)).margin < 0


def test_nothing_is_proved_by_floating_point(brake_a, monkeypatch):
    def unseen(*_: object) -> None:
        raise NotCertified("it is not seen")

    for name in ("schur", "equality", "raised", "limit_inside", "invariant", "horizon27", "tightening"):
        monkeypatch.setattr(exact_tube, name, unseen)
    found = [getattr(tube_checks, one)(brake_a) for one in ("schur", "lyapunov", "lmi20", "tube_inside", "rpi")]
    found += [tube_checks.horizon27(brake_a, 3), tube_checks.tightening_sound(brake_a, 2, sequences=2)]
    assert {(one.standing, one.grounds) for one in found} == {(Standing.SUPPORTED, Grounds.NUMERICS)}
    assert all("it is not seen" in one.method for one in found)


def test_hurwitz_rejects_a_good_gain_and_accepts_one_with_negative_poles(brake_a):
    finding = tube_checks.hurwitz_as_printed(brake_a)
    assert finding.standing is Standing.REFUTED and finding.witness["spectral radius"] < 1
    assert finding.grounds is Grounds.ALGEBRA and finding.margin == pytest.approx(-np.trace(brake_a.A_cl) / 4)
    turned = tube_checks.hurwitz_as_printed(twisted(brake_a, A_cl=np.diag([0.5, -0.9, -0.9, -0.9])))
    assert turned.standing is Standing.REFUTED and turned.margin == pytest.approx(-0.5)
    assert tube_checks.hurwitz_as_printed(twisted(brake_a, A_cl=-0.5 * np.eye(4))).standing is Standing.SUPPORTED


def test_horizon27_names_the_holds_that_fail(brake_a):
    assert tube_checks.horizon27(brake_a, 8).standing is Standing.PROVED
    finding = tube_checks.horizon27(brake_a, 15)
    assert finding.standing is Standing.REFUTED and "M = 12, 13, 14" in finding.method
    assert max(finding.witness["excess by M"], key=finding.witness["excess by M"].get) == finding.witness["M"]
    assert not brake_a.Sigma.contains(finding.witness["point of the tube"])
    assert tube_checks.horizon27_margin(brake_a, 15, plain(finding.witness)) == pytest.approx(finding.margin)
    with pytest.raises(InvalidValue, match="a point that the tube reaches"):
        tube_checks.horizon27_margin(brake_a, 15, finding.witness | {"point of the tube": 100 * np.ones(4)})


def test_tightening(tube):
    finding = tube_checks.tightening_sound(tube, 3, holds=(2,), sequences=5)
    assert finding.standing is Standing.PROVED
    assert finding.margin < 1e-8  # the extreme sequences attain the support: the bounds are not looser than needed
    blind = dataclasses.replace(tube, ignore_delay=True)
    refuted = tube_checks.tightening_sound(blind, 3, sequences=5)
    assert refuted.standing is Standing.REFUTED and refuted.margin < -1e-3
    assert tube_checks.tightening_margin(blind, plain(refuted.witness)) == pytest.approx(refuted.margin)


@pytest.mark.parametrize("N", [3, 8])
def test_costs(brake_a, N):
    short, long = RMPC(tube=brake_a, N=N), RSMPC(tube=brake_a, N=N)
    assert predictive_checks.nominal_decrease(short, steps=2).standing is Standing.SUPPORTED
    assert predictive_checks.suboptimality(long, steps=8).standing is Standing.SUPPORTED
    for check, again, law in (
        (predictive_checks.disturbed_decrease, predictive_checks.decrease_margin, short),
        (predictive_checks.disturbed_suboptimality, predictive_checks.suboptimality_margin, long),
    ):
        finding = check(law)
        assert finding.standing is Standing.REFUTED and finding.margin < 0
        witness = plain(finding.witness)
        assert again(law, witness) == pytest.approx(finding.margin)
        assert again(law, {**witness, "w": predictive_checks.NONE}) >= 0  # it is the disturbance that does it
        with pytest.raises(InvalidValue, match="disturb within W"):
            again(law, {**witness, "w": [0.0, 0.0, -9.0, -9.0]})


def test_a_claim_about_all_starts_needs_many(brake_a):
    for finding in (
        predictive_checks.nominal_decrease(RMPC(tube=brake_a, N=3), runs=20, steps=2),
        predictive_checks.suboptimality(RSMPC(tube=brake_a, N=3), runs=3, steps=20),
        predictive_checks.recursive_feasibility(RMPC(tube=brake_a, N=3), brake_a.plant, brake_a.bounds, runs=6),
    ):
        assert finding.standing is Standing.UNDECIDED and finding.margin >= 0
        assert "299 independent draws" in finding.reason


def test_a_decrease_that_fails_is_seen(brake_a):
    law = RMPC(tube=twisted(brake_a, P=0.2 * brake_a.P), N=3)  # violates (19)
    finding = predictive_checks.nominal_decrease(law, runs=8)
    assert finding.standing is Standing.REFUTED
    plan = law.plan(finding.witness["e"])
    assert plan.J == pytest.approx(finding.witness["J"])
    assert predictive_checks.decrease_margin(law, plain(finding.witness)) == pytest.approx(finding.margin)
    assert predictive_checks.decrease_margin(RMPC(tube=brake_a, N=3), plain(finding.witness)) > 0


def test_a_cost_that_was_promised_too_low_is_seen(brake_a):
    class Boasting(RSMPC):
        def plan(self, e, M):
            plan = super().plan(e, M)
            return plan._replace(J=0.1 * plan.J)

    finding = predictive_checks.suboptimality(Boasting(tube=brake_a, N=5, beta=1.0), runs=2, steps=100)
    assert finding.standing is Standing.REFUTED and finding.witness["spent"] > finding.witness["beta J"]
    sound = RSMPC(tube=brake_a, N=5, beta=1.0)
    assert predictive_checks.suboptimality_margin(sound, plain(finding.witness)) >= 0


def test_a_trigger_that_is_loose_is_seen(brake_a):
    """It holds although a held plan costs 5 % more than one decided anew: with beta = 1 nothing may be given up."""

    class Loose(RSMPC):
        def select(self, e):
            once = self.plan(e, 1)
            for M in reversed(self.offered):
                held = self.plan(e, M)
                if not isinstance(held, Infeasible) and held.J <= 1.05 * once.J:
                    return Selection(plan=held, M=M, qps=1)
            return Selection(plan=once, M=1, qps=1)

    loose, sound = (law(tube=brake_a, N=8, beta=1.0) for law in (Loose, RSMPC))
    finding = predictive_checks.suboptimality(loose, runs=12, steps=150)
    assert finding.standing is Standing.REFUTED and finding.margin < 0
    assert predictive_checks.suboptimality(sound, runs=12, steps=150).margin >= 0


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
    margin = predictive_checks.feasibility_margin(law, true.plant, true.bounds, plain(witness))
    assert margin == pytest.approx(finding.margin) and finding.margin < 0
    sound = RMPC(tube=true, N=15)
    if not isinstance(sound.plan(witness["e"]), Infeasible):  # where the sound law has a plan, it keeps one
        assert predictive_checks.feasibility_margin(sound, true.plant, true.bounds, plain(witness)) > 0


def test_a_range_that_is_too_small_is_seen(brake_a):
    law = RMPC(tube=brake_tube(low=-0.01, high=0.05), N=3)
    finding = predictive_checks.recursive_feasibility(law, brake_a.plant, brake_a.bounds, runs=30)
    assert finding.standing is Standing.REFUTED


@pytest.fixture(scope="module")
def small():
    return run(assigned(STUDY, ["horizons=[3, 5]"]), show_progress=False)


@pytest.mark.parametrize(("name", "tries"), [("rmpc-n3", 1), ("rsmpc-n5", 1), ("offset-free-n3", 3)])
def test_all_of_w_is_refuted_with_a_witness_that_replays(small, name, tries):
    study = small.study
    finding = stopping_outcomes.robustly_within(study, name, 2)
    assert finding.standing is Standing.REFUTED and finding.tries == tries
    witness = plain(finding.witness)
    assert stopping_outcomes.robust_margin(study, name, witness) == finding.margin < 0
    low, high = own(study).disturbance.low, own(study).disturbance.high
    assert low <= min(witness["brake.blocks"]) and max(witness["brake.blocks"]) <= high
    for base in (study, assigned(study, ["resistance.seed=3"])):
        set_up = assigned(base, witness["settings"])
        again = stopping_outcomes.stop(set_up, set_up.controllers[name])
        assert again.error_cm == pytest.approx(witness["stop_error_cm"]) and abs(again.error_cm) > 50
    with pytest.raises(InvalidValue, match="resist within W"):
        stopping_outcomes.robust_margin(study, name, {**witness, "brake.blocks": [high + 0.1]})


def test_a_late_step_is_what_the_estimate_cannot_see(small):
    """Held resistances are estimated and compensated; one step shortly before the mark is not."""
    study, name = small.study, "offset-free-n3"
    held = stopping_outcomes.held_brakes(own(study), 3)
    assert stopping_outcomes.share_within(study, name, held).share == 1
    late = stopping_outcomes.late_steps(own(study))
    assert stopping_outcomes.share_within(study, name, late).share < 1
    for brake in late:
        first, last = brake.blocks
        assert float(brake.resistance(1.0, brake.block_length - 0.1)) == first
        assert float(brake.resistance(1.0, brake.block_length + 0.1)) == last


def test_few_resistances_support_nothing_for_all_of_w(small, monkeypatch):
    monkeypatch.setattr(stopping_outcomes, "LIMIT_CM", 1000.0)
    finding = stopping_outcomes.robustly_within(small.study, "offset-free-n3", 2)
    assert finding.standing is Standing.UNDECIDED and "299" in finding.reason and 0 < finding.margin < 1000


def test_standings_of_a_campaign(small):
    examination = claims.examine(small)
    wanted = ("tightened_bounds", "stop_within_50cm", "comfort", "fewer_switches", "horizon27")
    verdicts = [judge(c) for c in examination.claims if c.name.removeprefix("stopping.") in wanted]
    by = {(v.claim.removeprefix("stopping."), v.controller): v.standing for v in verdicts}
    assert {s for (name, _), s in by.items() if name == "comfort"} == {Standing.REFUTED}
    assert {s for (name, _), s in by.items() if name == "horizon27"} == {Standing.PROVED}
    assert {s for (name, _), s in by.items() if name not in ("comfort", "horizon27")} == {Standing.SUPPORTED}
    names = {claim.name.removeprefix("stopping.") for claim in examination.claims}
    listed = "schur lyapunov lmi20 tube_inside rpi horizon27 tightening_sound nominal_decrease suboptimality32 "
    listed += "recursive_feasibility stop_within_50cm comfort fewer_switches hurwitz_as_printed"
    assert set(listed.split()) <= names
    text = " ".join(examination.conclude(verdicts))
    assert "RMPC stops" in text and "nan" not in text
    for made in (examination, claims.examine(small, full=True)):
        untold = [
            c.name for c in made.claims if expected_of(made.expectations, c.name, c.controller, "default") is None
        ]
        assert not untold
    expected = [(v, expected_of(examination.expectations, v.claim, v.controller, "default")) for v in verdicts]
    assert all(v.standing is e.standing for v, e in expected)
    for claim in examination.claims:
        assert (claim.role is Role.CONTROL) == claim.statement.startswith("negative control"), claim.name
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
        ("fewer_switches", "rsmpc-n3"),
    ):
        verdict = judge(by[key])
        assert verdict.standing is Standing.REFUTED and verdict.witness, key
    for key in (("tightened_bounds", "rmpc-n5"), ("tightened_bounds", "rsmpc-n5")):
        assert by[key].check().standing is Standing.REFUTED and by[key].check().margin < 0
        verdict = judge(by[key])  # the law run again keeps its bounds: the record is what is wrong
        assert verdict.standing is Standing.UNDECIDED and "when it was replayed" in verdict.method


def test_bounds_that_were_kept_say_nothing_of_a_run_without_its_end(small):
    data = small.data.copy(deep=True)
    data["stop_position"].loc["rmpc-n3"] = np.nan
    made = claims.examine(dataclasses.replace(small, data=data)).claims
    (claim,) = [c for c in made if (c.name, c.controller) == ("stopping.tightened_bounds", "rmpc-n3")]
    assert claim.check().standing is Standing.UNDECIDED and "no whole stop" in claim.check().reason


def test_a_run_without_a_plan_is_refuted_and_replays():
    study = assigned(STUDY, ["config=B", "start=cold", "horizons=[3]"])
    by = {(c.name, c.controller): c for c in claims.examine(run(study, show_progress=False)).claims}
    verdict = judge(by["stopping.tightened_bounds", "rmpc-n3"])
    assert verdict.standing is Standing.REFUTED and verdict.margin == verdict.replayed == -6
    assert verdict.witness["sample"] == 0 and "misses by" in verdict.method


def test_a_train_that_never_stops_supports_nothing_about_its_stop():
    done = run(assigned(STUDY, ["horizons=[3]", "brake.blocks=[-1.2]"]), show_progress=False)
    made = claims.examine(done)
    ends = ("tightened_bounds", "stop_within_50cm", "comfort", "fewer_switches")
    verdicts = [judge(c) for c in made.claims if c.name.removeprefix("stopping.") in ends]
    by = {(v.claim.removeprefix("stopping."), v.controller): v for v in verdicts}
    assert {v.standing for (name, _), v in by.items() if name == "stop_within_50cm"} == {Standing.REFUTED}
    assert {by[name, "rsmpc-n3"].standing for name in ("comfort", "fewer_switches")} == {Standing.UNDECIDED}
    assert Standing.SUPPORTED not in {v.standing for v in verdicts}
    said = " ".join([*(v.method for v in verdicts), *made.conclude(verdicts)])
    assert not re.search(r"\b(nan|inf)\b", said) and "nowhere" in said
    assert np.isnan(stopping_outcomes.share_within(done.study, "pid", [done.study.plant.plant]).worst_cm)


def test_a_negative_control_of_the_study_reaches_the_claim():
    study = assigned(STUDY, ["tube.ignore_delay=true", "horizons=[3]"])
    finding = claims._feasible(study, own(study), "rmpc", 3, 30)
    assert finding.standing is Standing.REFUTED
    sound = claims._feasible(study, dataclasses.replace(own(study), tube=Control()), "rmpc", 3, 300)
    assert sound.standing is Standing.SUPPORTED and "0 of 300" in sound.method


@pytest.mark.slow
@pytest.mark.parametrize("config", ["A", "B"])
@pytest.mark.parametrize("kind", ["rmpc", "rsmpc"])
def test_every_setting_stays_feasible(config, kind):
    study = assigned(STUDY, [f"config={config}"])
    for N in own(study).lengths:
        assert claims._feasible(study, own(study), kind, N, 300).standing is Standing.SUPPORTED


@pytest.mark.parametrize("case", ["", "B"])
def test_what_is_said_of_the_design_is_certified(case, tmp_path):
    study, recheck = in_case(STUDY, case), Recheck()
    judge_ = Judge(case or DEFAULT, expectations=EXPECTED, recheck=recheck)
    verdicts = [judge_.verdict(claim) for claim in design_claims(study, (3, 5))]
    assert [(one.label, one.controller) for one in verdicts if one.departs] == []
    proved = [one for one in verdicts if one.standing is Standing.PROVED]
    refuted = {(one.label, one.controller) for one in verdicts if one.standing is Standing.REFUTED}
    assert len(proved) + len(refuted) == len(verdicts) and len(proved) >= 8
    recheck.write_into(tmp_path, verdicts)
    assert {one.outcome for one in answers(tmp_path)} == {"accepted"} and len(answers(tmp_path)) == len(proved)


def test_what_has_no_certificate_is_no_more_than_supported():
    def unseen(*_: object) -> None:
        raise NotCertified("it is not seen")

    (claim,) = [one for one in design_claims(STUDY, (3,)) if one.name == "stopping.schur"]
    without = dataclasses.replace(claim, certify=partial(_certified, own(STUDY), unseen))
    verdict = Judge(recheck=Recheck(demanded=True)).verdict(without)
    assert verdict.standing is Standing.SUPPORTED and verdict.unchecked == "it is not seen"


@pytest.mark.slow
@pytest.mark.parametrize("case", ["", *STUDY.cases])
def test_every_claim_stands_as_is_expected(case):
    report = verify(run(in_case(STUDY, case), show_progress=False), show_progress=False)
    assert [(v.label, v.controller, v.standing) for v in report.verdicts if v.departs or v.expected is None] == []
