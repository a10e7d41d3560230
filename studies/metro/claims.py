"""The claims about the metro study are those of learning laws in general; what is expected of them is its own."""

from __future__ import annotations

import dataclasses

from studies.metro.published import EXPECTED
from verification.theorems import learning
from workbench.contracts.examination import Examination
from workbench.trials.campaign import Campaign


def examine(campaign: Campaign, *, full: bool = False) -> Examination:
    """Return the examination of every law of a metro campaign."""
    return dataclasses.replace(learning.examine(campaign, full=full), expectations=EXPECTED)
