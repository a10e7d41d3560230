"""Examining a campaign: the claims of its study, each checked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib.metadata import entry_points
from typing import Any

from models.quantity import InvalidValue
from verification.report.write import Report
from verification.theorems import learning
from workbench.contracts.examination import Examination
from workbench.contracts.verdict import Claim, Verdict, undecided
from workbench.trials import progress
from workbench.trials.campaign import Campaign
from workbench.trials.replay import replayed

GROUP = "workbench.claims"
"""The entry points that name a study's claims: ``name = "package.module:examine"``."""


def judge(claim: Claim) -> Verdict:
    """Run a claim's check. A check that crashes leaves the claim UNDECIDED, with the error as its method."""
    try:
        finding = claim.check()
    except Exception as error:
        finding = undecided(f"the check failed: {type(error).__name__}: {error}")
    return Verdict(
        claim=claim.name,
        controller=claim.controller,
        statement=claim.statement,
        source=claim.source,
        standing=finding.standing,
        margin=finding.margin,
        unit=finding.unit,
        witness=finding.witness,
        method=finding.method,
    )


def examination_of(campaign: Campaign, *, full: bool = False) -> Examination:
    """Return the examination that belongs to a campaign's study.

    An installed study names its ``examine(campaign, full=...)`` by an entry point; every other study made of trials
    gets the claims of learning laws in general, :mod:`verification.theorems.learning`. Raises InvalidValue for a
    study of another kind that has no claims.
    """
    named = entry_points(group=GROUP, name=campaign.study.name)
    if named:
        examination: Examination = next(iter(named)).load()(campaign, full=full)
        return examination
    if "mse" not in campaign.data:
        raise InvalidValue(
            f"there are no claims about {campaign.study.name}, which is not made of trials: "
            "use workbench run, or give verify an Examination of your own"
        )
    return learning.examine(campaign, full=full)


def verify(
    campaign: Campaign,
    claims: Examination | Sequence[Claim] | None = None,
    *,
    full: bool = False,
    show_progress: bool = True,
) -> Report:
    """Check every claim on a campaign and return the report's content.

    ``claims`` are claims of one's own, or a whole examination; by default those of the campaign's study. ``full``
    adds the long sweeps. A campaign that was loaded is run again first, and held against its record: see
    :func:`workbench.trials.replay.replayed`, which raises InvalidValue where the two depart.
    """
    replayed(campaign, show_progress=show_progress)
    if claims is None:
        chosen = examination_of(campaign, full=full)
    else:
        chosen = claims if isinstance(claims, Examination) else Examination(claims=claims, conclude=lambda _: [])
    shown = progress.bar if show_progress else progress.silent
    verdicts: list[Verdict] = []
    with shown(len(chosen.claims), f"verify {campaign.study.name}") as advance:
        for claim in chosen.claims:
            verdicts.append(judge(claim))
            advance(1)
    failed: list[str] = []
    figures = _made("figures", chosen.figures, {}, failed)
    tables = _made("tables", chosen.tables, [], failed)
    scores = _made("scores", chosen.scores, {}, failed)
    conclusion = _made("conclusion", lambda: list(chosen.conclude(verdicts)), [], failed)
    return Report(
        campaign=campaign,
        verdicts=verdicts,
        conclusion=[*conclusion, *failed],
        figures=figures,
        tables=tables,
        scores=scores,
    )


def _made(what: str, make: Callable[[], Any], nothing: Any, failed: list[str]) -> Any:
    """Return what is made, or nothing with a sentence: verdicts are not lost to what goes round them."""
    try:
        return make()
    except Exception as error:
        failed.append(f"The {what} of this report could not be made: {type(error).__name__}: {error}")
        return nothing
