"""Every controller against every other on the metro train, tuned alike."""

from __future__ import annotations

import dataclasses

from models.actuator import Actuator
from studies.metro.study import STUDY as METRO
from workbench.contracts.scenario import NormalNoise, Times
from workbench.contracts.trial_length import TrialLength
from workbench.design.comparison import comparison

LAWS = (
    "pid",
    "fipid",
    "fipid-smooth",
    "bp-fipid",
    "tracking-mpc",
    "cfdl",
    "icfdl",
    "pd-ilc",
    "increment",
    "palc",
    "variable-gain",
)
"""The laws that were compared so far; ``--laws`` takes the others of the library too."""

TRAIN = dataclasses.replace(
    METRO,
    controllers={"unused": METRO.controllers["pd"]},
    sweeps=(),
    actuator=Actuator(lower=-450e3, upper=450e3, rate=500e3),
    noise=NormalNoise(sigma=0.05),
    truth={"mass": Times(factor=1.1)},
    trial_length=TrialLength(law="fixed"),
    trials=30,
    gone={
        "mass_off_percent": "set truth.mass.factor, the true mass over the believed one, as in truth.mass.factor=1.1"
    },
)
"""The metro train behind limits and a rate limit, heavier than it is believed to be, its speed measured with noise."""

STUDY = dataclasses.replace(
    comparison(TRAIN, LAWS),
    title="Every controller against every other on the metro train, tuned alike",
)
