"""Every controller against every other on the metro train, tuned alike."""

from __future__ import annotations

import dataclasses

from studies.metro.study import STUDY as METRO
from workbench.design.comparison import comparison

STUDY = dataclasses.replace(
    comparison(METRO),
    title="Every controller against every other on the metro train, tuned alike",
)
