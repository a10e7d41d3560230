"""Examining a campaign: the claims of its study, each checked."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib.metadata import entry_points
from pathlib import Path
from typing import TypeVar

from models.quantity import InvalidValue
from models.users_code import InUsersCodeError, asking
from verification.report.write import CASES, Report, write_into
from verification.theorems import learning
from workbench.contracts.examination import Examination, Figure, Table
from workbench.contracts.settings import in_case
from workbench.contracts.study import Study
from workbench.contracts.verdict import DEFAULT, Claim, Finding, Verdict, undecided
from workbench.trials import progress
from workbench.trials.campaign import Campaign, run
from workbench.trials.replay import replayed

T = TypeVar("T")
Scored = Mapping[str, Mapping[str, float | None]]
GROUP = "workbench.claims"
"""The entry points that name a study's claims: ``name = "package.module:examine"``."""


def judge(claim: Claim, case: str = DEFAULT) -> Verdict:
    """Run a claim's check. A check that crashes leaves the claim UNDECIDED, with the error as its method."""
    try:
        finding = claim.check()
    except InUsersCodeError:  # a slip of the user's, which no standing should hide
        raise
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
        case=case,
    )


def examination_of(campaign: Campaign, *, full: bool = False) -> Examination:
    """Return the examination that belongs to a campaign's study.

    An installed study names its ``examine(campaign, full=...)`` by an entry point; every other study gets the claims
    of learning laws in general, :mod:`verification.theorems.learning`. What the study claims itself stands after them.
    Raises InvalidValue in one line for claims that cannot be made.
    """
    study = campaign.study
    named = entry_points(group=GROUP, name=study.name)
    made: Examination = (next(iter(named)).load() if named else learning.examine)(campaign, full=full)
    return dataclasses.replace(made, claims=[*made.claims, *_own(campaign)]) if study.claims else made


def _own(campaign: Campaign) -> list[Claim]:
    """Return the claims that a study makes itself, whose slips are told with their place."""
    found: list[Claim] = []
    for claimer in campaign.study.claims:
        with asking("the claims of the study", claimer):
            made = claimer(campaign.study, campaign.data)
            if not isinstance(made, (list, tuple)):
                raise InvalidValue(f"claims must be a list of Claim objects, got {made!r}")
            for one in made:
                if not isinstance(one, Claim):
                    raise InvalidValue(f"claims must be Claim objects, got {one!r}")
                if not callable(one.check):
                    raise InvalidValue(f"the check of {one.name} must be a function, got {one.check!r}")
            found += [dataclasses.replace(one, check=partial(_asked, one)) for one in made]
    return found


def _asked(claim: Claim) -> Finding:
    with asking(f"the check of {claim.name}", claim.check):
        finding = claim.check()
        if not isinstance(finding, Finding):
            raise InvalidValue(f"a check must give a Finding, got {finding!r}")
        return finding


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
    if not isinstance(campaign, Campaign):
        raise InvalidValue(f"verify takes a campaign, as in verify(run(study)); got {repr(campaign).splitlines()[0]}")
    replayed(campaign, show_progress=show_progress)
    if claims is None:
        chosen = examination_of(campaign, full=full)
    else:
        chosen = claims if isinstance(claims, Examination) else Examination(claims=claims, conclude=lambda _: [])
    shown = progress.bar if show_progress else progress.silent
    verdicts: list[Verdict] = []
    with shown(len(chosen.claims), f"verify {campaign.study.name} {campaign.study.case}".strip()) as advance:
        for claim in chosen.claims:
            verdicts.append(judge(claim, campaign.study.case or DEFAULT))
            advance(1)
    failed: list[str] = []
    nothing: tuple[Mapping[str, Figure], Sequence[Table], Scored] = ({}, [], {})
    figures = _made("figures", chosen.figures, nothing[0], failed)
    tables = _made("tables", chosen.tables, nothing[1], failed)
    scores = _made("scores", chosen.scores, nothing[2], failed)
    said: Sequence[str] = []
    conclusion = _made("conclusion", lambda: chosen.conclude(verdicts), said, failed)
    return Report(
        campaign=campaign,
        verdicts=verdicts,
        conclusion=[*conclusion, *failed],
        figures=figures,
        tables=tables,
        scores=scores,
    )


def verify_cases(
    study: Study, draft: Path, *, only: str | None = None, full: bool = False, show_progress: bool = True
) -> Report:
    """Run and check a study in every case, or in one, and write each into a folder as it comes; return one report.

    The default case, or the one that is asked for, lies at the top of ``draft``; every other in ``cases/NAME``, with
    files of the same names. Verdicts and report, which speak of all cases, are at the top alone.
    """
    first = in_case(study, only or "")
    done = run(first, show_progress=show_progress)
    done.record(draft)
    found = verify(done, full=full, show_progress=show_progress)
    others: dict[str, Report] = {}
    for name in () if only is not None or study.case else study.cases:  # a study in a case is that case alone
        campaign = run(in_case(study, name), show_progress=show_progress)
        folder = draft / CASES / name
        folder.mkdir(parents=True)
        campaign.record(folder)
        others[name] = verify(campaign, full=full, show_progress=show_progress)
    whole = dataclasses.replace(found, cases=others)
    write_into(whole, draft, show_progress=show_progress)
    return whole


def _made(what: str, make: Callable[[], T], nothing: T, failed: list[str]) -> T:
    """Return what is made, or nothing with a sentence: verdicts are not lost to what goes round them."""
    try:
        return make()
    except Exception as error:
        failed.append(f"The {what} of this report could not be made: {type(error).__name__}: {error}")
        return nothing
