"""Refutations are looked at on another run of the campaign: of claims, and of what is a premise of others alone."""

from __future__ import annotations

import numpy as np
import pytest
from small_plants import small

from models.quantity import InvalidValue
from verification.decide.judge import Judge
from verification.decide.verify import AnotherRun, examination_of
from workbench import Study, run
from workbench.contracts.claim import Claim
from workbench.contracts.finding import Finding, Grounds, Standing
from workbench.contracts.verdict import Verdict
from workbench.controllers import ICFDL
from workbench.trials.campaign import Campaign

N = 12


@pytest.fixture(scope="module")
def fell() -> Campaign:
    """A campaign whose law fell, so that the premise that it ran to the end is refuted by a run."""
    study = Study(
        name="small",
        plant=small("Rising", lambda x, u, k: (1.8 * x[0] + 0.5 * u,)),
        reference=np.sin(np.linspace(0, 2, N + 1)),
        controllers={"law": ICFDL(force_unit=1.0, rho=0.5, lam=1.0, mu=1.0, initial_input=0.0)},
        trials=6,
        divergence_factor=23.0,
    )
    return run(study, show_progress=False)


def test_a_premise_is_looked_at_on_another_run(fell: Campaign) -> None:
    judge, again = Judge(again=AnotherRun(fell, False)), AnotherRun(fell, False)
    claims = {one.name: one for one in examination_of(fell).claims}
    found = judge.verdict(claims["small.asymptotic"])
    assert isinstance(found, Verdict) and found.standing is Standing.UNDECIDED
    assert found.method.startswith("the theorem does not apply: ") and "trials ran" in found.method
    for one in claims.values():
        for premise in (*one.premises, *one.rests_on):
            assert again(premise).standing is premise.check().standing


def test_a_claim_that_the_other_run_does_not_make_is_told_in_one_line(fell: Campaign) -> None:
    stray = Claim(
        name="small.stray",
        statement="It is made nowhere else.",
        source="ours",
        controller="law",
        check=lambda: Finding(grounds=Grounds.RUN, margin=-float(N), witness={"trial": 1}),
    )
    with pytest.raises(InvalidValue, match="no claim of another run of the campaign: give it a replay of its own"):
        AnotherRun(fell, False)(stray)
    found = Judge(again=AnotherRun(fell, False)).verdict(stray)
    assert found.standing is Standing.UNDECIDED and "give it a replay of its own" in found.method
