"""What the claims on a learner of the shuttle rest on, each looked at in the study's own settings."""

from __future__ import annotations

from typing import cast

from models.vehicle import Vehicle
from studies.maglev.evidence import Evidence, Learner
from verification.checks import premises, settled
from workbench.contracts.claim import Claim

PAPER = "Zhang, Nan, Cao et al., PALC of a maglev train"


class Premises:
    """The premises of what is said of a learner, each one claim however many conclusions rest on it."""

    def __init__(self, evidence: Evidence) -> None:
        self.evidence, study = evidence, evidence.study
        self.silent = [settled.no_noise(study, PAPER), settled.same_disturbance(study, PAPER)]
        self.acting = settled.nothing_between(study, PAPER)
        self.train = settled.same_plant(study, PAPER)
        self.onward = settled.settled(
            "maglev.premise.continues",
            "A period begins where the last one ended.",
            PAPER,
            lambda: None if study.continues else "every period begins anew, so S jumps between periods",
            facts=lambda: {"a trial goes on where the last one ended": (int(study.continues), "")},
            holds=[("=", "a trial goes on where the last one ended", 1)],
        )
        self.whole = settled.whole_trials(study, PAPER)

    def of_the_recursion(self, name: str) -> list[Claim]:
        """Return what a factor from period to period rests on: S is that of the last period, passed on."""
        return [*self.silent, self.train, self.onward, self.whole, self._period(name)]

    def of_the_theorem(self, name: str) -> list[Claim]:
        """Return what the Lyapunov argument rests on besides."""
        return [self.acting, *self.of_the_recursion(name), self._model(name)]

    def _period(self, name: str) -> Claim:
        def why() -> str | None:
            late = self.evidence.learner(name).late
            return f"the period that the law assumes is wrong by {late} samples" if late else None

        return settled.settled(
            "maglev.premise.period",
            "The law knows the period.",
            f"{PAPER}, (13)",
            why,
            facts=lambda: {"samples by which the period is wrong": (self.evidence.learner(name).late, "")},
            controller=name,
        )

    def _model(self, name: str) -> Claim:
        def known() -> Vehicle | None:
            return cast(Learner, self.evidence.study.law(name)).model

        def why() -> str | None:
            same = known() == self.evidence.train
            return None if same else "the law's mass or running resistance is not the train's"

        of = "the train", "the law's model"
        return settled.settled(
            "maglev.premise.model",
            "The law knows the train's mass and running resistance.",
            f"{PAPER}, (12)",
            why,
            facts=lambda: {**premises.entries(self.evidence.train, of[0]), **premises.entries(known(), of[1])},
            holds=[("=", fact, fact.replace(*of)) for fact in premises.entries(self.evidence.train, of[0])],
            controller=name,
        )
