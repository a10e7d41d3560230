"""Model-free adaptive ILC of a metro train whose trial length varies.

Jiao & Hou (2025).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import xarray as xr

from models.metro_profile import MetroProfile
from models.point_mass import PointMass
from studies.metro.scores import slope_resistance
from studies.rail.scores import RIDE, train_scores
from workbench.controllers.cfdl import CFDL
from workbench.controllers.icfdl import ICFDL
from workbench.controllers.increment import Increment
from workbench.controllers.pd import PD
from workbench.trials.length import TrialLength
from workbench.trials.study import Sweep, TrialStudy


def figures(study: Any, data: xr.Dataset) -> Mapping[str, Callable[[], Any]]:
    """Return the figures of the metro study by name."""
    from studies.metro.figures import metro_figures

    return metro_figures(study, data, slope_resistance(study, data))


STUDY = TrialStudy(
    name="metro",
    title="Model-free adaptive ILC of a metro train whose trial length varies",
    source="Jiao & Hou, Control Theory & Applications 42(3), 2025, doi 10.7641/CTA.2024.30465",
    plant=PointMass(),
    reference=MetroProfile(),
    controllers={"cfdl": CFDL(), "icfdl": ICFDL(), "pd": PD(), "increment": Increment()},
    trials=150,
    trial_length=TrialLength(law="uniform"),
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
)
