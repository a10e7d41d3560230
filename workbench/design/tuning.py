"""One way to tune any law: a fixed number of trials of its settings, half spread out, half near the best so far."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from models.array import Array
from models.quantity import InvalidValue

PROCEDURE = (
    "Every law gets the same number of evaluations: its defaults first, then a Latin hypercube over the logarithms "
    "of its ranges until half of them are spent, then Gaussian steps round the best "
    "point so far, whose width shrinks from a fifth to a hundredth of the range. The best evaluation wins."
)
WIDEST, NARROWEST = 0.2, 0.01


class Found(NamedTuple):
    """The best settings found, what they cost, and what every evaluation cost, in order."""

    settings: dict[str, float]
    cost: float
    costs: tuple[float, ...]


def tune(
    cost: Callable[[Mapping[str, float]], float],
    ranges: Mapping[str, tuple[float, float]],
    first: Mapping[str, float],
    budget: int,
    seed: int,
) -> Found:
    """Minimise a cost over positive settings with exactly ``budget`` evaluations, or one where there is no setting.

    ``ranges`` are (low, high) by name, both above 0; ``first`` is evaluated first, also where it lies outside. A cost
    that is not finite counts as infinite. The same seed gives the same result. Raises InvalidValue for ranges that are
    not 0 < low < high.
    """
    if budget < 1:
        raise InvalidValue(f"budget must be at least 1, got {budget}")
    for name, (a, b) in ranges.items():
        if not 0 < a < b:
            raise InvalidValue(f"the range of {name} must satisfy 0 < low < high, got ({a}, {b})")
    names = list(ranges)
    if not names:
        alone = _finite(cost({}))
        return Found({}, alone, (alone,) * budget)
    low, width = _box(ranges)
    spread = max(budget // 2 - 1, 0)
    rng = np.random.default_rng(seed)
    points = _latin(len(names), spread, rng) if spread else np.zeros((0, len(names)))
    best, least, costs = dict(first), _finite(cost(first)), []
    costs.append(least)
    inside = [min(max(first[name], ranges[name][0]), ranges[name][1]) for name in names]
    centre = (np.log(inside) - low) / width
    for done in range(1, budget):
        at: Array
        if done <= spread:
            at = points[done - 1]
        else:
            left = (done - spread) / max(budget - spread, 1)
            step = WIDEST * (NARROWEST / WIDEST) ** left
            at = np.clip(centre + rng.normal(0.0, step, len(names)), 0.0, 1.0)
        tried = dict(zip(names, (float(value) for value in np.exp(low + width * at)), strict=True))
        costs.append(_finite(cost(tried)))
        if costs[-1] < least:
            best, least, centre = tried, costs[-1], at
    return Found(best, least, tuple(costs))


def _box(ranges: Mapping[str, tuple[float, float]]) -> tuple[Array, Array]:
    logs = np.log(np.array(list(ranges.values()), dtype=float).reshape(-1, 2))
    return logs[:, 0], logs[:, 1] - logs[:, 0]


def _latin(dimensions: int, points: int, rng: np.random.Generator) -> Array:
    """Return a Latin hypercube, (points, dimensions), in [0, 1]: every coordinate has one point in each stratum."""
    strata = np.stack([rng.permutation(points) for _ in range(dimensions)], axis=-1)
    cells: Array = (strata + rng.random((points, dimensions))) / points
    return cells


def _finite(value: float) -> float:
    return float(value) if np.isfinite(value) else float("inf")
