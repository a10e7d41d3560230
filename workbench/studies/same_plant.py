"""The same-plant study: every controller against every other on the metro train, tuned alike."""

from __future__ import annotations

import dataclasses

from workbench.comparison import comparison
from workbench.studies.metro import STUDY as METRO

STUDY = dataclasses.replace(
    comparison(METRO),
    title="Every controller against every other on the metro train, tuned alike",
)
