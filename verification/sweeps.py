"""Running a law with other parameters and seeing where it stops converging."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from workbench.campaign import Campaign
from workbench.compiled import compiled
from workbench.fold import stream


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


def sweep(campaign: Campaign, controller: str, field: str, values: Sequence[float]) -> Sweep:
    """Run a controller's campaign again for each value of one of its float fields, same trials otherwise."""
    study = campaign.study
    law = study.controllers[controller]
    fold = study.fold(controller)
    machine = compiled(fold.trial)
    inputs, reference = study.inputs(), study.reference_samples
    limit = (study.divergence_factor * float(np.abs(reference).max())) ** 2
    last, peak, first = [], [], np.nan
    for value in values:
        changed = fold.values_of(dataclasses.replace(law, **{field: float(value)}))
        mse: list[float] = []
        for left in stream(fold, reference, inputs, trial=machine, values=changed, carry_state=study.continues):
            mse.append(left.mse)
            if not mse[-1] <= limit:
                break
        first = mse[0]
        gone = not mse[-1] <= limit
        last.append(np.nan if gone else mse[-1])
        peak.append(np.inf if gone else max(mse))
    return Sweep(field, np.asarray(values, dtype=float), first, np.array(last), np.array(peak))


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
