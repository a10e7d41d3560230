"""Metrics of a ride: accelerations, jerk, energy and forces of a train whose output is its speed."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from workbench.contracts.number import finite
from workbench.contracts.study import Measures, Scores
from workbench.trials.metrics import acting_inputs, applied_inputs, peak

JOULES_PER_KWH = 3.6e6


def train_scores(study: Any, data: xr.Dataset) -> Scores:
    """Return max_abs_input_n (N) and max_abs_accel_mps2 (m/s^2) over all trials, applied samples only."""
    per_second = study.plant.speed_factor * study.plant.sampling_time
    return {
        str(controller): {
            "max_abs_input_n": peak(applied_inputs(data, controller)),
            "max_abs_accel_mps2": peak(np.diff(data["output"].sel(controller=controller).values) / per_second),
        }
        for controller in data["controller"].values
    }


def ride_scores(study: Any, data: xr.Dataset) -> Scores:
    """Return max_jerk (m/s^3), energy_kwh drawn in traction and force_peak (N) of every law's last trial.

    The force is the one that acts behind the actuator. None where the law diverged. The study's plant has a
    ``speed_factor``, output units in one m/s.
    """
    ts = float(study.plant.sampling_time)
    found: Scores = {}
    for controller in data["controller"].values:
        last = data.sel(controller=controller).isel(trial=-1)
        speed = last["output"].values / study.plant.speed_factor
        force = acting_inputs(last)[:-1]
        power = np.maximum(force * (speed[:-1] + speed[1:]) / 2, 0.0)
        found[str(controller)] = {
            "max_jerk": finite(np.abs(np.diff(speed, 2)).max() / ts**2),
            "energy_kwh": finite(power.sum() * ts / JOULES_PER_KWH),
            "force_peak": finite(np.abs(force).max()),
        }
    return found


RIDE = Measures(
    headings={"max_jerk": "jerk (m/s^3)", "energy_kwh": "energy (kWh)", "force_peak": "force peak (N)"},
    scores=ride_scores,
)
"""What a comparison of laws on a train shows of the last trial."""
