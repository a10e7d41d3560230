"""A pendulum with friction that swings along a path, by feedback and by learning."""

from typing import ClassVar, NamedTuple

import casadi as ca
import numpy as np

from models import Plant, declared, quantity, signal, signals
from models.discretise import RK4
from workbench import Law, Study
from workbench.controllers.parts.rows import known


@declared
class Pendulum(Plant):
    """m l^2 a'' = torque - m g l sin a - friction a'."""

    source: ClassVar[str] = "ours, 2026"
    integrator = RK4(substeps=2)
    states = signals(angle=signal("rad", "angle from hanging down", role="angle"), rate=("rad/s", "angular velocity"))
    inputs = signals(torque=signal("N m", "torque at the hinge", role="torque"))
    outputs = signals(angle=signal("rad", "angle from hanging down", role="angle"))
    sampling_time: float = quantity(default=0.02, unit="s", doc="sampling time", above=0)
    mass: float = quantity(default=1.0, unit="kg", doc="mass of the bob", above=0)
    length: float = quantity(default=0.5, unit="m", doc="length of the rod", above=0)
    friction: float = quantity(default=0.1, unit="N m s/rad", doc="viscous friction", least=0)
    gravity: float = quantity(default=9.81, unit="m/s^2", doc="acceleration of gravity", above=0)

    def rhs(self, x, u, w, t):
        inertia = self.mass * self.length**2
        pull = self.mass * self.gravity * self.length * ca.sin(x.angle)
        return x.rate, (u.torque - pull - self.friction * x.rate) / inertia

    def output(self, x):
        return (x.angle,)


class Memory(NamedTuple):
    u: ca.SX


class Acting(NamedTuple):
    before: ca.SX


@declared
class FeedbackAndLearning(Law):
    """A PD feedback within the trial, and a plan that learns from what it had to do."""

    source: ClassVar[str] = "ours, 2026"
    learns_on = "output"

    kp: float = quantity(default=12.0, unit="N m/rad", doc="proportional gain", above=0)
    kd: float = quantity(default=1.5, unit="N m s/rad", doc="derivative gain", least=0)
    rate: float = quantity(default=8.0, unit="N m/rad", doc="learning gain", above=0)
    step: float = quantity(default=0.02, unit="s", doc="sampling time", above=0)

    def start(self, task):
        return Memory(ca.DM.zeros(1, task.samples))

    def ready(self, memory):
        return Acting(ca.DM.zeros(1, 1))

    def act(self, memory_k, state, r, r_next, y):
        e = r - y
        return memory_k.u + self.kp * e + self.kd * (e - state.before) / self.step, Acting(e)

    def learn(self, memory, trial):
        e = known(trial.reached, trial.e)
        slope = (e[:, 1:] - e[:, :-1]) / self.step
        return Memory(memory.u + self.rate * e[:, 1:] + 0.1 * self.rate * slope)


def swing(samples):
    """Up to one radian and back, smoothly."""
    t = np.arange(samples + 1) / samples
    return np.sin(np.pi * t) ** 4


study = Study(
    name="pendulum",
    title="A pendulum that learns to swing",
    plant=Pendulum(),
    reference=swing(150),
    controllers={"learning": FeedbackAndLearning()},
    trials=30,
    truth={"mass": 1.15},
)
