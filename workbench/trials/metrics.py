"""Metrics of a run, from its Dataset alone."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from workbench.contracts.number import finite
from workbench.contracts.study import Scores


def peak(values: Any) -> float | None:
    """Return the largest magnitude of what is not missing."""
    magnitudes = np.abs(values[~np.isnan(values)])
    return finite(magnitudes.max()) if magnitudes.size else None


def applied_inputs(data: xr.Dataset, controller: str) -> Any:
    """Return the inputs that were applied, shape (trial, sample): the plan beyond a trial's end is NaN."""
    inputs = data["input"].sel(controller=controller).values
    return np.where(data["sample"].values[None, :] < data["trial_length"].values[:, None], inputs, np.nan)


def acting_inputs(data: xr.Dataset) -> Any:
    """Return the first input as it acts behind the actuator, or the command where the plant has none; same shape."""
    acting = [name for name in data if str(name).startswith("applied_")]
    return data[acting[0] if acting else "input"].values


def trial_scores(study: Any, data: xr.Dataset) -> Scores:
    """Return the common metrics of a study made of trials, by controller.

    mse_trial_1, mse_trial_50, mse_trial_100, mse_last, mse_max: mean square errors; mse_always_reached_last: that
    of the last trial over samples 1..T_min; max_abs_error_last; diverged_at_trial (None if it did not).
    """
    least = study.trial_length.least(study.horizon)
    scores: Scores = {}
    for controller in data["controller"].values:
        one = data.sel(controller=controller)
        mse = one["mse"].values
        error = one["error"].values
        always = error[-1, 1 : least + 1]
        diverged = finite(one["diverged_at_trial"])
        metrics: dict[str, float | None] = {
            f"mse_trial_{i}": finite(mse[i - 1]) if mse.size >= i else None for i in (1, 50, 100)
        }
        metrics |= {
            "mse_last": finite(mse[-1]),
            "mse_always_reached_last": finite(np.mean(always**2)),
            "mse_max": None if diverged or np.isnan(mse).any() else finite(mse.max()),
            "max_abs_error_last": peak(error[-1]),
            "diverged_at_trial": diverged,
        }
        scores[str(controller)] = metrics
    return scores
