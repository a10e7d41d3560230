"""What outputs should follow."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike

from models.array import Array
from models.plant import Plant
from models.quantity import InvalidValue, declared, given


class Reference(ABC):
    """What a study's outputs should follow: samples 0..N of every output."""

    @abstractmethod
    def samples(self, plant: Plant) -> Array:
        """Return the reference, shape (outputs, N + 1), in the units of the plant's outputs."""


@declared
class Given(Reference):
    """A reference given as numbers: shape (N + 1,) for one output or (outputs, N + 1)."""

    values: ArrayLike = given(doc="the samples 0..N of every output")

    def check(self) -> None:
        """Raise InvalidValue unless the values are finite and at least three samples long."""
        try:
            array = np.atleast_2d(np.asarray(self.values, dtype=float))
        except (TypeError, ValueError):
            raise InvalidValue("reference must be an array of numbers, shape (N + 1,) or (outputs, N + 1)") from None
        if array.ndim != 2 or array.shape[1] < 3:
            raise InvalidValue(
                f"reference must have shape (N + 1,) or (outputs, N + 1), N at least 2; got {array.shape}"
            )
        if not np.isfinite(array).all():
            bad = np.argwhere(~np.isfinite(array))[0]
            raise InvalidValue(f"reference must be finite at every sample, got {array[tuple(bad)]} at sample {bad[1]}")

    def __eq__(self, other: object) -> bool:
        """Tell whether another reference has the same samples."""
        return isinstance(other, Given) and np.array_equal(np.asarray(self.values), np.asarray(other.values))

    def __hash__(self) -> int:
        return hash(np.asarray(self.values, dtype=float).tobytes())

    def samples(self, plant: Plant) -> Array:
        """Return the values, shape (outputs, N + 1)."""
        array = np.atleast_2d(np.asarray(self.values, dtype=float))
        if array.shape[0] != len(plant.outputs):
            raise InvalidValue(
                f"reference must have {len(plant.outputs)} row(s), one an output of {plant.name}, got {array.shape[0]}"
            )
        return array
