"""The speed profile of Jiao & Hou (2025), doi 10.7641/CTA.2024.30465, equation (16)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from models.array import Array
from models.plant import Plant
from models.quantity import InvalidValue, count, declared
from models.reference import Reference

MOST_SAMPLES = 1_000_000


def metro_speed(k: ArrayLike) -> Array:
    """Return the reference speed at k in 0..2000, Jiao & Hou (2025), (16); same shape as k."""
    k = np.asarray(k, dtype=float)
    return np.select(
        [k <= 338, k <= 700, k <= 1000, k <= 1600],
        [-35 / 57122 * (k - 338) ** 2 + 70, k / 181 + 12332 / 181, -0.01 * k + 79, k / 600 + 202 / 3],
        -7 / 16000 * (k - 1600) ** 2 + 70,
    )


@declared
class MetroProfile(Reference):
    """The inter-station run (16): k is the sample index, or seconds where the plant's clock counts them."""

    horizon: int = count(default=2000, doc="k at the end of the run", least=2, most=2000)

    def samples(self, plant: Plant) -> Array:
        """Return the speed, shape (1, N + 1)."""
        if plant.clock == "samples":
            return metro_speed(np.arange(self.horizon + 1))[None, :]
        last = round(self.horizon / float(plant.sampling_time))
        if last > MOST_SAMPLES:
            raise InvalidValue(
                f"sampling_time must be at least {self.horizon / MOST_SAMPLES:g} s for a run of {self.horizon} s "
                f"({MOST_SAMPLES} samples), got {float(plant.sampling_time):g}"
            )
        return metro_speed(np.minimum(np.arange(last + 1) * float(plant.sampling_time), 2000.0))[None, :]
