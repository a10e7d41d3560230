"""Tuning: the budget is kept, the result is the best evaluation, and the same seed repeats it."""

from __future__ import annotations

import math

import pytest

from models.quantity import InvalidValue
from workbench.design.tuning import tune

RANGES = {"a": (1e-3, 1e3), "b": (0.1, 10.0)}
FIRST = {"a": 100.0, "b": 5.0}


def valley(settings):
    return math.log(settings["a"] / 0.5) ** 2 + 3 * math.log(settings["b"] / 2) ** 2


@pytest.mark.parametrize("budget", [1, 2, 3, 7, 60, 200])
def test_budget_and_best(budget):
    asked = []
    found = tune(lambda s: asked.append(dict(s)) or valley(s), RANGES, FIRST, budget, seed=3)
    assert len(asked) == budget == len(found.costs)
    assert asked[0] == FIRST
    assert found.cost == min(found.costs) == valley(found.settings)
    assert all(low <= s[name] <= high * (1 + 1e-12) for s in asked for name, (low, high) in RANGES.items())
    assert tune(valley, RANGES, FIRST, budget, seed=3) == found
    if budget >= 60:
        assert found.cost < 0.05
        assert tune(valley, RANGES, FIRST, budget, seed=4).settings != found.settings


def test_a_latin_hypercube_fills_every_stratum():
    asked = []
    tune(lambda s: asked.append(s["a"]) or 1.0, {"a": (1.0, math.exp(9.0))}, {"a": 1.0}, 20, seed=0)
    assert sorted(int(math.log(a)) for a in asked[1:10]) == list(range(9))


def test_costs_that_are_not_finite_lose():
    found = tune(lambda s: float("nan") if s["a"] > 1 else s["a"], {"a": (0.1, 10.0)}, {"a": 9.0}, 20, seed=1)
    assert found.cost <= 1 and math.inf in found.costs
    assert tune(lambda s: float("nan"), {"a": (0.1, 1.0)}, {"a": 0.5}, 4, seed=1).settings == {"a": 0.5}


def test_a_law_without_settings_is_evaluated_all_the_same():
    assert tune(lambda s: 2.0, {}, {}, 5, seed=0).costs == (2.0,) * 5


@pytest.mark.parametrize("bounds", [(0.0, 1.0), (2.0, 1.0), (-1.0, 1.0)])
def test_bad_ranges_are_refused(bounds):
    with pytest.raises(InvalidValue, match="range of a"):
        tune(lambda s: 0.0, {"a": bounds}, {"a": 0.5}, 3, seed=0)
    with pytest.raises(InvalidValue, match="budget"):
        tune(lambda s: 0.0, {"a": (0.1, 1.0)}, {"a": 0.5}, 0, seed=0)
