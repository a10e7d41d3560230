"""A batch reactor whose jacket is told the temperature of every batch: each batch is a trial."""

from typing import ClassVar, NamedTuple

import casadi as ca
import numpy as np

from models import Plant, declared, quantity, signal, signals
from models.discretise import RK4
from workbench import Law, Study
from workbench.contracts.scenario import From
from workbench.controllers.parts.rows import known


@declared
class BatchReactor(Plant):
    """One exothermic reaction of first order, heated and cooled by a jacket; the rate follows Arrhenius."""

    source: ClassVar[str] = "ours, 2026"
    integrator = RK4(substeps=4)
    states = signals(
        concentration=signal("kmol/m^3", "concentration of what reacts", domain=(0, None), role="concentration"),
        temperature=signal("K", "temperature of the reactor", domain=(250, 450), role="temperature"),
    )
    inputs = signals(jacket=signal("K", "temperature of the jacket", role="temperature"))
    outputs = signals(temperature=signal("K", "temperature of the reactor", role="temperature"))
    disturbances = signals(leak=("K/s", "heat that is lost"))
    sampling_time: float = quantity(default=20.0, unit="s", doc="sampling time", above=0)
    rate: float = quantity(default=7.0e4, unit="1/s", doc="rate of the reaction without a barrier", above=0)
    barrier: float = quantity(default=5500.0, unit="K", doc="activation energy over the gas constant", above=0)
    heat: float = quantity(default=12.0, unit="K m^3/kmol", doc="rise of temperature by what reacts", least=0)
    transfer: float = quantity(default=4.0e-3, unit="1/s", doc="heat transfer of the jacket", above=0)

    def rhs(self, x, u, w, t):
        reacting = self.rate * ca.exp(-self.barrier / x.temperature) * x.concentration
        return -reacting, self.heat * reacting + self.transfer * (u.jacket - x.temperature) - w.leak

    def output(self, x):
        return (x.temperature,)


class Memory(NamedTuple):
    u: ca.SX


class Acting(NamedTuple):
    total: ca.SX


@declared
class BatchLearning(Law):
    """A PI feedback about a plan of the jacket that learns from batch to batch."""

    source: ClassVar[str] = "ours, 2026"
    learns_on = "output"

    kp: float = quantity(default=2.0, unit="1", doc="proportional gain", least=0)
    ki: float = quantity(default=0.05, unit="1", doc="integral gain, by the sample", least=0)
    share: float = quantity(default=1.5, unit="1", doc="share of the feedback's error that is learned", above=0)
    first: float = quantity(default=300.0, unit="K", doc="jacket of the first batch", above=0)

    def start(self, task):
        return Memory(self.first * ca.DM.ones(1, task.samples))

    def ready(self, memory):
        return Acting(ca.DM.zeros(1, 1))

    def act(self, memory_k, state, r, r_next, y):
        e = r - y
        total = state.total + e
        return memory_k.u + self.kp * e + self.ki * total, Acting(total)

    def learn(self, memory, trial):
        return Memory(memory.u + self.share * known(trial.reached, trial.e)[:, 1:])


def recipe(samples):
    """Heat up, hold, cool down."""
    k = np.arange(samples + 1)
    return 300.0 + np.interp(k, [0, 60, 120, samples], [0, 35, 35, 10])


study = Study(
    name="batch-reactor",
    title="The temperature of a batch reactor, batch after batch",
    plant=BatchReactor(),
    reference=recipe(180),
    controllers={"batch": BatchLearning()},
    trials=25,
    initial=From(state=(5.0, 300.0), spread=(0.25, 0.5)),
    disturbance=0.001,
    trial_length=175,
)
