"""PID: the law that everything else is compared with."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import ClassVar, NamedTuple, Self

from models.expression import Expression
from models.quantity import declared, quantity
from workbench.contracts.law import Channels, Law, PIDAction, Task
from workbench.controllers.parts.rows import zeros
from workbench.controllers.parts.scales import scales
from workbench.controllers.parts.square import unequal


class Memory(NamedTuple):
    """What rides along: the sampling time in seconds, and a zero an output, (outputs, 1)."""

    sampling_time: Expression
    still: Expression


class Acting(NamedTuple):
    """The integral of the error and the last error, (outputs, 1)."""

    integral: Expression
    e: Expression


@declared
class PID(Law[Memory, Acting]):
    """u(k) = kp e(k) + ki Ts sum of e + kd (e(k) - e(k-1))/Ts, in units of ``input_unit``; no learning, no limits.

    Where there are as many inputs as outputs, input i acts on the error of output i, with the same gains.
    """

    source: ClassVar[str] = "Astrom & Hagglund, PID Controllers, 1995, positional form"
    channels: ClassVar[Channels] = Channels(None, None)

    kp: float = quantity(default=1.0, unit="input unit/output", doc="proportional gain", least=0)
    ki: float = quantity(default=0.1, unit="input unit/(output s)", doc="integral gain", least=0)
    kd: float = quantity(default=0.0, unit="input unit s/output", doc="derivative gain", least=0)
    input_unit: float = quantity(default=1.0, unit="plant's input", doc="the unit that the law gives u in", above=0)

    def refusal(self, task: Task) -> str | None:
        """Return the refusal of a plant with more inputs than outputs, or fewer."""
        return unequal(self, task)

    def start(self, task: Task) -> Memory:
        """Return the sampling time, and the zeros with which a trial begins."""
        return Memory(task.sampling_time, zeros(task.reference.shape[0]))

    def ready(self, memory: Memory) -> Acting:
        """Return the state before the first sample: everything 0."""
        return Acting(memory.still, memory.still)

    def act(
        self, memory_k: Memory, state: Acting, r: Expression, r_next: Expression, y: Expression
    ) -> tuple[Expression, Acting]:
        """Return the inputs and the state after a sample."""
        e = r - y
        integral = state.integral + memory_k.sampling_time * e
        u = self.kp * e + self.ki * integral + self.kd * (e - state.e) / memory_k.sampling_time
        return u * self.input_unit, Acting(integral, e)

    def ranges(self, task: Task) -> Mapping[str, tuple[float, float]]:
        """Return the gains to tune, about the input that changes the output by one unit a second."""
        unit = abs(scales(task).rate) / self.input_unit
        return {
            "kp": (0.01 * unit, 100.0 * unit),
            "ki": (1e-4 * unit, 10.0 * unit),
            "kd": (1e-4 * unit, 1.0 * unit),
        }

    def scaled_for(self, task: Task) -> Self:
        """Return the law in the unit of input that changes the output by one unit a second."""
        return dataclasses.replace(self, kp=1.0, ki=0.1, kd=0.01, input_unit=abs(scales(task).rate))

    @property
    def pid(self) -> PIDAction:
        """Its own gains."""
        return PIDAction("positional", self.kp, self.ki, self.kd, self.input_unit)
