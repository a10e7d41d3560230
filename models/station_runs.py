"""Runs from a standstill to the next, position and speed: integrals of an acceleration made of steps."""

from __future__ import annotations

import math

import numpy as np

from models.array import Array
from models.plant import Plant
from models.quantity import InvalidValue, declared, quantity
from models.reference import Reference


def grid(duration: float, sampling_time: float, what: str) -> Array:
    """Return the sample instants 0..duration in seconds, both ends included, shape (N + 1,).

    Raises InvalidValue unless the duration is a multiple of the sampling time.
    """
    step = float(sampling_time)
    samples = round(duration / step)
    if abs(samples * step - duration) > 1e-9 * duration:
        raise InvalidValue(f"{what} must be a multiple of the sampling time of {step:g} s, got {duration:.9g} s")
    return np.arange(samples + 1, dtype=float) * step


def integrated_steps(instants: tuple[float, ...], changes: tuple[float, ...], t: Array, times: int) -> Array:
    """Return the ``times``-fold integral of a sum of steps of height ``changes`` at ``instants``; same shape as t."""
    raised = (change * np.maximum(t - at, 0) ** times for at, change in zip(instants, changes, strict=True))
    return sum(raised, np.zeros_like(t)) / math.factorial(times)


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
class Shuttle(Reference):
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

    def samples(self, plant: Plant) -> Array:
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
class StationRun(Reference):
    """One run from a station to the next, its acceleration smoothed by a moving average: position and speed."""

    distance: float = quantity(default=1500.0, unit="m", doc="distance between the stations", above=0)
    speed: float = quantity(default=20.0, unit="m/s", doc="largest speed", above=0)
    acceleration: float = quantity(default=0.8, unit="m/s^2", doc="acceleration and deceleration", above=0)
    smoothing: float = quantity(default=2.0, unit="s", doc="width of the moving average", above=0)
    standing: float = quantity(default=2.0, unit="s", doc="standing time after arrival", least=0)

    def check(self) -> None:
        """Raise InvalidValue where the distance is too short for the speed."""
        Trapezoid(distance=self.distance, speed=self.speed, acceleration=self.acceleration)

    def samples(self, plant: Plant) -> Array:
        """Return position and speed, shape (2, N + 1)."""
        run = Trapezoid(distance=self.distance, speed=self.speed, acceleration=self.acceleration)
        t = grid(run.duration + self.smoothing + self.standing, plant.sampling_time, "the running time")
        rows = [
            integrated_steps(*run.changes, t, times) - integrated_steps(*run.changes, t - self.smoothing, times)
            for times in (3, 2)
        ]
        return np.stack(rows) / self.smoothing
