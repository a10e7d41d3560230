"""What a campaign meets: drawn as it says, bounded as it says, the same in every trial where it says so."""

from __future__ import annotations

import numpy as np
import pytest

from models.metro_line import MetroLine
from models.point_mass import PointMass
from models.quantity import InvalidValue
from workbench.contracts.plainly import as_departure, as_disturbance, as_initial, as_noise, as_plan
from workbench.contracts.scenario import (
    AtRest,
    Between,
    ByTrial,
    From,
    GaussianByOutput,
    GivenDisturbance,
    GivenInitial,
    GivenNoise,
    NormalDisturbance,
    NormalNoise,
    Times,
    Undisturbed,
    UniformNoise,
)

ONE, TWO = PointMass(), MetroLine()
"""Plants with one output, and with two."""


@pytest.mark.parametrize(
    ("noise", "plant", "bound"),
    [
        (NormalNoise(), TWO, [0, 0]),
        (NormalNoise(sigma=0.5), TWO, [np.inf, np.inf]),
        (NormalNoise(sigma=0.5, output="speed"), TWO, [0, np.inf]),
        (NormalNoise(sigma=0.5, limit=0.7), ONE, [0.7]),
        (UniformNoise(largest=0.25), ONE, [0.25]),
        (UniformNoise(largest=0.25, output="position"), TWO, [0.25, 0]),
        (GaussianByOutput(sigmas=(0.0, 2.0)), TWO, [0, np.inf]),
        (GivenNoise(values=((0.0, -3.0, 1.0),)), ONE, [3.0]),
    ],
)
def test_noise_stays_in_its_bound_and_comes_near_it(noise, plant, bound):
    samples = 3 if isinstance(noise, GivenNoise) else 20_000
    drawn = noise.draw(plant, samples, np.random.default_rng(1))
    assert drawn.shape == (len(plant.outputs), samples)
    assert noise.bound(plant).tolist() == bound
    largest = np.abs(drawn).max(axis=1)
    for size, limit in zip(largest, bound, strict=True):
        assert size <= limit and (limit == 0 or size > (0.99 * limit if np.isfinite(limit) else 1.0))


@pytest.mark.parametrize(
    "noise", [NormalNoise(sigma=1.0), NormalNoise(sigma=1.0, limit=0.5), UniformNoise(largest=1.0)]
)
def test_noise_is_that_of_its_stream(noise):
    """A stream gives its own noise, and other noise the next time: every trial meets another."""
    one, again, other = (np.random.default_rng(seed) for seed in (1, 1, 2))
    first, second = noise.draw(ONE, 9, one), noise.draw(ONE, 9, one)
    assert np.array_equal(first, noise.draw(ONE, 9, again)) and not np.array_equal(first, second)
    assert not np.array_equal(first, noise.draw(ONE, 9, other))


def test_truncated_noise_is_normal_between_its_limits():
    drawn = NormalNoise(sigma=1.0, limit=1.0).draw(ONE, 50_000, np.random.default_rng(2))[0]
    from scipy.stats import kstest, truncnorm

    assert kstest(drawn, truncnorm(-1, 1).cdf).pvalue > 1e-3
    assert kstest(drawn, truncnorm(-1.1, 1.1).cdf).pvalue < 1e-6


def test_an_output_that_there_is_not_is_refused():
    with pytest.raises(InvalidValue, match=r"noise.output must be one of: speed; got 'position'"):
        NormalNoise(sigma=1.0, output="position").draw(ONE, 5, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("initial", "repeats"),
    [
        (AtRest(), True),
        (From(state=(1.0, 2.0)), True),
        (From(state=(1.0, 2.0), spread=(0.0, 0.0)), True),
        (From(state=(1.0, 2.0), spread=(0.1, 0.0)), False),
        (GivenInitial(states=((1.0, 2.0),) * 4), True),
        (GivenInitial(states=((1.0, 2.0), (1.0, 2.0), (1.0, 2.0), (1.0, 2.1))), False),
    ],
)
def test_starts_say_whether_they_repeat(initial, repeats):
    drawn = initial.draw(ONE, 4, np.random.default_rng(3))
    assert drawn.shape == (4, 2) and initial.repeats is repeats
    assert (drawn == drawn[0]).all() == repeats
    bound = initial.bound(ONE)
    assert bound.shape == (2, 2) and (bound[:, 0] <= drawn).all() and (drawn <= bound[:, 1]).all()
    assert (bound[:, 0] == bound[:, 1]).all() == repeats


def test_starts_come_near_their_bounds():
    initial = From(state=(1.0, 2.0), spread=(0.5, -3.0))
    drawn = initial.draw(ONE, 20_000, np.random.default_rng(6))
    assert initial.bound(ONE).tolist() == [[0.5, 1.5], [-1.0, 5.0]]
    assert np.allclose([drawn.min(axis=0), drawn.max(axis=0)], initial.bound(ONE).T, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize(
    ("departure", "ends", "repeats"),
    [
        (Times(factor=1.1), (1.1, 1.1), True),
        (Between(low=0.9, high=1.1), (0.9, 1.1), False),
        (Between(low=1.1, high=1.1), (1.1, 1.1), True),
        (ByTrial(factors=(1.0, 1.2, 0.7)), (0.7, 1.2), False),
    ],
)
def test_departures_stay_within_their_range(departure, ends, repeats):
    trials = 3 if isinstance(departure, ByTrial) else 1000
    drawn = departure.draw(trials, np.random.default_rng(4))
    assert departure.range == ends and departure.repeats is repeats
    assert drawn.shape == (trials,) and drawn.min() >= ends[0] and drawn.max() <= ends[1]


@pytest.mark.parametrize(
    ("disturbance", "repeats"),
    [
        (Undisturbed(), True),
        (GivenDisturbance(values=((1.0, 2.0, 3.0),)), True),
        (NormalDisturbance(sigmas=(0.0,)), True),
        (NormalDisturbance(sigmas=(1.0,)), False),
    ],
)
def test_disturbances_say_whether_they_repeat(disturbance, repeats):
    from models.maglev import Maglev

    rng = np.random.default_rng(5)
    first, second = (disturbance.draw(Maglev(), 3, rng) for _ in range(2))
    assert disturbance.repeats is repeats and np.array_equal(first, second) == repeats
    low, high = disturbance.bound(Maglev())[0]
    assert low <= first.min() and first.max() <= high


@pytest.mark.parametrize(
    ("made", "kind"),
    [
        (lambda: as_noise(0.1, ONE, 11), NormalNoise(sigma=0.1)),
        (lambda: as_noise([0.1, 0.2], TWO, 11), GaussianByOutput(sigmas=(0.1, 0.2))),
        (lambda: as_noise(np.ones((1, 11)), ONE, 11), GivenNoise(values=((1.0,) * 11,))),
        (lambda: as_noise(UniformNoise(largest=1.0), ONE, 11), UniformNoise(largest=1.0)),
        (lambda: as_initial([1, 2], ONE, 3), From(state=(1.0, 2.0))),
        (lambda: as_initial([[1, 2], [3, 4], [5, 6]], ONE, 3), GivenInitial(states=((1, 2), (3, 4), (5, 6)))),
        (lambda: as_departure("mass", 1.1), Times(factor=1.1)),
        (lambda: as_departure("mass", [1.1, 0.9]), ByTrial(factors=(1.1, 0.9))),
    ],
)
def test_what_is_given_plainly(made, kind):
    assert made() == kind


@pytest.mark.parametrize(
    ("made", "says"),
    [
        (lambda: as_noise(0.1, TWO, 11), "one standard deviation an output, as their units differ, got 0.1"),
        (lambda: as_noise([0.1, 0.2, 0.3], TWO, 11), r"got shape \(3,\)"),
        (lambda: as_noise("loud", ONE, 11), "got 'loud'"),
        (lambda: as_noise(np.nan, ONE, 11), "noise must be finite"),
        (lambda: as_disturbance(1.0, ONE, 10), r"one for each of the 0 disturbance\(s\) of pointmass.* got shape \(\)"),
        (lambda: as_initial(1.0, ONE, 3), r"one number for each of the 2 state\(s\)"),
        (lambda: as_departure("mass", "heavy"), r"truth.mass must be .* got 'heavy'"),
        (lambda: as_plan([1.0, 2.0], 1, 5), r"first_plan must be .* got shape \(2,\)"),
    ],
)
def test_what_cannot_be_meant_is_refused(made, says):
    with pytest.raises(InvalidValue, match=says) as caught:
        made()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("plain", "shape", "row"),
    [(3.0, (1, 5), [3.0] * 5), ([3.0, 4.0], (2, 5), [3.0] * 5), (np.arange(5), (1, 5), range(5))],
)
def test_plans_given_plainly(plain, shape, row):
    plan = as_plan(plain, *shape)
    assert plan.shape == shape and plan[0].tolist() == list(row)
