"""The maglev study's claims: they stand as expected in every case, and every check can say the opposite."""

from __future__ import annotations

import dataclasses
import math
from fractions import Fraction
from functools import cache

import numpy as np
import pytest

from models.maglev import Maglev
from models.quantity import declared
from studies.maglev import lyapunov, period_contraction
from studies.maglev.equations import decrease, error_dynamics
from studies.maglev.lyapunov import Fall
from studies.maglev.outcomes import sliding
from studies.maglev.period_contraction import Loop
from studies.maglev.published import EXPECTED
from studies.maglev.reversal import turned, turns
from studies.maglev.study import STUDY
from verification.decide.judge import judge
from verification.decide.verify import examination_of, verify
from workbench.contracts import settings
from workbench.contracts.finding import Standing
from workbench.contracts.scenario import Between, UniformNoise
from workbench.contracts.trial_length import TrialLength
from workbench.controllers.palc import PALC, State
from workbench.trials.campaign import Campaign, run

PROVED, SUPPORTED, REFUTED, UNDECIDED = Standing.PROVED, Standing.SUPPORTED, Standing.REFUTED, Standing.UNDECIDED
PLAIN = Loop(0.4, 0.22, 0.2, 0.0, 0.0, 1e-9, False, None, 0.0)


def changed(*assignments, case="", only=(), **fields):
    study = settings.assigned(settings.in_case(dataclasses.replace(STUDY, **fields), case), assignments)
    if only:
        study = dataclasses.replace(study, controllers={name: study.controllers[name] for name in only})
    return study


def campaign(*assignments, case="", only=(), **fields):
    return run(changed(*assignments, case=case, only=only, **fields), show_progress=False)


@cache
def short():
    return campaign("trials=3", only=("palc",))


def standing(done, name, controller):
    claims = examination_of(done).claims
    chosen = [claim for claim in claims if claim.name == f"maglev.{name}" and claim.controller == controller]
    assert len(chosen) == 1
    return judge(chosen[0])


@pytest.mark.slow
@pytest.mark.parametrize("case", ["", *STUDY.cases])
def test_every_claim_stands_as_expected(case):
    report = verify(campaign(case=case), show_progress=False)
    assert [(one.label, one.controller) for one in report.verdicts if one.expected is None] == []
    assert [(one.label, one.controller, one.standing) for one in report.verdicts if one.departs] == []
    assert [(one.label, one.controller) for one in report.verdicts if one.left_open] == []
    lacking = [one for one in report.not_made if not one.claim.endswith("estimate_useful")]  # no law estimates
    assert {one.controller for one in lacking} == {"palc-filtered"}
    for one in report.verdicts:
        assert not {"nan", "inf", "none"} & set(one.method.lower().split()), one
        assert one.margin is None or math.isfinite(one.margin), one
    assert not any("could not be made" in said or "nan" in said for said in report.conclusion)
    lagging = next(one for one in report.verdicts if one.claim.endswith("lagging") and one.controller == "palc")
    if case == "":
        assert lagging.witness is not None
        assert lagging.witness["observed"] == pytest.approx(lagging.witness["predicted"], rel=0.02)


def test_everything_that_is_expected_is_claimed():
    claimed = {claim.name.removeprefix("maglev.") for claim in examination_of(short()).claims}
    assert claimed == set(EXPECTED) | {"estimate_useful"}  # which no law of the study has the meaning for


def test_checks_can_say_the_opposite():
    lagging = campaign(case="lagging", only=["palc"])
    for name in ("periodicity", "period_contraction", "lyapunov_decrease", "lyapunov_sampled"):
        assert standing(lagging, name, "palc").standing is REFUTED, name
    for name in ("lyapunov_identity", "lyapunov_printed", "error_dynamics"):
        verdict = standing(lagging, name, "palc")
        assert verdict.standing is UNDECIDED and "an actuator lies between" in verdict.method, name
    assert standing(short(), "period_contraction", "palc").standing is SUPPORTED
    two, one = (campaign(f"trials={trials}", only=["palc"]) for trials in (2, 1))
    assert standing(two, "period_contraction", "palc").standing is UNDECIDED
    for name in ("periodicity", "lyapunov_decrease", "lyapunov_sampled", "lyapunov_identity"):
        assert standing(one, name, "palc").standing is UNDECIDED


def test_a_law_that_was_stopped_is_supported_in_nothing_about_its_end():
    done = short()
    cut = done.data.copy(deep=True)
    for name in ("output", "line_resistance", "law_line_resistance", "error"):
        cut[name][:, 2, ...] = np.nan
    cut = Campaign(done.study, cut)
    for name in ("periodicity", "lyapunov_decrease", "lyapunov_sampled"):
        verdict = standing(cut, name, "palc")
        assert verdict.standing is REFUTED and "stopped as diverged after 2 of 3 periods" in verdict.method, name
    assert standing(cut, "period_contraction", "palc").standing is UNDECIDED


@declared
class Doubled(PALC):
    """It learns twice as fast as its gain says."""

    def act(self, memory_k, state, r, r_next, y):
        """Return the force with a resistance that moved twice."""
        (u,), after = super().act(memory_k, state, r, r_next, y)
        more = after.d_hat - memory_k.d_hat
        return (u + more,), State(after.d_hat + more)


@declared
class Careless(PALC):
    """It forgets the weight of the position error in its force."""

    def act(self, memory_k, state, r, r_next, y):
        """Return the force of a law with another weight."""
        (u,), after = super().act(memory_k, state, r, r_next, y)
        return (u + self.model.mass * self.alpha * self.lam * (y[0] - r[0]),), after


@declared
class Heavy(Maglev):
    """A train in which a tenth more mass moves than it says."""

    def rhs(self, x, u, w, t):
        """Return the slope of a heavier train."""
        v, a = super().rhs(x, u, w, t)
        return v, a / 1.1


def ready(law):
    return dataclasses.replace(STUDY, controllers={"palc": law}).law("palc")


@pytest.mark.parametrize(
    ("law", "train", "stands"),
    [
        (PALC(), Maglev(), PROVED),
        (PALC(alpha=1.0, lam=0.1, gamma=3.0), Maglev(mass=5e4, cars=2), PROVED),
        (PALC(), Maglev(line="flat"), PROVED),
        (Doubled(), Maglev(), REFUTED),
        (Careless(), Maglev(), REFUTED),
        (PALC(), Heavy(), REFUTED),
    ],
)
def test_the_equations_are_those_of_law_and_train(law, train, stands):
    for one in (error_dynamics(ready(law), train), decrease(ready(law), train, 0.5)):
        found = one.finding()
        assert found.standing is stands
        if stands is PROVED:
            assert one.held().margin > 0
        else:
            assert one.replay(found.witness) == found.margin < 0


@pytest.mark.parametrize("share", [0.0, 0.25, 0.499, 1.0])
def test_only_the_exact_factor_is_an_identity(share):
    found = decrease(ready(PALC()), Maglev(), share).finding()
    alpha, gamma = 0.4, 0.2
    sides = alpha + gamma / 2, alpha + share * gamma
    assert found.standing is REFUTED
    assert found.margin == pytest.approx(-abs(sides[0] - sides[1]) / max(sides), abs=2e-9)


BEYOND = [
    ("a lag", ["actuator.lag=0.4"], {}, "an actuator lies between"),
    ("a dead time", ["actuator.delay=0.01"], {}, "an actuator lies between"),
    ("a limit", ["actuator.lower=-95000"], {}, "an actuator lies between"),
    ("noise", ["noise.sigma=1e-6"], {}, "noise without a bound"),
    ("bounded noise", [], {"noise": UniformNoise(largest=1e-3)}, "noise of up to 0.001"),
    ("a force that differs", ["disturbance.force_psd=1"], {}, "drawn anew for every trial"),
    ("a new beginning", [], {"continues": False}, "every period begins anew"),
    ("another mass", [], {"truth": {"mass": 1.001}}, "mass or running resistance is not the train's"),
    ("a mass that changes", [], {"truth": {"mass": Between(low=0.9, high=1.1)}}, "changes from trial to trial: mass"),
    ("a wrong period", ["controllers.palc.late=1"], {}, "wrong by 1 samples"),
    ("a period too short", ["controllers.palc.late=-1"], {}, "wrong by -1 samples"),
    ("short trials", [], {"trial_length": TrialLength(law="uniform")}, "may end early"),
]


@pytest.mark.parametrize(("what", "assignments", "fields", "says"), BEYOND, ids=[row[0] for row in BEYOND])
def test_one_thing_beyond_the_premises_leaves_the_theorem_open(what, assignments, fields, says):
    done = short()
    beyond = Campaign(changed("trials=3", *assignments, only=("palc",), **fields), done.data)
    for name in ("error_dynamics", "lyapunov_identity", "lyapunov_printed"):
        verdict = standing(beyond, name, "palc")
        assert verdict.standing is UNDECIDED and says in verdict.method, (name, verdict.method)


def test_the_theorem_is_no_stronger_than_what_the_run_shows():
    assert standing(short(), "error_dynamics", "palc").standing is PROVED
    verdict = standing(short(), "lyapunov_identity", "palc")
    weaker = {one.claim for one in verdict.premises if one.standing is not PROVED}
    assert verdict.standing is not PROVED and weaker == {"maglev.periodicity", "maglev.lyapunov_sampled"}


def test_a_flat_line_turns_with_the_train_and_noise_can_help_where_nothing_is_learned():
    flat = campaign("trials=2", case="flat", only=["palc"])
    assert standing(flat, "reversal", None).standing is SUPPORTED
    single = campaign("trials=1", "seed=3", only=["palc"])
    verdict = standing(single, "noise_claim", None)
    assert (verdict.standing is SUPPORTED) is (verdict.witness["with_noise"] <= verdict.witness["without_noise"])


FALLS = [
    # changes of V, predicted ones, periods run of planned, does it fall, does it follow within a tenth
    ([-1.0, -0.5], [-1.0, -0.5], (3, 3), SUPPORTED, SUPPORTED),
    ([-1.0, -0.46], [-1.0, -0.5], (3, 3), SUPPORTED, SUPPORTED),
    ([-1.0, -0.44], [-1.0, -0.5], (3, 3), SUPPORTED, REFUTED),
    ([-1.0, -0.56], [-1.0, -0.5], (3, 3), SUPPORTED, REFUTED),
    ([-1.0, 0.1], [-1.0, -0.5], (3, 3), REFUTED, REFUTED),
    ([-1.0, 0.0], [-1.0, -0.5], (3, 3), REFUTED, REFUTED),
    ([-1.0, -0.5], [-1.0, -0.5], (3, 9), REFUTED, REFUTED),
    ([], [], (1, 9), UNDECIDED, UNDECIDED),
    ([0.0], [0.0], (2, 2), UNDECIDED, UNDECIDED),
]


@pytest.mark.parametrize(("changes", "predicted", "periods", "falls", "follows"), FALLS)
def test_a_fall_of_V_is_judged_by_its_worst_period(changes, predicted, periods, falls, follows):
    fall = Fall(np.array(changes), np.array(predicted), *periods)
    assert lyapunov.falls(fall).standing is falls
    assert lyapunov.follows(fall, 0.1).standing is follows


def decrease_of_a_sampled_loop(n):
    """Run S' = -alpha S + (d_hat - d)/M with n Euler steps a period and return the deviation from the identity."""
    step, periods, alpha, gamma, mass, s = 4.0 / n, 4, 0.4, 0.2, 90.0, 0.3
    d = 100 * np.sin(2 * np.pi * np.arange(n) / n) ** 3
    S, learned, before = np.zeros((periods, n + 1)), np.zeros((periods, n)), np.zeros(n)
    for j in range(periods):
        for k in range(n):
            S[j, k] = s
            learned[j, k] = before[k] - gamma * mass * s
            s += step * (-alpha * s + (learned[j, k] - d[k]) / mass)
        S[j, n] = s
        before = learned[j]
    got, predicted = lyapunov.decrease(S, np.tile(d, (periods, 1)), learned, step, alpha, gamma, mass)
    return got / predicted - 1


def test_the_decrease_of_a_sampled_loop_tends_to_that_of_the_identity():
    coarse, fine = decrease_of_a_sampled_loop(1000), decrease_of_a_sampled_loop(4000)
    assert np.abs(fine).max() < 5e-3
    np.testing.assert_allclose(fine / coarse, 0.25, atol=0.05)


def test_V_is_what_a_plain_sum_gives():
    done = short()
    one, train = done.data.sel(controller="palc"), STUDY.true_plant
    S, step = sliding(done, "palc"), 0.01
    d, d_hat = one["line_resistance"].values, one["law_line_resistance"].values
    V = []
    for j in range(3):
        stored = sum((d[j, k] - d_hat[j, k]) ** 2 for k in range(17800)) * step
        V.append(S[j, -1] ** 2 / 2 + stored / (2 * 0.2 * train.mass * train.mass))
    verdict = standing(done, "lyapunov_decrease", "palc")
    worst = verdict.witness["period"]
    assert verdict.witness["change_of_V"] == pytest.approx(V[worst - 1] - V[worst - 2], rel=1e-9)


def test_without_lag_the_factor_is_that_of_the_first_order_loop():
    w = np.logspace(-2, 2, 50)
    s = 1j * w
    np.testing.assert_allclose(period_contraction.factor(w, PLAIN), abs((s + 0.4) / (s + 0.6)), rtol=1e-6)
    assert (period_contraction.factor(w, PLAIN) < 1).all()
    filtered = PLAIN._replace(filtered=True)
    np.testing.assert_allclose(period_contraction.factor(w, filtered), abs((s + 0.2) / (s + 0.4)), rtol=1e-6)


def test_the_growth_of_a_known_oscillation_is_found():
    t = np.arange(17800) * 0.01
    w = 2 * np.pi * 33 / 178
    S = np.stack([1.3**j * np.sin(w * t) + np.cos(0.1 * t) for j in range(8)])
    assert period_contraction.observed(S, 178.0, w) == pytest.approx(1.3, rel=1e-9)
    assert np.isnan(period_contraction.observed(S[:2], 178.0, w))
    assert np.isnan(period_contraction.observed(np.tile(S[:1], (8, 1)), 178.0, w))


def radius(alpha, lam, k, mass, step):
    """Return the largest modulus of the sampled errors' eigenvalues, by another way: powers of the matrix."""
    by_speed, by_position = alpha + lam + k / mass, lam * (alpha + k / mass)
    half = step * step / 2
    held = np.array([[1 - half * by_position, step - half * by_speed], [-step * by_position, 1 - step * by_speed]])
    return float(np.abs(np.linalg.eigvals(held)).max())


@pytest.mark.parametrize(
    ("k", "step", "stands"),
    [(2e12, 1e-5, REFUTED), (2e12, 8e-8, PROVED), (1.8e4, 0.01, PROVED), (1.8e4, 2.44, REFUTED)],
)
def test_the_published_gain_needs_a_tiny_step(k, step, stands):
    found = period_contraction.sampled_gain(0.4, 0.22, k, 9e4, step)
    assert found.standing is stands
    assert (radius(0.4, 0.22, k, 9e4, step) < 1) is (stands is PROVED)


def test_the_largest_stable_step_is_where_the_radius_passes_one():
    rng = np.random.default_rng(5)
    for alpha, lam, learned in rng.uniform(0.05, 4, (50, 3)):
        largest = period_contraction.sampled_gain(alpha, lam, learned * 9e4, 9e4, 1e-6).bound
        for share, stands in ((1 - 1e-6, PROVED), (1 + 1e-6, REFUTED)):
            step = largest * share
            assert period_contraction.sampled_gain(alpha, lam, learned * 9e4, 9e4, step).standing is stands
            assert (radius(alpha, lam, learned * 9e4, 9e4, step) < 1) is (stands is PROVED)


def test_a_step_on_the_edge_is_not_stable_whatever_rounding_says():
    # 2/(alpha + lam + k/M) is a double here, and the margin exactly zero
    found = period_contraction.sampled_gain(0.5, 0.25, 0.25, 1.0, 2.0)
    assert found.margin == 0.0 and found.standing is REFUTED
    assert period_contraction.least_excess(0.5, 0.25, 0.25, 1.0, 2.0) == Fraction(0)


def test_grades_do_not_turn_with_the_train():
    train = Maglev()
    found = turns(train, 1580.0, 30.0)
    assert found.standing is REFUTED
    assert found.margin == pytest.approx(-2 * 90_000 * 9.81 * 0.03, rel=1e-8)
    assert turned(train, found.witness) == found.margin
    assert turned(train, {**found.witness, "x": 450.0}) > 0
