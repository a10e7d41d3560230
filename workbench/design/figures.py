"""The figure of a comparison: how every law fares by trial, and along its last one."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from workbench.contracts.study import Draw, Study
from workbench.design.comparison import error_by_trial
from workbench.design.one_error import weighed
from workbench.trials.figures import COLOURS, DASHES, STYLE, in_legend, pretty, ran

MANY = (*COLOURS, "#882255", "#999933", "#332288", "#88CCEE", "#AA4499")


def comparison_figures(study: Study, data: xr.Dataset) -> Mapping[str, Draw]:
    """Return the figures of a comparison by name."""
    return {"comparison": partial(comparison, study, data)}


def comparison(study: Study, data: xr.Dataset) -> Figure:
    """Draw the MSE by trial, what tuning found by evaluation, and errors and applied inputs of the last trial."""
    names, plant = ran(data), study.plant
    rows = 1 + -(-(len(plant.outputs) + len(plant.inputs)) // 2)
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(rows, 2, figsize=(11.0, 3.8 * rows), squeeze=False)
        by_trial, by_evaluation, *within = axes.ravel()
        for index, name in enumerate(names):
            style = {"color": MANY[index % len(MANY)], "linestyle": DASHES[index % len(DASHES)]}
            by_trial.semilogy(data["trial"], error_by_trial(study, data, name), **style, label=in_legend(name))
            spent = np.minimum.accumulate(data["tuning_mse"].sel(controller=name).values)
            by_evaluation.semilogy(data["evaluation"], np.where(np.isfinite(spent), spent, np.nan), **style)
        unit = pretty(weighed(study).unit)
        by_trial.set(xlabel="trial i", ylabel=f"MSE, true plant ({unit})")
        by_evaluation.set(xlabel="evaluation while tuning", ylabel=f"best so far, nominal plant ({unit})")
        for axis, what, row in zip(within, _rows_of(data, "error", "output_name"), plant.outputs, strict=False):
            _along(axis, data, what, names, f"error of {row.doc or row.name}, last trial ({row.unit})")
            _limit(axis, what, names)
        after = within[len(plant.outputs) :]
        for axis, what, row in zip(after, _rows_of(data, "applied", "input_name"), plant.inputs, strict=False):
            _along(axis, data, what, names, f"applied {row.doc or row.name}, last trial ({row.unit})")
            _limit(axis, what, names)
        for axis in after[len(plant.inputs) :]:
            axis.set_axis_off()
        figure.legend(*by_trial.get_legend_handles_labels(), loc="outside upper center", ncols=5, fontsize=9)
        return figure


def _rows_of(data: xr.Dataset, name: str, axis: str) -> list[xr.DataArray]:
    """Return a variable's last trial by channel, each (controller, sample)."""
    last = data[name].isel(trial=-1)
    return [last.isel({axis: i}) for i in range(last.sizes[axis])] if axis in last.dims else [last]


def _along(axis: Axes, data: xr.Dataset, values: xr.DataArray, names: list[str], label: str) -> None:
    for index, name in enumerate(names):
        colour, dashes = MANY[index % len(MANY)], DASHES[index % len(DASHES)]
        axis.plot(data["time"], values.sel(controller=name), color=colour, linestyle=dashes, linewidth=0.9)
    axis.set(xlabel="time (s)", ylabel=label)


def _limit(axis: Axes, values: xr.DataArray, names: list[str]) -> None:
    """Show what most laws do: one that is far off would hide all others."""
    shown = np.abs(values.sel(controller=names).values)
    if not np.isfinite(shown).any():
        return
    limit = 3 * float(np.nanquantile(shown, 0.9))
    if 0 < limit < np.nanmax(shown):
        axis.set_ylim(-limit, limit)
