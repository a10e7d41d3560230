"""Speed profiles made of raised cosines: smooth changes between constant speeds."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from models.array import Array
from models.plant import Plant
from models.quantity import InvalidValue, count, declared, given
from models.reference import Reference


@declared
class RaisedCosines(Reference):
    """A profile that moves from speed to speed along half cosines; constant before, between and after.

    ``moves`` holds (from second, to second, from speed, to speed), one after the other.
    """

    horizon: int = count(doc="N, the last sample", unit="samples", least=2)
    moves: tuple[tuple[float, float, float, float], ...] = given(doc="the changes of speed")

    def check(self) -> None:
        """Raise InvalidValue unless the moves follow each other in time and join in speed."""
        if not self.moves or any(begin >= end for begin, end, _, _ in self.moves):
            raise InvalidValue("moves must hold at least one change that ends after it began")
        for before, after in pairwise(self.moves):
            if after[0] < before[1] or after[2] != before[3]:
                raise InvalidValue(f"moves must follow each other, got {after} after {before}")

    def samples(self, plant: Plant) -> Array:
        """Return the speed, shape (1, N + 1)."""
        t = np.arange(self.horizon + 1) * float(plant.sampling_time)
        speed = np.full(t.shape, self.moves[0][2])
        for begin, end, low, high in self.moves:
            along = np.clip((t - begin) / (end - begin), 0.0, 1.0)
            speed = speed + (high - low) * (1 - np.cos(np.pi * along)) / 2
        return speed[None, :]
