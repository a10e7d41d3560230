"""Variable-gain ILC with initial-state learning on a metro line.

D-type ILC; patent of NJIT (2017).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial

import numpy as np
import xarray as xr

from models.array import Array
from models.metro_line import MetroLine
from models.plant import Plant
from models.quantity import declared, quantity
from models.station_runs import StationRun
from studies.variable_gain.scores import scores
from workbench.contracts.scenario import Initial, NormalNoise, Times
from workbench.contracts.study import Draw, Study
from workbench.controllers.fixed_gain import FixedGain
from workbench.controllers.variable_gain import VariableGain
from workbench.requirements.divergence import slope_growth


@declared
class Start(Initial):
    """Where trials begin: an offset, a random addition drawn once, and one drawn anew for every trial.

    A law that learns the initial state moves it from there.
    """

    position: float = quantity(default=0.8, unit="m", doc="offset of the initial position")
    speed: float = quantity(default=0.3, unit="m/s", doc="offset of the initial speed")
    random_sigma: float = quantity(
        default=0.0, unit="m, m/s", doc="standard deviation of a random addition to both, drawn once", least=0
    )
    trial_sigma: float = quantity(
        default=0.0, unit="m, m/s", doc="standard deviation of a random addition to both, for every trial", least=0
    )

    def draw(self, plant: Plant, trials: int, rng: np.random.Generator) -> Array:
        """Return the initial states, shape (trials, 2), before anything was learned."""
        once = np.array([self.position, self.speed]) + self.random_sigma * rng.normal(size=2)
        return once + self.trial_sigma * rng.normal(size=(trials, 2))

    @property
    def repeats(self) -> bool:
        """Whether every trial begins in the same state."""
        return self.trial_sigma == 0

    def bound(self, plant: Plant) -> Array:
        """Return the offsets, infinite bounds where something is drawn."""
        widest = math.inf if self.random_sigma or self.trial_sigma else 0.0
        return np.array([[self.position - widest, self.position + widest], [self.speed - widest, self.speed + widest]])


def figures(study: Study, data: xr.Dataset) -> Mapping[str, Draw]:
    """Return the figures of the study by name."""
    from studies.variable_gain.figures import figures

    return figures(data)


NOISE, MISMATCH, NOT_LEARNED = "noise", "mismatch", "without-initial-learning"
SMOOTHED, FROM_POSITION = "noise-smoothed", "learning-from-position"
"""Names of cases."""

STUDY = Study(
    name="variable-gain",
    title="Variable-gain ILC with initial-state learning on a metro line",
    source="Nanjing Institute of Technology, patent application (2017): ATO speed control by iterative learning",
    plant=MetroLine(),
    reference=StationRun(),
    controllers={"variable": VariableGain(), "fixed": FixedGain()},
    trials=30,
    initial=Start(),
    noise=NormalNoise(output="speed"),
    truth={"input_gain": Times(factor=1.0)},
    watch=partial(slope_growth, 1),
    scorers=(scores,),
    drawings=figures,
    cases={
        NOT_LEARNED: {"controllers.variable.initial_learning": False, "controllers.fixed.initial_learning": False},
        NOISE: {"noise.sigma": 0.02},
        SMOOTHED: {"noise.sigma": 0.02, "controllers.variable.smoothing_s": 1.0},
        MISMATCH: {"truth.input_gain.factor": 2.1},
        FROM_POSITION: {"controllers.fixed.learns": "position"},
    },
    renamed={"noise.speed_sigma": "noise.sigma", "gain_mismatch": "truth.input_gain.factor"},
    gone={
        "initial_learning": "each law has its own, as in controllers.variable.initial_learning=false; "
        f"the case {NOT_LEARNED} switches off all of them"
    },
)
