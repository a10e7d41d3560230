"""PALC: periodic adaptive learning control of a maglev shuttle (Zhang, Nan, Cao et al.)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, NamedTuple, Self

from models.expression import Expression
from models.plant import Signal, signals
from models.quantity import count, declared, given, quantity, rebuilt
from models.vehicle import Vehicle
from workbench.contracts.law import Channels, Law, LearnedSignal, Task, Trial
from workbench.controllers.parts.rows import ones, zeros
from workbench.controllers.parts.shuttle_force import base_force, errors, late_by, overlong
from workbench.controllers.parts.vehicle_model import believed, lacking, needed


class Memory(NamedTuple):
    """What the law reads as the line resistance one period ago, (1, N), in N, and what rides along."""

    d_hat: Expression
    before: Expression
    """The line resistance learned in the last period, (1, N); d_hat is the same, late by the error of the period."""
    learning: Expression
    """0 in the first period, then 1."""
    sampling_time: Expression


class State(NamedTuple):
    """The line resistance learned at the sample, in N."""

    d_hat: Expression


@declared
class PALC(Law[Memory, State]):
    """u = M dv_d/dt + D(v) - M [(alpha + lam) e_v + alpha lam e_x] + d_hat, d_hat(t) = d_hat(t - P) - k S(t).

    d_hat is 0 in the first period; learning acts within the period, with the S of the same instant. ``late`` is
    the number of samples by which the period that the law assumes is too long (ours).
    Ours: the force is held over a sample, so dv_d/dt is the reference's mean over the coming one.
    """

    source: ClassVar[str] = "Zhang, Nan, Cao et al., PALC of a maglev train, (8)-(13)"
    channels: ClassVar[Channels] = Channels(outputs=2, inputs=1)
    told: ClassVar[tuple[str, ...]] = ("reference", "model")
    learns_on: ClassVar[LearnedSignal | None] = "output"
    tells: ClassVar[tuple[Signal, ...]] = signals(line_resistance=("N", "learned line resistance"))

    model: Vehicle | None = given(default=None, doc="what the law knows of what it moves; None: as the task says")
    late: int = count(
        default=0, unit="samples", doc="by how much the assumed period is too long; below 0: too short", least=-math.inf
    )
    alpha: float = quantity(default=0.4, unit="1/s", doc="gain on S", above=0)
    lam: float = quantity(default=0.22, unit="1/s", doc="weight of the position error in S", above=0)
    gamma: float = quantity(default=0.2, unit="1/s", doc="learning gain k over the mass", above=0)

    def ready_for(self, task: Task) -> Self:
        """Return the law with the task's model, where it was given none of its own."""
        return rebuilt(self, {"model": believed(self.model, task)})

    def refusal(self, task: Task) -> str | None:
        """Return the refusal of a task whose plant is no vehicle, for a law without a model of its own."""
        return lacking(self, believed(self.model, task)) or overlong(self.late, task)

    def start(self, task: Task) -> Memory:
        """Return nothing learned."""
        nothing = zeros(1, task.samples)
        return Memory(nothing, nothing, zeros(), task.sampling_time)

    def ready(self, memory: Memory) -> State:
        """Return a state to fill."""
        return State(zeros())

    def act(
        self, memory_k: Memory, state: State, r: Expression, r_next: Expression, y: Expression
    ) -> tuple[tuple[Expression], State]:
        """Return the force and the line resistance learned."""
        e = errors(r, y, self.lam)
        model = needed(self, self.model)
        d_hat = memory_k.d_hat - memory_k.learning * self.gamma * model.mass * e.s  # (13)
        acceleration = (r_next[1] - r[1]) / memory_k.sampling_time
        return (base_force(model, e, acceleration, y[1], self.alpha, self.lam) + d_hat,), State(d_hat)  # (12)

    def learn(self, memory: Memory, trial: Trial[State]) -> Memory:
        """Return what was learned, as the next period will read it."""
        now = trial.state.d_hat
        return Memory(late_by(self.late, memory.before, now), now, ones(), memory.sampling_time)

    def tell(self, memory: Memory, trial: Trial[State]) -> tuple[Expression]:
        """Return the learned line resistance."""
        return (trial.state.d_hat,)

    def ranges(self, task: Task) -> Mapping[str, tuple[float, float]]:
        """Return the gains to tune, which the mass and the time that the law knows make independent of the plant."""
        return {"alpha": (0.05, 20.0), "lam": (1e-3, 5.0), "gamma": (1e-3, 5.0)}
