"""Indices of tracking a speed: error integrals, step response, comfort and energy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from models.array import Array
from workbench.contracts.number import finite
from workbench.contracts.study import Scores, Study
from workbench.trials.draws import SCORE, of_draws

BAND = 0.02
FOUR = ("ise", "iae", "itse", "itae")
AGAINST = "fipid"
"""The controller that the others are held against."""
METRICS = {
    "ise": "(m/s)^2 s",
    "iae": "m",
    "itse": "(m/s)^2 s^2",
    "itae": "m s",
    "rise_time": "s",
    "settling_time": "s",
    "peak_time": "s",
    "overshoot_percent": "%",
    "recovery_time": "s",
    "max_jerk": "m/s^3",
    "energy_index": "m/s^2",
}
"""Units of the indices, by name."""


def indices(r: Array, y: Array, sampling_time: float, kicks: Sequence[int] | None = None) -> dict[str, float]:
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
        "max_jerk": float(jerks(y, sampling_time).max()),
        "energy_index": float(np.sum(np.abs(y[1:] * speed_change)) / distance) if distance else np.nan,
    }
    return found | (_step(r, y, sampling_time, kicks) if kicks else dict.fromkeys(STEP, np.nan))


STEP = ("rise_time", "settling_time", "peak_time", "overshoot_percent", "recovery_time")


def jerks(y: Array, sampling_time: float) -> Array:
    """Return the magnitude of the jerk at samples 1..N-2 of a speed, (N,)."""
    found: Array = np.abs(np.diff(y, 2)) / sampling_time**2
    return found


def _step(r: Array, y: Array, sampling_time: float, kicks: Sequence[int]) -> dict[str, float]:
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


def _reached(y: Array, level: float) -> float:
    """Return the sample, interpolated, at which y first reaches a level; NaN if it never does."""
    above = np.flatnonzero(y >= level)
    if not above.size:
        return float("nan")
    at = int(above[0])
    return float(at) if at == 0 else at - float((y[at] - level) / (y[at] - y[at - 1]))


def _settled(deviation: Array, band: float) -> float:
    """Return the first sample from which the deviation stays in the band; NaN if it does not at the end."""
    outside = np.flatnonzero(np.abs(deviation) > band)
    if not outside.size:
        return 0.0
    return float(outside[-1] + 1) if outside[-1] + 1 < len(deviation) else float("nan")


def _last(data: xr.Dataset, variable: str, controller: str) -> Array:
    values: Array = data[variable].sel(controller=controller).values[-1]
    return values


def gains(data: xr.Dataset, controller: str) -> Array:
    """Return the gain p1 - p2 f at every sample of a controller's last trial, (N + 1,); NaN where it has none."""
    if "p1" not in data:
        return np.full(data.sizes["sample"], np.nan)
    p1, p2, f = (_last(data, name, controller) for name in ("p1", "p2", "f"))
    return p1 - p2 * f


def slopes(data: xr.Dataset, controller: str) -> tuple[Array, Array]:
    """Return the changes of output and input from sample to sample of a controller's last trial, (N - 1,) each."""
    dy: Array = np.diff(_last(data, "output", controller)[:-1])
    du: Array = np.diff(_last(data, "input", controller)[:-1])
    return dy, du


def scores(study: Study, data: xr.Dataset) -> Scores:
    """Return every controller's metrics of the last trial.

    The indices; gain_max, the largest p1 - p2 f; share_better_all_four, 1 where ISE, IAE, ITSE and ITAE all lie below
    those of fipid, else 0; wrong_sign_share, the share of samples at which output and input change in opposite
    directions. None where a metric does not exist.
    """
    names = [str(name) for name in data["controller"].values]
    last = {metric: data[metric].values[:, -1] for metric in METRICS}
    table: Scores = {}
    for at, name in enumerate(names):
        row = {metric: finite(values[at]) for metric, values in last.items()}
        gain = gains(data, name)
        row["gain_max"] = finite(np.nanmax(gain)) if np.isfinite(gain).any() else None
        dy, du = slopes(data, name)
        row["wrong_sign_share"] = float(np.mean(np.sign(dy * du) < 0))
        row["share_better_all_four"] = None
        if AGAINST in names:
            base = names.index(AGAINST)
            row["share_better_all_four"] = float(all(last[index][at] < last[index][base] for index in FOUR))
        table[name] = row
    return table


def share_over_draws(study: Study, drawn: xr.Dataset) -> Scores:
    """Return what a median over draws does not say: the share that is better on all four, and the largest gain."""
    table: Scores = {}
    for name in map(str, drawn["controller"].values):
        row: dict[str, float | None] = {}
        if "share_better_all_four" in drawn[SCORE].values:
            better = of_draws(drawn, name, "share_better_all_four")
            row["share_better_all_four"] = finite(better.mean())
        largest = of_draws(drawn, name, "gain_max")
        row["gain_max"] = finite(np.nanmax(largest)) if np.isfinite(largest).any() else None
        table[name] = row
    return table


def better_all_four(drawn: xr.Dataset, controller: str, against: str) -> float:
    """Return the share of draws in which a controller's four error integrals all lie below another's."""
    below = [of_draws(drawn, controller, index) < of_draws(drawn, against, index) for index in FOUR]
    return float(np.mean(np.all(below, axis=0)))
