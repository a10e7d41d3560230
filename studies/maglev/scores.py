"""Metrics of the maglev study, from its Dataset."""

from __future__ import annotations

from typing import cast

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.integrate import trapezoid

from models.array import Array
from models.maglev import Maglev
from workbench.contracts.number import finite
from workbench.contracts.study import Scores, Study
from workbench.trials.record import OUTPUT

JOULES_PER_KWH = 3.6e6


def of(data: xr.Dataset, variable: str, output: str) -> xr.DataArray:
    """Return a variable (output, error, reference) of the position or the speed."""
    return data[variable].sel({OUTPUT: output}, drop=True)


def sections(study: Study, data: xr.Dataset) -> dict[str, NDArray[np.bool_]]:
    """Return which samples of the reference lie on straight, curved and graded line: masks (N + 1,) by name."""
    line, x = cast(Maglev, study.true_plant).line, of(data, "reference", "position").values
    curve = np.zeros(x.shape, dtype=bool)
    for start, end in zip(line.curve_starts_m, line.curve_ends_m, strict=True):
        curve |= (x >= start) & (x <= end)
    grades = np.array(line.grade_permille)[np.searchsorted(np.array(line.grade_starts_m), x, side="right")]
    grade = grades != 0
    return {"straight": ~curve & ~grade, "curve": curve, "grade": grade}


def itae(data: xr.Dataset, controller: str) -> Array:
    """Return the integral of t |e_x| over every period in m s^2, t from the period's beginning; shape (periods,)."""
    time = data["time"].values
    weighted = time * np.abs(of(data, "error", "position").sel(controller=controller).values)
    found: Array = trapezoid(weighted, dx=float(time[1]), axis=1)
    return found


def energy(data: xr.Dataset, controller: str) -> Array:
    """Return the energy used by each sample of every period in kWh, shape (periods, N).

    It is the integral of max(F v, 0), F being the force that acts: exact for one held over a sample without reversal
    in it.
    """
    force: Array = data["applied"].sel(controller=controller).values[:, :-1]
    moved: Array = np.diff(of(data, "output", "position").sel(controller=controller).values)
    return np.maximum(force * moved, 0) / JOULES_PER_KWH


def scores(study: Study, data: xr.Dataset) -> Scores:
    """Return the metrics of every controller.

    max_position_error_first|last and rms_position_error_last in m; max_speed_error_straight|curve|grade in m/s, by
    where the reference is, of the last period; itae_last in m s^2; energy_kwh_last; energy_change_percent against
    pid; learned_resistance_rms_error in N, of the last period (None for a law that learns none).
    """
    parts = sections(study, data)
    table: Scores = {}
    for name in map(str, data["controller"].values):
        one = data.sel(controller=name)
        position, speed = np.abs(of(one, "error", "position").values), np.abs(of(one, "error", "speed").values[-1])
        row = {
            "max_position_error_first": finite(position[0].max()),
            "max_position_error_last": finite(position[-1].max()),
            "rms_position_error_last": finite(np.sqrt(np.mean(position[-1] ** 2))),
        }
        for part, mask in parts.items():
            row[f"max_speed_error_{part}"] = finite(speed[mask].max()) if mask.any() else None
        row["itae_last"] = finite(itae(data, name)[-1])
        row["energy_kwh_last"] = finite(energy(data, name)[-1].sum())
        learned = one["law_line_resistance"].values[-1, :-1] if "law_line_resistance" in data else np.array([np.nan])
        true = one["line_resistance"].values[-1, :-1]
        row["learned_resistance_rms_error"] = finite(np.sqrt(np.mean((learned - true) ** 2)))
        table[name] = row
    baseline = table.get("pid", {}).get("energy_kwh_last")
    for row in table.values():
        used = row["energy_kwh_last"]
        row["energy_change_percent"] = 100 * (used / baseline - 1) if baseline and used is not None else None
    return table
