"""What ``workbench verify`` writes: HTML, JSON and JUnit XML from a report's content. Nothing is computed here."""

from __future__ import annotations

import dataclasses
import json
import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

import jinja2
from markupsafe import Markup

from models.quantity import InvalidValue
from verification.certificates.recheck import Recheck
from verification.report.embedded import Drawn, embedded, titled
from verification.report.gate import Departure, Gate, named
from verification.report.junit import junit
from verification.report.listing import fallen, fragment, mark
from verification.report.notation import clean
from verification.report.typeset import Typeset, typeset
from verification.report.words import (
    STANDINGS,
    SURVIVED,
    breakable,
    evidence,
    meant,
    measure,
    scope,
    setting,
    shown,
    survives,
    witness,
)
from workbench.contracts import settings
from workbench.contracts.examination import Figure, Table
from workbench.contracts.finding import Standing
from workbench.contracts.number import finite
from workbench.contracts.study import Progress, Scores, Study
from workbench.contracts.survival import Survivals
from workbench.contracts.verdict import DEFAULT, NotMade, Verdict
from workbench.trials import progress
from workbench.trials.campaign import Campaign, write_figures
from workbench.trials.draft import replacing
from workbench.trials.provenance import plants_of

CASES = "cases"
"""The folder that holds a folder for every case but the first."""
Numbered = tuple[int, Verdict]
"""A verdict with its number in the page."""
log = logging.getLogger(__name__)


class Equations(NamedTuple):
    """The equations of one plant, or why they could not be typeset."""

    path: str
    source: str
    typeset: Typeset | None
    failure: str = ""


class Part(NamedTuple):
    """What the page shows of one case of the study."""

    case: str
    prefix: str
    """What the names of its places in the page begin with."""
    folder: str
    changes: Sequence[tuple[str, object]]
    """Settings that differ from the study as it is declared, by path."""
    conclusion: Sequence[str]
    verdicts: Sequence[Numbered]
    controllers: Sequence[str]
    claims: Mapping[str, Mapping[str, Sequence[Numbered]]]
    counts: Mapping[Standing, int]
    not_made: Mapping[tuple[str, str], Sequence[NotMade]]
    """Claims that were not made, by controller and by the property that is lacking."""
    tables: Sequence[Table]
    metrics: Sequence[str]
    scores: Scores
    digits: Survivals
    stopped: Sequence[tuple[str, str]]
    figures: Sequence[Drawn]

    @property
    def spoken(self) -> str:
        """What a name that is read aloud ends with, so that no two are the same."""
        return f", case {self.case}" if self.prefix else ""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Report:
    """A campaign with its verdicts and everything else that a report shows."""

    campaign: Campaign
    verdicts: Sequence[Verdict]
    conclusion: Sequence[str]
    figures: Mapping[str, Figure]
    tables: Sequence[Table]
    scores: Mapping[str, Mapping[str, float | None]]
    digits: Survivals = dataclasses.field(default_factory=dict)
    """How many digits of the run's scores survive, by controller and metric."""
    cases: Mapping[str, Report] = dataclasses.field(default_factory=dict)
    """The reports of the study's other cases, by name."""
    not_made: Sequence[NotMade] = ()
    """Claims that have no meaning here, each with what it lacks."""
    certificates: Recheck | None = None
    """The certificates of what was proved, of all cases."""
    gate: Gate = dataclasses.field(default_factory=Gate)
    """What the verdicts are held against."""

    @property
    def all_verdicts(self) -> list[Verdict]:
        """The verdicts, then those of the other cases."""
        return [*self.verdicts, *(one for report in self.cases.values() for one in report.verdicts)]

    @property
    def all_not_made(self) -> list[NotMade]:
        """The claims that were not made, then those of the other cases."""
        return [*self.not_made, *(one for report in self.cases.values() for one in report.not_made)]

    @property
    def departures(self) -> list[Departure]:
        """What departs from what is expected, in all cases."""
        return self.gate.departures(self.all_verdicts, self.all_not_made)

    @property
    def stopped(self) -> list[tuple[str, str]]:
        """The controllers that did not come to their end, with the reason that the run noted."""
        return self.campaign.stopped

    @property
    def case(self) -> str:
        """The study's case that this speaks of, its other ones aside."""
        return self.campaign.study.case or DEFAULT

    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Write everything that ``workbench verify`` writes into a folder, all or nothing; return the folder.

        Raises InvalidValue where the folder cannot be written.
        """
        return write(self, folder)

    def _repr_html_(self) -> str:
        """Return the verdicts as a table, which notebooks show."""
        return fragment(self)


def write(report: Report, folder: str | os.PathLike[str], *, show_progress: bool = True) -> Path:
    """Replace a folder by all that ``workbench verify`` writes, all or nothing; return the folder.

    Raises InvalidValue where it cannot be written, or holds what no run wrote.
    """
    with replacing(folder) as draft:
        for folder_of, one in _folders(report, draft):
            one.campaign.record(folder_of)
        write_into(report, draft, show_progress=show_progress)
    return Path(folder)


def write_into(report: Report, draft: Path, *, show_progress: bool = True) -> None:
    """Write verdicts.json, verdicts.xml and report.html into a folder, and what belongs to every case.

    That is scores.json, the study's documents and figures/, of the first case into the folder itself, of every other
    into ``cases/NAME`` in it; there are no figures of evidence of the others. The record is written by
    :meth:`workbench.trials.campaign.Campaign.record`, before anything is verified. A figure that cannot be drawn
    leaves its reason in the report.
    """
    campaign = report.campaign
    _text(draft / "verdicts.json", json.dumps(verdicts_json(report), indent=2, allow_nan=False))
    _text(
        draft / "verdicts.xml",
        junit(campaign.study.name, _version(report), report.all_verdicts, report.all_not_made, report.gate),
    )
    if report.certificates is not None:
        report.certificates.write_into(draft, report.all_verdicts)
    parts: list[Part] = []
    for folder, one in _folders(report, draft):
        scores = all_scores(one)
        content = {**one.campaign.scores_json(), "scores": scores, "digits": digits_json(one)}
        _text(folder / "scores.json", json.dumps(content, indent=2, allow_nan=False))
        one.campaign.write_documents(folder)
        shown_as = progress.bar if show_progress else progress.silent
        figures = _drawn(one, folder / "figures", shown_as, evidence=one is report)
        first = 1 + sum(len(part.verdicts) for part in parts)
        parts.append(_part(one, first, figures, scores, folder.relative_to(draft)))
    _text(draft / "report.html", html(report, parts))


def _folders(report: Report, draft: Path) -> Iterator[tuple[Path, Report]]:
    """Give the folder of every case, made where it is not there, and the report of that case."""
    yield draft, report
    for name, other in report.cases.items():
        folder = draft / CASES / name
        folder.mkdir(parents=True, exist_ok=True)
        yield folder, other


def _part(report: Report, first: int, figures: Sequence[Drawn], scores: Scores, folder: Path) -> Part:
    """Return what the page shows of a case, its verdicts numbered from ``first`` on."""
    study, alone = report.campaign.study, folder == Path()
    numbered = list(enumerate(report.verdicts, first))
    controllers, claims = at_a_glance(numbered)
    return Part(
        case=report.case,
        prefix="" if alone else f"case-{report.case}-",
        folder="." if alone else f"{folder.as_posix()}/",
        changes=list(study.cases.get(study.case, {}).items()),
        conclusion=report.conclusion,
        verdicts=numbered,
        controllers=controllers,
        claims=claims,
        counts={standing: sum(one.standing is standing for one in report.verdicts) for standing in Standing},
        not_made=_grouped(report.not_made),
        tables=report.tables,
        metrics=list(dict.fromkeys(metric for row in scores.values() for metric in row)),
        scores=scores,
        digits=report.digits,
        stopped=report.stopped,
        figures=figures,
    )


def _grouped(not_made: Sequence[NotMade]) -> dict[tuple[str, str], list[NotMade]]:
    """Return claims that were not made by controller and by what they lack."""
    found: dict[tuple[str, str], list[NotMade]] = {}
    for one in not_made:
        found.setdefault((one.controller or "", one.lacks), []).append(one)
    return found


def verdicts_json(report: Report) -> list[dict[str, object]]:
    """Return the content of ``verdicts.json``."""
    return [*(one.as_json() for one in report.all_verdicts), *(one.as_json() for one in report.all_not_made)]


def exit_status(report: Report) -> int:
    """Return the exit status of ``workbench verify``: see :meth:`verification.report.gate.Gate.status`."""
    return report.gate.status(report.all_verdicts, report.all_not_made)


def all_scores(report: Report) -> Scores:
    """Return the campaign's metrics, with those that the checks add."""
    scores = {controller: dict(row) for controller, row in report.campaign.scores().items()}
    for controller, metrics in report.scores.items():
        scores.setdefault(controller, {}).update({name: finite(value) for name, value in metrics.items()})
    return scores


def digits_json(report: Report) -> dict[str, object]:
    """Return how many digits of the scores survive, by controller and metric, as ``scores.json`` holds them."""
    return {
        controller: {metric: one.as_json() for metric, one in row.items()} for controller, row in report.digits.items()
    }


def html(report: Report, parts: Sequence[Part]) -> str:
    """Return ``report.html``: one file that fetches nothing and runs nothing, with a section a case."""
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {"number": shown, "breakable": breakable, "setting": setting}
    numbers = {one.key: number for part in parts for number, one in part.verdicts}
    template = environment.from_string(files(__package__).joinpath("report.html.j2").read_text(encoding="utf-8"))
    study = report.campaign.study
    counts = {standing: sum(one.standing is standing for one in report.all_verdicts) for standing in Standing}
    page = template.render(
        study=study,
        version=_version(report),
        standings=[(standing, STANDINGS[standing][1], counts[standing]) for standing in Standing],
        signs={standing: STANDINGS[standing][0] for standing in Standing},
        parts=parts,
        equations=list(_equations(study)),
        settings=settings.rows(study),
        witness=witness,
        scope=scope,
        evidence=evidence,
        measure=measure,
        meant=meant,
        survives=survives,
        survived=SURVIVED,
        mark=partial(mark, report),
        departure=report.gate.departure,
        fallen=fallen(report),
        contradictions=[one for one in report.all_verdicts if one.contradiction],
        departures=report.departures,
        named=named,
        numbers=numbers,
        Markup=Markup,
    )
    return clean(page)


def at_a_glance(verdicts: Sequence[Numbered]) -> tuple[list[str], dict[str, dict[str, list[Numbered]]]]:
    """Return the controllers, and by claim and controller the numbered verdicts."""
    controllers = list(dict.fromkeys(one.controller or "" for _, one in verdicts))
    claims: dict[str, dict[str, list[Numbered]]] = {}
    for number, one in verdicts:
        claims.setdefault(one.claim, {}).setdefault(one.controller or "", []).append((number, one))
    return controllers, claims


def _version(report: Report) -> str:
    return str(report.campaign.data.attrs.get("version", ""))


def _text(file: Path, content: str) -> None:
    file.write_text(content.rstrip("\n") + "\n", encoding="utf-8", errors="replace", newline="\n")


def _equations(study: Study) -> Iterator[Equations]:
    for path, plant in plants_of(study):
        source = plant.source
        try:
            yield Equations(path, source, typeset(plant))
        except Exception as error:
            # Equations beyond typesetting must not cost the verdicts.
            said = str(error) if isinstance(error, InvalidValue) else f"{type(error).__name__}: {error}"
            yield Equations(path, source, None, said)


def _drawn(report: Report, folder: Path, shown: Progress, *, evidence: bool) -> list[Drawn]:
    """Draw every figure once, as files, and return what the page shows of each; those of the evidence where wanted."""
    from workbench.trials.glyphs import said_together

    folder.mkdir()
    plain = {name: Figure(caption=titled(name), draw=draw) for name, draw in report.campaign.figures().items()}
    of_evidence = report.figures if evidence else {}
    figures = dict(of_evidence) | {name: one for name, one in plain.items() if name not in of_evidence}
    drawn: list[Drawn] = []
    with said_together(), shown(len(figures), f"figures {report.campaign.study.case}".strip()) as advance:
        for name, figure in figures.items():
            try:
                write_figures({name: figure.draw}, folder)
            except OSError:
                raise
            except Exception as error:
                known = isinstance(error, InvalidValue)
                said = str(error) if known else f"the program met {type(error).__name__}, see its log"
                log.warning("the figure %s could not be drawn: %s", name, said, exc_info=None if known else error)
                drawn.append(Drawn(name, figure.caption, 0, 0, None, said))
            else:
                drawn.append(embedded(name, figure.caption, folder))
            advance(1)
    return drawn
