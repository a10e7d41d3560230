"""PALC: periodic adaptive learning control of a maglev shuttle (Zhang, Nan, Cao et al.)."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import casadi as ca

from models.plant import Signal, signals
from models.quantity import declared, given, quantity
from workbench.contracts.law import Law, LearnedSignal, Task, Trial
from workbench.controllers.parts.nominal_model import NominalModel, lacking, needed
from workbench.controllers.parts.shuttle_force import base_force, errors, late_by


class Memory(NamedTuple):
    """What the law reads as the line resistance one period ago, (1, N), in N, and what rides along."""

    d_hat: Any
    before: Any
    """The line resistance learned in the last period, (1, N); d_hat is the same, late by the error of the period."""
    learning: Any
    """0 in the first period, then 1."""
    sampling_time: Any


class State(NamedTuple):
    """The line resistance learned at the sample, in N."""

    d_hat: Any


@declared
class PALC(Law):
    """u = M dv_d/dt + D(v) - M [(alpha + lam) e_v + alpha lam e_x] + d_hat, d_hat(t) = d_hat(t - P) - k S(t).

    d_hat is 0 in the first period; learning acts within the period, with the S of the same instant. ``late`` is
    the number of samples by which the period that the law assumes is too long (ours; see the study's period_error).
    Ours: the force is held over a sample, so dv_d/dt is the reference's mean over the coming one.
    """

    source: ClassVar[str] = "Zhang, Nan, Cao et al., PALC of a maglev train, (8)-(13)"
    learns_on: ClassVar[LearnedSignal | None] = "output"
    tells: ClassVar[tuple[Signal, ...]] = signals(line_resistance=("N", "learned line resistance"))

    model: NominalModel | None = given(default=None, doc="what the law knows of what it moves; the study gives it")
    late: int = given(default=0, doc="samples by which the assumed period is too long; the study gives its own")
    alpha: float = quantity(default=0.4, unit="1/s", doc="gain on S", above=0)
    lam: float = quantity(default=0.22, unit="1/s", doc="weight of the position error in S", above=0)
    gamma: float = quantity(default=0.2, unit="1/s", doc="learning gain k over the mass", above=0)

    def refusal(self, study: Any) -> str | None:
        """Return the refusal of a study that gives no model."""
        return lacking(self, self.model)

    def start(self, task: Task) -> Memory:
        """Return nothing learned."""
        nothing = ca.DM.zeros(1, task.samples)
        return Memory(nothing, nothing, ca.DM.zeros(1, 1), task.sampling_time)

    def ready(self, memory: Memory) -> State:
        """Return a state to fill."""
        return State(ca.DM.zeros(1, 1))

    def act(self, memory_k: Memory, state: State, r: Any, r_next: Any, y: Any) -> tuple[Any, State]:
        """Return the force and the line resistance learned."""
        e = errors(r, y, self.lam)
        model = needed(self, self.model)
        d_hat = memory_k.d_hat - memory_k.learning * self.gamma * model.mass * e.s  # (13)
        acceleration = (r_next[1] - r[1]) / memory_k.sampling_time
        return (base_force(model, e, acceleration, y[1], self.alpha, self.lam) + d_hat,), State(d_hat)  # (12)

    def learn(self, memory: Memory, trial: Trial) -> Memory:
        """Return what was learned, as the next period will read it."""
        now = trial.state.d_hat
        return Memory(late_by(self.late, memory.before, now), now, ca.DM.ones(1, 1), memory.sampling_time)

    def tell(self, memory: Memory, trial: Trial) -> Any:
        """Return the learned line resistance."""
        return (trial.state.d_hat,)
