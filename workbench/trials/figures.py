"""Figures of runs: they take results and draw."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from models.array import Array
from workbench.contracts.study import Draw, Study
from workbench.trials.record import OUTPUT

STYLE: Any = {  # Matplotlib types the names of its settings one by one
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
DASHES: tuple[str | tuple[int, tuple[int, ...]], ...] = (
    "-",
    "--",
    "-.",
    ":",
    (0, (5, 1)),
    (0, (3, 1, 1, 1)),
    (0, (1, 1)),
)
MARKERS = ("o", "s", "^", "D", "v", "P", "X")


def styled(index: int) -> dict[str, Any]:  # keyword arguments of Matplotlib
    """Return colour and dashes of the n-th curve: distinct on screen, in grey print and to the colour-blind."""
    return {"color": COLOURS[index % len(COLOURS)], "linestyle": DASHES[index % len(DASHES)]}


def axis_label(variable: xr.DataArray) -> str:
    """Return ``long name (unit)`` of a variable; one output of several is named, and has a unit of its own."""
    name, unit = variable.attrs.get("long_name", variable.name), variable.attrs.get("units", "")
    if OUTPUT in variable.coords and not variable[OUTPUT].dims:
        output, own = str(variable[OUTPUT].values), str(variable["output_unit"].values)
        name, unit = output if name == "output" else f"{name} {output}", own
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


def trials_run(data: xr.Dataset, controller: str) -> int:
    """Return how many trials a controller ran."""
    mse = data["mse"].sel(controller=controller).notnull()
    return int(mse.any([one for one in mse.dims if one != "trial"]).sum())


def by_output(variable: xr.DataArray) -> list[xr.DataArray]:
    """Return a variable of every output, in order; of a single output it is the variable itself."""
    if OUTPUT not in variable.dims:
        return [variable]
    return [variable.sel({OUTPUT: name}) for name in variable[OUTPUT].values]


def panels(rows: int) -> tuple[Figure, list[Axes]]:
    """Return a figure with some panels below each other that share their horizontal axis."""
    figure, axes = plt.subplots(rows, 1, sharex=True, squeeze=False, figsize=(7.0, 4.2 + 1.6 * (rows - 1)))
    return figure, list(axes[:, 0])


def by_trial(axes: Axes, data: xr.Dataset, values: Callable[[str], ArrayLike]) -> None:
    """Draw ``values(controller)``, one a trial, of every controller: on a log scale, with a mark at every trial."""
    for index, name in enumerate(ran(data)):
        axes.semilogy(
            data["trial"],
            np.asarray(values(name)),
            **styled(index),
            marker=MARKERS[index % len(MARKERS)],
            markersize=4,
            label=in_legend(name),
        )


def trial_figures(study: Study, data: xr.Dataset) -> Mapping[str, Draw]:
    """Return the figures that every study has; of several outputs each has a panel of its own."""
    figures: dict[str, Draw] = {
        "reference": partial(reference, data),
        "trial_lengths": partial(trial_lengths, data),
        "mse": partial(mse, data),
    }
    for controller in ran(data):
        figures[f"tracking_{controller}"] = partial(tracking, data, controller)
    for sweep in study.sweeps:
        figures[f"sensitivity_{sweep.field}"] = partial(sensitivity, data, sweep.field)
    return figures


def reference(data: xr.Dataset) -> Figure:
    """Draw the reference over samples."""
    rows = by_output(data["reference"])
    with plt.rc_context(STYLE):
        figure, drawn = panels(len(rows))
        for axes, row in zip(drawn, rows, strict=True):
            axes.plot(data["sample"], row, **styled(0))
            axes.set_ylabel(axis_label(row))
        drawn[-1].set_xlabel("sample k")
        return figure


def trial_lengths(data: xr.Dataset) -> Figure:
    """Draw how long every trial lasted: one row of marks, or one a controller where each ends its trials itself."""
    lengths = data["trial_length"]
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        if "controller" in lengths.dims:
            for index, name in enumerate(ran(data)):
                row = lengths.sel(controller=name)
                look = {**styled(index), "linestyle": "none", "marker": MARKERS[index % len(MARKERS)], "markersize": 4}
                axes.plot(data["trial"], row.where(row >= 0), **look, label=in_legend(name))
            axes.legend()
        else:
            axes.plot(data["trial"], lengths, linestyle="none", marker="o", markersize=4, color=COLOURS[0])
        axes.set(xlabel="trial i", ylabel=f"trial length ({lengths.attrs['units']})")
        return figure


def tracking(data: xr.Dataset, controller: str, trials: tuple[int, ...] = (50, 100)) -> Figure:
    """Draw the output of a controller at some trials (the last one where they were not run) and the reference."""
    one = data.sel(controller=controller)
    done = trials_run(data, controller)
    chosen = sorted({min(trial, done) for trial in trials})
    targets, outputs = by_output(data["reference"]), by_output(one["output"])
    with plt.rc_context(STYLE):
        figure, drawn = panels(len(outputs))
        for axes, target, output in zip(drawn, targets, outputs, strict=True):
            axes.plot(data["sample"], target, color="black", linewidth=2.2, alpha=0.5, label="reference")
            for index, trial in enumerate(chosen):
                axes.plot(data["sample"], output.sel(trial=trial), **styled(index), label=f"trial {trial}")
            axes.set_ylabel(axis_label(output))
        drawn[0].set_title(f"Tracking of {controller}")
        drawn[0].legend()
        drawn[-1].set_xlabel("sample k")
        return figure


def mse(data: xr.Dataset) -> Figure:
    """Draw the mean square error of every controller by trial, on a log scale."""
    rows = by_output(data["mse"])
    with plt.rc_context(STYLE):
        figure, drawn = panels(len(rows))
        for axes, row in zip(drawn, rows, strict=True):
            for index, controller in enumerate(ran(data)):
                values = _positive(row.sel(controller=controller).values)
                axes.semilogy(data["trial"], values, **styled(index), label=in_legend(controller))
            axes.set_ylabel(_squared(row))
        drawn[-1].set_xlabel("trial i")
        if drawn[0].lines:
            drawn[0].legend()
        return figure


def _positive(values: Array) -> Array:
    return np.where(np.isfinite(values), values, np.nan)


def _squared(variable: xr.DataArray) -> str:
    if OUTPUT not in variable.coords:
        return f"mean square error ({pretty(variable.attrs['units'])})"
    unit = pretty(f"({variable['output_unit'].values})^2")
    return f"mean square error of\n{variable[OUTPUT].values} ({unit})"


def sensitivity(data: xr.Dataset, field: str) -> Figure:
    """Draw the last MSE against a field that was varied, marking where the controller diverged."""
    values = data[f"sweep_{field}_mse_last"]
    at, names = f"sweep_{field}", f"sweep_{field}_controller"
    highest = float(values.max()) if values.notnull().any() else 1.0
    row = {name: 5 * highest * 2.0**index for index, name in enumerate(values[names].values)}
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        axes.axhspan(2.5 * highest, 2 * max(row.values()), color="0.93", label="diverged")
        for index, controller in enumerate(row):
            last, mark = values.sel({names: controller}), MARKERS[index % len(MARKERS)]
            axes.loglog(last[at], last, **styled(index), marker=mark, label=in_legend(str(controller)))
            gone = last[at].values[np.isnan(last.values)]
            axes.scatter(
                gone, np.full(gone.size, row[controller]), marker="x", s=60, color=COLOURS[index % len(COLOURS)]
            )
        axes.set(
            xlabel=f"{field.replace('_', ' ')} ({pretty(data[at].attrs['units'])})",
            ylabel=f"last mean square error ({pretty(values.attrs['units'])})",
            ylim=(None, 2 * max(row.values())),
        )
        figure.legend(loc="outside upper center", ncols=len(row) + 1)
        return figure
