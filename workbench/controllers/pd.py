"""Improved PD-type ILC, the baseline of Jiao & Hou (2025), (18)."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

from models.quantity import declared, quantity
from workbench.contracts.law import Law, LearnedSignal, Task, Trial
from workbench.controllers.parts.rows import constant_row, known


class Memory(NamedTuple):
    """The plan of the trial to come, (1, N), in force units."""

    u: Any


@declared
class PD(Law):
    """PD-type ILC with errors set to zero after a trial's end (doi 10.7641/CTA.2024.30465).

    Ours: it computes in units of ``force_unit``, like the laws it is compared with; the published gains are
    read in newtons.
    """

    source: ClassVar[str] = "Jiao & Hou 2025, (18)"
    learns_on: ClassVar[LearnedSignal | None] = "output"

    kp: float = quantity(default=4.46, unit="force unit/output", doc="gain on the next sample's error")
    kd: float = quantity(default=1000.0, unit="force unit/output", doc="gain on this sample's error")
    force_unit: float = quantity(default=1.0, unit="N", doc="the unit that the law computes forces in", above=0)
    initial_input: float = quantity(default=1500.0, unit="N", doc="input of the first trial")

    def start(self, task: Task) -> Memory:
        """Return the initial plan."""
        return Memory(constant_row(self.initial_input / self.force_unit, task.samples))

    def act(self, memory_k: Memory, state: Any, r: Any, r_next: Any, y: Any) -> tuple[Any, Any]:
        """Return the planned input in newtons."""
        return memory_k.u * self.force_unit, state

    def learn(self, memory: Memory, trial: Trial) -> Memory:
        """Return the plan for the next trial."""
        e = known(trial.reached, trial.e)  # e*
        return Memory(memory.u + self.kp * e[1:] + self.kd * e[:-1])  # (18)
