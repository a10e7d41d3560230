"""What a run shows: laws that diverge, that do not learn, that learn; a law that fell is never said to end well."""

from __future__ import annotations

import numpy as np
import pytest

from models.plant import Plant, signals
from models.quantity import declared, quantity
from verification.decide.judge import Judge
from verification.decide.verify import verify
from verification.theorems.outcomes import _fallen, outcomes
from workbench import Study, run
from workbench.contracts.finding import Standing
from workbench.contracts.verdict import NotMade, Verdict
from workbench.controllers import ICFDL, PD
from workbench.controllers.pid import PID

SUPPORTED, REFUTED, UNDECIDED = Standing.SUPPORTED, Standing.REFUTED, Standing.UNDECIDED
RAMP = np.linspace(0.0, 1.0, 31) ** 2


@declared
class Cart(Plant):
    """A cart with friction."""

    source = "made for tests, 2026"
    states = outputs = signals(v="1")
    inputs = signals(u="1")
    sampling_time: float = quantity(default=1.0, unit="s", doc="sampling time", above=0)

    def step(self, x, u, w, k):
        return (0.5 * x.v + u.u,)

    def output(self, x):
        return (x.v,)


def campaign(law, **changes):
    fields = {"plant": Cart(), "reference": RAMP, "controllers": {"law": law}, "trials": 30, **changes}
    return run(Study(**fields), show_progress=False)


def found(done):
    verdicts = [Judge().verdict(one) for one in outcomes(done)]
    return {one.claim.split(".", 1)[1]: one for one in verdicts}


LAWS = {
    # law, does_not_diverge, error_falls
    "learns": (PD(kp=0.5, kd=0.0, initial_input=0.1), SUPPORTED, SUPPORTED),
    "hardly learns": (PD(kp=1e-9, kd=0.0, initial_input=0.1), SUPPORTED, SUPPORTED),
    "grows": (PD(kp=-0.02, kd=0.0, initial_input=0.1), SUPPORTED, REFUTED),
    "falls": (PD(kp=9.0, kd=0.0, initial_input=0.1), REFUTED, REFUTED),
}


@pytest.mark.parametrize("name", LAWS)
def test_what_is_said_of_a_law(name):
    law, runs, falls = LAWS[name]
    verdicts = found(campaign(law))
    assert verdicts["does_not_diverge"].standing is runs
    assert verdicts["error_falls"].standing is falls
    assert isinstance(verdicts["estimate_useful"], NotMade)


def test_a_law_that_fell_is_said_to_end_well_in_nothing():
    report = verify(campaign(LAWS["falls"][0]), show_progress=False)
    assert "law" in report.conclusion[0] and "diverged" in report.conclusion[0]
    for name in ("asymptotic", "monotone", "error_falls", "does_not_diverge"):
        (one,) = [v for v in report.verdicts if v.claim.endswith(name)]
        assert one.standing in (REFUTED, UNDECIDED), one


def test_laws_that_do_not_learn_or_estimate():
    verdicts = found(campaign(PID(kp=0.1, ki=0.1)))
    assert isinstance(verdicts["error_falls"], NotMade) and "learns_on" in verdicts["error_falls"].lacks
    assert isinstance(verdicts["estimate_useful"], NotMade) and "estimator" in verdicts["estimate_useful"].lacks
    assert isinstance(verdicts["does_not_diverge"], Verdict)


CURVES = {
    "falls at once, then wanders": (np.r_[100.0, np.random.default_rng(0).uniform(0.9, 1.1, 60)], SUPPORTED),
    "falls slowly": (np.linspace(2.0, 1.0, 8), SUPPORTED),
    "two trials only": (np.array([2.0, 1.0]), UNDECIDED),
    "chance": (np.random.default_rng(3).uniform(0.9, 1.1, 40), None),
    "rises": (np.linspace(1.0, 2.0, 20), REFUTED),
    "stands still": (np.ones(20), REFUTED),
    "no error at all": (np.zeros(20), SUPPORTED),
}


@pytest.mark.parametrize("name", CURVES)
def test_a_fall_is_told_from_chance(name):
    errors, standing = CURVES[name]
    finding = _fallen(errors)
    if standing is None:
        assert finding.standing is not SUPPORTED
    else:
        assert finding.standing is standing, finding


def test_chance_is_taken_for_a_fall_no_more_often_than_the_level_says():
    rng = np.random.default_rng(5)
    called = [_fallen(rng.uniform(0.5, 1.5, 30)).standing is SUPPORTED for _ in range(400)]
    assert np.mean(called) <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / 400)


def test_an_estimate_is_held_against_the_derivative():
    near = campaign(ICFDL(force_unit=1.0, lam=1.0, initial_input=0.1, phi0=0.2, mu=1e-9, eps=1e-9))
    verdict = found(near)["estimate_useful"]
    witness = verdict.witness
    assert witness["median_error_of_the_first_estimate"] == pytest.approx(0.8, rel=1e-9)  # df/du is 1, phi(k,1) 0.2
    assert verdict.margin == pytest.approx(0.8 - witness["median_error"], rel=1e-9)
    assert verdict.bound == witness["median_error"]
