"""Model-free adaptive ILC of a metro train whose trial length varies.

Jiao & Hou (2025).
"""

from __future__ import annotations

from collections.abc import Mapping

import xarray as xr

from models.metro_profile import MetroProfile
from models.point_mass import PointMass
from studies.metro.scores import slope_resistance
from studies.rail.scores import RIDE, train_scores
from workbench.contracts.scenario import Between, From, NormalNoise
from workbench.contracts.study import Draw, Study, Sweep
from workbench.contracts.trial_length import TrialLength
from workbench.controllers.cfdl import CFDL
from workbench.controllers.icfdl import ICFDL
from workbench.controllers.increment import Increment
from workbench.controllers.pd import PD


def figures(study: Study, data: xr.Dataset) -> Mapping[str, Draw]:
    """Return the figures of the metro study by name."""
    from studies.metro.figures import metro_figures

    return metro_figures(study, data, slope_resistance(study, data))


STUDY = Study(
    name="metro",
    title="Model-free adaptive ILC of a metro train whose trial length varies",
    source="Jiao & Hou, Control Theory & Applications 42(3), 2025, doi 10.7641/CTA.2024.30465",
    plant=PointMass(),
    reference=MetroProfile(),
    controllers={"cfdl": CFDL(), "icfdl": ICFDL(), "pd": PD(), "increment": Increment()},
    trials=150,
    trial_length=TrialLength(law="uniform"),
    noise=NormalNoise(),
    sweeps=(
        Sweep(
            field="force_unit",
            values=(1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0),
            controllers=("icfdl", "pd"),
            unit="N",
        ),
    ),
    scorers=(train_scores,),
    compared=(RIDE,),
    drawings=figures,
    cases={
        # each breaks one assumption of the paper's, or one that is silent in it
        "starts-differ": {"initial": From(state=(0.0, 0.0), spread=(0.5, 5.0))},
        "limited": {"actuator.lower": -420_000.0, "actuator.upper": 420_000.0},
        "lagging": {"actuator.lag": 0.5, "actuator.delay": 0.3},
        "trips-differ": {
            "truth.mass": Between(low=0.9, high=1.1),
            "truth.b0_mean": Between(low=0.8, high=1.2),
            "truth.b1_mean": Between(low=0.8, high=1.2),
            "truth.b2_mean": Between(low=0.8, high=1.2),
        },
        "longer-than-the-run": {"trial_length.minimum": 1950, "trial_length.maximum": 2050},
    },
    renamed={"noise.speed_sigma": "noise.sigma"},
)
