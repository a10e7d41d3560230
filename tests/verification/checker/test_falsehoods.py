"""A thousand falsehoods by construction, of every kind of certificate: none is accepted."""

from __future__ import annotations

import itertools
from collections import Counter

import numpy as np
import pytest
from falsehoods import FAMILIES, PIECES, rows, rows_of, theorems
from forging import Forged, accepted, shown, theorem
from learned_by_hand import LAWS, law
from small_funnels import funnel

from verification.checker.reading import Rejected

SEED = 16


def given(name: str, most: int) -> list[Forged]:
    family, count = FAMILIES[name]
    return list(itertools.islice(family(np.random.default_rng(SEED), count), most))


def why(one: Forged) -> str:
    try:
        return f"ACCEPTED {shown(one).sentence}"
    except Rejected as error:
        return str(error)


@pytest.mark.parametrize("name", FAMILIES)
def test_no_falsehood_is_accepted_of_the_first(name):
    for one in given(name, 40):
        assert not accepted(one), (one.statement, one.proof)


@pytest.mark.slow
def test_no_falsehood_is_accepted_of_all():
    total, malformed = 0, Counter[str]()
    for name, (_, count) in FAMILIES.items():
        found = given(name, 10**6)
        assert len(found) >= count
        total += len(found)
        for one in found:
            answer = why(one)
            assert not answer.startswith("ACCEPTED"), (name, one.statement, one.proof)
            malformed[name] += "malformed" in answer
    assert total >= 1000 and sum(malformed.values()) < total / 20, malformed
    assert PIECES > 1


def test_what_they_are_next_to_is_accepted():
    """A corpus of what is rejected for another reason would tell nothing."""
    rng = np.random.default_rng(SEED)
    for increment in (False, True):
        assert accepted(law(5, "", 0.5, increment=increment)), why(law(5, "", 0.5, increment=increment))
    base, at = rows_of(rng)
    sums = rows(base, at["samples"], at["weight"], *(float(at[name]) * (1 + 1e-12) for name in "rp"))
    assert accepted(sums), why(sums)
    assert accepted(funnel(rng))
    for name, premises in theorems(rng):
        assert accepted(theorem(name, **premises)), (name, why(theorem(name, **premises)))


@pytest.mark.parametrize("wrong", LAWS)
@pytest.mark.parametrize("n", [2, 3, 6])
def test_no_law_that_learns_otherwise_is_accepted(n, wrong):
    assert not accepted(law(n, wrong, 0.5)), why(law(n, wrong, 0.5))
