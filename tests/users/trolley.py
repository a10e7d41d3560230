"""A trolley whose drive answers five samples late, and a law that is told so."""

from typing import ClassVar, NamedTuple

import casadi as ca
import numpy as np

from models import Plant, declared, quantity, signal, signals
from models.actuator import Actuator
from workbench import Law, Study
from workbench.controllers.parts.rows import known


@declared
class Trolley(Plant):
    """A mass with rolling friction, its speed driven by a force."""

    source: ClassVar[str] = "ours, 2026"
    states = signals(speed=signal("m/s", "speed", role="speed"))
    inputs = signals(force=signal("N", "force", role="force"))
    outputs = signals(speed=signal("m/s", "speed", role="speed"))
    sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)
    mass: float = quantity(default=20.0, unit="kg", doc="mass", above=0)
    friction: float = quantity(default=8.0, unit="N s/m", doc="friction", least=0)

    def step(self, x, u, w, k):
        return (x.speed + self.sampling_time / self.mass * (u.force - self.friction * x.speed),)

    def output(self, x):
        return (x.speed,)


class Memory(NamedTuple):
    u: ca.SX


@declared
class LateLearning(Law):
    """u(k) <- u(k) + gain (change of the error over the sample that u(k) reaches first)."""

    source: ClassVar[str] = "ours, 2026"
    told: ClassVar[tuple[str, ...]] = ("reference", "delay")
    learns_on = "output"

    gain: float = quantity(default=120.0, unit="N s/m", doc="learning gain", above=0)
    samples: float = quantity(default=1, unit="samples", doc="relative degree", structural=True)

    def ready_for(self, task):
        return LateLearning(gain=self.gain, samples=task.relative_degree)

    def start(self, task):
        return Memory(ca.DM.zeros(1, task.samples))

    def act(self, memory_k, state, r, r_next, y):
        return memory_k.u, state

    def learn(self, memory, trial):
        d, n = int(self.samples), memory.u.shape[1]
        e = known(trial.reached, trial.e)
        change = e[:, d:] - e[:, d - 1 : n]
        return Memory(memory.u + self.gain * ca.horzcat(change, ca.DM.zeros(1, d - 1)))


def ride(samples):
    """From rest after the dead time, up to 1 m/s and back."""
    k = np.arange(samples + 1)
    return np.interp(k, [0, 6, 50, 90, samples], [0, 0, 1, 1, 0])


study = Study(
    name="trolley",
    title="A trolley with five samples of dead time",
    plant=Trolley(),
    reference=ride(130),
    controllers={"late": LateLearning()},
    trials=40,
    actuator=Actuator(delay=0.5),
)
