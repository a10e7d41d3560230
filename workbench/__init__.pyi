from workbench.contracts.law import Law as Law
from workbench.contracts.study import Study as Study
from workbench.contracts.trial_length import TrialLength as TrialLength
from workbench.contracts.verifying import Verification as Verification
from workbench.distribution import __version__ as __version__
from workbench.trials.campaign import Campaign as Campaign
from workbench.trials.campaign import load as load
from workbench.trials.campaign import run as run

__all__ = ["Campaign", "Law", "Study", "TrialLength", "Verification", "load", "run"]
