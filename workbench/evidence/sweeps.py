"""Running a law with other parameters and seeing where it stops converging."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from workbench.fold.fold import stream
from workbench.fold.machine_code import compiled
from workbench.trials.campaign import Campaign


class Sweep(NamedTuple):
    """What became of a law for each value of a field."""

    field: str
    values: Any
    mse_first: float
    mse_last: Any
    """NaN where the law diverged."""
    mse_peak: Any
    """Largest MSE of the campaign, infinite where the law diverged."""

    @property
    def converges(self) -> Any:
        """Whether the last MSE lies below the first, by value."""
        return np.nan_to_num(self.mse_last, nan=np.inf) < self.mse_first


class Runner:
    """A controller's campaign, ready to be run with other values of its law's float fields."""

    def __init__(self, campaign: Campaign, controller: str) -> None:
        self.study = campaign.study
        self.law = self.study.controllers[controller]
        self.fold = self.study.fold(controller)
        self.machine = compiled(self.fold.trial)
        self.inputs, self.reference = self.study.inputs(), self.study.reference_samples
        self.limit = (self.study.divergence_factor * float(np.abs(self.reference).max())) ** 2

    def mse(self, **fields: float) -> list[float]:
        """Return the MSE by trial with some fields changed, up to the trial at which it diverges."""
        values = self.fold.values_of(dataclasses.replace(self.law, **fields))
        mse: list[float] = []
        for left in stream(
            self.fold,
            self.reference,
            self.inputs,
            trial=self.machine,
            values=values,
            carry_state=self.study.continues,
        ):
            mse.append(left.mse)
            if self.gone(mse):
                break
        return mse

    def gone(self, mse: list[float]) -> bool:
        """Tell whether the last of these trials diverged."""
        return not mse[-1] <= self.limit


def sweep(campaign: Campaign, controller: str, field: str, values: Sequence[float]) -> Sweep:
    """Run a controller's campaign again for each value of one of its float fields, same trials otherwise."""
    runner = Runner(campaign, controller)
    runs = [runner.mse(**{field: float(value)}) for value in values]
    last = [np.nan if runner.gone(mse) else mse[-1] for mse in runs]
    peak = [np.inf if runner.gone(mse) else max(mse) for mse in runs]
    return Sweep(field, np.asarray(values, dtype=float), runs[0][0], np.array(last), np.array(peak))


class Grid(NamedTuple):
    """What became of a CFDL law for each lambda (rows) and force unit (columns)."""

    lam: Any
    force_unit: Any
    mse_first: float
    mse_last: Any
    """NaN where the law diverged, (lambdas, units)."""


def grid(campaign: Campaign, controller: str, lam: Sequence[float], force_unit: Sequence[float]) -> Grid:
    """Run a CFDL controller's campaign again for every pair of lambda and force unit, same trials otherwise."""
    runner = Runner(campaign, controller)
    last = np.full((len(lam), len(force_unit)), np.nan)
    first = np.nan
    for i, weight in enumerate(lam):
        for j, unit in enumerate(force_unit):
            mse = runner.mse(lam=float(weight), force_unit=float(unit))
            first = mse[0]
            last[i, j] = np.nan if runner.gone(mse) else mse[-1]
    return Grid(np.asarray(lam, dtype=float), np.asarray(force_unit, dtype=float), first, last)


def boundary(found: Sweep) -> float | None:
    """Return the smallest value from which on the law converges for every larger one tried, or None."""
    good = found.converges
    if not good[-1]:
        return None
    bad = np.flatnonzero(~good)
    return float(found.values[bad[-1] + 1 if bad.size else 0])


def around(middle: float, decades: float = 4.0, count: int = 25) -> Any:
    """Return ``count`` values spread over ``decades`` on each side of a positive number, evenly on a log scale."""
    return middle * np.logspace(-decades, decades, count)
