"""What only the metro study computes from a run."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import xarray as xr


def slope_resistance(study: Any, data: xr.Dataset, trials: tuple[int, ...] = (60, 120)) -> xr.DataArray:
    """Return the slope resistance per unit mass in N/kg, dims (run, sample): the paper's Fig. 4.

    The first run follows the reference exactly; the others are trials of icfdl (else of the first controller that
    ran), at the positions that they recorded, NaN after their end. A trial that was not run becomes the last one
    that was.
    """
    plant = study.plant
    followed = plant.sampling_time / plant.speed_factor * np.cumsum(data["reference"].values)
    positions = {"run along the reference": np.concatenate([[0.0], followed[:-1]])}
    done = data["mse"].notnull().sum("trial")
    ran = [str(name) for name in data["controller"].values if done.sel(controller=name) > 0]
    if ran:
        name = "icfdl" if "icfdl" in ran else ran[0]
        for trial in sorted({min(trial, int(done.sel(controller=name))) for trial in trials}):
            positions[f"{name}, trial {trial}"] = data["state_position"].sel(controller=name, trial=trial).values
    force = plant.slope_force(ca.DM(np.stack(list(positions.values()))))
    per_mass = ca.DM(force).full() / (1.0 if plant.reading == "printed" else plant.mass)
    return xr.DataArray(
        np.where(np.isnan(np.stack(list(positions.values()))), np.nan, per_mass),
        coords={"run": list(positions), "sample": data["sample"]},
        dims=("run", "sample"),
        attrs={"units": "N/kg", "long_name": "slope resistance per unit mass"},
    )
