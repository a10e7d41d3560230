"""Model-free adaptive ILC of a metro train whose trial length varies.

Jiao & Hou (2025).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca
import numpy as np
import xarray as xr

from models.metro_profile import MetroProfile
from models.point_mass import PointMass
from studies.rail.scores import RIDE, train_scores
from workbench.controllers.cfdl import CFDL
from workbench.controllers.icfdl import ICFDL
from workbench.controllers.increment import Increment
from workbench.controllers.pd import PD
from workbench.trials.length import TrialLength
from workbench.trials.study import Sweep, TrialStudy


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


def figures(study: Any, data: xr.Dataset) -> Mapping[str, Callable[[], Any]]:
    """Return the figures of the metro study by name."""
    from studies.metro.figures import metro_figures

    return metro_figures(study, data, slope_resistance(study, data))


STUDY = TrialStudy(
    name="metro",
    title="Model-free adaptive ILC of a metro train whose trial length varies",
    source="Jiao & Hou, Control Theory & Applications 42(3), 2025, doi 10.7641/CTA.2024.30465",
    plant=PointMass(),
    reference=MetroProfile(),
    controllers={"cfdl": CFDL(), "icfdl": ICFDL(), "pd": PD(), "increment": Increment()},
    trials=150,
    trial_length=TrialLength(law="uniform"),
    sweeps=(
        Sweep(
            field="force_unit",
            values=(1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0),
            controllers=("icfdl", "pd"),
            unit="N",
        ),
    ),
    scorers=(train_scores,),
    compared=(RIDE,),
    drawings=figures,
)
