"""Figures of runs: they take results and draw."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import pyplot as plt

STYLE: Any = {
    "figure.figsize": (7.0, 4.2),
    "figure.dpi": 100,
    "savefig.dpi": 150,
    "figure.constrained_layout.use": True,
    "font.size": 11,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "lines.linewidth": 1.6,
    "svg.hashsalt": "workbench",
}
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
DASHES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (3, 1, 1, 1)), (0, (1, 1)))
MARKERS = ("o", "s", "^", "D", "v", "P", "X")


def styled(index: int) -> dict[str, Any]:
    """Return colour and dashes of the n-th curve: distinct on screen, in grey print and to the colour-blind."""
    return {"color": COLOURS[index % len(COLOURS)], "linestyle": DASHES[index % len(DASHES)]}


def axis_label(variable: xr.DataArray) -> str:
    """Return ``long name (unit)`` of a variable."""
    name, unit = variable.attrs.get("long_name", variable.name), variable.attrs.get("units", "")
    return f"{name} ({pretty(unit)})" if unit not in ("", "1") else str(name)


def in_legend(name: str) -> str:
    """Return a name as a legend shows it: Matplotlib leaves out what begins with an underscore."""
    return f" {name}" if name.startswith("_") else name


def pretty(unit: str) -> str:
    """Return a unit as it is typeset: (m/s)^2 with a raised two."""
    return unit.replace("^2", "²").replace("^3", "³")


def ran(data: xr.Dataset) -> list[str]:
    """Return the controllers that have at least one trial."""
    return [str(c) for c in data["controller"].values if data["mse"].sel(controller=c).notnull().any()]


def by_trial(axes: Any, data: xr.Dataset, values: Callable[[str], Any]) -> None:
    """Draw ``values(controller)``, one a trial, of every controller: on a log scale, with a mark at every trial."""
    for index, name in enumerate(ran(data)):
        axes.semilogy(
            data["trial"],
            values(name),
            **styled(index),
            marker=MARKERS[index % len(MARKERS)],
            markersize=4,
            label=in_legend(name),
        )


def trial_figures(study: Any, data: xr.Dataset) -> Mapping[str, Callable[[], Any]]:
    """Return the figures that every study made of trials has."""
    figures: dict[str, Callable[[], Any]] = {
        "reference": partial(reference, data),
        "trial_lengths": partial(trial_lengths, data),
        "mse": partial(mse, data),
    }
    for controller in ran(data):
        figures[f"tracking_{controller}"] = partial(tracking, data, controller)
    for sweep in study.sweeps:
        figures[f"sensitivity_{sweep.field}"] = partial(sensitivity, data, sweep.field)
    return figures


def reference(data: xr.Dataset) -> Any:
    """Draw the reference over samples."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        axes.plot(data["sample"], data["reference"], **styled(0))
        axes.set(xlabel="sample k", ylabel=axis_label(data["reference"]))
        return figure


def trial_lengths(data: xr.Dataset) -> Any:
    """Draw how long every trial lasted."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        axes.plot(data["trial"], data["trial_length"], linestyle="none", marker="o", markersize=4, color=COLOURS[0])
        axes.set(xlabel="trial i", ylabel=f"trial length ({data['trial_length'].attrs['units']})")
        return figure


def tracking(data: xr.Dataset, controller: str, trials: tuple[int, ...] = (50, 100)) -> Any:
    """Draw the output of a controller at some trials (the last one where they were not run) and the reference."""
    one = data.sel(controller=controller)
    done = int(one["mse"].notnull().sum())
    chosen = sorted({min(trial, done) for trial in trials})
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        axes.plot(data["sample"], data["reference"], color="black", linewidth=2.2, alpha=0.5, label="reference")
        for index, trial in enumerate(chosen):
            axes.plot(data["sample"], one["output"].sel(trial=trial), **styled(index), label=f"trial {trial}")
        axes.set(xlabel="sample k", ylabel=axis_label(data["output"]), title=f"Tracking of {controller}")
        axes.legend()
        return figure


def mse(data: xr.Dataset) -> Any:
    """Draw the mean square error of every controller by trial, on a log scale."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        for index, controller in enumerate(ran(data)):
            values = data["mse"].sel(controller=controller)
            axes.semilogy(
                data["trial"],
                np.where(np.isfinite(values), values, np.nan),
                **styled(index),
                label=in_legend(controller),
            )
        axes.set(xlabel="trial i", ylabel=f"mean square error ({pretty(data['mse'].attrs['units'])})")
        if axes.lines:
            axes.legend()
        return figure


def sensitivity(data: xr.Dataset, field: str) -> Any:
    """Draw the last MSE against a field that was varied, marking where the controller diverged."""
    values = data[f"sweep_{field}_mse_last"]
    at, names = f"sweep_{field}", f"sweep_{field}_controller"
    highest = float(values.max()) if values.notnull().any() else 1.0
    row = {name: 5 * highest * 2.0**index for index, name in enumerate(values[names].values)}
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        axes.axhspan(2.5 * highest, 2 * max(row.values()), color="0.93", label="diverged")
        for index, controller in enumerate(row):
            last = values.sel({names: controller})
            axes.loglog(last[at], last, **styled(index), marker=MARKERS[index], label=in_legend(str(controller)))
            gone = last[at].values[np.isnan(last.values)]
            axes.scatter(gone, np.full(gone.size, row[controller]), marker="x", s=60, color=COLOURS[index])
        axes.set(
            xlabel=f"{field.replace('_', ' ')} ({pretty(data[at].attrs['units'])})",
            ylabel=f"last mean square error ({pretty(values.attrs['units'])})",
            ylim=(None, 2 * max(row.values())),
        )
        figure.legend(loc="outside upper center", ncols=len(row) + 1)
        return figure
