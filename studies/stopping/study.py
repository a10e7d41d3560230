"""Robust self-triggered MPC of a train that stops at a mark.

Predictive laws against a PID with feed-forward; Liu, Xun, Gao & Yin (2022).
"""

from __future__ import annotations

from collections.abc import Mapping

import xarray as xr

from models.brake import Halting
from models.reference import Given
from studies.stopping.design import design_document
from studies.stopping.figures import stopping_figures
from studies.stopping.record import derived
from studies.stopping.scores import scores
from studies.stopping.settings import Stopping, own
from workbench.contracts.scenario import From, Undisturbed
from workbench.contracts.study import Study, composed


def compose(settings: Stopping, seed: int) -> Mapping[str, object]:
    """Return the fields of the study that its own settings make, and for a random resistance the seed.

    Raises InvalidValue where the disturbance leaves no room.
    """
    brake = settings.braked(seed)
    return {
        "plant": Halting(plant=brake),
        "reference": Given(values=settings.reference()),
        "controllers": settings.controllers(brake),
        "initial": From(state=settings.begin),
        "disturbance": Undisturbed(),
    }


def documents(study: Study, data: xr.Dataset) -> Mapping[str, object]:
    """Return what is written beside run.nc: the design."""
    settings = own(study)
    return {"design.json": design_document(settings.design, settings.linear, max(settings.lengths))}


STUDY = composed(
    Stopping(),
    compose,
    name="stopping",
    title="Robust self-triggered MPC of a train that stops at a mark",
    source="Liu, Xun, Gao & Yin, Acta Automatica Sinica 48(1), 2022, doi 10.16383/j.aas.c200039",
    trials=1,
    cases={
        "random": {"resistance.seed": 0},
        "B": {"config": "B"},
        "euler": {"model": "euler"},
        "cold": {"start": "cold"},
    },
    scorers=(scores,),
    derived=derived,
    documents=documents,
    drawings=stopping_figures,
)
