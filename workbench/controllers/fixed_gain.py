"""D-type ILC with a fixed gain and initial-state learning: what a variable gain is compared with."""

from __future__ import annotations

from typing import ClassVar

from models.expression import Expression
from models.quantity import choice, declared, quantity, switch
from workbench.contracts.law import Channels, Law, LearnedSignal, Task, Trial
from workbench.controllers.parts import d_type
from workbench.controllers.parts.d_type import Memory


@declared
class FixedGain(Law[Memory, tuple[()]]):
    """F <- F + lam d/dt e_v, x(0) <- x(0) + lam0 e(0); outputs are position and speed.

    Ours: d/dt as the forward difference over a sample, F_0 the reference's acceleration.
    """

    source: ClassVar[str] = "Nanjing Institute of Technology, patent application 2017, (3), (5), with a constant gain"
    channels: ClassVar[Channels] = Channels(outputs=2, inputs=1)
    told: ClassVar[tuple[str, ...]] = ("reference", "plan")
    learns_on: ClassVar[LearnedSignal | None] = "output"

    lam: float = quantity(default=1.0, unit="1", doc="learning gain", above=0)
    lam0: float = quantity(default=0.6, unit="1", doc="lambda_0, gain of initial-state learning", above=0, below=2)
    learns: str = choice(default="speed", options=("speed", "position"), doc="the output whose slope is learned from")
    initial_learning: bool = switch(default=True, doc="whether the initial state is learned")

    def start(self, task: Task) -> Memory:
        """Return the first plan (by default the reference's acceleration), and a start that was not moved."""
        return d_type.first(task)

    def place(self, memory: Memory, x0: Expression) -> Expression:
        """Return the initial state: position and speed as learned."""
        return d_type.placed(memory, x0)

    def act(
        self, memory_k: Memory, state: tuple[()], r: Expression, r_next: Expression, y: Expression
    ) -> tuple[Expression, tuple[()]]:
        """Return the planned force."""
        return memory_k.F, state

    def learn(self, memory: Memory, trial: Trial[tuple[()]]) -> Memory:
        """Return plan and start for the next trial."""
        rise = d_type.rise(trial, 1 if self.learns == "speed" else 0)
        F = memory.F + self.lam * rise / memory.sampling_time  # (3)
        moved = d_type.moved(memory, trial, self.lam0, self.initial_learning)  # (5)
        return Memory(F, moved, memory.sampling_time)
