"""Figures of the variable-gain study."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import pyplot as plt

from studies.variable_gain.study import peaks
from workbench.trials.figures import STYLE, by_trial, ran, styled

SHOWN = (1, 2, 5, 10)


def figures(sampling_time: float, data: xr.Dataset) -> Mapping[str, Callable[[], Any]]:
    """Return the study's figures by name, each a function that draws and returns a Matplotlib figure."""
    data = data.assign_coords(time=("sample", data["sample"].values * sampling_time))
    drawn: dict[str, Callable[[], Any]] = {
        "reference": partial(reference, data),
        "errors_by_trial": partial(errors_by_trial, data),
        "initial_error": partial(initial_error, data),
    }
    for name in ran(data):
        drawn[f"tracking_{name}"] = partial(tracking, data, name)
        drawn[f"force_{name}"] = partial(force, data, name)
        if "law_learning_gain" in data and data["law_learning_gain"].sel(controller=name).notnull().any():
            drawn[f"learning_gain_{name}"] = partial(learning_gain, data, name)
    return drawn


def _chosen(data: xr.Dataset, controller: str) -> list[int]:
    done = int(data["mse"].sel(controller=controller).notnull().sum())
    return sorted({min(trial, done) for trial in (*SHOWN, done)})


def reference(data: xr.Dataset) -> Any:
    """Draw the reference's position and speed over time."""
    with plt.rc_context(STYLE):
        figure, (upper, lower) = plt.subplots(2, 1, sharex=True)
        upper.plot(data["time"], data["reference"], **styled(0))
        lower.plot(data["time"], data["reference_speed"], **styled(1))
        upper.set(ylabel="position (m)")
        lower.set(ylabel="speed (m/s)", xlabel="time (s)")
        return figure


def errors_by_trial(data: xr.Dataset) -> Any:
    """Draw the largest position and speed error of every trial."""
    with plt.rc_context(STYLE):
        figure, panels = plt.subplots(1, 2, figsize=(9.0, 4.2))
        for axes, variable, label in zip(
            panels, ("error", "error_speed"), ("max |position error| (m)", "max |speed error| (m/s)"), strict=True
        ):
            by_trial(axes, data, partial(peaks, data, variable=variable))
            axes.set(xlabel="trial k", ylabel=label)
            axes.legend()
        return figure


def initial_error(data: xr.Dataset) -> Any:
    """Draw the initial position and speed error of every trial."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        for index, name in enumerate(ran(data)):
            for variable, unit, marker in (("error", "position (m)", "o"), ("error_speed", "speed (m/s)", "s")):
                start = np.abs(data[variable].sel(controller=name).isel(sample=0))
                axes.semilogy(
                    data["trial"],
                    np.where(start > 0, start, np.nan),
                    **styled(index),
                    marker=marker,
                    markersize=4,
                    label=f"{name}: {unit}",
                )
        axes.set(xlabel="trial k", ylabel="|initial error| (m, m/s)")
        axes.legend()
        return figure


def _trials(data: xr.Dataset, controller: str, variable: str, axes: Any) -> None:
    for index, trial in enumerate(_chosen(data, controller)):
        values = data[variable].sel(controller=controller, trial=trial)
        axes.plot(data["time"], values, **styled(index), label=f"trial {trial}")


def tracking(data: xr.Dataset, controller: str) -> Any:
    """Draw position and speed errors over time at some trials."""
    with plt.rc_context(STYLE):
        figure, (upper, lower) = plt.subplots(2, 1, sharex=True, figsize=(7.0, 5.4))
        _trials(data, controller, "error", upper)
        _trials(data, controller, "error_speed", lower)
        upper.set(ylabel="position error (m)", title=controller)
        upper.set_yscale("symlog", linthresh=0.1)
        lower.set(ylabel="speed error (m/s)", xlabel="time (s)")
        lower.set_yscale("symlog", linthresh=0.01)
        upper.legend(ncols=2)
        return figure


def force(data: xr.Dataset, controller: str) -> Any:
    """Draw the planned force per unit mass at some trials."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        _trials(data, controller, "input", axes)
        axes.set(xlabel="time (s)", ylabel="force (N/kg)", title=controller)
        axes.legend()
        return figure


def learning_gain(data: xr.Dataset, controller: str) -> Any:
    """Draw the learning gain over time at some trials."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        _trials(data, controller, "law_learning_gain", axes)
        axes.set(xlabel="time (s)", ylabel="learning gain λ", title=controller, ylim=(0, 1.05))
        axes.legend()
        return figure
