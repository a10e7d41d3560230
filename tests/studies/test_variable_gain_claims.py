"""The variable-gain study's claims: they stand as expected in every case, and every check can say the opposite."""

from __future__ import annotations

import dataclasses
import math
import warnings

import casadi as ca
import numpy as np
import pytest

from models.metro_line import MetroLine
from models.plant import Plant, signals
from models.quantity import declared, quantity
from studies.variable_gain.claims import BANDS, BOX
from studies.variable_gain.direct_term import answers_at_once, contraction, spectral_radius
from studies.variable_gain.law_equations import LawEquations
from studies.variable_gain.outcomes import initial_state_ratio
from studies.variable_gain.published import EXPECTED
from studies.variable_gain.scores import scores
from studies.variable_gain.study import STUDY
from verification.checks.initial_state import converges_at, converges_from, held_against, share_from
from verification.checks.lipschitz import held_slopes, jump_at, lipschitz
from verification.decide.judge import ContradictionWarning, judge
from verification.decide.verify import examination_of, verify
from workbench.contracts import settings
from workbench.contracts.finding import Standing, plain
from workbench.contracts.scenario import Between, UniformNoise
from workbench.controllers.fixed_gain import FixedGain
from workbench.controllers.variable_gain import VariableGain
from workbench.trials.campaign import Campaign, run

PROVED, SUPPORTED, REFUTED, UNDECIDED = Standing.PROVED, Standing.SUPPORTED, Standing.REFUTED, Standing.UNDECIDED


def changed(*assignments, **fields):
    return settings.assigned(dataclasses.replace(STUDY, **fields), assignments)


def standings(name, *assignments, **fields):
    return judged(run(changed(*assignments, **fields), show_progress=False), name)


def judged(campaign, name):
    claims = [claim for claim in examination_of(campaign).claims if claim.name == f"variable-gain.{name}"]
    assert claims
    return {claim.controller: judge(claim) for claim in claims}


def as_expected(case):
    report = verify(run(settings.in_case(STUDY, case), show_progress=False), show_progress=False)
    assert [(one.label, one.controller) for one in report.verdicts if one.expected is None] == []
    assert [(one.label, one.controller, one.standing) for one in report.verdicts if one.departs] == []
    assert [(one.label, one.controller) for one in report.verdicts if one.left_open] == []
    assert {one.claim for one in report.not_made} == {"variable-gain.estimate_useful"}  # no law estimates
    for one in report.verdicts:
        assert not {"nan", "inf", "none"} & set(one.method.lower().split()), one
        assert one.margin is None or math.isfinite(one.margin), one
        if one.standing is PROVED and one.claim != "variable-gain.spectral_radius_printed":
            assert one.held is not None and one.held.margin >= 0, one
    return report


def test_every_claim_stands_as_expected():
    report = as_expected("")
    assert {one.claim.removeprefix("variable-gain.") for one in report.verdicts} == set(EXPECTED)
    assert len(report.conclusion) == 4 and report.tables[0].rows
    assert "0.3 m/s" in report.conclusion[1] and "smoothed" in report.conclusion[3]
    witness = next(verdict.witness for verdict in report.verdicts if verdict.claim.endswith("radius_printed"))
    assert witness is not None and max(witness["eigenvalues"]) == 1.0


@pytest.mark.slow
@pytest.mark.parametrize("case", STUDY.cases)
def test_every_claim_stands_as_expected_in_every_case(case):
    as_expected(case)


OPPOSITES = [
    ("speed_contraction", ["gain_mismatch=2.1"], "fixed", REFUTED),
    ("speed_contraction", ["gain_mismatch=2.1"], "variable", REFUTED),
    ("speed_contraction", ["gain_mismatch=1.99"], "variable", PROVED),
    ("speed_contraction", ["gain_mismatch=2"], "fixed", REFUTED),
    ("speed_contraction", ["gain_mismatch=6", "controllers.fixed.lam=0.3"], "fixed", PROVED),
    ("speed_contraction", ["actuator.lag=0.5"], "fixed", UNDECIDED),
    ("speed_contraction", ["actuator.upper=1"], "variable", UNDECIDED),
    ("speed_contraction", ["controllers.fixed.learns=position"], "fixed", UNDECIDED),
    ("relative_degree_speed", ["actuator.delay=0.1"], None, UNDECIDED),
    ("spectral_radius_printed", ["actuator.delay=0.1"], None, UNDECIDED),
    ("learning_law", ["controllers.fixed.learns=position"], "fixed", REFUTED),
    ("initial_state_ratio", ["controllers.fixed.initial_learning=false"], "fixed", REFUTED),
    ("initial_state_ratio", ["controllers.variable.lam0=0.9"], "variable", PROVED),
    ("initial_state_ratio", ["noise.sigma=0.02"], "variable", PROVED),
    ("initial_state_ratio", ["initial.trial_sigma=0.1"], "variable", UNDECIDED),
    ("global_initial_convergence", ["trials=12"], "variable", REFUTED),
    ("global_initial_convergence", ["trials=12", "actuator.lag=0.3"], "fixed", REFUTED),
    ("initial_learning_needed", ["initial.speed=0", "initial.position=0"], None, SUPPORTED),
    ("initial_learning_needed", ["initial.speed=0", "initial.position=0.02"], None, REFUTED),
    ("noise_claim", ["controllers.variable.smoothing_s=20", "trials=6"], None, SUPPORTED),
    ("faster_than_fixed", ["gain_mismatch=1.9", "trials=60", "controllers.variable.lam_min=0.5"], None, SUPPORTED),
    ("faster_than_fixed", ["trials=3"], None, UNDECIDED),
    ("mismatch_limit", ["trials=5"], None, REFUTED),
    ("position_only", ["trials=1"], None, UNDECIDED),
    ("position_only", ["trials=2", "gain_mismatch=0.01"], None, SUPPORTED),
]


@pytest.mark.parametrize(("name", "assignments", "controller", "standing"), OPPOSITES)
def test_checks_can_say_the_opposite(name, assignments, controller, standing):
    trials = [] if any("trials=" in one for one in assignments) or name not in QUICK else ["trials=2"]
    verdict = standings(name, *trials, *assignments)[controller]
    assert verdict.standing is standing, verdict


QUICK = ("speed_contraction", "relative_degree_speed", "spectral_radius_printed", "learning_law", "initial_state_ratio")


def test_a_gain_that_the_plant_bears_converges():
    found = standings("mismatch_limit", cases={**STUDY.cases, "mismatch": {"truth.input_gain.factor": 1.2}})[None]
    assert found.standing is SUPPORTED and found.margin > 0


@pytest.mark.parametrize(
    ("name", "fields", "says"),
    [
        ("initial_state_ratio", {"noise": UniformNoise(largest=0.01)}, "is added to the measured position"),
        ("initial_state_ratio", {"continues": True}, "begins where the last one ended"),
        ("speed_contraction", {"truth": {"input_gain": Between(low=0.9, high=1.1)}}, "changes from trial to trial"),
        ("relative_degree", {"truth": {"input_gain": Between(low=0.9, high=1.1)}}, "changes from trial to trial"),
    ],
)
def test_one_thing_beyond_a_premise_leaves_the_conclusion_open(name, fields, says):
    for verdict in standings(name, "trials=2", **fields).values():
        assert verdict.standing is UNDECIDED and says in verdict.method


@pytest.mark.parametrize(("off", "stands"), [(0.0, PROVED), (1e-15, PROVED), (1e-9, UNDECIDED), (-0.5, UNDECIDED)])
def test_a_ratio_is_held_against_every_trial_of_the_record(off, stands):
    campaign = run(changed("trials=6"), show_progress=False)
    data = campaign.data.copy(deep=True)
    data["error"].loc[{"controller": "fixed", "output_name": "position", "trial": 4, "sample": 0}] += off
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ContradictionWarning)
        verdict = judged(Campaign(campaign.study, data), "initial_state_ratio")["fixed"]
    assert verdict.standing is stands and bool(verdict.contradiction) is (stands is UNDECIDED)


def test_rounding_of_initial_errors_is_allowed_for_and_no_more():
    errors = 0.8 * 0.4 ** np.arange(20)
    sizes = np.full(20, 0.8)
    assert held_against(errors, sizes, 0.4).margin > 0 and held_against(errors, sizes, 0.4).tries == 19
    assert held_against(errors, sizes, 0.4 + 1e-12).margin < 0
    errors[-1] = np.nan
    assert held_against(errors, sizes, 0.4).tries == 18
    assert held_against(errors[:1], sizes[:1], 0.4).tries == 0


@declared
class Misleading(VariableGain):
    """It tells half the gain that it learns with."""

    def tell(self, memory, trial):
        """Return half the gain."""
        return (0.5 * self.gain(memory, trial),)


@declared
class Leaning(FixedGain):
    """It leans on what it measures within the trial too."""

    def act(self, memory_k, state, r, r_next, y):
        """Return the plan with feedback."""
        return memory_k.F + 0.5 * (r[1] - y[1]), state


@declared
class Hasty(FixedGain):
    """It moves the start by more than lambda_0 says."""

    def learn(self, memory, trial):
        """Return a memory whose start moved further."""
        after = super().learn(memory, trial)
        return after._replace(moved=after.moved + 0.1 * trial.e[:, 0])


@declared
class Bold(VariableGain):
    """Its gain goes up to 2.5."""

    def gain(self, memory, trial):
        """Return the gain and a half."""
        return 2.5 * super().gain(memory, trial)


def equations(law):
    return LawEquations(dataclasses.replace(STUDY, controllers={"law": law}), "law")


@pytest.mark.parametrize(
    ("law", "learning", "ratio"),
    [
        (VariableGain(), PROVED, PROVED),
        (VariableGain(smoothing_s=1.0), PROVED, PROVED),
        (FixedGain(lam=0.7, lam0=1.3), PROVED, PROVED),
        (Misleading(), REFUTED, PROVED),
        (Leaning(), REFUTED, PROVED),
        (Hasty(), PROVED, REFUTED),
        (FixedGain(initial_learning=False), PROVED, REFUTED),
        (FixedGain(learns="position"), REFUTED, PROVED),
    ],
    ids=lambda value: type(value).__name__ if not isinstance(value, Standing) else "",
)
def test_the_patents_equations_are_those_of_the_law(law, learning, ratio):
    one = equations(law)
    for identity, stands in ((one.learning(), learning), (one.ratio(), ratio)):
        found = identity.finding()
        assert found.standing is stands
        if stands is REFUTED:
            assert identity.replay(plain(found.witness)) == found.margin < 0


@pytest.mark.parametrize("law", [VariableGain(), VariableGain(lam_min=0.05, steepness=40.0), Bold()])
def test_gains_lie_where_they_are_said_to_and_come_close_to_the_ends(law):
    short = dataclasses.replace(STUDY, controllers={"law": law})
    one, rng = LawEquations(short, "law"), np.random.default_rng(1)
    gains = one.gains
    seen = [one.attained(rng.normal(size=STUDY.horizon + 1) * scale) for scale in (0.0, 1e-3, 1.0, 1e3)]
    seen += [one.attained(row) for row in gains.tried]
    low, high = float(gains.low), float(gains.high)
    assert all(low <= value <= high for value in seen)
    assert min(seen) == pytest.approx(low, rel=1e-9) and max(seen) == pytest.approx(high, rel=1e-9)


def test_a_gain_above_two_is_refuted_with_errors_that_reach_it():
    found = contraction(MetroLine(), 1, equations(Bold()))
    assert found.standing is REFUTED and found.witness["lambda"] == pytest.approx(2.5)
    assert found.margin == pytest.approx(1 - 1.5)


@declared
class Curved(VariableGain):
    """Its gain is a curve of the one that it inherits, of which intervals know less than is true."""

    def gain(self, memory, trial):
        """Return a gain of at most 0.95."""
        gain = super().gain(memory, trial)
        return 0.2 + 3 * gain * (1 - gain)


def test_a_bound_above_two_that_no_errors_reach_refutes_nothing():
    law = equations(Curved())
    found = contraction(MetroLine(), 1, law)
    assert float(law.gains.high) > 2
    assert found.standing is UNDECIDED and "no errors were found that reach 1" in found.reason


@declared
class Wild(FixedGain):
    """Its gain of initial-state learning may be anything."""

    lam0: float = quantity(default=2.5, unit="1", doc="lambda_0")


@pytest.mark.parametrize(("lam0", "stands"), [(1.9, PROVED), (2.0, REFUTED), (2.5, REFUTED), (-0.1, REFUTED)])
def test_an_initial_error_that_does_not_shrink_is_refuted(lam0, stands):
    law = equations(Wild(lam0=lam0))
    assert initial_state_ratio(law, law.ratio()).standing is stands


@declared
class Slippery(MetroLine):
    """Its wheels slip at some places: the input gain depends on the position."""

    def rhs(self, x, u, w, t):
        """Return the slope with a force that fades."""
        v, a = super().rhs(x, u, w, t)
        return v, a - 0.9 * self.input_gain * u.force * ca.sin(x.position / 100) ** 2


def test_a_gain_that_depends_on_the_state_is_not_judged_at_one_point():
    assert contraction(Slippery(), 1, equations(FixedGain())).standing is UNDECIDED
    assert answers_at_once(Slippery(), ("speed",)).standing is UNDECIDED
    assert spectral_radius(Slippery(), 1.0).standing is UNDECIDED


@declared
class Pair(Plant):
    """Two states, each with an input of its own."""

    source = "made for this test"
    states = outputs = signals(a="1", b="1")
    inputs = signals(p="1/s", q="1/s")
    sampling_time = 0.1
    second: float = quantity(default=0.5, unit="1", doc="gain of the second input")

    def rhs(self, x, u, w, t):
        """Return both inputs."""
        return u.p + 0.3 * u.q, self.second * u.q

    def output(self, x):
        """Return both states."""
        return x.a, x.b


@pytest.mark.parametrize(("second", "lam", "stands"), [(0.5, 1.0, PROVED), (2.0, 1.0, REFUTED), (2.5, 1.0, REFUTED)])
def test_the_printed_condition_holds_where_every_output_has_an_input(second, lam, stands):
    plant = Pair(second=second)
    found = spectral_radius(plant, lam)
    radius = np.abs(np.linalg.eigvals(np.eye(2) - lam * np.array([[1, 0.3], [0, second]]))).max()
    assert found.standing is stands and found.margin == pytest.approx(1 - radius, abs=1e-12)


def test_the_lipschitz_constant_is_above_every_slope_sampled_and_the_jump_is_there():
    plant = MetroLine(tunnel_resistance=0.0)
    found = lipschitz(plant, *BOX, BANDS)
    assert found.standing is PROVED and found.bound < 5
    rng, x = np.random.default_rng(2), ca.SX.sym("x", 2)
    f = ca.Function("f", [x], [plant.slope(x, ca.SX(0), ca.SX(0, 1), 0)])
    a, b = (rng.uniform(*np.array(BOX)[:, :], (4000, 2)).T for _ in range(2))
    b = a + 1e-3 * (b - a)
    ratios = np.abs(f(a).full() - f(b).full()).max(axis=0) / np.abs(a - b).max(axis=0)
    assert ratios.max() <= found.bound
    assert held_slopes(plant, *BOX, found).margin > 0
    assert held_slopes(plant, *BOX, dataclasses.replace(found, bound=0.5 * float(ratios.max()))).margin < 0
    jump = lipschitz(MetroLine(), *BOX, BANDS)
    assert jump.standing is REFUTED and jump.witness is not None and jump.unit == "m/s/s"
    assert jump.margin == pytest.approx(-9.81e-3 * 0.00013 * 400, rel=1e-3)
    witness = plain(jump.witness)
    assert jump_at(MetroLine(), witness) == pytest.approx(jump.margin, rel=1e-3)
    assert jump_at(plant, witness) > 0  # no jump where there is no tunnel
    assert jump_at(plant, {"x1": [250.0, 15.0], "x2": [550.0, 15.0]}) > 0  # a ramp between them is no jump


def test_starts_are_judged_by_every_output_and_replayed():
    study, starts = changed("trials=12"), np.array([[3.0, 0.5], [0.1, 0.1]])
    for tolerances, stands in (((1e3, 1e3), SUPPORTED), ((1e-9, 1e3), REFUTED), ((1e3, 1e-9), REFUTED)):
        found = converges_from(study, "variable", starts, tolerances)
        assert found.standing is stands and found.tries == 2
        assert converges_at(study, "variable", tolerances, plain(found.witness)) == pytest.approx(found.margin)
    assert (
        "0 of 2 fail: of all starts at most 78 % fail" in converges_from(study, "variable", starts, (1e3, 1e3)).method
    )


def test_one_start_that_fails_is_the_witness():
    study, starts = changed("trials=12"), np.array([[0.1, 0.0], [-18.0, -1.9], [0.2, 0.1]])
    tolerances = (0.01, 5e-4)
    shares = [share_from(study, "fixed", start, tolerances) for start in starts]
    assert sorted(shares)[1] < 1 < max(shares)
    found = converges_from(study, "fixed", starts, tolerances)
    assert found.standing is REFUTED and "1 of 3 fail" in found.method
    assert found.witness["start"] == starts[int(np.argmax(shares))].tolist()


def test_a_run_that_leaves_the_numbers_fails_without_a_number():
    study = changed("trials=40", "truth.input_gain.factor=40", "controllers.fixed.lam=3")
    found = converges_from(study, "fixed", np.array([[1.0, 1.0]]), (1.0, 1.0))
    assert found.standing is REFUTED and found.margin is None and found.witness == {"start": [1.0, 1.0]}


@pytest.mark.parametrize(("position", "speed", "within"), [(0.05, 0.005, 2.0), (0.05, 0.05, None), (0.5, 0.005, None)])
def test_trials_to_tolerance_asks_for_both_outputs(position, speed, within):
    campaign = run(changed("trials=2"), show_progress=False)
    data = campaign.data.copy(deep=True)
    for name, size in (("position", position), ("speed", speed)):
        data["error"].loc[{"output_name": name, "trial": 1}] = 9.0
        data["error"].loc[{"output_name": name, "trial": 2}] = size
    for row in scores(campaign.study, data).values():
        assert row["trials_to_tolerance"] == within


def test_what_has_no_meaning_is_not_made():
    study = dataclasses.replace(changed("trials=2"), controllers={"fixed": FixedGain()})
    claims = examination_of(run(study, show_progress=False)).claims
    lacking = {one.name.removeprefix("variable-gain."): one.lacks for one in claims if one.lacks}
    assert "estimator" in lacking.pop("estimate_useful")
    assert lacking == dict.fromkeys(("noise_claim", "faster_than_fixed"), "a law with a variable gain")
