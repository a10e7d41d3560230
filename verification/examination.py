"""Examining a campaign: the claims of its study, each checked, and what a report shows beside them."""

from __future__ import annotations

import dataclasses
import importlib
import importlib.util
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from models.quantity import InvalidValue
from verification.verdict import Claim, Verdict, judge
from workbench import progress
from workbench.campaign import Campaign


@dataclasses.dataclass(frozen=True, kw_only=True)
class Table:
    """A table of a report, e.g. what a paper published beside what was measured, and why they differ."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Figure:
    """A figure of a report: what it shows, and a function that draws it with Matplotlib."""

    caption: str
    draw: Callable[[], Any]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Examination:
    """What a study's claims module says about a campaign, before anything is checked.

    ``conclude`` turns the verdicts into paragraphs in plain words; ``scores`` are metrics by controller that
    ``scores.json`` gains; both run after the checks, and may use what the checks computed.
    """

    claims: Sequence[Claim]
    conclude: Callable[[Sequence[Verdict]], Sequence[str]]
    figures: Callable[[], Mapping[str, Figure]] = dict
    tables: Callable[[], Sequence[Table]] = list
    scores: Callable[[], Mapping[str, Mapping[str, float | None]]] = dict


@dataclasses.dataclass(frozen=True, kw_only=True)
class Report:
    """A campaign with its verdicts and everything else that a report shows."""

    campaign: Campaign
    verdicts: Sequence[Verdict]
    conclusion: Sequence[str]
    figures: Mapping[str, Figure]
    tables: Sequence[Table]
    scores: Mapping[str, Mapping[str, float | None]]

    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Write everything that ``workbench verify`` writes into a folder, all or nothing; return the folder.

        Raises InvalidValue where the folder cannot be written.
        """
        from verification.report import write

        return write(self, folder)

    def _repr_html_(self) -> str:
        """Return the verdicts as a table, which notebooks show."""
        from verification.report import fragment

        return fragment(self)


def examination_of(campaign: Campaign, *, full: bool = False) -> Examination:
    """Return the examination that belongs to a campaign's study.

    A built-in study has ``verification/claims/NAME.py`` with ``examine(campaign, full=...)``; every other study
    made of trials gets the claims of learning laws in general, ``verification/claims/learning.py``. Raises
    InvalidValue for a study of another kind that has no claims.
    """
    name = campaign.study.name.replace("-", "_")
    module = f"verification.claims.{name}"
    if not name.isidentifier() or importlib.util.find_spec(module) is None:
        if "mse" not in campaign.data:
            raise InvalidValue(
                f"there are no claims about {campaign.study.name}, which is not made of trials: "
                "use workbench run, or give verify an Examination of your own"
            )
        module = "verification.claims.learning"
    examination: Examination = importlib.import_module(module).examine(campaign, full=full)
    return examination


def verify(
    campaign: Campaign,
    claims: Examination | Sequence[Claim] | None = None,
    *,
    full: bool = False,
    show_progress: bool = True,
) -> Report:
    """Check every claim on a campaign and return the report's content.

    ``claims`` are claims of one's own, or a whole examination; by default those of the campaign's study. ``full``
    adds the long sweeps.
    """
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
