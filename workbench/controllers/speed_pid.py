"""PID control of an error with feed-forward, limited, with the integral held at the limit."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import numpy as np

from models.quantity import InvalidValue, declared, quantity


class Integral(NamedTuple):
    """Memory of the law: the integral of the error, in its unit times s, and the error before (None at first)."""

    total: float
    before: float | None


@declared
class SpeedPID:
    """A PID with feed-forward: u = feed + kp e + ki (integral of e) + kd (de/dt), within limits.

    Source: the comparison of Liu et al. 2022, doi 10.16383/j.aas.c200039, which prints no gains. At a limit the
    integral does not grow further.
    """

    source: ClassVar[str] = "Liu, Xun, Gao & Yin 2022, the comparison; gains: ours"

    kp: float = quantity(default=0.7, unit="s/m", doc="proportional gain", structural=True)
    ki: float = quantity(default=0.2, unit="1/m", doc="integral gain", structural=True)
    kd: float = quantity(default=0.2, unit="s^2/m", doc="derivative gain", structural=True)
    sample_time: float = quantity(default=0.2, unit="s", doc="sampling time", above=0, structural=True)
    low: float = quantity(default=0.0, unit="1", doc="least command", structural=True)
    high: float = quantity(default=1.0, unit="1", doc="largest command", structural=True)
    feed: float = quantity(default=0.0, unit="1", doc="the command at no error", structural=True)

    def check(self) -> None:
        """Raise InvalidValue unless the limits are in order."""
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
