"""Figures of what a campaign shows of the PPD and of convergence: they take results and draw."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypedDict

import numpy as np
from matplotlib import colors
from matplotlib import pyplot as plt
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from models.array import Array
from workbench.evidence.ppd import Evidence
from workbench.evidence.sweeps import Grid, Sweep
from workbench.trials.figures import COLOURS, MARKERS, STYLE, pretty, styled


class ImageStyle(TypedDict):
    """How maps by trial and sample are drawn."""

    aspect: Literal["auto"]
    origin: Literal["lower"]
    interpolation: Literal["nearest"]


MAPS: ImageStyle = {"aspect": "auto", "origin": "lower", "interpolation": "nearest"}


def three_along(evidence: Evidence, trials: Sequence[int]) -> Figure:
    """Draw partial derivative, realised ratio and estimate over the samples of some trials (numbers from 1)."""
    chosen = [trial for trial in trials if 2 <= trial <= evidence.ratio.shape[0]]
    with plt.rc_context({**STYLE, "figure.figsize": (7.0, 1.0 + 2.2 * len(chosen))}):
        figure, axes = plt.subplots(len(chosen), 1, sharex=True, squeeze=False)
        scale = float(np.nanmax(np.abs(evidence.partial)))
        least = 30 * scale  # of the axis on either side, so that it shows more than one tick
        for ax, trial in zip(axes[:, 0], chosen, strict=True):
            row = trial - 1
            ax.plot(
                evidence.ratio[row],
                color=COLOURS[1],
                marker=".",
                markersize=2,
                linestyle="none",
                label="realised ratio",
            )
            ax.plot(evidence.estimate[row], **styled(2), label="estimate")
            ax.plot(evidence.partial[row], color="black", linewidth=2, label="partial derivative")
            ax.set_yscale("symlog", linthresh=10 * scale)
            low, high = ax.get_ylim()
            ax.set_ylim(min(low, -least), max(high, least))
            ax.set(ylabel=evidence.unit, title=f"{evidence.controller}, trial {trial}")
        axes[-1, 0].set_xlabel("sample k")
        axes[0, 0].legend(loc="upper right", fontsize=9)
        return figure


def _map(values: Array, norm: Normalize, label: str, title: str, colours: str) -> Figure:
    with plt.rc_context({**STYLE, "axes.grid": False}):
        figure, axes = plt.subplots()
        trials, samples = values.shape
        shown = axes.imshow(values, norm=norm, cmap=colours, extent=(0, samples, 0.5, trials + 0.5), **MAPS)
        figure.colorbar(shown, ax=axes, label=label)
        axes.set(xlabel="sample k", ylabel="trial i", title=title)
        return figure


def error_map(evidence: Evidence) -> Figure:
    """Draw the relative error of the estimate against the partial derivative, trial by sample."""
    error = np.clip(evidence.relative_error(), 1e-3, 1e3)
    norm = colors.LogNorm(1e-3, 1e3)
    return _map(error, norm, "|estimate - partial| / |partial| (1)", evidence.controller, "cividis")


def sign_map(evidence: Evidence) -> Figure:
    """Draw realised ratio over partial derivative, trial by sample: at or below 0 assumption A4 fails."""
    relative = evidence.relative_ratio()
    norm = colors.SymLogNorm(1.0, vmin=-1e3, vmax=1e3)
    label = "realised ratio / partial derivative (1)"
    return _map(np.clip(relative, -1e3, 1e3), norm, label, evidence.controller, "PuOr")


def contraction_map(controller: str, factor: Array) -> Figure:
    """Draw the contraction factor of Theorem 1, trial by sample: outside (-1, 1) its argument fails."""
    norm = colors.SymLogNorm(1.0, vmin=-1e3, vmax=1e3)
    label = "1 - rho phi_c phi / (lambda + phi^2) (1)"
    return _map(np.clip(factor, -1e3, 1e3), norm, label, controller, "PuOr")


def excitation_map(controller: str, share: Array) -> Figure:
    """Draw the share by which a trial's data could move the estimate, trial by sample."""
    norm = colors.LogNorm(1e-8, 1.0)
    label = "eta du^2 / (mu + du^2) (1)"
    return _map(np.clip(share, 1e-8, 1.0), norm, label, controller, "cividis")


def ratio_histogram(evidence: Evidence) -> Figure:
    """Draw how often realised ratio over partial derivative takes which value."""
    relative = evidence.relative_ratio()
    relative = relative[np.isfinite(relative)]
    edges: list[float] = np.logspace(-2, 6, 41).tolist()
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        for index, (values, label) in enumerate(
            ((relative[relative > 0], "positive"), (-relative[relative <= 0], "not positive"))
        ):
            axes.hist(
                np.clip(values, edges[0], edges[-1]),
                edges,
                histtype="step",
                linewidth=1.8,
                label=label,
                **styled(index),
            )
        axes.axvline(1.0, color="black", linewidth=1, label="partial derivative")
        axes.set(
            xscale="log",
            yscale="log",
            xlabel="|realised ratio| / partial derivative (1)",
            ylabel="trials and samples (count)",
            title=evidence.controller,
        )
        axes.legend()
        return figure


def error_by_trial(controller: str, error: Array, excitation: Array, resets: Array) -> Figure:
    """Draw quantiles (rows 10, 50, 90 %) of the estimate's error by trial, with excitation and resets below."""
    trials = np.arange(1, error.shape[1] + 1)
    with plt.rc_context({**STYLE, "figure.figsize": (7.0, 5.6)}):
        figure, (top, bottom) = plt.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        top.fill_between(trials, error[0], error[2], color=COLOURS[0], alpha=0.25, label="10 to 90 %")
        top.plot(trials, error[1], **styled(0), label="median")
        top.set(yscale="log", ylabel="relative error (1)", title=f"{controller}: estimate against partial derivative")
        top.legend()
        bottom.plot(trials, np.maximum(excitation[1], 1e-12), **styled(2), label="excitation share, median")
        bottom.plot(trials, np.maximum(resets, 1e-12), **styled(1), label="share of samples reset (13)")
        bottom.set(yscale="log", ylim=(1e-8, 2), xlabel="trial i", ylabel="share (1)")
        bottom.legend()
        return figure


def error_by_sample(controller: str, error: Array) -> Figure:
    """Draw quantiles (rows 10, 50, 90 %) of the estimate's error by sample."""
    samples = np.arange(error.shape[1])
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        axes.fill_between(samples, error[0], error[2], color=COLOURS[0], alpha=0.25, label="10 to 90 % of trials")
        axes.plot(samples, error[1], **styled(0), label="median of trials")
        axes.set(yscale="log", ylim=(1e-4, None), xlabel="sample k", ylabel="relative error (1)", title=controller)
        axes.legend()
        return figure


def lambda_sweep(
    controller: str, found: Sweep, lines: dict[str, float], used: float, *, units: tuple[str, str] = ("1", "1")
) -> Figure:
    """Draw last and largest MSE against lambda, with predicted boundaries and the lambda used as lines.

    ``units`` are those of lambda and of the MSE.
    """
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        axes.loglog(found.values, found.mse_last, marker=MARKERS[0], **styled(0), label="last MSE")
        finite = np.isfinite(found.mse_peak)
        axes.loglog(found.values[finite], found.mse_peak[finite], marker=MARKERS[1], **styled(1), label="largest MSE")
        gone = found.values[~finite]
        top = float(np.nanmax(np.where(finite, found.mse_peak, np.nan))) * 10 if finite.any() else 1.0
        axes.scatter(gone, np.full(gone.size, top), marker="x", color="black", label="diverged")
        axes.axvline(used, color="black", linewidth=1.2, label=f"used: {used:.3g}")
        for index, (label, value) in enumerate(lines.items(), start=2):
            axes.axvline(value, **styled(index), label=f"{label}: {value:.3g}")
        axes.set(xlabel=f"lambda ({pretty(units[0])})", ylabel=f"MSE ({pretty(units[1])})", title=controller)
        axes.legend(fontsize=8.5)
        return figure


def sweep_map(
    controller: str,
    found: Grid,
    lines: dict[str, Array],
    used: tuple[float, float],
    *,
    units: tuple[str, str, str] = ("1", "1", "1"),
) -> Figure:
    """Draw the last MSE over lambda and force unit, predicted boundaries as lines over the units, and what is used.

    ``units`` are those of the output, of the input and of the MSE.
    """
    with plt.rc_context({**STYLE, "axes.grid": False}):
        figure, axes = plt.subplots()
        norm = colors.LogNorm()
        shown = axes.pcolormesh(
            found.force_unit, found.lam, found.mse_last, norm=norm, cmap="cividis", shading="nearest"
        )
        figure.colorbar(shown, ax=axes, label=f"last MSE ({pretty(units[2])})")
        across, up = np.meshgrid(found.force_unit, found.lam)
        gone = ~(np.nan_to_num(found.mse_last, nan=np.inf) < found.mse_first)
        axes.scatter(across[gone], up[gone], marker="x", color="black", s=22, label="diverges, or ends above trial 1")
        for index, (label, values) in enumerate(lines.items()):
            axes.plot(found.force_unit, values, color="#D00000", linestyle=("-", "--")[index % 2], label=label)
        axes.scatter(*used, marker="*", s=160, color="white", edgecolor="black", label="used", zorder=3)
        axes.set(xscale="log", yscale="log", xlabel=f"force unit ({units[1]})")
        axes.set_ylabel(pretty(f"lambda (({units[0]} per force unit)^2)"))
        axes.set(title=controller, ylim=(found.lam[0] / 2, found.lam[-1] * 2))
        figure.legend(fontsize=8.5, loc="outside lower center", ncols=2)
        return figure


def predicted_against_observed(controller: str, predicted: Array, observed: Array, *, unit: str = "1") -> Figure:
    """Draw the MSE by trial that the frozen lifted map predicts beside the observed one."""
    trials = np.arange(1, observed.size + 1)
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        axes.semilogy(trials, observed, **styled(0), label="observed")
        axes.semilogy(trials[: predicted.size], predicted, **styled(1), label="predicted by the frozen map")
        axes.set(xlabel="trial i", ylabel=f"MSE ({pretty(unit)})", title=controller)
        axes.legend()
        return figure


def row_sums(controller: str, off: Array, own: Array, *, unit: str = "1") -> Figure:
    """Draw the lifted plant's row sums off the diagonal beside its diagonal, by sample."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        axes.semilogy(np.where(off > 0, off, np.nan), **styled(1), label="row sum off the diagonal")
        axes.semilogy(own, **styled(0), label="diagonal (partial derivative)")
        lowest = float(own[own > 0].min()) if (own > 0).any() else 1.0
        axes.set(xlabel="sample k", ylabel=unit, title=controller, ylim=(1e-3 * lowest, None))
        axes.legend()
        return figure
