"""Variable-gain ILC with initial-state learning on a metro line.

D-type ILC; patent of NJIT (2017).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from models.metro_line import MetroLine
from models.plant import Plant
from models.quantity import count, declared, given, part, quantity, switch
from models.station_runs import StationRun
from studies.variable_gain.scores import scores
from workbench.contracts.study import Folded, Progress, Scores, Study
from workbench.controllers.fixed_gain import FixedGain
from workbench.controllers.variable_gain import VariableGain
from workbench.requirements.divergence import slope_growth
from workbench.trials.drawn import SpeedNoise
from workbench.trials.study import TrialStudy

"""What ``trials_to_tolerance`` asks for, m and m/s."""


@declared
class Start:
    """Where trials begin: an offset, a random addition drawn once, and one drawn anew for every trial."""

    position: float = quantity(default=0.8, unit="m", doc="offset of the initial position")
    speed: float = quantity(default=0.3, unit="m/s", doc="offset of the initial speed")
    random_sigma: float = quantity(
        default=0.0, unit="m, m/s", doc="standard deviation of a random addition to both, drawn once", least=0
    )
    trial_sigma: float = quantity(
        default=0.0, unit="m, m/s", doc="standard deviation of a random addition to both, for every trial", least=0
    )

    def draw(self, plant: Plant, trials: int, rng: np.random.Generator) -> Any:
        """Return the initial states, shape (trials, 2), before anything was learned."""
        once = np.array([self.position, self.speed]) + self.random_sigma * rng.normal(size=2)
        return once + self.trial_sigma * rng.normal(size=(trials, 2))


@declared
class VariableGainStudy(Study):
    """Position and speed of a metro train, learned from trial to trial together with where it starts."""

    name: str = given(default="variable-gain", doc="name, used for folders and reports")
    title: str = given(
        default="Variable-gain ILC with initial-state learning on a metro line", doc="what the study is, in one line"
    )
    source: str = given(
        default="Nanjing Institute of Technology, patent application (2017): ATO speed control by iterative learning",
        doc="patent that it follows",
    )
    plant: MetroLine = part(default=MetroLine(), doc="the train on its line")
    reference: StationRun = part(default=StationRun(), doc="position and speed to follow")
    controllers: Mapping[str, Any] = part(
        default={"variable": VariableGain(), "fixed": FixedGain()}, doc="the controllers by name"
    )
    trials: int = count(default=30, doc="number of trials, the first included", least=1)
    initial: Start = part(default=Start(), doc="where trials begin")
    initial_learning: bool = switch(default=True, doc="whether the laws learn the initial state")
    noise: SpeedNoise = part(default=SpeedNoise(row=1), doc="measurement noise")
    gain_mismatch: float = quantity(
        default=1.0, unit="1", doc="b, input gain of the train over the one that the laws assume", above=0
    )
    seed: int = count(default=0, doc="seed of everything random")

    def check(self) -> None:
        """Raise InvalidValue where the parts do not fit together."""
        _ = self.trial_study

    @property
    def trial_study(self) -> TrialStudy:
        """The same study as plant x reference x controllers."""
        laws = self.controllers
        if not self.initial_learning:
            laws = {name: dataclasses.replace(law, initial_learning=False) for name, law in laws.items()}
        return TrialStudy(
            name=self.name,
            title=self.title,
            source=self.source,
            plant=dataclasses.replace(self.plant, input_gain=self.plant.input_gain * self.gain_mismatch),
            reference=self.reference,
            controllers=laws,
            trials=self.trials,
            noise=self.noise,
            initial=self.initial,
            seed=self.seed,
            watch=partial(slope_growth, 1),
        )

    def folded(self) -> dict[str, Folded]:
        """Return what every controller is folded from, by name."""
        return self.trial_study.folded()

    def simulate(self, progress: Progress) -> xr.Dataset:
        """Run every controller; see :class:`workbench.contracts.study.Study`."""
        return self.trial_study.simulate(progress)

    def scores(self, data: xr.Dataset) -> Scores:
        """Return the metrics of every controller; see :func:`scores`."""
        return scores(data)

    def figures(self, data: xr.Dataset) -> Mapping[str, Callable[[], Any]]:
        """Return the figures by name, as functions that draw."""
        from studies.variable_gain.figures import figures

        return figures(self.plant.sampling_time, data)


STUDY = VariableGainStudy()
