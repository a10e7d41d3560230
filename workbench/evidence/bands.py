"""Figures of bands that hold every trial, and of bounds of errors by trial, with the recorded trials in them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from models.array import Array
from workbench.trials.figures import STYLE, pretty, styled

MOST = 60
"""Recorded trials that are drawn."""
THIN = 0.05
"""A band is thin that is narrower than this share of what its panel spans."""
OFTEN = 1 / 3
"""A band that is thin at this share of the samples gets a panel close up."""
CLOSER = 1 / 3
"""The largest share of the span that a panel close up may show."""


class Panel(NamedTuple):
    """One signal: its band, and what was recorded of it."""

    name: str
    unit: str
    low: Array
    """(samples,)."""
    high: Array
    recorded: Array
    """(trials, samples), NaN where a trial did not reach."""
    wanted: Array | None = None
    """The reference, where there is one."""


def bands(title: str, panels: Sequence[Panel]) -> Figure:
    """Draw the band of every signal over the samples, with recorded trials inside.

    Where a band is thin for many samples a second panel shows it close up.
    """
    with plt.rc_context(STYLE):
        width, height = plt.rcParams["figure.figsize"]
        rows: list[tuple[Panel, tuple[float, float] | None]] = []
        for panel in panels:
            rows.append((panel, None))
            if (ends := close_up(panel.low, panel.high)) is not None:
                rows.append((panel, ends))
        figure, axes = plt.subplots(
            len(rows), 1, sharex=True, squeeze=False, figsize=(width, 0.45 * height * len(rows) + 0.6)
        )
        for ax, (panel, ends) in zip(axes[:, 0], rows, strict=True):
            _draw(ax, panel)
            ax.set_ylabel(_label(panel.name, panel.unit))
            if ends is not None:
                ax.set_ylim(*ends)
                ax.set_title("close up", loc="right", fontsize="small")
        axes[-1, 0].set_xlabel("sample k")
        axes[0, 0].set_title(title)
        figure.align_ylabels(axes[:, 0])
        shown = {
            label: handle
            for ax in axes[:, 0]
            for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)
        }  # fmt: skip
        legend = figure.legend(list(shown.values()), list(shown), loc="outside lower center", ncols=len(shown))
        for line in legend.get_lines():
            line.set(linewidth=1.6, alpha=1.0)
        return figure


def close_up(low: Array, high: Array) -> tuple[float, float] | None:
    """Return what a panel has to show for a thin band to be seen, or None where it is not thin, or that is no help."""
    width, span = high - low, float(high.max() - low.min())
    thin = width < THIN * span
    if thin.mean() < OFTEN:
        return None
    least, most = float(np.quantile(low[thin], 0.05)), float(np.quantile(high[thin], 0.95))
    if not 0 < most - least <= CLOSER * span:
        return None
    room = 0.25 * (most - least)
    return least - room, most + room


def _draw(ax: Axes, panel: Panel) -> None:
    k = np.arange(panel.low.size)
    ax.fill_between(k, panel.low, panel.high, color="0.85", linewidth=0, label="every trial stays in here")
    count = panel.recorded.shape[0]
    chosen = np.unique(np.linspace(0, max(count - 1, 0), min(count, MOST)).astype(int))
    for i, trial in enumerate(chosen):
        ax.plot(
            k,
            panel.recorded[trial, : k.size],
            color=styled(0)["color"],
            linewidth=0.6,
            alpha=0.6,
            label=None if i else "recorded trials",
        )
    if panel.wanted is not None:
        ax.plot(k, panel.wanted[: k.size], color="black", linewidth=1.2, linestyle="--", zorder=4, label="reference")
    for end in (panel.low, panel.high):  # above the trials, which may run along an end
        ax.plot(k, end, color="0.35", linewidth=0.9, zorder=3)


def learning_curve(title: str, bound: Array, recorded: Array, *, final: float | None, unit: str) -> Figure:
    """Draw the bound of the mean square error by trial over the recorded errors, and what it goes to."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        trials = np.arange(1, bound.size + 1)
        axes.semilogy(trials, bound, **styled(1), label="proved bound")
        axes.semilogy(trials[: recorded.size], recorded[: bound.size], **styled(0), label="recorded")
        if final is not None and final > 1e-6 * float(bound[-1]):
            axes.axhline(final, color="0.25", linewidth=1.2, linestyle=":", label="the bound as trials go on")
        axes.set(xlabel="trial i", ylabel=_label("MSE", unit), title=title)
        axes.legend()
        return figure


def _label(name: str, unit: str) -> str:
    """Return ``name (unit)``, or the name alone of what has no unit."""
    return f"{name} ({pretty(unit)})" if unit not in ("", "1") else name
