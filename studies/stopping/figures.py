"""Figures of the stopping study, like Figs. 3-11 of Liu, Xun, Gao & Yin (2022), and the tube."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from models.array import Array
from studies.stopping.scores import UPDATE
from studies.stopping.settings import Stopping, own
from workbench.contracts.study import Draw, Study
from workbench.sets import Polytope, minimal_rpi
from workbench.trials.figures import COLOURS, MARKERS, STYLE, axis_label, styled

KINDS = {"rmpc": "RMPC", "rsmpc": "RSMPC", "offset-free": "offset-free MPC"}
TUBE_AT = (1, 5, 10, 20, 40)
"""Samples whose tube sections are drawn."""
PLANE = np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""From x to (v, s)."""


def stopping_figures(study: Study, data: xr.Dataset) -> Mapping[str, Draw]:
    """Return the figures by name, each a function that draws."""
    settings = own(study)
    data = data.dropna("sample", how="all", subset=["speed"])
    shortest, longest = min(settings.lengths), max(settings.lengths)
    shown = ["pid", "ideal-mpc"]
    shown += [f"{kind}-n{N}" for kind in KINDS for N in dict.fromkeys((shortest, longest))]
    figures: dict[str, Draw] = {f"speed_{name}": partial(speed, data, name) for name in shown}
    for kind in KINDS:
        figures[f"speed_error_{kind}"] = partial(speed_error, data, kind, settings.lengths)
    figures["stop_error"] = partial(stop_error, settings, data)
    figures["tube"] = partial(tube, settings, data)
    figures["updates"] = partial(updates, settings, data)
    return figures


def speed(data: xr.Dataset, controller: str) -> Figure:
    """Draw speed and reference over distance, and the brake command on a second axis."""
    one = data.sel(controller=controller)
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        right = axes.twinx()
        axes.plot(data["reference_position"], data["reference_speed"], color="black", alpha=0.5, lw=2.4)
        axes.plot(one["position"], one["speed"], **styled(0))
        right.step(one["position"], one["command"], where="post", color=COLOURS[1], linewidth=1.0)
        right.grid(False)
        axes.set(xlabel="distance (m)", ylabel=axis_label(data["speed"]), ylim=(0, None))
        right.set_ylabel(axis_label(data["command"]), color=COLOURS[1])
        labels = ("reference speed", f"speed, {controller}", "brake command (right)")
        figure.legend([*axes.lines, *right.lines], labels, loc="outside upper center", ncols=3)
        return figure


def speed_error(data: xr.Dataset, kind: str, horizons: tuple[int, ...]) -> Figure:
    """Draw the speed error of one kind of law over distance, one curve a horizon."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        for index, N in enumerate(horizons):
            one = data.sel(controller=f"{kind}-n{N}")
            axes.plot(one["position"], one["speed_error"], **styled(index), label=f"N = {N}")
        axes.set(xlabel="distance (m)", ylabel=axis_label(data["speed_error"]), title=KINDS[kind])
        axes.legend(ncols=2)
        return figure


def stop_error(settings: Stopping, data: xr.Dataset) -> Figure:
    """Draw where the train stopped relative to the mark against the horizon, with the laws that have none."""
    off = 100 * (data["stop_position"] - settings.curve.stop_position)
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots()
        for index, kind in enumerate(KINDS):
            values = [float(off.sel(controller=f"{kind}-n{N}")) for N in settings.lengths]
            axes.plot(settings.lengths, values, **styled(index), marker=MARKERS[index], label=KINDS[kind])
        for index, name in enumerate(("pid", "ideal-mpc"), len(KINDS)):
            axes.axhline(float(off.sel(controller=name)), **styled(index), label=name)
        axes.axhline(50, color="0.5", linewidth=1)
        axes.axhline(-50, color="0.5", linewidth=1)
        axes.set(xlabel="horizon N (samples)", ylabel="stopping error (cm), limits at ±50", xticks=settings.lengths)
        figure.legend(loc="outside upper center", ncols=3)
        return figure


def tube(settings: Stopping, data: xr.Dataset) -> Figure:
    """Draw the tube around the reference in the plane of speed and position errors, and the true errors in it."""
    design = settings.design
    lag = design.plant.prediction_error
    names = [
        f"rmpc-n{max(settings.lengths)}",
        f"rsmpc-n{max(settings.lengths)}",
        f"offset-free-n{max(settings.lengths)}",
    ]
    with plt.rc_context(STYLE):
        figure, (whole, near) = plt.subplots(1, 2, figsize=(10.0, 4.6))
        for axes in (whole, near):
            for shade, i in enumerate(TUBE_AT):
                corners = (design.F(i) + lag).mapped(PLANE).outline()
                axes.fill(*corners.T, facecolor="none", edgecolor=str(0.75 - 0.12 * shade), label=f"tube, {i} samples")
            limit = (minimal_rpi(design.A_cl, design.W_z).partial + lag).mapped(PLANE).outline()
            axes.fill(*limit.T, facecolor=COLOURS[4], alpha=0.25, label="tube, in the end")
            for index, name in enumerate(names):
                one = data.sel(controller=name)
                axes.plot(one["speed_error"], one["position"] - data["reference_position"], **styled(index), label=name)
            axes.plot(0, 0, "k+", markersize=10)
            axes.set(xlabel="speed error (m/s)", ylabel="position error (m)")
        whole.fill(*shadow(design.Sigma).T, facecolor="0.93", zorder=0, label="invariant set Σ, projected")
        whole.add_patch(_box(settings.design.bounds.h, "black", "bounds X"))
        whole.add_patch(_box(settings.design.X_z.h, COLOURS[3], "tightened by the delay"))
        whole.set(title="bounds and tube")
        near.set(title="the runs", xlim=_around(data, names, "v"), ylim=_around(data, names, "s"))
        handles, labels = whole.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=9)
        return figure


def shadow(polytope: Polytope, directions: int = 40) -> Array:
    """Return corners of the projection of a bounded polytope onto (v, s), (directions, 2): where its faces meet."""
    angles = np.linspace(0, 2 * np.pi, directions, endpoint=False)
    scale = np.array([polytope.support(row) for row in PLANE])  # the two axes have different units
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=1) / scale
    reach = np.array([polytope.support(normal @ PLANE) for normal in normals])
    pairs = [np.array([i, (i + 1) % directions]) for i in range(directions)]
    return np.array([np.linalg.solve(normals[pair], reach[pair]) for pair in pairs])


def _box(h: Array, colour: str, label: str) -> Rectangle:
    """Return the rectangle of the bounds on v and s, of offsets [u+, u-, v+, v-, s+, s-]."""
    corner, width, height = (-h[3], -h[5]), h[2] + h[3], h[4] + h[5]
    return Rectangle(corner, width, height, fill=False, edgecolor=colour, linestyle="--", label=label)


def _around(data: xr.Dataset, names: list[str], which: str) -> tuple[float, float]:
    some = data.sel(controller=names)
    values = some["speed_error"] if which == "v" else some["position"] - data["reference_position"]
    low, high = min(float(values.min()), 0.0), max(float(values.max()), 0.0)
    room = 0.15 * (high - low) + 1e-3
    return low - room, high + room


def updates(settings: Stopping, data: xr.Dataset) -> Figure:
    """Draw when RMPC and RSMPC changed the command: one row a law, one mark an update."""
    names = [f"{kind}-n{N}" for N in settings.lengths for kind in ("rmpc", "rsmpc")]
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(7.0, 1.4 + 0.32 * len(names)))
        for row, name in enumerate(names):
            at = data["time"].values[np.abs(data["increment"].sel(controller=name).values) > UPDATE]
            axes.plot(at, np.full(at.size, row), "|", color=COLOURS[row % 2], markersize=9, markeredgewidth=1.0)
        axes.set(xlabel="time (s)", yticks=range(len(names)), yticklabels=names, title="updates of the brake command")
        axes.invert_yaxis()
        return figure
