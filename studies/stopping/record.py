"""The record of a stopping study: one stop in the study's own words, and what it says of the predicted error."""

from __future__ import annotations

import numpy as np
import xarray as xr

from models.array import Array
from studies.stopping.settings import own
from workbench.contracts.study import Study

ROWS = {
    "speed": ("state_speed", "m/s", "speed"),
    "position": ("state_position", "m", "position"),
    "command": ("input", "1", "brake command"),
    "acceleration": ("state_acceleration", "m/s^2", "acceleration by the brake"),
    "hold": ("law_hold", "samples", "planned hold M"),
    "cost": ("law_cost", "1", "cost J of the plan"),
    "qps": ("law_qps", "1", "quadratic programs solved"),
    "infeasible": ("law_infeasible", "1", "1 where no plan could be made and the last safe one is held"),
    "peak_jerk": ("state_peak_jerk", "m/s^3", "largest jerk of the brake during the sample"),
}
"""Variables by controller and sample, of the samples before the stop: from which, unit, description."""
WITHOUT_PLAN = {"hold": 1.0, "qps": 0.0, "infeasible": 0.0}
"""What a law that plans nothing does at every sample."""


def derived(study: Study, data: xr.Dataset) -> xr.Dataset:
    """Return a record with the stop of the first trial beside what every run records.

    Variables have the dims controller and sample; samples from the stop on are missing.
    """
    settings, one = own(study), data.isel(trial=0, drop=True)
    k, length = one["sample"], one["trial_length"]
    for name, (source, unit, label) in ROWS.items():
        row = one[source] if source in one else one["state_speed"] * np.nan
        if name == "peak_jerk":  # the state tells of the sample that led to it
            row = row.shift(sample=-1)
        if name in WITHOUT_PLAN:
            row = row.fillna(WITHOUT_PLAN[name])
        _add(data, name, row.where(k < length), unit, label)
    command = data["command"]
    before = command.shift(sample=1).where(k > 0, settings.held)
    _add(data, "increment", command - before, "1", "increment of the brake command")
    for name in ("speed", "position"):
        unit = "m/s" if name == "speed" else "m"
        row = one["reference"].sel(output_name=name, drop=True)
        _add(data, f"reference_{name}", row, unit, f"reference {name}")
    _add(data, "speed_error", data["speed"] - data["reference_speed"], "m/s", "speed error")
    label = "largest excess of the predicted error over the tightened bounds X_z, each in its own unit"
    data["bound_excess"] = (("controller", "sample"), bound_excess(study, data), {"units": "1", "long_name": label})
    end = one.isel(sample=length.clip(min=0))
    stands = end["state_speed"] <= 0
    _add(data, "stop_position", end["state_position"].where(stands), "m", "where the train stood first")
    _add(data, "stop_time", end["state_running_time"].where(stands), "s", "when the train stood first")
    return data


def _add(data: xr.Dataset, name: str, row: xr.DataArray, unit: str, label: str) -> None:
    data[name] = row.variable
    data[name].attrs = {"units": unit, "long_name": label}


def predicted_errors(study: Study, one: xr.Dataset) -> Array:
    """Return e(k) = z(k) - x_s(k+l) of one law, shape (samples, 4), from what was recorded; NaN after its stop."""
    settings = own(study)
    plant, brake, curve = settings.design.plant, settings.brake, settings.curve
    commands = np.concatenate([np.full(plant.delay + 1, settings.held), one["command"].values])
    k = np.arange(one.sizes["sample"], dtype=np.int64)
    states = [one["acceleration"].values, commands[k], one["speed"].values, one["position"].values]
    z = np.stack(states, axis=1)
    for j in range(plant.delay):  # the command of sample k itself is not among those predicted with
        z = z @ plant.A.T + np.outer(commands[k + j + 1] - commands[k + j], plant.b)
    t = (k + plant.delay).astype(np.float64) * brake.sampling_time
    v, s = curve.at(t)
    held = -curve.deceleration / brake.full_brake
    reference = np.stack([np.full(k.size, -curve.deceleration), np.full(k.size, held), v, s], axis=1)
    errors: Array = z - reference
    return errors


def bound_excess(study: Study, data: xr.Dataset) -> Array:
    """Return by how much the predicted error exceeds X_z at worst, shape (controllers, samples)."""
    bounds = own(study).design.X_z
    rows = [predicted_errors(study, data.sel(controller=name)) for name in data["controller"].values]
    return np.stack([(e @ bounds.H.T - bounds.h).max(axis=1) for e in rows])
