"""The maglev study's claims: their standings at the defaults, and that every check can say the opposite."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from models.maglev import Maglev
from studies.maglev import lyapunov, period_contraction
from studies.maglev.period_contraction import Loop
from studies.maglev.reversal import turns
from studies.maglev.study import STUDY
from verification.decide.verify import examination_of, judge, verify
from workbench.contracts import settings
from workbench.trials.campaign import run

DEFAULTS = {
    ("periodicity", "pid"): "SUPPORTED",
    ("periodicity", "palc"): "SUPPORTED",
    ("lyapunov_identity", "palc"): "PROVED",
    ("lyapunov_printed", "palc"): "REFUTED",
    ("lyapunov_decrease", "palc"): "SUPPORTED",
    ("positivity", "palc"): "PROVED",
    ("positivity", "palc-filtered"): "PROVED",
    ("period_contraction", "palc"): "SUPPORTED",
    ("period_contraction", "palc-filtered"): "SUPPORTED",
    ("period_contraction_lagging", "palc"): "REFUTED",
    ("period_contraction_lagging", "palc-filtered"): "SUPPORTED",
    ("saturation_windup", "palc"): "REFUTED",
    ("saturation_windup", "palc-filtered"): "SUPPORTED",
    ("gain_as_published", None): "REFUTED",
    ("reversal", None): "REFUTED",
    ("noise_claim", None): "REFUTED",
}
PLAIN = Loop(0.4, 0.22, 0.2, 0.0, 0.0, 1e-9, False, None, 0.0)


def campaign(*assignments, case="", only=()):
    study = settings.assigned(settings.in_case(STUDY, case), assignments)
    if only:
        study = dataclasses.replace(study, controllers={name: study.controllers[name] for name in only})
    return run(study, show_progress=False)


def standing(done, name, controller):
    claims = examination_of(done).claims
    chosen = [claim for claim in claims if claim.name == f"maglev.{name}" and claim.controller == controller]
    assert len(chosen) == 1
    return judge(chosen[0])


@pytest.mark.slow
def test_every_claim_stands_as_known_at_the_defaults():
    report = verify(campaign(), show_progress=False)
    found = {(one.claim.removeprefix("maglev."), one.controller): str(one.standing) for one in report.verdicts}
    assert {key: found.get(key) for key in DEFAULTS} == DEFAULTS
    assert len(report.conclusion) == 5 and len(report.tables[0].rows) == 8
    lagging = next(one for one in report.verdicts if one.claim.endswith("lagging") and one.controller == "palc")
    assert lagging.witness is not None
    assert lagging.witness["observed"] == pytest.approx(lagging.witness["predicted"], rel=0.02)


def test_checks_can_say_the_opposite():
    lagging = campaign(case="lagging", only=["palc"])
    for name in ("periodicity", "period_contraction", "lyapunov_decrease"):
        assert str(standing(lagging, name, "palc").standing) == "REFUTED", name
    short = campaign("trials=2", only=["palc"])
    assert str(standing(short, "period_contraction", "palc").standing) == "UNDECIDED"
    one = campaign("trials=1", only=["palc"])
    assert str(standing(one, "periodicity", "palc").standing) == "UNDECIDED"
    assert str(standing(one, "lyapunov_decrease", "palc").standing) == "UNDECIDED"


def test_a_flat_line_turns_with_the_train_and_noise_can_help_where_nothing_is_learned():
    flat = campaign("trials=2", case="flat", only=["palc"])
    assert str(standing(flat, "reversal", None).standing) == "SUPPORTED"
    single = campaign("trials=1", "seed=3", only=["palc"])
    verdict = standing(single, "noise_claim", None)
    assert (str(verdict.standing) == "SUPPORTED") is (verdict.witness["with_noise"] <= verdict.witness["without_noise"])


def test_only_the_exact_factor_is_an_identity():
    assert str(lyapunov.identity(0.4, 0.2).standing) == "PROVED"
    for wrong in (0.0, 0.25, 1.0):
        found = lyapunov.identity(0.4, 0.2, wrong)
        assert str(found.standing) == "REFUTED" and found.witness["gap"] != 0


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


@pytest.mark.parametrize(
    ("k", "step", "stands"), [(2e12, 1e-5, "REFUTED"), (2e12, 8e-8, "PROVED"), (1.8e4, 0.01, "PROVED")]
)
def test_the_published_gain_needs_a_tiny_step(k, step, stands):
    found = period_contraction.sampled_gain(0.4, k, 9e4, step)
    assert str(found.standing) == stands
    assert (abs(found.witness["pole"]) < 1) is (stands == "PROVED")


def test_grades_do_not_turn_with_the_train():
    found = turns(Maglev(), 1580.0, 30.0)
    assert str(found.standing) == "REFUTED"
    assert found.margin == pytest.approx(-2 * 90_000 * 9.81 * 0.03, rel=1e-9)
