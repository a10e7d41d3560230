"""Figures of the metro study, like Figs. 2-7 of Jiao & Hou (2025), and the sensitivity to the force unit."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.figure import Figure

from workbench.contracts.study import Draw, Study
from workbench.trials import figures as plots


def metro_figures(study: Study, data: xr.Dataset, resistance: xr.DataArray) -> Mapping[str, Draw]:
    """Return the figures of every study made of trials, and the slope resistance beside them.

    ``resistance`` has dims (run, sample): the slope resistance per unit mass that each of some runs met.
    """
    return {**plots.trial_figures(study, data), "resistance": partial(slope_resistance, resistance)}


def slope_resistance(resistance: xr.DataArray) -> Figure:
    """Draw the slope resistance per unit mass over samples, one curve a run."""
    with plt.rc_context(plots.STYLE):
        figure, axes = plt.subplots()
        for index, run in enumerate(resistance["run"].values):
            axes.plot(resistance["sample"], resistance.sel(run=run), **plots.styled(index), label=str(run))
        axes.set(xlabel="sample k", ylabel=plots.axis_label(resistance))
        axes.legend()
        return figure
