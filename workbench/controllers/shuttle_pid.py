"""PID with feed-forward and compensation of the known resistance: the maglev shuttle's baseline."""

from __future__ import annotations

from typing import ClassVar, NamedTuple, Self

from models.expression import Expression
from models.quantity import declared, given, quantity, rebuilt
from models.vehicle import Vehicle
from workbench.contracts.law import Channels, Law, LearnedSignal, Task, Trial
from workbench.controllers.parts.rows import zeros
from workbench.controllers.parts.shuttle_force import base_force, errors
from workbench.controllers.parts.vehicle_model import believed, lacking, needed


class Memory(NamedTuple):
    """The integral of e_x in m s at the beginning of the trial, and the sampling time."""

    integral: Expression
    sampling_time: Expression


class State(NamedTuple):
    """The integral of e_x in m s."""

    integral: Expression


@declared
class ShuttlePID(Law[Memory, State]):
    """u = M dv_d/dt + D(v) - M [(alpha + lam) e_v + alpha lam e_x] - Ki integral of e_x.

    Ours, as the paper's gains are lost: the same PD terms, feed-forward and compensation as PALC has; the integral
    runs on from one period to the next, and is summed after the force is computed. dv_d/dt is the reference's mean
    over the coming sample, as PALC has it.
    """

    source: ClassVar[str] = "Zhang, Nan, Cao et al., PALC of a maglev train, the PID of figures 4-12"
    channels: ClassVar[Channels] = Channels(outputs=2, inputs=1)
    told: ClassVar[tuple[str, ...]] = ("reference", "model")
    learns_on: ClassVar[LearnedSignal | None] = "output"

    model: Vehicle | None = given(default=None, doc="what the law knows of what it moves; None: as the task says")
    alpha: float = quantity(default=0.4, unit="1/s", doc="gain on S", above=0)
    lam: float = quantity(default=0.22, unit="1/s", doc="weight of the position error in S", above=0)
    ki_over_m: float = quantity(default=0.01, unit="1/s^3", doc="integral gain over the mass", least=0)

    def ready_for(self, task: Task) -> Self:
        """Return the law with the task's model, where it was given none of its own."""
        return rebuilt(self, {"model": believed(self.model, task)})

    def refusal(self, task: Task) -> str | None:
        """Return the refusal of a task whose plant is no vehicle, for a law without a model of its own."""
        return lacking(self, believed(self.model, task))

    def start(self, task: Task) -> Memory:
        """Return an empty integral."""
        return Memory(zeros(), task.sampling_time)

    def ready(self, memory: Memory) -> State:
        """Return the integral that the last trial ended with."""
        return State(memory.integral)

    def act(
        self, memory_k: Memory, state: State, r: Expression, r_next: Expression, y: Expression
    ) -> tuple[tuple[Expression], State]:
        """Return the force, and the integral with this sample's error."""
        e = errors(r, y, self.lam)
        acceleration = (r_next[1] - r[1]) / memory_k.sampling_time
        model = needed(self, self.model)
        force = base_force(model, e, acceleration, y[1], self.alpha, self.lam)
        force = force - self.ki_over_m * model.mass * state.integral
        return (force,), State(state.integral + e.x * memory_k.sampling_time)

    def learn(self, memory: Memory, trial: Trial[State]) -> Memory:
        """Return the integral for the next trial to go on with; nothing else is kept."""
        return Memory(trial.state.integral[-1], memory.sampling_time)
