"""A constant deceleration to a stop: the reference of the stopping study."""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from models.array import Array
from models.plant import Plant
from models.quantity import declared, quantity

At = TypeVar("At", float, Array)


@declared
class BrakingCurve:
    """A constant deceleration from a speed at position 0: v = v0 - a t, s = v0 t - a t^2 / 2, also past the stop.

    Source: Liu, Xun, Gao & Yin 2022, doi 10.16383/j.aas.c200039.
    """

    speed: float = quantity(default=20.0, unit="m/s", doc="speed at the start", above=0, structural=True)
    deceleration: float = quantity(default=0.5, unit="m/s^2", doc="deceleration", above=0, structural=True)

    @property
    def stop_time(self) -> float:
        """When the curve stops, in seconds."""
        return self.speed / self.deceleration

    @property
    def stop_position(self) -> float:
        """Where the curve stops, in metres."""
        return self.speed**2 / (2 * self.deceleration)

    def at(self, t: At) -> tuple[At, At]:
        """Return speed in m/s and position in m at t seconds; same shape as t."""
        return self.speed - self.deceleration * t, self.speed * t - self.deceleration * t * t / 2

    def samples(self, plant: Plant) -> Array:
        """Return the speed down to the stop, shape (1, N + 1), for a plant whose output is a speed in m/s."""
        period = float(plant.sampling_time)
        t = np.arange(int(self.stop_time / period + 1e-9) + 1, dtype=float) * period
        return np.asarray(self.at(t)[0])[None, :]
