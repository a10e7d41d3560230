"""Two tanks in a row: the level of the second answers the flow into the first two samples later."""

from typing import ClassVar, NamedTuple

import casadi as ca
import numpy as np

from models import Plant, declared, quantity, signal, signals
from workbench import Law, Study
from workbench.controllers.parts.rows import known


@declared
class TwoTanks(Plant):
    """Torricelli's law, one explicit step a sample; the levels mean something from empty to full."""

    source: ClassVar[str] = "ours, 2026"
    states = signals(
        first=signal("m", "level of the first tank", domain=(0, 1.5), role="level"),
        second=signal("m", "level of the second tank", domain=(0, 1.5), role="level"),
    )
    inputs = signals(inflow=signal("m^3/s", "flow into the first tank", domain=(0, None), role="flow"))
    outputs = signals(second=signal("m", "level of the second tank", role="level"))
    sampling_time: float = quantity(default=1.0, unit="s", doc="sampling time", above=0)
    area: float = quantity(default=0.5, unit="m^2", doc="area of a tank", above=0)
    outlet: float = quantity(default=0.02, unit="m^2.5/s", doc="flow out of a tank by the root of its level", above=0)

    def step(self, x, u, w, k):
        between = self.outlet * ca.sqrt(ca.fmax(x.first, 0))
        leaving = self.outlet * ca.sqrt(ca.fmax(x.second, 0))
        h = self.sampling_time / self.area
        return x.first + h * (u.inflow - between), x.second + h * (between - leaving)

    def output(self, x):
        return (x.second,)


class Memory(NamedTuple):
    u: ca.SX


@declared
class DelayedLearning(Law):
    """u(k) <- u(k) + gain (e(k + d) + weight (e(k + d) - e(k + d - 1))), d the relative degree that it is told."""

    source: ClassVar[str] = "ours, 2026"
    told: ClassVar[tuple[str, ...]] = ("reference", "delay")
    learns_on = "output"

    gain: float = quantity(default=0.05, unit="m^2/s", doc="learning gain", above=0)
    weight: float = quantity(default=20.0, unit="1", doc="weight of the error's change", least=0)
    first: float = quantity(default=0.012, unit="m^3/s", doc="flow of the first trial", least=0)
    late: float = quantity(default=2, unit="samples", doc="relative degree", structural=True)

    def ready_for(self, task):
        import dataclasses

        return dataclasses.replace(self, late=task.relative_degree)

    def start(self, task):
        return Memory(self.first * ca.DM.ones(1, task.samples))

    def act(self, memory_k, state, r, r_next, y):
        return memory_k.u, state

    def learn(self, memory, trial):
        d, n = int(self.late), memory.u.shape[1]
        e = known(trial.reached, trial.e)
        ahead = ca.horzcat(e[:, d:], ca.DM.zeros(1, d - 1))
        before = ca.horzcat(e[:, d - 1 : n], ca.DM.zeros(1, d - 1))
        return Memory(memory.u + self.gain * (ahead + self.weight * (ahead - before)))


def rise(samples):
    share = np.clip(np.arange(samples + 1) / 80, 0, 1)
    return 0.36 + 0.3 * share**2 * (3 - 2 * share)


study = Study(
    name="two-tanks",
    title="The level of the second of two tanks",
    plant=TwoTanks(),
    reference=rise(100),
    controllers={"delayed": DelayedLearning()},
    trials=60,
    initial=(0.36, 0.36),
)
