"""PID: the law that everything else is compared with."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import casadi as ca

from models.quantity import declared, quantity
from workbench.contracts.law import Law, Task


class Memory(NamedTuple):
    """What rides along: the sampling time in seconds."""

    sampling_time: Any


class Acting(NamedTuple):
    """The integral of the error and the last error."""

    integral: Any
    e: Any


@declared
class PID(Law):
    """u(k) = kp e(k) + ki Ts sum of e + kd (e(k) - e(k-1))/Ts, in units of ``input_unit``; no learning, no limits."""

    source: ClassVar[str] = "Astrom & Hagglund, PID Controllers, 1995, positional form"

    kp: float = quantity(default=1.0, unit="input unit/output", doc="proportional gain", least=0)
    ki: float = quantity(default=0.1, unit="input unit/(output s)", doc="integral gain", least=0)
    kd: float = quantity(default=0.0, unit="input unit s/output", doc="derivative gain", least=0)
    input_unit: float = quantity(default=1.0, unit="plant's input", doc="the unit that the law gives u in", above=0)

    def start(self, task: Task) -> Memory:
        """Return the sampling time."""
        return Memory(ca.MX(task.sampling_time) if isinstance(task.sampling_time, ca.MX) else ca.DM(task.sampling_time))

    def ready(self, memory: Memory) -> Acting:
        """Return the state before the first sample: everything 0."""
        return Acting(0, 0)

    def act(self, memory_k: Memory, state: Acting, r: Any, r_next: Any, y: Any) -> tuple[Any, Acting]:
        """Return the input and the state after a sample."""
        e = r[0] - y[0]
        integral = state.integral + memory_k.sampling_time * e
        u = self.kp * e + self.ki * integral + self.kd * (e - state.e) / memory_k.sampling_time
        return u * self.input_unit, Acting(integral, e)
