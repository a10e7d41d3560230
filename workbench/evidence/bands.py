"""Figures of bands that hold every trial, and of bounds of errors by trial, with the recorded trials in them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from models.array import Array
from workbench.trials.figures import STYLE, pretty, styled

MOST = 60  # recorded trials that are drawn


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
    """Draw the band of every signal over the samples, with recorded trials inside."""
    with plt.rc_context(STYLE):
        width, height = plt.rcParams["figure.figsize"]
        figure, axes = plt.subplots(
            len(panels), 1, sharex=True, squeeze=False, figsize=(width, 0.45 * height * len(panels) + 0.6)
        )
        for ax, panel in zip(axes[:, 0], panels, strict=True):
            k = np.arange(panel.low.size)
            ax.fill_between(k, panel.low, panel.high, color="0.85", linewidth=0, label="every trial stays in here")
            ax.plot(k, panel.low, color="0.45", linewidth=0.8)
            ax.plot(k, panel.high, color="0.45", linewidth=0.8)
            count = panel.recorded.shape[0]
            chosen = np.unique(np.linspace(0, max(count - 1, 0), min(count, MOST)).astype(int))
            colour = styled(0)["color"]
            for i, trial in enumerate(chosen):
                ax.plot(
                    k,
                    panel.recorded[trial, : k.size],
                    color=colour,
                    linewidth=0.6,
                    alpha=0.6,
                    label=None if i else "recorded trials",
                )
            if panel.wanted is not None:
                ax.plot(k, panel.wanted[: k.size], color="black", linewidth=1.0, linestyle="--", label="reference")
            ax.set_ylabel(f"{panel.name} ({pretty(panel.unit)})")
        axes[-1, 0].set_xlabel("sample k")
        axes[0, 0].set_title(title)
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
        return figure


def learning_curve(title: str, bound: Array, recorded: Array, *, final: float | None, unit: str) -> Figure:
    """Draw the bound of the mean square error by trial over the recorded errors, and what it goes to."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        trials = np.arange(1, bound.size + 1)
        axes.semilogy(trials, bound, **styled(1), label="proved bound")
        axes.semilogy(trials[: recorded.size], recorded, **styled(0), label="recorded")
        if final is not None and final > 1e-6 * float(bound[-1]):
            axes.axhline(final, color="0.45", linewidth=1.0, linestyle=":", label="the bound as trials go on")
        axes.set(xlabel="trial i", ylabel=f"MSE ({pretty(unit)})", title=title)
        axes.legend()
        return figure
