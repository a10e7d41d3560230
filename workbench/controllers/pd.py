"""Improved PD-type ILC, the baseline of Jiao & Hou (2025), (18)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import ClassVar, NamedTuple, Self

from models.expression import Expression
from models.quantity import declared, quantity
from workbench.contracts.law import Channels, Law, LearnedSignal, Task, Trial
from workbench.controllers.parts.rows import first_plan, known
from workbench.controllers.parts.scales import scales
from workbench.controllers.parts.square import unequal


class Memory(NamedTuple):
    """The plan of the trial to come, (inputs, N), in force units."""

    u: Expression


@declared
class PD(Law[Memory, tuple[()]]):
    """PD-type ILC with errors set to zero after a trial's end (doi 10.7641/CTA.2024.30465).

    Ours: it computes in units of ``force_unit``, like the laws it is compared with; the published gains are
    read in newtons. Where there are as many inputs as outputs, input i learns from output i, with the same gains.
    """

    source: ClassVar[str] = "Jiao & Hou 2025, (18)"
    channels: ClassVar[Channels] = Channels(None, None)
    told: ClassVar[tuple[str, ...]] = ("reference", "plan")
    learns_on: ClassVar[LearnedSignal | None] = "output"

    kp: float = quantity(default=4.46, unit="force unit/output", doc="gain on the next sample's error")
    kd: float = quantity(default=1000.0, unit="force unit/output", doc="gain on this sample's error")
    force_unit: float = quantity(default=1.0, unit="N", doc="the unit that the law computes forces in", above=0)
    initial_input: float = quantity(
        default=1500.0, unit="N", doc="input of the first trial, where the task gives no first plan"
    )

    def refusal(self, task: Task) -> str | None:
        """Return the refusal of a plant with more inputs than outputs, or fewer."""
        return unequal(self, task)

    def start(self, task: Task) -> Memory:
        """Return the initial plan."""
        return Memory(first_plan(task, self.initial_input, self.force_unit, task.reference.shape[0]))

    def act(
        self, memory_k: Memory, state: tuple[()], r: Expression, r_next: Expression, y: Expression
    ) -> tuple[Expression, tuple[()]]:
        """Return the planned inputs in newtons."""
        return memory_k.u * self.force_unit, state

    def learn(self, memory: Memory, trial: Trial[tuple[()]]) -> Memory:
        """Return the plan for the next trial."""
        e = known(trial.reached, trial.e)  # e*
        return Memory(memory.u + self.kp * e[:, 1:] + self.kd * e[:, :-1])  # (18)

    def ranges(self, task: Task) -> Mapping[str, tuple[float, float]]:
        """Return the gains to tune, about the input that changes the output by one unit a sample."""
        unit = abs(scales(task).step) / self.force_unit
        return {"kp": (1e-5 * unit, 1.0 * unit), "kd": (1e-6 * unit, 1.0 * unit)}

    def scaled_for(self, task: Task) -> Self:
        """Return the law in the unit of input that changes the output by one unit a sample, without a first input."""
        return dataclasses.replace(self, kp=0.1, kd=0.01, force_unit=abs(scales(task).step), initial_input=0.0)
