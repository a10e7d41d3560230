"""Periodic adaptive learning control of a maglev shuttle.

Trials are periods, and the state runs on. Zhang, Nan, Cao et al.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import cast

import casadi as ca
import numpy as np
import xarray as xr

from models.array import Array
from models.maglev import Maglev
from models.plant import Plant
from models.quantity import declared, quantity
from models.station_runs import Shuttle
from studies.maglev.scores import scores
from workbench.contracts.scenario import Disturbance
from workbench.contracts.study import Draw, Study
from workbench.controllers.palc import PALC
from workbench.controllers.palc_filtered import FilteredPALC
from workbench.controllers.shuttle_pid import ShuttlePID
from workbench.trials.record import OUTPUT


@declared
class ForceNoise(Disturbance):
    """White noise on the force, held over a sample: its variance is the density over the sampling time."""

    force_psd: float = quantity(
        default=0.0, unit="N^2/Hz", doc="two-sided power spectral density of the disturbing force", least=0
    )

    def draw(self, plant: Plant, samples: int, rng: np.random.Generator) -> Array:
        """Return one period's disturbances, shape (disturbances, samples)."""
        sigma = np.sqrt(self.force_psd / float(plant.sampling_time))
        drawn: Array = sigma * rng.normal(size=(len(plant.disturbances), samples))
        return drawn

    @property
    def repeats(self) -> bool:
        """Whether nothing is drawn."""
        return self.force_psd == 0

    def bound(self, plant: Plant) -> Array:
        """Return infinite bounds where something is drawn."""
        widest = 0.0 if self.repeats else math.inf
        return np.tile([-widest, widest], (len(plant.disturbances), 1))


def with_line_resistance(study: Study, data: xr.Dataset) -> xr.Dataset:
    """Return a record with the true line resistance along every period, (controller, trial, sample) in N."""
    position, speed = (data["output"].sel({OUTPUT: name}) for name in ("position", "speed"))
    true = _along(cast(Maglev, study.true_plant), position.values, speed.values)
    about = {"units": "N", "long_name": "true line resistance"}
    return data.assign(line_resistance=(position.dims, true, about))


def _along(train: Maglev, position: Array, speed: Array) -> Array:
    """Return the true line resistance in N along recorded positions (m) and speeds (m/s), same shape."""
    x, v = ca.SX.sym("x"), ca.SX.sym("v")
    one = ca.Function("line_resistance", [x, v], [train.line_resistance(x, v)], ["x", "v"], ["d"])
    every = one.map(position.shape[-1])
    true: Array = np.empty(position.shape)
    for at in np.ndindex(position.shape[:-1]):
        true[at] = every(x=position[at][None, :], v=speed[at][None, :])["d"].full()[0]
    return true


def figures(study: Study, data: xr.Dataset) -> Mapping[str, Draw]:
    """Return the figures of the study by name."""
    from studies.maglev.figures import figures

    return figures(study, data)


LAGGING, NOISY, WRONG = "lagging", "noisy", {"0.1": "period-100-ms-too-long", "1": "period-1-s-too-long"}
FLAT_LINE, LIMITED, SHORT = "flat", "limited", "period-100-ms-too-short"
"""Names of cases; those of a wrong period the seconds that it is too long."""


def _late(samples: int) -> dict[str, object]:
    return {"controllers.palc.late": samples, "controllers.palc-filtered.late": samples}


STUDY = Study(
    name="maglev",
    title="Periodic adaptive learning control of a maglev shuttle",
    source="Zhang, Nan, Cao et al., Beijing Jiaotong University: PALC of a medium/low-speed maglev train",
    plant=Maglev(),
    reference=Shuttle(),
    controllers={"pid": ShuttlePID(), "palc": PALC(), "palc-filtered": FilteredPALC()},
    trials=17,
    disturbance=ForceNoise(),
    continues=True,
    scorers=(scores,),
    derived=with_line_resistance,
    drawings=figures,
    cases={
        LAGGING: {"actuator.lag": 0.4, "actuator.delay": 0.6},
        NOISY: {"disturbance.force_psd": 1e6},
        FLAT_LINE: {"plant.line": "flat"},
        LIMITED: {"actuator.lower": -95_000.0, "actuator.upper": 95_000.0, "trials": 25},
        WRONG["0.1"]: _late(10),
        WRONG["1"]: _late(100),
        SHORT: _late(-10),
    },
    renamed={"periods": "trials", "line": "plant.line", "noise.force_psd": "disturbance.force_psd"},
    gone={
        "force_limit": "set actuator.lower and actuator.upper, in N; both take null for none",
        "period_error": "set controllers.palc.late and controllers.palc-filtered.late, in samples",
    },
)
