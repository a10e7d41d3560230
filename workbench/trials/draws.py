"""Repetitions of a campaign with other random parts: their metrics side by side, and what they have in common."""

from __future__ import annotations

import dataclasses

import numpy as np
import xarray as xr

from models.array import Array
from workbench.contracts.number import finite
from workbench.contracts.study import Progress, Scores, Study
from workbench.trials.metrics import scores_of
from workbench.trials.simulation import simulate

LOW, HIGH = 0.1, 0.9
SCORE = "score"
"""Axis along which the metrics of ``scores.json`` stand in ``draws.nc``."""


def draw_of(study: Study, draw: int) -> Study:
    """Return the campaign that is a draw of a study, counted from 0: that of the study's seed plus the draw."""
    return dataclasses.replace(study, seed=study.seed + draw, draws=1)


def draws(study: Study, first: xr.Dataset, progress: Progress) -> xr.Dataset:
    """Return the metrics of every draw, given the record of the first: ``mse`` and one row a metric of the scores."""
    scores, mse = [], []
    for draw in range(study.draws):
        one = draw_of(study, draw)
        data = first if draw == 0 else simulate(one, progress)
        scores.append(scores_of(one, data))
        mse.append(data["mse"].values)
    names = [str(name) for name in first["controller"].values]
    metrics = list(dict.fromkeys(metric for table in scores for row in table.values() for metric in row))
    values = np.array(
        [[[_number(table, name, metric) for metric in metrics] for table in scores] for name in names], dtype=float
    ).reshape(len(names), study.draws, len(metrics))
    dims = first["mse"].dims
    made = xr.Dataset(
        {
            "scores": (("controller", "draw", SCORE), values, {"units": "", "long_name": "metrics of every draw"}),
            "mse": ((dims[0], "draw", *dims[1:]), np.moveaxis(np.array(mse), 0, 1), first["mse"].attrs),
        },
        {
            "controller": first["controller"],
            "trial": first["trial"],
            "draw": ("draw", np.arange(1, study.draws + 1), {"units": "1", "long_name": "draw"}),
            "seed": ("draw", study.seed + np.arange(study.draws), {"units": "1", "long_name": "seed of the draw"}),
            SCORE: (SCORE, np.array(metrics, dtype=str), {"units": "", "long_name": "metric"}),
        },
    )
    return made


def _number(table: Scores, name: str, metric: str) -> float:
    value = table.get(name, {}).get(metric)
    return np.nan if value is None else value


def of_draws(drawn: xr.Dataset, controller: str, metric: str) -> Array:
    """Return a metric of a controller by draw, (draws,); NaN where it does not exist."""
    values: Array = drawn["scores"].sel({"controller": controller, SCORE: metric}).values
    return values


def over_draws(drawn: xr.Dataset) -> Scores:
    """Return the medians over the draws, and where draws differ METRIC_p10 and METRIC_p90.

    A metric that does not exist in some draw counts as infinite there.
    """
    found: Scores = {}
    for name in map(str, drawn["controller"].values):
        row: dict[str, float | None] = {}
        for metric in map(str, drawn[SCORE].values):
            values = np.nan_to_num(of_draws(drawn, name, metric), nan=np.inf)
            row[metric] = quantile(values, 0.5)
            if (values != values[0]).any():
                row[f"{metric}_p10"], row[f"{metric}_p90"] = quantile(values, LOW), quantile(values, HIGH)
        found[name] = row
    return found


def quantile(values: Array, share: float) -> float | None:
    """Return a quantile of values of which some may be infinite; None for one that is."""
    return finite(np.quantile(values, share, method="linear" if np.isfinite(values).all() else "higher"))
