"""PID with feed-forward and compensation of the known resistance: the maglev shuttle's baseline."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import casadi as ca

from models.quantity import declared, given, quantity
from workbench.contracts.law import Law, LearnedSignal, Task, Trial
from workbench.controllers.parts.nominal_model import NominalModel, lacking, needed
from workbench.controllers.parts.shuttle_force import base_force, errors


class Memory(NamedTuple):
    """The integral of e_x in m s at the beginning of the trial, and the sampling time."""

    integral: Any
    sampling_time: Any


class State(NamedTuple):
    """The integral of e_x in m s."""

    integral: Any


@declared
class ShuttlePID(Law):
    """u = M dv_d/dt + D(v) - M [(alpha + lam) e_v + alpha lam e_x] - Ki integral of e_x.

    Ours, as the paper's gains are lost: the same PD terms, feed-forward and compensation as PALC has; the integral
    runs on from one period to the next, and is summed after the force is computed. dv_d/dt is the reference's mean
    over the coming sample, as PALC has it.
    """

    source: ClassVar[str] = "Zhang, Nan, Cao et al., PALC of a maglev train, the PID of figures 4-12"
    learns_on: ClassVar[LearnedSignal | None] = "output"

    model: NominalModel | None = given(default=None, doc="what the law knows of what it moves; the study gives it")
    alpha: float = quantity(default=0.4, unit="1/s", doc="gain on S", above=0)
    lam: float = quantity(default=0.22, unit="1/s", doc="weight of the position error in S", above=0)
    ki_over_m: float = quantity(default=0.01, unit="1/s^3", doc="integral gain over the mass", least=0)

    def refusal(self, study: Any) -> str | None:
        """Return the refusal of a study that gives no model."""
        return lacking(self, self.model)

    def start(self, task: Task) -> Memory:
        """Return an empty integral."""
        return Memory(ca.DM.zeros(1, 1), task.sampling_time)

    def ready(self, memory: Memory) -> State:
        """Return the integral that the last trial ended with."""
        return State(memory.integral)

    def act(self, memory_k: Memory, state: State, r: Any, r_next: Any, y: Any) -> tuple[Any, State]:
        """Return the force, and the integral with this sample's error."""
        e = errors(r, y, self.lam)
        acceleration = (r_next[1] - r[1]) / memory_k.sampling_time
        model = needed(self, self.model)
        force = base_force(model, e, acceleration, y[1], self.alpha, self.lam)
        force = force - self.ki_over_m * model.mass * state.integral
        return (force,), State(state.integral + e.x * memory_k.sampling_time)

    def learn(self, memory: Memory, trial: Trial) -> Memory:
        """Return the integral for the next trial to go on with; nothing else is kept."""
        return Memory(trial.state.integral[-1], memory.sampling_time)
