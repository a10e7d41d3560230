"""The box of states, inputs, disturbances and times that a proof is stated for."""

from __future__ import annotations

import numpy as np

from models.array import Array
from models.plant import Plant
from verification.enclosure.box import Box
from workbench.evidence.trajectory import Trajectories

MARGIN = 0.05  # of each range, added at both ends


def domain(plant: Plant, taken: Trajectories, w: Array | None = None, margin: float = MARGIN) -> Box:
    """Return the box that holds every recorded trial, widened by ``margin`` of each range.

    Its names are those of the plant's step: x, u, w, k; k runs from 0 to N and is not widened. ``w`` (nw, any) are
    the disturbances met, by default zero.
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
    ranges["k"] = (0.0, float(n))
    return Box(ranges)


def described(plant: Plant, box: Box) -> str:
    """Return the box in words, with names and units."""
    parts = []
    for key, named in (("x", plant.states), ("u", plant.inputs), ("w", plant.disturbances)):
        lower, upper = box[key]
        for i, signal in enumerate(named):
            parts.append(f"{signal.name} in [{lower[i, 0]:.4g}, {upper[i, 0]:.4g}] {signal.unit}")
    lower, upper = box["k"]
    parts.append(f"k in [{lower[0, 0]:g}, {upper[0, 0]:g}]")
    return ", ".join(parts)


def _wider(lower: Array, upper: Array, margin: float) -> tuple[Array, Array]:
    room = margin * (upper - lower)
    return lower - room, upper + room
