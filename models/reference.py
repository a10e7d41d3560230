"""Speed profiles to follow."""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np

from models.plant import Plant
from models.quantity import InvalidValue, count, declared, given, quantity

MOST_SAMPLES = 1_000_000


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
        if last > MOST_SAMPLES:
            raise InvalidValue(
                f"sampling_time must be at least {self.horizon / MOST_SAMPLES:g} s for a run of {self.horizon} s "
                f"({MOST_SAMPLES} samples), got {float(plant.sampling_time):g}"
            )
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


def grid(duration: float, sampling_time: Any, what: str) -> Any:
    """Return the sample instants 0..duration in seconds, both ends included, shape (N + 1,).

    Raises InvalidValue unless the duration is a multiple of the sampling time.
    """
    step = float(sampling_time)
    samples = round(duration / step)
    if abs(samples * step - duration) > 1e-9 * duration:
        raise InvalidValue(f"{what} must be a multiple of the sampling time of {step:g} s, got {duration:.9g} s")
    return np.arange(samples + 1) * step


def integrated_steps(instants: tuple[float, ...], changes: tuple[float, ...], t: Any, times: int) -> Any:
    """Return the ``times``-fold integral of a sum of steps of height ``changes`` at ``instants``; same shape as t."""
    raised = (change * np.maximum(t - at, 0) ** times for at, change in zip(instants, changes, strict=True))
    return sum(raised) / math.factorial(times)


@declared
class Trapezoid:
    """One run from standstill to standstill at a constant acceleration, speed and deceleration."""

    distance: float = quantity(unit="m", doc="distance run", above=0)
    speed: float = quantity(unit="m/s", doc="largest speed", above=0)
    acceleration: float = quantity(unit="m/s^2", doc="acceleration and deceleration", above=0)

    def check(self) -> None:
        """Raise InvalidValue where the distance is too short for the speed."""
        if self.speed**2 / self.acceleration > self.distance * (1 + 1e-12):
            raise InvalidValue(
                f"speed must be reached within the distance of {self.distance:g} m at {self.acceleration:g} m/s^2 "
                f"(at most {math.sqrt(self.distance * self.acceleration):.4g} m/s), got {self.speed:g}"
            )

    @property
    def duration(self) -> float:
        """Running time in seconds."""
        return self.distance / self.speed + self.speed / self.acceleration

    @property
    def changes(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Instants (s) and heights (m/s^2) of the steps of the acceleration."""
        rise, a = self.speed / self.acceleration, self.acceleration
        return (0.0, rise, self.duration - rise, self.duration), (a, -a, -a, a)


@declared
class Shuttle:
    """There and back between two stations, standing at each: one period, outputs position and speed."""

    distance: float = quantity(default=1580.0, unit="m", doc="distance between the stations", above=0)
    speed: float = quantity(default=30.0, unit="m/s", doc="largest speed", above=0)
    acceleration: float = quantity(default=0.9, unit="m/s^2", doc="acceleration and deceleration", above=0)
    standing: float = quantity(default=3.0, unit="s", doc="standing time at each station", least=0)

    def check(self) -> None:
        """Raise InvalidValue where the distance is too short for the speed."""
        Trapezoid(distance=self.distance, speed=self.speed, acceleration=self.acceleration)

    @property
    def period(self) -> float:
        """Seconds from one departure to the next."""
        run = Trapezoid(distance=self.distance, speed=self.speed, acceleration=self.acceleration)
        return 2 * (run.duration + self.standing)

    def samples(self, plant: Plant) -> Any:
        """Return position and speed, shape (2, N + 1), N being the period in samples."""
        run = Trapezoid(distance=self.distance, speed=self.speed, acceleration=self.acceleration)
        t = grid(self.period, plant.sampling_time, "the period")
        instants, heights = run.changes
        back = tuple(at + self.period / 2 for at in instants)
        both = instants + back, heights + tuple(-height for height in heights)
        rows = np.stack([integrated_steps(*both, t, 2), integrated_steps(*both, t, 1)])
        rows[:, -1] = 0.0
        return rows


@declared
class StationRun:
    """One run from a station to the next, its acceleration smoothed by a moving average: position and speed."""

    distance: float = quantity(default=1500.0, unit="m", doc="distance between the stations", above=0)
    speed: float = quantity(default=20.0, unit="m/s", doc="largest speed", above=0)
    acceleration: float = quantity(default=0.8, unit="m/s^2", doc="acceleration and deceleration", above=0)
    smoothing: float = quantity(default=2.0, unit="s", doc="width of the moving average", above=0)
    standing: float = quantity(default=2.0, unit="s", doc="standing time after arrival", least=0)

    def check(self) -> None:
        """Raise InvalidValue where the distance is too short for the speed."""
        Trapezoid(distance=self.distance, speed=self.speed, acceleration=self.acceleration)

    def samples(self, plant: Plant) -> Any:
        """Return position and speed, shape (2, N + 1)."""
        run = Trapezoid(distance=self.distance, speed=self.speed, acceleration=self.acceleration)
        t = grid(run.duration + self.smoothing + self.standing, plant.sampling_time, "the running time")
        rows = [
            integrated_steps(*run.changes, t, times) - integrated_steps(*run.changes, t - self.smoothing, times)
            for times in (3, 2)
        ]
        return np.stack(rows) / self.smoothing
