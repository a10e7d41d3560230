"""PID control of an error with feed-forward, limited, with the integral held at the limit."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar, NamedTuple

import casadi as ca
import numpy as np

from models.array import Array
from models.quantity import InvalidValue, declared, given, quantity
from workbench.contracts.law import Channels, Decision, Law, Seen, Task


class Integral(NamedTuple):
    """The acting state: the integral of the error, in its unit times s, and the error before (None at first)."""

    total: float
    before: float | None


class Reference(NamedTuple):
    """The memory, which stays as it is: the first output's reference, (1, N + 1)."""

    r: Array


@declared
class SpeedPID(Law[Reference, Integral]):
    """A PID with feed-forward: u = feed + kp e + ki (integral of e) + kd (de/dt), within limits.

    The error is that of the first output, reference minus output, unless a study says what it is.

    Source: the comparison of Liu et al. 2022, doi 10.16383/j.aas.c200039, which prints no gains. At a limit the
    integral does not grow further.
    """

    source: ClassVar[str] = "Liu, Xun, Gao & Yin 2022, the comparison; gains: ours"
    channels: ClassVar[Channels] = Channels(outputs=None)
    told: ClassVar[tuple[str, ...]] = ("reference",)

    kp: float = quantity(default=0.7, unit="s/m", doc="proportional gain", structural=True)
    ki: float = quantity(default=0.2, unit="1/m", doc="integral gain", structural=True)
    kd: float = quantity(default=0.2, unit="s^2/m", doc="derivative gain", structural=True)
    sample_time: float = quantity(default=0.2, unit="s", doc="sampling time", above=0, structural=True)
    low: float = quantity(default=0.0, unit="1", doc="least command", structural=True)
    high: float = quantity(default=1.0, unit="1", doc="largest command", structural=True)
    feed: float = quantity(default=0.0, unit="1", doc="the command at no error", structural=True)
    error: Callable[[Seen], float] | None = given(
        default=None, doc="the error, given what is seen; None: reference minus the first output"
    )

    def check(self) -> None:
        """Raise InvalidValue unless the limits are in order."""
        if not self.low < self.high:
            raise InvalidValue(f"low must be below high, got low {self.low} and high {self.high}")

    def start(self, task: Task) -> Reference:
        """Return the reference of the first output: it does not learn."""
        return Reference(ca.DM(task.reference).full()[:1])

    def ready(self, memory: Reference) -> Integral:
        """Return the acting state before the first sample."""
        return Integral(total=0.0, before=None)

    def move(self, state: Integral, error: float) -> tuple[float, Integral]:
        """u(k) for the error at k, and the next acting state. InvalidValue if the error is not finite."""
        if not np.isfinite(error):
            raise InvalidValue(f"the error must be finite, got {error}; no input is computed from it")
        slope = 0.0 if state.before is None else (error - state.before) / self.sample_time
        total = state.total + error * self.sample_time
        u = self.feed + self.kp * error + self.ki * total + self.kd * slope
        limited = min(max(u, self.low), self.high)
        stuck = u != limited and (u - limited) * error > 0
        return limited, Integral(total=state.total if stuck else total, before=error)

    def decide(self, memory: Reference, state: Integral, seen: Seen) -> tuple[Decision, Integral]:
        """Return the input for what is seen, and the next acting state."""
        error = float(memory.r[0, seen.k] - seen.y[0]) if self.error is None else self.error(seen)
        u, state = self.move(state, error)
        return Decision(np.array([u])), state
