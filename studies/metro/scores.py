"""What only the metro study computes from a run."""

from __future__ import annotations

from typing import cast

import casadi as ca
import numpy as np
import xarray as xr

from models.array import Array
from models.expression import as_expression
from models.point_mass import PointMass
from studies.rail.scores import speed_of
from workbench.contracts.study import Study


def slope_resistance(study: Study, data: xr.Dataset, trials: tuple[int, ...] = (60, 120)) -> xr.DataArray:
    """Return the slope resistance per unit mass in N/kg, dims (run, sample): the paper's Fig. 4.

    The first run follows the reference exactly; the others are trials of icfdl (else of the first controller that
    ran), at the positions that they recorded, NaN after their end. A trial that was not run becomes the last one
    that was.
    """
    plant = cast(PointMass, study.plant)
    followed = float(plant.sampling_time) / speed_of(study).per_si * np.cumsum(data["reference"].values)
    positions: dict[str, Array] = {"run along the reference": np.concatenate([[0.0], followed[:-1]])}
    done = data["mse"].notnull().sum("trial")
    ran = [str(name) for name in data["controller"].values if done.sel(controller=name) > 0]
    if ran:
        name = "icfdl" if "icfdl" in ran else ran[0]
        for trial in sorted({min(trial, int(done.sel(controller=name))) for trial in trials}):
            positions[f"{name}, trial {trial}"] = data["state_position"].sel(controller=name, trial=trial).values
    along = np.stack(list(positions.values()))
    force = ca.DM(plant.slope_force(as_expression(ca.DM(along)))).full()
    per_mass = force / (1.0 if plant.reading == "printed" else plant.mass)
    return xr.DataArray(
        np.where(np.isnan(along), np.nan, per_mass),
        coords={"run": list(positions), "sample": data["sample"]},
        dims=("run", "sample"),
        attrs={"units": "N/kg", "long_name": "slope resistance per unit mass"},
    )
