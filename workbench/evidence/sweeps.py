"""Running a law with other parameters and seeing where it stops converging."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.array import Array
from workbench.trials.campaign import Campaign
from workbench.trials.simulation import runner_of, swept


class Sweep(NamedTuple):
    """What became of a law for each value of a field."""

    field: str
    values: Array
    mse_first: float
    mse_last: Array
    """NaN where the law diverged."""
    mse_peak: Array
    """Largest MSE of the campaign, infinite where the law diverged."""

    @property
    def converges(self) -> NDArray[np.bool_]:
        """Whether the last MSE lies below the first, by value."""
        return np.asarray(np.nan_to_num(self.mse_last, nan=np.inf) < self.mse_first)


class Swept:
    """A controller's campaign, ready to be run with other values of its law's float fields."""

    def __init__(self, campaign: Campaign, controller: str) -> None:
        self.runner = runner_of(campaign.study, controller, campaign.tuned_laws()[controller])
        self.inputs = campaign.study.inputs()

    def mse(self, **fields: float) -> tuple[list[float], bool]:
        """Return the MSE by trial with some fields changed, and whether it diverged at the last of them."""
        mse, reason = swept(self.runner, self.inputs, fields)
        return mse, reason is not None


def sweep(campaign: Campaign, controller: str, field: str, values: Array) -> Sweep:
    """Run a controller's campaign again for each value of one of its float fields, same trials otherwise."""
    runner = Swept(campaign, controller)
    runs = [runner.mse(**{field: float(value)}) for value in values]
    last = [np.nan if gone else mse[-1] for mse, gone in runs]
    peak = [np.inf if gone else max(mse) for mse, gone in runs]
    return Sweep(field, np.asarray(values, dtype=float), runs[0][0][0], np.array(last), np.array(peak))


class Grid(NamedTuple):
    """What became of a CFDL law for each lambda (rows) and force unit (columns)."""

    lam: Array
    force_unit: Array
    mse_first: float
    mse_last: Array
    """NaN where the law diverged, (lambdas, units)."""


def grid(campaign: Campaign, controller: str, lam: Array, force_unit: Array) -> Grid:
    """Run a CFDL controller's campaign again for every pair of lambda and force unit, same trials otherwise."""
    runner = Swept(campaign, controller)
    last = np.full((len(lam), len(force_unit)), np.nan)
    first = np.nan
    for i, weight in enumerate(lam):
        for j, unit in enumerate(force_unit):
            mse, gone = runner.mse(lam=float(weight), force_unit=float(unit))
            first = mse[0]
            last[i, j] = np.nan if gone else mse[-1]
    return Grid(np.asarray(lam, dtype=float), np.asarray(force_unit, dtype=float), first, last)


def boundary(found: Sweep) -> float | None:
    """Return the smallest value from which on the law converges for every larger one tried, or None."""
    good = found.converges
    if not good[-1]:
        return None
    bad = np.flatnonzero(~good)
    return float(found.values[bad[-1] + 1 if bad.size else 0])


def around(middle: float, decades: float = 4.0, count: int = 25) -> Array:
    """Return ``count`` values spread over ``decades`` on each side of a positive number, evenly on a log scale."""
    return np.asarray(middle * np.logspace(-decades, decades, count))
