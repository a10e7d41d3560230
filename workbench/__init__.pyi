from workbench.contracts.law import Law as Law
from workbench.distribution import __version__ as __version__
from workbench.trials.campaign import Campaign as Campaign
from workbench.trials.campaign import load as load
from workbench.trials.campaign import run as run
from workbench.trials.length import TrialLength as TrialLength
from workbench.trials.study import TrialStudy as TrialStudy

__all__ = ["Campaign", "Law", "TrialLength", "TrialStudy", "load", "run"]
