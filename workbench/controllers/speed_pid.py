"""Proportional-integral-derivative control of an error, limited, with the integral held at the limit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from models.quantity import InvalidValue


class Integral(NamedTuple):
    """Memory of the law: the integral of the error, in its unit times s, and the error before (None at first)."""

    total: float
    before: float | None


@dataclass(frozen=True, kw_only=True)
class SpeedPID:
    """u = feed + kp e + ki (integral of e) + kd (de/dt), within limits.

    Parameters
    ----------
    kp, ki, kd
        Gains, in units of u per m/s, per m and per m/s^2 for a speed error.
    sample_time
        s.
    low, high
        Limits of u.
    feed
        What u is at no error.

    Source: the comparison of Liu et al. 2022, doi 10.16383/j.aas.c200039, which prints no gains. At a limit the
    integral does not grow further.
    """

    kp: float
    ki: float
    kd: float
    sample_time: float
    low: float
    high: float
    feed: float = 0.0

    def __post_init__(self) -> None:
        for name in ("kp", "ki", "kd", "feed"):
            if not np.isfinite(getattr(self, name)):
                raise InvalidValue(f"{name} must be finite, got {getattr(self, name)}")
        if not (np.isfinite(self.sample_time) and self.sample_time > 0):
            raise InvalidValue(f"sample_time must be positive, got {self.sample_time}")
        if not self.low < self.high:
            raise InvalidValue(f"low must be below high, got low {self.low} and high {self.high}")

    def start(self) -> Integral:
        """The memory before the first sample."""
        return Integral(total=0.0, before=None)

    def act(self, memory: Integral, error: float) -> tuple[float, Integral]:
        """u(k) for the error at k, and the memory for the next sample. InvalidValue if the error is not finite."""
        if not np.isfinite(error):
            raise InvalidValue(f"the error must be finite, got {error}; no input is computed from it")
        slope = 0.0 if memory.before is None else (error - memory.before) / self.sample_time
        total = memory.total + error * self.sample_time
        u = self.feed + self.kp * error + self.ki * total + self.kd * slope
        limited = min(max(u, self.low), self.high)
        stuck = u != limited and (u - limited) * error > 0
        return limited, Integral(total=memory.total if stuck else total, before=error)
