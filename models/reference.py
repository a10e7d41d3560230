"""Speed profiles to follow."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from models.plant import Plant
from models.quantity import InvalidValue, count, declared, given


class Reference(Protocol):
    """What a study's outputs should follow: samples 0..N of every output."""

    def samples(self, plant: Plant) -> Any:
        """Return the reference, shape (outputs, N + 1), in the units of the plant's outputs."""


def metro_speed(k: Any) -> Any:
    """Return the reference speed at k in 0..2000, Jiao & Hou (2025), (16); same shape as k."""
    k = np.asarray(k, dtype=float)
    return np.select(
        [k <= 338, k <= 700, k <= 1000, k <= 1600],
        [-35 / 57122 * (k - 338) ** 2 + 70, k / 181 + 12332 / 181, -0.01 * k + 79, k / 600 + 202 / 3],
        -7 / 16000 * (k - 1600) ** 2 + 70,
    )


@declared
class MetroProfile:
    """The inter-station run (16): k is the sample index, or seconds where the plant's reading says so."""

    horizon: int = count(default=2000, doc="k at the end of the run", least=2, most=2000)

    def samples(self, plant: Plant) -> Any:
        """Return the speed, shape (1, N + 1)."""
        if getattr(plant, "reading", "metro") != "seconds":
            return metro_speed(np.arange(self.horizon + 1))[None, :]
        last = round(self.horizon / float(plant.sampling_time))
        return metro_speed(np.minimum(np.arange(last + 1) * float(plant.sampling_time), 2000.0))[None, :]


@declared
class Given:
    """A reference given as numbers: shape (N + 1,) for one output or (outputs, N + 1)."""

    values: Any = given(doc="the samples 0..N of every output")

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

    def samples(self, plant: Plant) -> Any:
        """Return the values, shape (outputs, N + 1)."""
        array = np.atleast_2d(np.asarray(self.values, dtype=float))
        if array.shape[0] != len(plant.outputs):
            raise InvalidValue(
                f"reference must have {len(plant.outputs)} row(s), one an output of {plant.name}, got {array.shape[0]}"
            )
        return array
