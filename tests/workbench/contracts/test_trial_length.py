"""Trial lengths against their distribution."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from models.metro_profile import MetroProfile
from models.point_mass import PointMass
from models.quantity import InvalidValue
from workbench.contracts.study import Study
from workbench.contracts.trial_length import TrialLength, as_trial_length
from workbench.controllers import PD

TABLE = (0.1, 0.0, 0.6, 0.3)


@pytest.mark.parametrize(
    ("law", "horizon", "first", "probabilities"),
    [
        (TrialLength(), 2000, 1901, [0.01] * 100),
        (TrialLength(), 20_000, 19_001, [0.001] * 1000),
        (TrialLength(minimum=1990), 2000, 1991, [0.1] * 10),
        (TrialLength(law="fixed"), 2000, 2000, [1.0]),
        (TrialLength(law="table", probabilities=TABLE), 2000, 1997, TABLE),
        (TrialLength(law="table", probabilities=TABLE, minimum=100), 2000, 101, TABLE),
    ],
)
def test_draws_follow_the_distribution(law, horizon, first, probabilities):
    lengths, mass = law.distribution(horizon)
    np.testing.assert_array_equal(lengths, first + np.arange(len(probabilities)))
    np.testing.assert_allclose(mass, probabilities)
    drawn = law.draw(horizon, 20_000, np.random.default_rng(5))
    assert drawn.dtype == np.int64
    counts = np.array([(drawn == length).sum() for length in lengths])
    assert counts.sum() == drawn.size
    expected = np.array(probabilities) * drawn.size
    assert (counts[expected == 0] == 0).all()
    if (expected > 0).sum() > 1:
        assert stats.chisquare(counts[expected > 0], expected[expected > 0]).pvalue > 1e-3
    reached = law.reach_probability(horizon)
    assert reached.shape == (horizon + 1,)
    np.testing.assert_allclose(reached[: first + 1], 1.0)
    for k in (first, first + 1, horizon):
        if k <= horizon:
            assert reached[k] == pytest.approx((drawn >= k).mean(), abs=0.02)


def test_a_wrong_distribution_would_be_seen():
    drawn = TrialLength(minimum=1990).draw(2000, 20_000, np.random.default_rng(5))
    counts = np.bincount(drawn - 1991, minlength=10)
    skewed = np.linspace(0.8, 1.2, 10) * drawn.size / 10
    assert stats.chisquare(counts, skewed).pvalue < 1e-6


def test_lengths_come_from_the_seed():
    def lengths(seed, **others):
        study = Study(
            plant=PointMass(),
            reference=MetroProfile(),
            controllers={"pd": PD()},
            trial_length=TrialLength(),
            seed=seed,
            **others,
        )
        return [one.length for one in study.inputs()]

    assert lengths(3) == lengths(3)
    assert lengths(3) != lengths(4)
    assert lengths(3, trials=40) == lengths(3)[:40]
    assert 1901 <= min(lengths(3)) and max(lengths(3)) <= 2000


@pytest.mark.parametrize(
    ("fields", "horizon", "message"),
    [
        ({"law": "table"}, 2000, "probabilities must be given for law table"),
        ({"probabilities": (0.5, 0.5)}, 2000, "probabilities belong to law table, got law uniform"),
        ({"law": "table", "probabilities": (0.5, 0.6)}, 2000, "must add up to 1, got 1.1"),
        ({"law": "table", "probabilities": (1.5, -0.5)}, 2000, "none negative"),
        ({"law": "table", "probabilities": ()}, 2000, "at least one number"),
        ({"law": "table", "probabilities": 3}, 2000, "row of numbers"),
        ({"maximum": 1800, "minimum": 1900}, 2000, "maximum must lie above the minimum of 1900, got 1800"),
        ({"law": "fixed", "maximum": 1800}, 2000, "maximum belongs to law uniform, got law fixed"),
        ({"length": 1800}, 2000, "length belongs to law fixed, got law uniform"),
        ({"law": "given"}, 2000, "lengths must be given for law given"),
        ({"law": "given", "lengths": (3, 0)}, 2000, "lengths must be 1 sample or more, got 0"),
        ({"minimum": 2000}, 2000, r"must lie in \[1, 1999\], below the horizon of 2000 samples, got 2000"),
        ({"minimum": 0}, 2000, r"minimum must lie in \[1, ∞\)"),
        ({"law": "normal"}, 2000, r"law must be one of uniform \| fixed \| table \| given, got 'normal'"),
    ],
)
def test_bad_lengths_are_refused(fields, horizon, message):
    with pytest.raises(InvalidValue, match=message):
        TrialLength(**fields).least(horizon)


@pytest.mark.parametrize(
    ("law", "horizon"),
    [
        (TrialLength(minimum=1900, maximum=2100), 2000),
        (TrialLength(law="table", probabilities=TABLE, minimum=1998), 2000),
        (TrialLength(law="table", probabilities=TABLE, minimum=1999), 2000),
    ],
)
def test_what_lasts_longer_than_the_horizon_counts_as_the_horizon(law, horizon):
    lengths, mass = law.distribution(horizon)
    whole = law.distribution(10 * horizon)
    expected = {}
    for length, probability in zip(*whole, strict=True):
        expected[min(int(length), horizon)] = expected.get(min(int(length), horizon), 0.0) + probability
    assert dict(zip(lengths.tolist(), mass, strict=True)) == pytest.approx(expected)
    drawn = law.draw(horizon, 20_000, np.random.default_rng(5))
    assert drawn.max() == horizon and (drawn == horizon).mean() == pytest.approx(expected[horizon], abs=0.02)
    assert law.reach_probability(horizon)[horizon] == pytest.approx(expected[horizon])


@pytest.mark.parametrize(
    ("plain", "lengths"), [(40, [40] * 3), ([10, 20, 30], [10, 20, 30]), ([10, 20, 300], [10, 20, 50])]
)
def test_lengths_may_be_given_plainly(plain, lengths):
    law = as_trial_length(plain, 3)
    assert law.draw(50, 3, np.random.default_rng(0)).tolist() == lengths and law.varies
    assert law.least(50) == min(lengths)
    mass = dict(zip(*(one.tolist() for one in law.distribution(50)), strict=True))
    assert mass == pytest.approx({length: lengths.count(length) / 3 for length in lengths})


@pytest.mark.parametrize("plain", ["fixed", [1, 2], 0, 2.5, [[1, 2, 3]], None, [1, 2, "x"]])
def test_what_is_no_length_is_refused(plain):
    with pytest.raises(InvalidValue, match="trial_length must be a TrialLength, a whole number of samples, or 3 of"):
        as_trial_length(plain, 3)
