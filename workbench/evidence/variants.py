"""A campaign and the same study run with other settings, each variant run once and only when it is asked for."""

from __future__ import annotations

import dataclasses
from functools import cache

from workbench.contracts import settings
from workbench.contracts.law import AnyLaw
from workbench.contracts.study import Study
from workbench.trials.campaign import Campaign, run


class Variants:
    """A campaign and its variants."""

    def __init__(self, campaign: Campaign) -> None:
        self.campaign, self.study = campaign, campaign.study
        self.variant = cache(self._variant)
        """variant(*assignments, case="", laws=()): the study in one of its cases, with ``path=value`` assignments, and
        with other laws by name."""

    def _variant(self, *assignments: str, case: str = "", laws: tuple[tuple[str, AnyLaw], ...] = ()) -> Campaign:
        study = settings.assigned(in_case(self.study, case), assignments) if assignments else in_case(self.study, case)
        if laws:
            study = dataclasses.replace(study, controllers=dict(laws))
        return self.campaign if study is self.study else run(study, show_progress=False)


def in_case(study: Study, name: str) -> Study:
    """Return a study in one of its cases, whose changes of controllers that it does not have are left out.

    A study that was cut down to some of its controllers keeps the cases that were declared for all of them.
    """
    if name not in study.cases:
        return settings.in_case(study, name)
    absent = [path for path in study.cases[name] if path.startswith("controllers.")]
    absent = [path for path in absent if path.split(".")[1] not in study.controllers]
    if not absent:
        return settings.in_case(study, name)
    left = {path: value for path, value in study.cases[name].items() if path not in absent}
    return settings.in_case(dataclasses.replace(study, cases={**study.cases, name: left}), name)
