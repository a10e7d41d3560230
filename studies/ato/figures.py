"""Figures of the ato study, like the paper's 4 to 6, and what the paper does not show: how the draws spread."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from models.array import Array
from studies.ato.scores import AGAINST, FOUR, indices
from workbench.contracts.study import Draw
from workbench.trials.draws import of_draws
from workbench.trials.figures import COLOURS, STYLE, axis_label, ran, styled

JERK_LIMIT = 0.75


def ato_figures(data: xr.Dataset) -> Mapping[str, Draw]:
    """Return the figures of a step or curve test by name; signals are those of the draw that was recorded."""
    figures: dict[str, Draw] = {
        "response": partial(response, data),
        "error": partial(error, data),
        "factors": partial(factors, data),
        "comfort_energy": partial(comfort_energy, data),
    }
    if "scores" in data and AGAINST in ran(data) and len(ran(data)) > 1:
        figures["seeds"] = partial(seeds, data)
    if "grid_ise" in data:
        figures["grid"] = partial(grid, data)
    return figures


def _curve(axes: Axes, data: xr.Dataset, values: xr.DataArray, name: str, index: int) -> None:
    axes.plot(data["time"], values.sel(controller=name).isel(trial=-1), **styled(index), label=name)


def _by_draw(data: xr.Dataset, name: str, metric: str) -> Array:
    """Return a metric by draw, or that of the one draw that there is."""
    if "scores" in data:
        return of_draws(data, name, metric)
    values: Array = data[metric].sel(controller=name).values[-1:]
    return values


def _disturbed(data: xr.Dataset) -> bool:
    return bool(np.nan_to_num(data["added"].values).any())


def _mark_kicks(axes: Axes, data: xr.Dataset) -> None:
    kicks = data["time"].values[np.nan_to_num(data["added"].values) != 0]
    for number, at in enumerate(kicks):
        axes.axvline(at, color="grey", linestyle=":", linewidth=1.2, label=None if number else "disturbance")


def response(data: xr.Dataset) -> Figure:
    """Draw reference and outputs, the disturbance marked."""
    with plt.rc_context(STYLE):
        curve = not _disturbed(data) and float(data["time"].max()) > 100
        figure, panels = plt.subplots(1, 3 if curve else 1, figsize=(11.0, 4.2) if curve else (7.0, 4.2), squeeze=False)
        windows = [None, (0.0, 30.0), (355.0, 435.0)] if curve else [None]
        for axes, window in zip(panels[0], windows, strict=True):
            axes.plot(data["time"], data["reference"], color="black", linewidth=2.2, alpha=0.5, label="reference")
            for index, name in enumerate(ran(data)):
                _curve(axes, data, data["output"], name, index)
            _mark_kicks(axes, data)
            axes.set(xlabel=axis_label(data["time"]), ylabel=axis_label(data["output"]))
            if window:
                axes.set_xlim(*window)
                inside = (data["time"] >= window[0]) & (data["time"] <= window[1])
                shown = data["reference"].values[inside.values]
                axes.set_ylim(shown.min() - 1, shown.max() + 1)
                axes.set_title("setting off" if window[0] == 0 else "braking")
        panels[0][0].legend(fontsize=9)
        return figure


def error(data: xr.Dataset) -> Figure:
    """Draw the error of every law."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        for index, name in enumerate(ran(data)):
            _curve(axes, data, data["error"], name, index)
        _mark_kicks(axes, data)
        axes.set(xlabel=axis_label(data["time"]), ylabel=axis_label(data["error"]))
        axes.legend(fontsize=9)
        return figure


def factors(data: xr.Dataset) -> Figure:
    """Draw p1, p2 and the gain p1 - p2 f over time."""
    with plt.rc_context(STYLE):
        figure, panels = plt.subplots(3, 1, sharex=True, figsize=(7.0, 7.2))
        kinds = {"p1": data["p1"], "p2": data["p2"], "gain p1 - p2 f": data["p1"] - data["p2"] * data["f"]}
        for axes, (label, values) in zip(panels, kinds.items(), strict=True):
            for index, name in enumerate(ran(data)):
                _curve(axes, data, values, name, index)
            _mark_kicks(axes, data)
            axes.set_ylabel(label)
        panels[-1].set_xlabel(axis_label(data["time"]))
        panels[0].legend(fontsize=9, ncols=2)
        return figure


def comfort_energy(data: xr.Dataset) -> Figure:
    """Draw the largest jerk against its limit, and the energy index: medians over the draws, their 10-90 % range."""
    sampling_time = float(data["time"][1] - data["time"][0])
    r = data["reference"].values[:-1]
    names = ran(data)
    target = indices(r, r, sampling_time)
    curve = not _disturbed(data)
    with plt.rc_context(STYLE):
        figure, panels = plt.subplots(1, 2, figsize=(9.0, 4.2))
        for axes, metric in zip(panels, ("max_jerk", "energy_index"), strict=True):
            runs = [_by_draw(data, name, metric) for name in names]
            low, middle, high = (np.array([np.quantile(run, q) for run in runs]) for q in (0.1, 0.5, 0.9))
            axes.bar(range(len(names)), middle, color=[COLOURS[i % len(COLOURS)] for i in range(len(names))], alpha=0.8)
            axes.errorbar(
                range(len(names)), middle, [middle - low, high - middle], linestyle="none", color="black", capsize=3
            )
            if curve:
                axes.axhline(target[metric], color="black", linestyle="--", label="target curve itself")
            axes.set_xticks(range(len(names)), names, rotation=25, ha="right")
            axes.set_ylabel(axis_label(data[metric]))
            axes.set_ylim(
                0, 1.35 * max(high.max(), target[metric] if curve else 0.0, JERK_LIMIT / 1.2 * (axes is panels[0]))
            )
        panels[0].axhline(JERK_LIMIT, color="red", linestyle=":", label="limit")
        panels[0].legend(fontsize=9, loc="upper left")
        return figure


def seeds(data: xr.Dataset, against: str = AGAINST) -> Figure:
    """Draw how the four error integrals spread over the draws, relative to those of fipid."""
    names = [name for name in ran(data) if name != against]
    with plt.rc_context(STYLE):
        figure, panels = plt.subplots(1, 4, figsize=(11.0, 4.2), sharey=True)
        for axes, index in zip(panels, FOUR, strict=True):
            base = _by_draw(data, against, index)
            ratios = [_by_draw(data, name, index) / base for name in names]
            for at, ratio in enumerate(ratios):
                spread = np.linspace(-0.25, 0.25, ratio.size) if np.ptp(ratio) > 0 else np.zeros(ratio.size)
                axes.plot(at + spread, ratio, "o", markersize=3, color=COLOURS[(at + 1) % len(COLOURS)], alpha=0.6)
                axes.plot([at - 0.3, at + 0.3], [np.median(ratio)] * 2, color="black", linewidth=2)
            axes.axhline(1.0, color="grey", linestyle=":")
            axes.set_xticks(range(len(names)), names, rotation=30, ha="right")
            axes.set_title(index.upper())
        panels[0].set_ylabel(f"index relative to {against}, one dot a draw (1)")
        return figure


def grid(data: xr.Dataset) -> Figure:
    """Draw the ISE against the fixed gain p1 = p2, with the medians of the other laws as levels."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        for tuned in data["tuned"].values:
            axes.semilogy(data["grid"], data["grid_ise"].sel(tuned=tuned), "ko-", markersize=3, label=f"{tuned}: tried")
        for index, name in enumerate(ran(data)):
            if name not in data["tuned"].values:
                middle = float(np.median(_by_draw(data, name, "ise")))
                axes.axhline(middle, **styled(index), label=f"{name} (median)")
        axes.set(xlabel=axis_label(data["grid"]), ylabel=axis_label(data["grid_ise"]))
        axes.legend(fontsize=9)
        return figure
