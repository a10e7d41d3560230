"""The metro study: model-free adaptive ILC of a train whose trial length varies, Jiao & Hou (2025)."""

from __future__ import annotations

from models.point_mass import PointMass
from models.reference import MetroProfile
from workbench.controllers.cfdl import CFDL
from workbench.controllers.icfdl import ICFDL
from workbench.controllers.increment import Increment
from workbench.controllers.pd import PD
from workbench.metrics import train_scores
from workbench.trial_length import TrialLength
from workbench.trial_study import Sweep, TrialStudy

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
)
