"""D-type ILC whose gain grows with the error, with initial-state learning (patent, Nanjing Inst. of Tech., 2017)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import ClassVar, Self

import casadi as ca

from models.expression import Expression
from models.plant import Signal, signals
from models.quantity import declared, quantity, switch
from workbench.contracts.law import Channels, Law, LearnedSignal, SlopeLearning, Task, Trial
from workbench.controllers.parts import d_type, zero_phase
from workbench.controllers.parts.d_type import Memory
from workbench.controllers.parts.rows import known


@declared
class VariableGain(Law[Memory, tuple[()]]):
    """F <- F + lambda_k(t) d/dt e_v, x(0) <- x(0) + lambda_0 e(0); outputs are position and speed.

    Ours, where the published text is silent or lost: the modifier lambda = lam_min + (1 - lam_min)/(1 + exp(-
    steepness (|e_v|/E|e_v| - 1))), computed from the measured speed error of the same sample, and lam_min where
    E|e_v| is 0; d/dt as the forward difference over a sample, divided by the nominal input gain 1; F_0 the
    reference's acceleration; smoothing of |e_v| by a zero-phase low-pass filter as wide as a moving average of
    ``smoothing_s``.
    """

    source: ClassVar[str] = "Nanjing Institute of Technology, patent application 2017, (3)-(6)"
    channels: ClassVar[Channels] = Channels(outputs=2, inputs=1)
    told: ClassVar[tuple[str, ...]] = ("reference", "plan")
    learns_on: ClassVar[LearnedSignal | None] = "output"
    tells: ClassVar[tuple[Signal, ...]] = signals(learning_gain=("1", "learning gain lambda"))

    lam_min: float = quantity(default=0.3, unit="1", doc="least learning gain", above=0, most=1)
    steepness: float = quantity(default=5.0, unit="1", doc="steepness of the modifier", above=0)
    lam0: float = quantity(default=0.6, unit="1", doc="lambda_0, gain of initial-state learning", above=0, below=2)
    smoothing_s: float = quantity(
        default=0.0, unit="s", doc="time over which |e_v| is smoothed; 0: not", least=0, structural=True
    )
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
        slope = d_type.rise(trial, 1) / memory.sampling_time
        F = memory.F + self.gain(memory, trial) * slope  # (3)
        moved = d_type.moved(memory, trial, self.lam0, self.initial_learning)  # (5)
        return Memory(F, moved, memory.sampling_time)

    def tell(self, memory: Memory, trial: Trial[tuple[()]]) -> tuple[Expression]:
        """Return the gain that the trial is learned from with."""
        return (self.gain(memory, trial),)

    def gain(self, memory: Memory, trial: Trial[tuple[()]]) -> Expression:
        """Return lambda_k(t), (1, N), between lam_min and 1."""
        size = ca.fabs(known(trial.reached, trial.e[1, :]))
        mean = ca.sum2(size) / ca.sum2(trial.reached)
        if self.smoothing_s > 0:
            size = zero_phase.low_pass(size, 0.603 / self.smoothing_s, memory.sampling_time)
        share = size[:-1] / ca.if_else(mean > 0, mean, 1)
        lam = self.lam_min + (1 - self.lam_min) / (1 + ca.exp(-self.steepness * (share - 1)))  # (4), ours
        return ca.if_else(mean > 0, lam, self.lam_min)

    def refusal(self, task: Task) -> str | None:
        """Return the refusal of a smoothing that is too short for the sampling time."""
        least = 2 * 0.603 * float(task.sampling_time)
        if 0 < self.smoothing_s <= least:
            return f"smoothing_s must be 0 or above {least:g} s, got {self.smoothing_s:g}"
        return None

    def ranges(self, task: Task) -> Mapping[str, tuple[float, float]]:
        """Return the least gain and the steepness to tune."""
        return {"lam_min": (0.01, 1.0), "steepness": (0.5, 50.0)}

    def scaled_for(self, task: Task) -> Self:
        """Return the law without initial-state learning: where a trial begins is not its own to choose."""
        return dataclasses.replace(self, initial_learning=False)

    @property
    def slope_learning(self) -> SlopeLearning:
        """Its gain lies between the least one and 1, its input is a force per mass."""
        return SlopeLearning(self.lam_min, 1.0, 1.0)
