"""Figures of the ato study, like the paper's 4 to 6, and what the paper does not show: weights and seeds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import pyplot as plt

from studies.ato.scores import FOUR, indices
from workbench.trials.figures import COLOURS, STYLE, axis_label, styled

JERK_LIMIT = 0.75


def ato_figures(study: Any, data: xr.Dataset) -> Mapping[str, Callable[[], Any]]:
    """Return the figures of a step or curve test by name."""
    figures: dict[str, Callable[[], Any]] = {
        "response": partial(response, data),
        "error": partial(error, data),
        "factors": partial(factors, data),
        "comfort_energy": partial(comfort_energy, data),
    }
    if data.sizes["seed"] > 1:
        figures["seeds"] = partial(seeds, data)
    if "grid_ise" in data:
        figures["grid"] = partial(grid, data)
    return figures


def _names(data: xr.Dataset) -> list[str]:
    return [str(name) for name in data["controller"].values]


def _banded(axes: Any, data: xr.Dataset, kind: str, name: str, index: int) -> None:
    """Draw the median over seeds, and the 10-90 % range where the seeds differ."""
    values = data[kind].sel(controller=name).values
    time = data["time"].values
    low, middle, high = np.quantile(values, [0.1, 0.5, 0.9], axis=0)
    axes.plot(time, middle, **styled(index), label=name)
    if not np.array_equal(low[np.isfinite(low)], high[np.isfinite(high)]):
        axes.fill_between(time, low, high, color=COLOURS[index % len(COLOURS)], alpha=0.15, linewidth=0)


def _mark_kicks(axes: Any, data: xr.Dataset) -> None:
    kicks = data["time"].values[np.nan_to_num(data["added"].values) != 0]
    for number, at in enumerate(kicks):
        axes.axvline(at, color="grey", linestyle=":", linewidth=1.2, label=None if number else "disturbance")


def response(data: xr.Dataset) -> Any:
    """Draw reference and outputs: medians over the seeds with their 10-90 % range, the disturbance marked."""
    with plt.rc_context(STYLE):
        curve = not np.nan_to_num(data["added"].values).any()
        figure, panels = plt.subplots(1, 3 if curve else 1, figsize=(11.0, 4.2) if curve else (7.0, 4.2), squeeze=False)
        windows = [None, (0.0, 30.0), (355.0, 435.0)] if curve else [None]
        for axes, window in zip(panels[0], windows, strict=True):
            axes.plot(data["time"], data["reference"], color="black", linewidth=2.2, alpha=0.5, label="reference")
            for index, name in enumerate(_names(data)):
                _banded(axes, data, "output", name, index)
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


def error(data: xr.Dataset) -> Any:
    """Draw the error of every law: medians over the seeds with their 10-90 % range."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        for index, name in enumerate(_names(data)):
            _banded(axes, data, "error", name, index)
        _mark_kicks(axes, data)
        axes.set(xlabel=axis_label(data["time"]), ylabel=axis_label(data["error"]))
        axes.legend(fontsize=9)
        return figure


def factors(data: xr.Dataset) -> Any:
    """Draw p1, p2 and the gain p1 - p2 f over time: medians over the seeds with their 10-90 % range."""
    with plt.rc_context(STYLE):
        figure, panels = plt.subplots(3, 1, sharex=True, figsize=(7.0, 7.2))
        whole = data.assign(gain=data["p1"] - data["p2"] * data["f"])
        for axes, kind, label in zip(panels, ("p1", "p2", "gain"), ("p1", "p2", "gain p1 - p2 f"), strict=True):
            for index, name in enumerate(_names(data)):
                _banded(axes, whole.isel(sample=slice(0, -1)), kind, name, index)
            _mark_kicks(axes, data)
            axes.set_ylabel(label)
        panels[-1].set_xlabel(axis_label(data["time"]))
        panels[0].legend(fontsize=9, ncols=2)
        return figure


def comfort_energy(data: xr.Dataset) -> Any:
    """Draw the largest jerk against its limit, and the energy index, of every law and of the reference itself."""
    sampling_time = float(data["time"][1] - data["time"][0])
    r = data["reference"].values[:-1]
    names = _names(data)
    target = indices(r, r, sampling_time)
    curve = not np.nan_to_num(data["added"].values).any()
    with plt.rc_context(STYLE):
        figure, panels = plt.subplots(1, 2, figsize=(9.0, 4.2))
        for axes, metric in zip(panels, ("max_jerk", "energy_index"), strict=True):
            runs = [data[metric].sel(controller=name).values for name in names]
            low, middle, high = (np.array([np.quantile(run, q) for run in runs]) for q in (0.1, 0.5, 0.9))
            axes.bar(range(len(names)), middle, color=COLOURS[: len(names)], alpha=0.8)
            axes.errorbar(
                range(len(names)), middle, [middle - low, high - middle], linestyle="none", color="black", capsize=3
            )
            if curve:
                axes.axhline(target[metric], color="black", linestyle="--", label="target curve itself")
            axes.set_xticks(range(len(names)), names, rotation=25, ha="right")
            axes.set_ylabel(f"{axis_label(data[metric])}")
            axes.set_ylim(
                0, 1.35 * max(high.max(), target[metric] if curve else 0.0, JERK_LIMIT / 1.2 * (axes is panels[0]))
            )
        panels[0].axhline(JERK_LIMIT, color="red", linestyle=":", label="limit")
        panels[0].legend(fontsize=9, loc="upper left")
        return figure


def seeds(data: xr.Dataset, against: str = "fipid") -> Any:
    """Draw how the four error integrals spread over the seeds, relative to those of fipid."""
    names = [name for name in _names(data) if name != against]
    with plt.rc_context(STYLE):
        figure, panels = plt.subplots(1, 4, figsize=(11.0, 4.2), sharey=True)
        for axes, index in zip(panels, FOUR, strict=True):
            base = data[index].sel(controller=against)
            ratios = [(data[index].sel(controller=name) / base).values for name in names]
            for at, ratio in enumerate(ratios):
                spread = np.linspace(-0.25, 0.25, ratio.size) if np.ptp(ratio) > 0 else np.zeros(ratio.size)
                axes.plot(at + spread, ratio, "o", markersize=3, color=COLOURS[(at + 1) % len(COLOURS)], alpha=0.6)
                axes.plot([at - 0.3, at + 0.3], [np.median(ratio)] * 2, color="black", linewidth=2)
            axes.axhline(1.0, color="grey", linestyle=":")
            axes.set_xticks(range(len(names)), names, rotation=30, ha="right")
            axes.set_title(index.upper())
        panels[0].set_ylabel(f"index relative to {against}, one dot a seed (1)")
        return figure


def grid(data: xr.Dataset) -> Any:
    """Draw the ISE against the fixed gain p1 = p2, with those of the other laws as levels."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        for tuned in data["tuned"].values:
            axes.semilogy(data["grid"], data["grid_ise"].sel(tuned=tuned), "ko-", markersize=3, label=f"{tuned}: tried")
        for index, name in enumerate(_names(data)):
            if name not in data["tuned"].values:
                middle = float(np.median(data["ise"].sel(controller=name)))
                axes.axhline(middle, **styled(index), label=f"{name} (median)")
        axes.set(xlabel=axis_label(data["grid"]), ylabel=axis_label(data["grid_ise"]))
        axes.legend(fontsize=9)
        return figure
