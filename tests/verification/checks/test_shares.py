"""What so many draws say of all: bounds against sums of binomial chances, and claims about all that need enough."""

from __future__ import annotations

import math

import pytest

from models.quantity import InvalidValue
from verification.checks.shares import about_all, in_words, most_that_fail, tries_needed
from workbench.contracts.finding import Finding, Grounds, Standing


def chance_of_at_most(failed, tries, share):
    return sum(math.comb(tries, i) * share**i * (1 - share) ** (tries - i) for i in range(failed + 1))


@pytest.mark.parametrize(("failed", "tries"), [(0, 1), (0, 50), (3, 50), (43, 50), (0, 299), (12, 300)])
def test_a_share_above_the_bound_would_seldom_fail_so_rarely(failed, tries):
    bound = most_that_fail(failed, tries)
    assert chance_of_at_most(failed, tries, bound) == pytest.approx(0.05, rel=1e-6)


def test_needed_tries_are_the_fewest():
    needed = tries_needed()
    assert most_that_fail(0, needed) <= 0.01 < most_that_fail(0, needed - 1)
    assert most_that_fail(7, 7) == 1.0
    assert in_words(0, 3000, "draws fail") == "0 of 3000 draws fail: at most 0.0998 % at 95 % confidence"


@pytest.mark.parametrize(("failed", "tries"), [(-1, 3), (4, 3), (0, 0)])
def test_impossible_counts_are_refused(failed, tries):
    with pytest.raises(InvalidValue, match="failed must lie in"):
        most_that_fail(failed, tries)


def test_a_claim_about_all():
    few, enough, bad = (
        Finding(grounds=Grounds.TRIES, margin=margin, unit="cm", tries=tries, witness={"at": 1}, method="tried")
        for tries, margin in ((298, 2.0), (299, 2.0), (5, -1.0))
    )
    told = about_all(few)
    assert told.standing is Standing.UNDECIDED and told.margin == 2.0 and told.witness == {"tries": 298, "at": 1}
    assert "299 independent draws" in told.reason and told.reason.startswith("tried")
    assert about_all(enough) is enough and about_all(bad) is bad
