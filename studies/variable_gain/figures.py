"""Figures of the variable-gain study."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.variable_gain.scores import peaks
from workbench.contracts.study import Draw
from workbench.trials.figures import STYLE, by_output, by_trial, ran, styled, trials_run
from workbench.trials.record import OUTPUT

SHOWN = (1, 2, 5, 10)


def figures(data: xr.Dataset) -> Mapping[str, Draw]:
    """Return the study's figures by name, each a function that draws and returns a Matplotlib figure."""
    drawn: dict[str, Draw] = {
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
    done = trials_run(data, controller)
    return sorted({min(trial, done) for trial in (*SHOWN, done)})


def reference(data: xr.Dataset) -> Figure:
    """Draw the reference's position and speed over time."""
    with plt.rc_context(STYLE):
        figure, panels = plt.subplots(2, 1, sharex=True)
        for index, (axes, row, label) in enumerate(
            zip(panels, by_output(data["reference"]), ("position (m)", "speed (m/s)"), strict=True)
        ):
            axes.plot(data["time"], row, **styled(index))
            axes.set_ylabel(label)
        panels[-1].set_xlabel("time (s)")
        return figure


def errors_by_trial(data: xr.Dataset) -> Figure:
    """Draw the largest position and speed error of every trial."""
    with plt.rc_context(STYLE):
        figure, panels = plt.subplots(1, 2, figsize=(9.0, 4.2))
        labels = {"position": "max |position error| (m)", "speed": "max |speed error| (m/s)"}
        for axes, (output, label) in zip(panels, labels.items(), strict=True):
            by_trial(axes, data, partial(peaks, data, output=output))
            axes.set(xlabel="trial k", ylabel=label)
            axes.legend()
        return figure


def initial_error(data: xr.Dataset) -> Figure:
    """Draw the initial position and speed error of every trial."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        for index, name in enumerate(ran(data)):
            for output, unit, marker in (("position", "m", "o"), ("speed", "m/s", "s")):
                start = np.abs(data["error"].sel({"controller": name, OUTPUT: output}).isel(sample=0))
                axes.semilogy(
                    data["trial"],
                    np.where(start > 0, start, np.nan),
                    **styled(index),
                    marker=marker,
                    markersize=4,
                    label=f"{name}: {output} ({unit})",
                )
        axes.set(xlabel="trial k", ylabel="|initial error| (m, m/s)")
        axes.legend()
        return figure


def _trials(row: xr.DataArray, data: xr.Dataset, controller: str, axes: Axes) -> None:
    for index, trial in enumerate(_chosen(data, controller)):
        axes.plot(data["time"], row.sel(controller=controller, trial=trial), **styled(index), label=f"trial {trial}")


def tracking(data: xr.Dataset, controller: str) -> Figure:
    """Draw position and speed errors over time at some trials."""
    with plt.rc_context(STYLE):
        figure, (upper, lower) = plt.subplots(2, 1, sharex=True, figsize=(7.0, 5.4))
        _trials(data["error"].sel({OUTPUT: "position"}), data, controller, upper)
        _trials(data["error"].sel({OUTPUT: "speed"}), data, controller, lower)
        upper.set(ylabel="position error (m)", title=controller)
        upper.set_yscale("symlog", linthresh=0.1)
        lower.set(ylabel="speed error (m/s)", xlabel="time (s)")
        lower.set_yscale("symlog", linthresh=0.01)
        upper.legend(ncols=2)
        return figure


def force(data: xr.Dataset, controller: str) -> Figure:
    """Draw the planned force per unit mass at some trials."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        _trials(data["input"], data, controller, axes)
        axes.set(xlabel="time (s)", ylabel="force (N/kg)", title=controller)
        axes.legend()
        return figure


def learning_gain(data: xr.Dataset, controller: str) -> Figure:
    """Draw the learning gain over time at some trials."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        _trials(data["law_learning_gain"], data, controller, axes)
        axes.set(xlabel="time (s)", ylabel="learning gain λ", title=controller, ylim=(0, 1.05))
        axes.legend()
        return figure
