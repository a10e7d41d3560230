"""A robot's joint in rad and N m, with a law of its own that is compared with the library's."""

from typing import ClassVar, NamedTuple

import casadi as ca
import numpy as np

from models import Plant, declared, quantity, signal, signals
from models.actuator import Actuator
from workbench import Law, Study
from workbench.contracts.study import Measures
from workbench.controllers.parts.rows import known


@declared
class Joint(Plant):
    """J dv/dt = torque - damping v; the angular velocity is measured."""

    source: ClassVar[str] = "ours, 2026"
    states = signals(velocity=("rad/s", "angular velocity"), angle=signal("rad", "angle", role="angle"))
    inputs = signals(torque=signal("N m", "torque of the motor", role="torque"))
    outputs = signals(velocity=("rad/s", "angular velocity"))
    sampling_time: float = quantity(default=0.01, unit="s", doc="sampling time", above=0)
    inertia: float = quantity(default=0.4, unit="kg m^2", doc="moment of inertia", above=0)
    damping: float = quantity(default=0.6, unit="N m s/rad", doc="viscous friction", least=0)

    def step(self, x, u, w, k):
        change = (u.torque - self.damping * x.velocity) / self.inertia
        return x.velocity + self.sampling_time * change, x.angle + self.sampling_time * x.velocity

    def output(self, x):
        return (x.velocity,)


class Memory(NamedTuple):
    u: ca.SX


@declared
class ModelBased(Law):
    """u <- u + share J/Ts (change of the error), with the inertia of the model that it is told."""

    source: ClassVar[str] = "ours, 2026"
    told: ClassVar[tuple[str, ...]] = ("reference", "model")
    learns_on = "output"

    share: float = quantity(default=0.5, unit="1", doc="share of the error that is made up for", above=0, below=2)
    inertia: float = quantity(default=1.0, unit="kg m^2", doc="moment of inertia that it believes in", above=0)
    step: float = quantity(default=0.01, unit="s", doc="sampling time", above=0)

    def ready_for(self, task):
        if not isinstance(task.model, Joint):
            return self
        return ModelBased(share=self.share, inertia=task.model.inertia, step=task.model.sampling_time)

    def ranges(self, task):
        return {"share": (0.05, 1.5)}

    def start(self, task):
        return Memory(ca.DM.zeros(1, task.samples))

    def act(self, memory_k, state, r, r_next, y):
        return memory_k.u, state

    def learn(self, memory, trial):
        e = known(trial.reached, trial.e)
        return Memory(memory.u + self.share * self.inertia / self.step * (e[:, 1:] - e[:, :-1]))


def peak_torque(study, data):
    last = data["applied"].isel(trial=-1)
    return {
        str(name): {"peak_torque": float(abs(last.sel(controller=name)).max())} for name in data["controller"].values
    }


def turn(samples):
    t = np.arange(samples + 1) / samples
    return 2.0 * np.sin(np.pi * t) ** 2


study = Study(
    name="robot-joint",
    title="A robot's joint",
    plant=Joint(),
    reference=turn(200),
    controllers={"model-based": ModelBased()},
    trials=20,
    noise=0.002,
    actuator=Actuator(lower=-8.0, upper=8.0),
    truth={"inertia": 1.1},
    compared=(Measures(headings={"peak_torque": "peak torque (N m)"}, scores=peak_torque),),
)
