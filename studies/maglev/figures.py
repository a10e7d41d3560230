"""Figures of the maglev study, in the order of the paper's: they take results and draw."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import pyplot as plt

from studies.maglev.scores import energy, itae
from workbench.trials.figures import STYLE, by_trial, ran, styled

EVERY = 10
"""Every which sample curves are drawn with."""


def figures(study: Any, data: xr.Dataset) -> Mapping[str, Callable[[], Any]]:
    """Return the study's figures by name, each a function that draws and returns a Matplotlib figure."""
    seconds = data["sample"].values * float(study.plant.sampling_time)
    data = data.assign_coords(time=("sample", seconds))
    return {
        "line": partial(line, study),
        "reference": partial(reference, data),
        "position": partial(position, data),
        "position_error": partial(over_time, data, "error", "position error (m)"),
        "speed": partial(speed, data),
        "speed_error": partial(over_time, data, "error_speed", "speed error (m/s)"),
        "line_resistance": partial(line_resistance, data),
        "force": partial(over_time, data, "input", "force commanded (kN)", 1e-3),
        "energy": partial(energy_used, data),
        "itae": partial(itae_by_period, study, data),
        "error_by_period": partial(error_by_period, data),
    }


def _last(data: xr.Dataset, controller: str, variable: str) -> Any:
    """Return the last period that a controller ran, every EVERY-th sample."""
    done = int(data["mse"].sel(controller=controller).notnull().sum())
    return data[variable].sel(controller=controller).isel(trial=max(done, 1) - 1, sample=slice(None, None, EVERY))


def _time(data: xr.Dataset) -> Any:
    return data["time"].values[::EVERY]


def line(study: Any) -> Any:
    """Draw grade and curvature over position."""
    profile = study.train.line
    x = np.linspace(0, study.reference.distance, 1600)
    grade = np.array(profile.grade_permille)[np.searchsorted(np.array(profile.grade_starts_m), x, side="right")]
    curvature = np.zeros(x.shape)
    for start, end, radius in zip(profile.curve_starts_m, profile.curve_ends_m, profile.curve_radii_m, strict=True):
        curvature[(x >= start) & (x < end)] = 1000 / radius
    with plt.rc_context(STYLE):
        figure, (upper, lower) = plt.subplots(2, 1, sharex=True)
        upper.plot(x, grade, **styled(0))
        lower.plot(x, curvature, **styled(1))
        upper.set(ylabel="grade (per mille)")
        lower.set(ylabel="curvature (1/km)", xlabel="position (m)")
        return figure


def reference(data: xr.Dataset) -> Any:
    """Draw the reference speed over position, there and back."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        axes.plot(data["reference"], data["reference_speed"], **styled(0))
        axes.set(xlabel="position (m)", ylabel="reference speed (m/s)")
        return figure


def _tracking(data: xr.Dataset, variable: str, target: str, label: str) -> Any:
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        axes.plot(data["time"], data[target], color="black", linewidth=2.4, alpha=0.4, label="reference")
        for index, name in enumerate(ran(data)):
            axes.plot(_time(data), _last(data, name, variable), **styled(index), label=name)
        axes.set(xlabel="time in the last period (s)", ylabel=label)
        axes.legend()
        return figure


def position(data: xr.Dataset) -> Any:
    """Draw the position of every controller in the last period."""
    return _tracking(data, "output", "reference", "position (m)")


def speed(data: xr.Dataset) -> Any:
    """Draw the speed of every controller in the last period."""
    return _tracking(data, "output_speed", "reference_speed", "speed (m/s)")


def over_time(data: xr.Dataset, variable: str, label: str, factor: float = 1.0) -> Any:
    """Draw a variable of every controller in the last period."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        for index, name in enumerate(ran(data)):
            axes.plot(_time(data), factor * _last(data, name, variable), **styled(index), label=name)
        axes.set(xlabel="time in the last period (s)", ylabel=label)
        axes.legend()
        return figure


def line_resistance(data: xr.Dataset) -> Any:
    """Draw the line resistance that was learned, and the true one."""
    laws = [name for name in ran(data) if data["law_line_resistance"].sel(controller=name).notnull().any()]
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        shown = laws[0] if laws else ran(data)[0]
        true = _last(data, shown, "line_resistance") / 1000
        axes.plot(_time(data), true, color="black", linewidth=2.4, alpha=0.4, label=f"true ({shown})")
        for index, name in enumerate(laws):
            axes.plot(_time(data), _last(data, name, "law_line_resistance") / 1000, **styled(index), label=name)
        axes.set(xlabel="time in the last period (s)", ylabel="line resistance (kN)")
        axes.legend()
        return figure


def energy_used(data: xr.Dataset) -> Any:
    """Draw the energy used up to every instant of the last period."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        for index, name in enumerate(ran(data)):
            done = int(data["mse"].sel(controller=name).notnull().sum())
            used = np.cumsum(energy(data, name)[done - 1])
            axes.plot(data["time"].values[1::EVERY], used[::EVERY], **styled(index), label=name)
        axes.set(xlabel="time in the last period (s)", ylabel="energy (kWh)")
        axes.legend()
        return figure


def itae_by_period(study: Any, data: xr.Dataset) -> Any:
    """Draw the ITAE of the position error of every period."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        by_trial(axes, data, lambda name: itae(study, data, name))
        axes.set(xlabel="period", ylabel="ITAE of the position error (m s²)")
        axes.legend()
        return figure


def error_by_period(data: xr.Dataset) -> Any:
    """Draw the largest position error of every period."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        by_trial(axes, data, lambda name: abs(data["error"].sel(controller=name)).max("sample"))
        axes.set(xlabel="period", ylabel="max |position error| (m)")
        axes.legend()
        return figure
