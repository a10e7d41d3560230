"""A campaign and the same study run with other settings, each variant run once and only when it is asked for."""

from __future__ import annotations

import dataclasses
from functools import cache
from typing import Any

from workbench.trials import settings
from workbench.trials.campaign import Campaign, run


class Variants:
    """A campaign and its variants."""

    def __init__(self, campaign: Campaign) -> None:
        self.campaign, self.study = campaign, campaign.study
        self.variant = cache(self._variant)
        """variant(*assignments, laws=()): the study with ``path=value`` assignments, and with other laws by name."""

    def _variant(self, *assignments: str, laws: tuple[tuple[str, Any], ...] = ()) -> Campaign:
        if not assignments and not laws:
            return self.campaign
        study = settings.assigned(self.study, assignments)
        if laws:
            study = dataclasses.replace(study, controllers=dict(laws))
        return run(study, show_progress=False)
