"""Four tanks, two pumps, two levels: learning a change of level with a gain matrix."""

from typing import ClassVar, NamedTuple

import casadi as ca
import numpy as np
from matplotlib import pyplot as plt

from models import Plant, declared, quantity, signal, signals, table
from models.discretise import RK4
from workbench import Law, Study
from workbench.contracts.claim import Claim
from workbench.contracts.finding import Finding
from workbench.contracts.law import Channels
from workbench.controllers.parts.rows import known

LEVELS, PUMPS = (12.4, 12.7, 1.8, 1.4), (3.0, 3.0)
"""Levels (cm) that the pumps hold, nearly, and what holds them (V)."""


@declared
class QuadrupleTank(Plant):
    """Torricelli's law in four tanks: each pump fills a lower tank and, the other way across, an upper one."""

    source: ClassVar[str] = "Johansson, IEEE Trans. Control Systems Technology 8(3), 2000"
    integrator = RK4()
    states = signals(
        lower_1=signal("cm", "level of lower tank 1", domain=(0, 20), role="level"),
        lower_2=signal("cm", "level of lower tank 2", domain=(0, 20), role="level"),
        upper_1=signal("cm", "level of upper tank 1", domain=(0, 20), role="level"),
        upper_2=signal("cm", "level of upper tank 2", domain=(0, 20), role="level"),
    )
    inputs = signals(pump_1=signal("V", "voltage of pump 1", role="voltage"), pump_2=("V", "voltage of pump 2"))
    outputs = signals(
        lower_1=signal("cm", "level of lower tank 1", role="level"),
        lower_2=signal("cm", "level of lower tank 2", role="level"),
    )
    sampling_time: float = quantity(default=2.0, unit="s", doc="sampling time", above=0, structural=True)
    areas: tuple[float, ...] = table(default=(28.0, 32.0, 28.0, 32.0), unit="cm^2", doc="areas of the tanks")
    holes: tuple[float, ...] = table(default=(0.071, 0.057, 0.071, 0.057), unit="cm^2", doc="areas of the holes")
    gain_1: float = quantity(default=3.33, unit="cm^3/(V s)", doc="flow of pump 1", above=0)
    gain_2: float = quantity(default=3.35, unit="cm^3/(V s)", doc="flow of pump 2", above=0)
    share_1: float = quantity(default=0.70, unit="1", doc="share of pump 1 that fills its lower tank", above=0, below=1)
    share_2: float = quantity(default=0.60, unit="1", doc="share of pump 2 that fills its lower tank", above=0, below=1)
    gravity: float = quantity(default=981.0, unit="cm/s^2", doc="acceleration of gravity", above=0)

    def rhs(self, x, u, w, t):
        out = [a * ca.sqrt(2 * self.gravity * ca.fmax(h, 1e-6)) for a, h in zip(self.holes, x, strict=True)]
        flow_1, flow_2 = self.gain_1 * u.pump_1, self.gain_2 * u.pump_2
        into = (
            out[2] + self.share_1 * flow_1,
            out[3] + self.share_2 * flow_2,
            (1 - self.share_2) * flow_2,
            (1 - self.share_1) * flow_1,
        )
        return tuple((one - other) / area for one, other, area in zip(into, out, self.areas, strict=True))

    def output(self, x):
        return x.lower_1, x.lower_2


class Plan(NamedTuple):
    u: ca.SX


@declared
class MatrixILC(Law):
    """u <- u + L (e(k+1) - e(k)) with a constant matrix L, from the inputs that hold the first levels."""

    source: ClassVar[str] = "ours, 2026"
    channels: ClassVar[Channels] = Channels(outputs=2, inputs=2)
    learns_on = "output"

    gain: float = quantity(default=0.4, unit="1", doc="share of the error that is made up for in a trial", above=0)
    slope: tuple[float, ...] = table(
        default=(0.083, 0.0, 0.0, 0.0628), unit="cm/(V s)", doc="rate of the levels by the pumps, row by row"
    )

    def start(self, task):
        return Plan(ca.repmat(ca.DM(PUMPS), 1, task.samples))

    def act(self, memory_k, state, r, r_next, y):
        return memory_k.u, state

    def learn(self, memory, trial):
        inverse = ca.inv(ca.DM(np.reshape(self.slope, (2, 2)))) / 2.0
        e = known(trial.reached, trial.e)
        return Plan(memory.u + self.gain * inverse @ (e[:, 1:] - e[:, :-1]))


def smooth(samples):
    """A change of both levels, up and down, over some samples."""
    share = np.clip((np.arange(samples + 1) - 10) / 60, 0, 1)
    rise = share**2 * (3 - 2 * share)
    return np.stack([LEVELS[0] + 2.0 * rise, LEVELS[1] - 1.0 * rise])


def overshoot(study, data):
    """How far the first level rises above its target in the last trial."""
    target = float(study.reference_samples[0].max())
    level = data["output"].sel(output_name="lower_1").isel(trial=-1)
    return {
        str(name): {"overshoot_cm": float(level.sel(controller=name).max()) - target}
        for name in data["controller"].values
    }


def levels(study, data):
    """Both levels of the last trial."""
    last = data["output"].isel(controller=0, trial=-1)

    def draw():
        figure, axes = plt.subplots()
        for name in last["output_name"].values:
            axes.plot(data["time"], last.sel(output_name=name), label=str(name))
            axes.plot(data["time"], data["reference"].sel(output_name=name), "k:")
        axes.set(xlabel="time (s)", ylabel="level (cm)")
        axes.legend()
        return figure

    return {"levels": draw}


def never_empty(study, data):
    """Claim that no tank runs empty in the trials that were recorded."""
    names = [f"state_{signal.name}" for signal in study.plant.states]

    def check():
        lowest = min(float(data[name].min()) for name in names)
        return Finding(margin=lowest, unit="cm", witness={"lowest": lowest}, method="all recorded trials")

    return [Claim(name="quadruple-tank.never_empty", statement="No tank runs empty.", source="ours", check=check)]


study = Study(
    name="quadruple-tank",
    title="Learning a change of level in four tanks",
    source="ours, after Johansson (2000)",
    plant=QuadrupleTank(),
    reference=smooth(120),
    controllers={"matrix-ilc": MatrixILC()},
    trials=40,
    initial=LEVELS,
    scorers=(overshoot,),
    drawings=levels,
    claims=(never_empty,),
)
