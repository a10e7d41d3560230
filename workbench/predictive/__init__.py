"""Tube predictive control of linear plants with an input delay: design, condensed problems, their solver."""

from workbench.predictive.delayed_plant import DelayedPlant
from workbench.predictive.disturbance_model import DisturbanceModel
from workbench.predictive.tube import Tube

__all__ = ["DelayedPlant", "DisturbanceModel", "Tube"]
