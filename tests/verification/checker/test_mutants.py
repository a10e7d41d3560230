"""Random changes of true certificates: each is rejected, or its sentence is seen to be true by an oracle."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from certificate_mutants import CLASSES, mutate, seeds, true
from falsehoods import of_curves
from forging import Forged, accepted

SEED = 16


def seen(kind: str, count: int) -> Counter[str]:
    """Look at so many mutants of a class; return how many were rejected, and how many are true."""
    rng, found = np.random.default_rng(SEED), Counter[str]()
    given = list(seeds(rng))
    while sum(found.values()) < count:
        one = given[rng.integers(len(given))]
        other = mutate(rng, one, kind)
        if other is None:
            continue
        if not accepted(other):
            found["rejected"] += 1
            continue
        found["accepted"] += 1
        assert true(rng, other), (kind, other.kind, told(other))
    return found


def told(one: Forged) -> object:
    return [(part.kind, part.statement, part.proof, part.graphs) for part in one.all()]


@pytest.mark.parametrize("kind", CLASSES)
def test_a_mutant_is_rejected_or_true(kind):
    found = seen(kind, 100)
    assert found["rejected"] > 10


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "count"), [(kind, 4000 if kind == "numbers" else 1200) for kind in CLASSES])
def test_ten_thousand_mutants_are_rejected_or_true(kind, count):
    found = seen(kind, count)
    print(kind, dict(found))
    assert sum(found.values()) == count


@pytest.mark.slow
def test_no_bound_beyond_the_best_is_accepted():
    found = list(of_curves(np.random.default_rng(SEED + 1), 1000))
    assert len(found) == 1000
    assert not [one.statement for one in found if accepted(one)]


def test_what_is_changed_was_true():
    rng = np.random.default_rng(SEED)
    for one in seeds(rng):
        assert accepted(one) and true(rng, one), told(one)
