"""Indices of tracking a speed: error integrals, step response, comfort and energy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from workbench.contracts.number import finite
from workbench.contracts.study import Scores

BAND = 0.02
FOUR = ("ise", "iae", "itse", "itae")


def indices(r: Any, y: Any, sampling_time: float, kicks: Sequence[int] | None = None) -> dict[str, float]:
    """Return the indices of one run from reference and output, two arrays of shape (N,).

    Integrals are sums times the sampling time. ITSE and ITAE weigh the k-th sample, counted from 1 as the paper does,
    by k Ts: the first one by Ts and not by 0. ``kicks`` are the
    samples (from 1) at which a unit step's input is disturbed: rise (10-90 %), settling (2 %), peak and overshoot are
    taken before the first one, recovery (2 %) from the last one on; without kicks they are NaN, as is what the run
    does not reach. max_jerk is max |D2 y|/Ts^2, energy_index is the integral of |v a| over the distance.
    """
    e = r - y
    t = np.arange(1, len(e) + 1) * sampling_time
    speed_change = np.diff(y)
    distance = float(np.sum(y) * sampling_time)
    found = {
        "ise": float(np.sum(e**2) * sampling_time),
        "iae": float(np.sum(np.abs(e)) * sampling_time),
        "itse": float(np.sum(t * e**2) * sampling_time),
        "itae": float(np.sum(t * np.abs(e)) * sampling_time),
        "max_jerk": float(np.abs(np.diff(y, 2)).max() / sampling_time**2),
        "energy_index": float(np.sum(np.abs(y[1:] * speed_change)) / distance) if distance else np.nan,
    }
    return found | (_step(r, y, sampling_time, kicks) if kicks else dict.fromkeys(STEP, np.nan))


STEP = ("rise_time", "settling_time", "peak_time", "overshoot_percent", "recovery_time")


def _step(r: Any, y: Any, sampling_time: float, kicks: Sequence[int]) -> dict[str, float]:
    calm = y[: kicks[0] - 1]
    target = r[0]
    top = int(np.argmax(calm))
    return {
        "rise_time": (_reached(calm, 0.9 * target) - _reached(calm, 0.1 * target)) * sampling_time,
        "settling_time": _settled(calm - target, BAND * abs(target)) * sampling_time,
        "peak_time": top * sampling_time,
        "overshoot_percent": max(0.0, float(calm[top] / target - 1) * 100),
        "recovery_time": _settled(y[kicks[-1] - 1 :] - r[kicks[-1] - 1 :], BAND * abs(target)) * sampling_time,
    }


def _reached(y: Any, level: float) -> float:
    """Return the sample, interpolated, at which y first reaches a level; NaN if it never does."""
    above = np.flatnonzero(y >= level)
    if not above.size:
        return float("nan")
    at = int(above[0])
    return float(at) if at == 0 else at - float((y[at] - level) / (y[at] - y[at - 1]))


def _settled(deviation: Any, band: float) -> float:
    """Return the first sample from which the deviation stays in the band; NaN if it does not at the end."""
    outside = np.flatnonzero(np.abs(deviation) > band)
    if not outside.size:
        return 0.0
    return float(outside[-1] + 1) if outside[-1] + 1 < len(deviation) else float("nan")


METRICS = (*FOUR, *STEP, "max_jerk", "energy_index")


def median_scores(data: xr.Dataset, seeded: Sequence[str], against: str = "fipid") -> Scores:
    """Return every controller's metrics from the indices of its runs.

    Values are medians over the seeds; the ``seeded`` controllers also have METRIC_p10 and METRIC_p90.
    share_better_all_four is the share of seeds in which ISE, IAE, ITSE and ITAE all lie below those of ``against``.
    gain_max is the largest p1 - p2 f. A metric that does not exist in some run counts as infinite there.
    """
    scores: Scores = {}
    names = [str(name) for name in data["controller"].values]
    for name in names:
        one = data.sel(controller=name)
        metrics: dict[str, float | None] = {}
        for metric in METRICS:
            runs = np.nan_to_num(one[metric].values, nan=np.inf)
            metrics[metric] = _quantile(runs, 0.5)
            if name in seeded:
                metrics[f"{metric}_p10"], metrics[f"{metric}_p90"] = _quantile(runs, 0.1), _quantile(runs, 0.9)
        gain = (one["p1"] - one["p2"] * one["f"]).values
        metrics["gain_max"] = float(np.nanmax(gain)) if np.isfinite(gain).any() else None
        metrics["share_better_all_four"] = better_all_four(data, name, against) if against in names else None
        scores[name] = metrics
    return scores


def _quantile(values: Any, share: float) -> float | None:
    return finite(np.quantile(values, share, method="linear" if np.isfinite(values).all() else "higher"))


def better_all_four(data: xr.Dataset, controller: str, against: str) -> float:
    """Return the share of seeds in which a controller's four error integrals all lie below another's."""
    below = [data[index].sel(controller=controller) < data[index].sel(controller=against) for index in FOUR]
    return float(np.mean(np.all(below, axis=0)))
