"""Figures of the maglev study, in the order of the paper's: they take results and draw."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import cast

import numpy as np
import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from models.array import Array
from models.maglev import Maglev
from studies.maglev.scores import energy, itae, of
from workbench.contracts.study import Draw, Study
from workbench.trials.figures import STYLE, by_trial, ran, styled, trials_run

EVERY = 10
"""Every which sample curves are drawn with."""


def figures(study: Study, data: xr.Dataset) -> Mapping[str, Draw]:
    """Return the study's figures by name, each a function that draws and returns a Matplotlib figure."""
    return {
        "line": partial(line, study, data),
        "reference": partial(reference, data),
        "position": partial(tracking, data, "position", "position (m)"),
        "position_error": partial(over_time, data, of(data, "error", "position"), "position error (m)"),
        "speed": partial(tracking, data, "speed", "speed (m/s)"),
        "speed_error": partial(over_time, data, of(data, "error", "speed"), "speed error (m/s)"),
        "line_resistance": partial(line_resistance, data),
        "force": partial(over_time, data, data["input"], "force commanded (kN)", 1e-3),
        "energy": partial(energy_used, data),
        "itae": partial(itae_by_period, data),
        "error_by_period": partial(error_by_period, data),
    }


def _last(data: xr.Dataset, controller: str, variable: xr.DataArray) -> xr.DataArray:
    """Return the last period that a controller ran, every EVERY-th sample."""
    done = max(trials_run(data, controller), 1)
    return variable.sel(controller=controller).isel(trial=done - 1, sample=slice(None, None, EVERY))


def _time(data: xr.Dataset) -> Array:
    times: Array = data["time"].values[::EVERY]
    return times


def line(study: Study, data: xr.Dataset) -> Figure:
    """Draw grade and curvature over position."""
    profile = cast(Maglev, study.true_plant).line
    x = np.linspace(0, float(of(data, "reference", "position").max()), 1600)
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


def reference(data: xr.Dataset) -> Figure:
    """Draw the reference speed over position, there and back."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        axes.plot(of(data, "reference", "position"), of(data, "reference", "speed"), **styled(0))
        axes.set(xlabel="position (m)", ylabel="reference speed (m/s)")
        return figure


def tracking(data: xr.Dataset, output: str, label: str) -> Figure:
    """Draw an output of every controller in the last period."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        reference = of(data, "reference", output)
        axes.plot(data["time"], reference, color="black", linewidth=2.4, alpha=0.4, label="reference")
        for index, name in enumerate(ran(data)):
            axes.plot(_time(data), _last(data, name, of(data, "output", output)), **styled(index), label=name)
        axes.set(xlabel="time in the last period (s)", ylabel=label)
        axes.legend()
        return figure


def over_time(data: xr.Dataset, variable: xr.DataArray, label: str, factor: float = 1.0) -> Figure:
    """Draw a variable of every controller in the last period."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        for index, name in enumerate(ran(data)):
            axes.plot(_time(data), factor * _last(data, name, variable), **styled(index), label=name)
        axes.set(xlabel="time in the last period (s)", ylabel=label)
        axes.legend()
        return figure


def line_resistance(data: xr.Dataset) -> Figure:
    """Draw the line resistance that was learned, and the true one."""
    told = "law_line_resistance" in data
    laws = [n for n in ran(data) if told and data["law_line_resistance"].sel(controller=n).notnull().any()]
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        shown = laws[0] if laws else ran(data)[0]
        true = _last(data, shown, data["line_resistance"]) / 1000
        axes.plot(_time(data), true, color="black", linewidth=2.4, alpha=0.4, label=f"true ({shown})")
        for index, name in enumerate(laws):
            learned = _last(data, name, data["law_line_resistance"])
            axes.plot(_time(data), learned / 1000, **styled(index), label=name)
        axes.set(xlabel="time in the last period (s)", ylabel="line resistance (kN)")
        axes.legend()
        return figure


def energy_used(data: xr.Dataset) -> Figure:
    """Draw the energy used up to every instant of the last period."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        for index, name in enumerate(ran(data)):
            used = np.cumsum(energy(data, name)[trials_run(data, name) - 1])
            axes.plot(data["time"].values[1::EVERY], used[::EVERY], **styled(index), label=name)
        axes.set(xlabel="time in the last period (s)", ylabel="energy (kWh)")
        axes.legend()
        return figure


def itae_by_period(data: xr.Dataset) -> Figure:
    """Draw the ITAE of the position error of every period."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        by_trial(axes, data, partial(itae, data))
        axes.set(xlabel="period", ylabel="ITAE of the position error (m s²)")
        axes.legend()
        return figure


def error_by_period(data: xr.Dataset) -> Figure:
    """Draw the largest position error of every period."""
    error = of(data, "error", "position")
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        by_trial(axes, data, lambda name: abs(error.sel(controller=name)).max("sample").values)
        axes.set(xlabel="period", ylabel="max |position error| (m)")
        axes.legend()
        return figure
