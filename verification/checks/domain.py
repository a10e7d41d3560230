"""The box of states, inputs, disturbances and samples that a proof is stated for."""

from __future__ import annotations

import math

import numpy as np

from models.array import Array
from models.named_signals import Signal
from models.plant import Plant
from verification.enclosure.box import Box
from workbench.evidence.trajectory import Trajectories

MARGIN = 0.05  # of each range, added at both ends


def domain(plant: Plant, taken: Trajectories, w: Array | None = None, margin: float = MARGIN) -> Box:
    """Return the box that holds every recorded trial, widened by ``margin`` of each range.

    Its names are those of the plant's step: x, u, w, k. k is whole and not widened: the steps of a trial of N samples
    are those at 0 to N - 1, the last of which leads to the state at N. ``w`` (nw, any) are the disturbances met, by
    default zero. Where a signal declares a domain its range is cut to it, for the equations mean nothing beyond; a
    range that lies beyond it altogether stays as it is.
    """
    n = taken.u.shape[1]
    reached = np.arange(n)[None, :] < taken.lengths[:, None]
    applied = taken.u[reached & np.isfinite(taken.u)]
    lower = np.nanmin(taken.x, axis=(0, 2))
    upper = np.nanmax(taken.x, axis=(0, 2))
    ranges: dict[str, tuple[Array | float, Array | float]] = {"x": _wider(lower, upper, margin)}
    others = np.zeros(len(plant.inputs) - 1)
    low_u, high_u = _wider(np.array([applied.min()]), np.array([applied.max()]), margin)
    ranges["u"] = (np.concatenate([low_u, others]), np.concatenate([high_u, others]))
    met = np.zeros((len(plant.disturbances), 1)) if w is None else np.asarray(w, dtype=float)
    ranges["w"] = _wider(met.min(axis=1), met.max(axis=1), margin) if met.size else (np.zeros(0), np.zeros(0))
    for key, named in _named(plant):
        ranges[key] = _within(named, *ranges[key])
    ranges["k"] = (0.0, float(n - 1))
    return Box(ranges, whole=("k",))


def _named(plant: Plant) -> tuple[tuple[str, tuple[Signal, ...]], ...]:
    return ("x", plant.states), ("u", plant.inputs), ("w", plant.disturbances)


def _within(named: tuple[Signal, ...], lower: Array | float, upper: Array | float) -> tuple[Array, Array]:
    """Return a range cut to the domains that signals declare."""
    low, high = np.array(lower, dtype=float), np.array(upper, dtype=float)
    for i, signal in enumerate(named):
        least, most = _domain(signal)
        if low[i] <= most and high[i] >= least:
            low[i], high[i] = max(low[i], least), min(high[i], most)
    return low, high


def _domain(signal: Signal) -> tuple[float, float]:
    least, most = signal.domain or (None, None)
    return -math.inf if least is None else least, math.inf if most is None else most


def described(plant: Plant, box: Box) -> str:
    """Return the box in words, with names and units."""
    parts = []
    for key, named in _named(plant):
        lower, upper = box[key]
        for i, signal in enumerate(named):
            parts.append(
                f"{signal.name} in [{lower[i, 0]:.4g}, {upper[i, 0]:.4g}] {signal.unit}"
                + _cut(signal, float(lower[i, 0]), float(upper[i, 0]))
            )
    lower, upper = box["k"]
    kind = "whole k" if "k" in box.whole else "k"
    parts.append(f"{kind} in [{lower[0, 0]:g}, {upper[0, 0]:g}]")
    return ", ".join(parts)


def _cut(signal: Signal, lower: float, upper: float) -> str:
    """Return in words that a range ends where the signal's domain does, or lies beyond it."""
    least, most = _domain(signal)
    if lower > most or upper < least:
        return " (beyond its domain)"
    return " (cut to its domain)" if lower == least or upper == most else ""


def _wider(lower: Array, upper: Array, margin: float) -> tuple[Array, Array]:
    room = margin * (upper - lower)
    return lower - room, upper + room
