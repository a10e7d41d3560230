"""The record of a stopping study: its Dataset and its metrics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from studies.stopping.run import Stop
from workbench.contracts.number import finite
from workbench.contracts.study import Scores

UPDATE = 1e-6
"""|du| above which a sample counts as an update of the command."""
SWITCH = 1e-3
"""|du| above which it counts as a switch of the brake."""

ROWS = {
    "speed": ("m/s", "speed"),
    "position": ("m", "position"),
    "command": ("1", "brake command"),
    "increment": ("1", "increment of the brake command"),
    "acceleration": ("m/s^2", "acceleration by the brake"),
    "hold": ("samples", "planned hold M"),
    "cost": ("1", "cost J of the plan"),
    "qps": ("1", "quadratic programs solved"),
    "infeasible": ("1", "1 where no plan could be made and the last safe one is held"),
    "peak_jerk": ("m/s^3", "largest jerk of the brake during the sample"),
}


def dataset(study: Any, stops: Mapping[str, Stop]) -> xr.Dataset:
    """Return runs as a Dataset with dims controller and sample; samples after a stop are missing."""
    names = list(stops)
    longest = max(len(stop.rows["speed"]) for stop in stops.values())
    k = np.arange(longest)
    t = k * study.brake.sampling_time
    v, s = study.curve.at(t)
    data = xr.Dataset(coords={"controller": names, "sample": k})
    data["sample"].attrs = {"units": "1", "long_name": "sample k"}
    data["time"] = ("sample", t, {"units": "s", "long_name": "time"})
    data["reference_speed"] = ("sample", v, {"units": "m/s", "long_name": "reference speed"})
    data["reference_position"] = ("sample", s, {"units": "m", "long_name": "reference position"})
    for row, (unit, label) in ROWS.items():
        values = np.full((len(names), longest), np.nan)
        for index, stop in enumerate(stops.values()):
            values[index, : len(stop.rows[row])] = stop.rows[row]
        data[row] = (("controller", "sample"), values, {"units": unit, "long_name": label})
    data["speed_error"] = data["speed"] - data["reference_speed"]
    data["speed_error"].attrs = {"units": "m/s", "long_name": "speed error"}
    data["bound_excess"] = (("controller", "sample"), bound_excess(study, data))
    data["bound_excess"].attrs = {
        "units": "1",
        "long_name": "largest excess of the predicted error over the tightened bounds X_z, each in its own unit",
    }
    data["stop_position"] = ("controller", [stop.position for stop in stops.values()])
    data["stop_position"].attrs = {"units": "m", "long_name": "where the train stood first"}
    data["stop_time"] = ("controller", [stop.time for stop in stops.values()])
    data["stop_time"].attrs = {"units": "s", "long_name": "when the train stood first"}
    data["stopped"] = ("controller", [stop.reason for stop in stops.values()])
    data["stopped"].attrs = {"units": "", "long_name": "why there was no plan, at the first sample without one"}
    return data


def predicted_errors(study: Any, one: xr.Dataset) -> Any:
    """Return e(k) = z(k) - x_s(k+l) of one law, shape (samples, 4), from what was recorded; NaN after its stop."""
    plant, brake = study.design.plant, study.brake
    begin = -study.curve.deceleration / brake.full_brake if study.start == "warm" else 0.0
    commands = np.concatenate([np.full(plant.delay + 1, begin), one["command"].values])
    k = np.arange(one.sizes["sample"])
    states = [one["acceleration"].values, commands[k], one["speed"].values, one["position"].values]
    z = np.stack(states, axis=1)
    for j in range(plant.delay):  # the command of sample k itself is not among those predicted with
        z = z @ plant.A.T + np.outer(commands[k + j + 1] - commands[k + j], plant.b)
    v, s = study.curve.at((k + plant.delay) * brake.sampling_time)
    held = -study.curve.deceleration / brake.full_brake
    return z - np.stack([np.full(k.size, -study.curve.deceleration), np.full(k.size, held), v, s], axis=1)


def bound_excess(study: Any, data: xr.Dataset) -> Any:
    """Return by how much the predicted error exceeds X_z at worst, shape (controllers, samples)."""
    bounds = study.design.X_z
    rows = [predicted_errors(study, data.sel(controller=name)) for name in data["controller"].values]
    return np.stack([(e @ bounds.H.T - bounds.h).max(axis=1) for e in rows])


def scores(study: Any, data: xr.Dataset) -> Scores:
    """Return the metrics of every law.

    stop_error_cm; rms_speed_error, max_speed_error (m/s); updates, switches: samples whose |du| exceeds 1e-6, 1e-3;
    max_jerk (m/s^3) of the brake; total_variation of the command; qps_solved; infeasible: samples without a plan.
    """
    result: Scores = {}
    for name in data["controller"].values:
        one = data.sel(controller=name)
        kept = one["speed"].notnull().values
        error, du = one["speed_error"].values[kept], np.abs(one["increment"].values[kept])
        stop = float(one["stop_position"]) - study.curve.stop_position
        result[str(name)] = {
            "stop_error_cm": finite(100 * stop),
            "rms_speed_error": finite(np.sqrt(np.mean(error**2))),
            "max_speed_error": finite(np.abs(error).max()),
            "updates": float((du > UPDATE).sum()),
            "switches": float((du > SWITCH).sum()),
            "max_jerk": finite(one["peak_jerk"].max()),
            "total_variation": finite(du.sum()),
            "qps_solved": finite(one["qps"].sum()),
            "infeasible": finite(one["infeasible"].sum()),
        }
    return result
