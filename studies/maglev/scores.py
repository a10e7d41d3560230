"""Metrics of the maglev study, from its Dataset."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from scipy.integrate import trapezoid

from workbench.contracts.number import finite
from workbench.contracts.study import Scores

JOULES_PER_KWH = 3.6e6


def seconds(study: Any, data: xr.Dataset) -> Any:
    """Return the time within the period of every sample, shape (N + 1,)."""
    return data["sample"].values * float(study.plant.sampling_time)


def sections(study: Any, data: xr.Dataset) -> dict[str, Any]:
    """Return which samples of the reference lie on straight, curved and graded line: masks (N + 1,) by name."""
    line, x = study.train.line, data["reference"].values
    curve = np.zeros(x.shape, dtype=bool)
    for start, end in zip(line.curve_starts_m, line.curve_ends_m, strict=True):
        curve |= (x >= start) & (x <= end)
    grades = np.array(line.grade_permille)[np.searchsorted(np.array(line.grade_starts_m), x, side="right")]
    grade = grades != 0
    return {"straight": ~curve & ~grade, "curve": curve, "grade": grade}


def itae(study: Any, data: xr.Dataset, controller: str) -> Any:
    """Return the integral of t |e_x| over every period in m s^2, t from the period's beginning; shape (periods,)."""
    weighted = seconds(study, data) * np.abs(data["error"].sel(controller=controller).values)
    return trapezoid(weighted, dx=float(study.plant.sampling_time), axis=1)


def energy(data: xr.Dataset, controller: str) -> Any:
    """Return the energy used by each sample of every period in kWh, shape (periods, N).

    It is the integral of max(F v, 0), exact for a force held over a sample without reversal in it.
    """
    name = "applied_force" if "applied_force" in data else "input"
    force = data[name].sel(controller=controller).values[:, :-1]
    return np.maximum(force * np.diff(data["output"].sel(controller=controller).values), 0) / JOULES_PER_KWH


def scores(study: Any, data: xr.Dataset) -> Scores:
    """Return the metrics of every controller.

    max_position_error_first|last and rms_position_error_last in m; max_speed_error_straight|curve|grade in m/s, by
    where the reference is, of the last period; itae_last in m s^2; energy_kwh_last; energy_change_percent against
    pid; learned_resistance_rms_error in N, of the last period (None for a law that learns none).
    """
    parts = sections(study, data)
    table: Scores = {}
    for name in map(str, data["controller"].values):
        one = data.sel(controller=name)
        position, speed = np.abs(one["error"].values), np.abs(one["error_speed"].values[-1])
        row = {
            "max_position_error_first": finite(position[0].max()),
            "max_position_error_last": finite(position[-1].max()),
            "rms_position_error_last": finite(np.sqrt(np.mean(position[-1] ** 2))),
        }
        for part, mask in parts.items():
            row[f"max_speed_error_{part}"] = finite(speed[mask].max()) if mask.any() else None
        row["itae_last"] = finite(itae(study, data, name)[-1])
        row["energy_kwh_last"] = finite(energy(data, name)[-1].sum())
        learned = one["law_line_resistance"].values[-1, :-1] if "law_line_resistance" in data else np.array([np.nan])
        true = one["line_resistance"].values[-1, :-1]
        row["learned_resistance_rms_error"] = finite(np.sqrt(np.mean((learned - true) ** 2)))
        row["diverged_at_trial"] = finite(one["diverged_at_trial"])
        table[name] = row
    baseline = table.get("pid", {}).get("energy_kwh_last")
    for row in table.values():
        used = row["energy_kwh_last"]
        row["energy_change_percent"] = 100 * (used / baseline - 1) if baseline and used is not None else None
    return table
