"""The figure of a comparison: how every law fares by trial, and along its last one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import pyplot as plt

from workbench.trials.figures import COLOURS, DASHES, STYLE, in_legend, ran

MANY = (*COLOURS, "#882255", "#999933", "#332288", "#88CCEE", "#AA4499")


def comparison_figures(study: Any, data: xr.Dataset) -> Mapping[str, Callable[[], Any]]:
    """Return the figures of a comparison by name."""
    return {"comparison": partial(comparison, float(study.plant.sampling_time), data)}


def comparison(sampling_time: float, data: xr.Dataset) -> Any:
    """Draw the MSE by trial, what tuning found by evaluation, and error and applied input of the last trial."""
    names = ran(data)
    applied = next((str(name) for name in data if str(name).startswith("applied_")), "input")
    time = data["sample"].values * sampling_time
    with plt.rc_context(STYLE):
        figure, ((by_trial, by_evaluation), (error, force)) = plt.subplots(2, 2, figsize=(11.0, 7.6))
        for index, name in enumerate(names):
            one = data.sel(controller=name)
            by_trial.semilogy(data["trial"], one["mse"], **_style(index), label=in_legend(name))
            spent = np.minimum.accumulate(one["tuning_mse"].values)
            by_evaluation.semilogy(
                data["evaluation"], np.where(np.isfinite(spent), spent, np.nan), **_style(index), label=in_legend(name)
            )
            error.plot(time, one["error"].isel(trial=-1), **_style(index), linewidth=1.0)
            force.plot(time, one[applied].isel(trial=-1) / 1e3, **_style(index), linewidth=0.8)
        unit = data["mse"].attrs["units"]
        by_trial.set(xlabel="trial i", ylabel=f"MSE, true plant ({unit})")
        by_evaluation.set(xlabel="evaluation while tuning", ylabel=f"best so far, nominal plant ({unit})")
        error.set(xlabel="time (s)", ylabel=f"error of the last trial ({data['error'].attrs['units']})")
        force.set(xlabel="time (s)", ylabel=f"applied input of the last trial (k{data[applied].attrs['units']})")
        shown = np.concatenate([data["error"].sel(controller=name).isel(trial=-1).values for name in names])
        limit = 3 * float(np.nanquantile(np.abs(shown), 0.9))
        error.set_ylim(-limit, limit)
        figure.legend(*by_trial.get_legend_handles_labels(), loc="outside upper center", ncols=5, fontsize=9)
        return figure


def _style(index: int) -> dict[str, Any]:
    """Return colour and dashes that differ for more laws than there are common colours."""
    return {"color": MANY[index % len(MANY)], "linestyle": DASHES[index % len(DASHES)]}
