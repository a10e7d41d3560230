"""Periodic adaptive learning control of a maglev shuttle.

Zhang, Nan, Cao et al.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
import xarray as xr

from models.actuator import Actuator, Saturated
from models.line import FLAT
from models.maglev import Maglev
from models.plant import Plant
from models.quantity import InvalidValue, choice, count, declared, given, part, quantity
from models.station_runs import Shuttle
from studies.maglev.scores import scores
from workbench.contracts.study import Folded, Progress, Scores, Study
from workbench.controllers.palc import PALC
from workbench.controllers.palc_filtered import FilteredPALC
from workbench.controllers.shuttle_pid import ShuttlePID
from workbench.trials.study import TrialStudy


@declared
class ForceNoise:
    """White noise on the force, held over a sample: its variance is the density over the sampling time."""

    force_psd: float = quantity(
        default=0.0, unit="N^2/Hz", doc="two-sided power spectral density of the disturbing force", least=0
    )

    def draw(self, plant: Plant, samples: int, rng: np.random.Generator) -> Any:
        """Return one period's disturbances, shape (disturbances, samples)."""
        sigma = np.sqrt(self.force_psd / float(plant.sampling_time))
        return sigma * rng.normal(size=(len(plant.disturbances), samples))


@declared
class MaglevStudy(Study):
    """A shuttle between two stations: trials are periods, and the state runs on from one to the next."""

    name: str = given(default="maglev", doc="name, used for folders and reports")
    title: str = given(
        default="Periodic adaptive learning control of a maglev shuttle", doc="what the study is, in one line"
    )
    source: str = given(
        default="Zhang, Nan, Cao et al., Beijing Jiaotong University: PALC of a medium/low-speed maglev train",
        doc="paper that it follows",
    )
    plant: Maglev = part(default=Maglev(), doc="the train on its line")
    line: str = choice(default="paper", options=("paper", "flat"), doc="plant.line, or one without grades and curves")
    reference: Shuttle = part(default=Shuttle(), doc="position and speed to follow")
    controllers: Mapping[str, Any] = part(
        default={"pid": ShuttlePID(), "palc": PALC(), "palc-filtered": FilteredPALC()}, doc="the controllers by name"
    )
    periods: int = count(default=17, doc="number of periods, the first included", least=1)
    actuator: Actuator = part(default=Actuator(), doc="what lies between command and force")
    force_limit: float | None = quantity(
        default=None, unit="N", doc="largest force either way; null: none", above=0, optional=True, structural=True
    )
    noise: ForceNoise = part(default=ForceNoise(), doc="noise on the force")
    period_error: float = quantity(
        default=0.0,
        unit="s",
        doc="by how much the period that the laws assume is too long, a multiple of the sampling time",
        structural=True,
    )
    seed: int = count(default=0, doc="seed of everything random")

    def check(self) -> None:
        """Raise InvalidValue where the parts do not fit together."""
        step, period = float(self.plant.sampling_time), self.reference.period
        if abs(self.period_error) >= period / 2:
            raise InvalidValue(
                f"period_error must lie below half the period of {period:g} s, got {self.period_error:g}"
            )
        if abs(self.late * step - self.period_error) > 1e-9:
            raise InvalidValue(
                f"period_error must be a multiple of the sampling time of {step:g} s, got {self.period_error:g}"
            )
        _ = self.trial_study

    @property
    def late(self) -> int:
        """Samples by which the period that the laws assume is too long."""
        return round(self.period_error / float(self.plant.sampling_time))

    @property
    def train(self) -> Maglev:
        """The train on the line chosen."""
        return self.plant if self.line == "paper" else dataclasses.replace(self.plant, line=FLAT)

    @cached_property
    def trial_study(self) -> TrialStudy:
        """The same study as plant x reference x controllers, a trial being a period."""
        plant = self.actuator.wrapped(self.train)
        if self.force_limit is not None:
            plant = Saturated(plant=plant, lower=-self.force_limit, upper=self.force_limit)
        return TrialStudy(
            name=self.name,
            title=self.title,
            source=self.source,
            plant=plant,
            reference=self.reference,
            controllers={name: self.told(law) for name, law in self.controllers.items()},
            trials=self.periods,
            continues=True,
            disturbance=self.noise,
            seed=self.seed,
        )

    def told(self, law: Any) -> Any:
        """Return the law with what it knows of this study: the train and the error of its period."""
        known = {"model": self.train, "late": self.late}
        fields = {field.name for field in dataclasses.fields(law)}
        return dataclasses.replace(law, **{name: value for name, value in known.items() if name in fields})

    def folded(self) -> dict[str, Folded]:
        """Return what every controller is folded from, by name."""
        return self.trial_study.folded()

    def simulate(self, progress: Progress) -> xr.Dataset:
        """Run every controller, as a study does. The true line resistance stands beside."""
        data = self.trial_study.simulate(progress)
        true = _along(self.train, data["output"].values, data["output_speed"].values)
        about = {"units": "N", "long_name": "true line resistance"}
        return data.assign(line_resistance=(data["output"].dims, true, about))

    def scores(self, data: xr.Dataset) -> Scores:
        """Return the metrics of every controller; see :func:`studies.maglev.scores.scores`."""
        return scores(self, data)

    def figures(self, data: xr.Dataset) -> Mapping[str, Callable[[], Any]]:
        """Return the figures by name, as functions that draw."""
        from studies.maglev.figures import figures

        return figures(self, data)


def _along(train: Maglev, position: Any, speed: Any) -> Any:
    """Return the true line resistance in N along recorded positions (m) and speeds (m/s), same shape."""
    x, v = ca.SX.sym("x"), ca.SX.sym("v")
    one = ca.Function("line_resistance", [x, v], [train.line_resistance(x, v)], ["x", "v"], ["d"])
    buffer: Any
    trigger: Any
    buffer, trigger = one.map(position.shape[-1]).buffer()
    true: Any = np.empty(position.shape)
    for at in np.ndindex(position.shape[:-1]):
        rows: Any = np.ascontiguousarray(position[at]), np.ascontiguousarray(speed[at])
        buffer.set_arg(0, memoryview(rows[0]))
        buffer.set_arg(1, memoryview(rows[1]))
        buffer.set_res(0, memoryview(true[at]))
        trigger()
    return true


STUDY = MaglevStudy()
