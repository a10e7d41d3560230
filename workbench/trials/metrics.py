"""Metrics of a run, from its Dataset alone."""

from __future__ import annotations

import numpy as np
import xarray as xr

from models.array import Array
from models.errors import InvalidValue
from models.users_code import asking
from workbench.contracts.number import finite
from workbench.contracts.study import Scores, Study


def peak(values: Array) -> float | None:
    """Return the largest magnitude of what is not missing."""
    magnitudes = np.abs(values[~np.isnan(values)])
    return finite(magnitudes.max()) if magnitudes.size else None


def reached_inputs(data: xr.Dataset, controller: str) -> Array:
    """Return the inputs that were commanded, the plan beyond a trial's end being NaN; same shape as ``input``."""
    inputs = data["input"].sel(controller=controller)
    length = data["trial_length"]
    length = length.sel(controller=controller) if "controller" in length.dims else length
    within: Array = inputs.where(data["sample"] < length).transpose(*inputs.dims).values
    return within


def scores_of(study: Study, data: xr.Dataset) -> Scores:
    """Return the metrics of every controller: the common ones, and those of the study's own scorers."""
    merged = trial_scores(study, data)
    for scorer in study.scorers:
        with asking("a scorer of the study", scorer):
            for name, metrics in scorer(study, data).items():
                if name not in merged:
                    raise InvalidValue(f"metrics must be by controller, one of: {', '.join(merged)}; got {name!r}")
                merged[name].update({metric: finite(value) for metric, value in metrics.items()})
    return merged


def trial_scores(study: Study, data: xr.Dataset) -> Scores:
    """Return the common metrics, by controller.

    mse_trial_1, mse_trial_50, mse_trial_100, mse_last, mse_max: mean square errors; mse_always_reached_last: that
    of the last trial over samples 1..T_min; max_abs_error_last; diverged_at_trial (None if it did not). Of several
    outputs each has metrics of its own, mse_last_NAME and so on.
    """
    least = study.scenario.trial_length.least(study.horizon)
    several = "output_name" in data.dims
    outputs = [str(name) for name in data["output_name"].values] if several else [""]
    scores: Scores = {}
    for controller in data["controller"].values:
        one = data.sel(controller=controller)
        diverged = finite(one["diverged_at_trial"])
        metrics: dict[str, float | None] = {}
        for output in outputs:
            own = one.sel(output_name=output) if several else one
            found = _of_output(own["mse"].values, own["error"].values, least, diverged)
            metrics |= {f"{name}_{output}" if several else name: value for name, value in found.items()}
        metrics["diverged_at_trial"] = diverged
        scores[str(controller)] = metrics
    return scores


def _of_output(mse: Array, error: Array, least: int, diverged: float | None) -> dict[str, float | None]:
    metrics: dict[str, float | None] = {
        f"mse_trial_{i}": finite(mse[i - 1]) if mse.size >= i else None for i in (1, 50, 100)
    }
    return metrics | {
        "mse_last": finite(mse[-1]),
        "mse_always_reached_last": finite(np.mean(error[-1, 1 : least + 1] ** 2)),
        "mse_max": None if diverged or np.isnan(mse).any() else finite(mse.max()),
        "max_abs_error_last": peak(error[-1]),
    }
