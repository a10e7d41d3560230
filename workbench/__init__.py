"""Declare a plant once, run controllers on it, and look."""

from workbench.campaign import Campaign, load, run
from workbench.trial_length import TrialLength
from workbench.trial_study import TrialStudy

__all__ = ["Campaign", "TrialLength", "TrialStudy", "load", "run"]
