"""What is examined about a campaign, and what a report shows beside the verdicts."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from workbench.contracts.claim import Claim, Expectations
from workbench.contracts.survival import Survivals
from workbench.contracts.verdict import Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure


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
    draw: Callable[[], MatplotlibFigure]


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
    digits: Callable[[], Survivals] = dict
    """How many digits of the run's scores survive, run after the checks too."""
    expectations: Expectations = dataclasses.field(default_factory=dict)
    """How the claims are expected to stand in the cases as shipped, written by hand."""
