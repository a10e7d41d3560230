"""What ``workbench verify`` writes: HTML, JSON and JUnit XML from a report's content. Nothing is computed here."""

from __future__ import annotations

import dataclasses
import json
import logging
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

import jinja2
import numpy as np
from markupsafe import Markup

from models.quantity import InvalidValue
from verification.report.embedded import Drawn, embedded, titled
from verification.report.junit import junit
from verification.report.notation import clean
from verification.report.typeset import Typeset, typeset
from workbench.contracts import settings
from workbench.contracts.examination import Figure, Table
from workbench.contracts.number import finite
from workbench.contracts.study import Progress, Scores, Study
from workbench.contracts.verdict import DEFAULT, Standing, Verdict
from workbench.trials import progress
from workbench.trials.campaign import Campaign, write_figures
from workbench.trials.draft import replacing
from workbench.trials.provenance import plants_of

STANDINGS = {
    Standing.PROVED: ("✓", "holds: by exact algebra, or by interval arithmetic over the box that is stated"),
    Standing.SUPPORTED: ("≈", "was sampled, and nothing against it was found"),
    Standing.REFUTED: ("✗", "fails: the witness can be replayed"),
    Standing.UNDECIDED: ("?", "could not be told by this method, or the check failed"),
}
"""The sign of every standing, and what it says of a claim."""
FEW = 5
CASES = "cases"
"""The folder that holds a folder for every case but the first."""
Numbered = tuple[int, Verdict]
"""A verdict with its number in the page."""
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
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
    tables: Sequence[Table]
    metrics: Sequence[str]
    scores: Scores
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
    cases: Mapping[str, Report] = dataclasses.field(default_factory=dict)
    """The reports of the study's other cases, by name."""

    @property
    def all_verdicts(self) -> list[Verdict]:
        """The verdicts, then those of the other cases."""
        return [*self.verdicts, *(one for report in self.cases.values() for one in report.verdicts)]

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
    _text(draft / "verdicts.xml", junit(campaign.study.name, _version(report), report.all_verdicts))
    parts: list[Part] = []
    for folder, one in _folders(report, draft):
        scores = all_scores(one)
        content = {**one.campaign.scores_json(), "scores": scores}
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
        tables=report.tables,
        metrics=list(dict.fromkeys(metric for row in scores.values() for metric in row)),
        scores=scores,
        stopped=_stopped(report),
        figures=figures,
    )


def verdicts_json(report: Report) -> list[dict[str, object]]:
    """Return the content of ``verdicts.json``."""
    return [verdict.as_json() for verdict in report.all_verdicts]


def all_scores(report: Report) -> Scores:
    """Return the campaign's metrics, with those that the checks add."""
    scores = {controller: dict(row) for controller, row in report.campaign.scores().items()}
    for controller, metrics in report.scores.items():
        scores.setdefault(controller, {}).update({name: finite(value) for name, value in metrics.items()})
    return scores


def exit_status(report: Report, *, strict: bool = False) -> int:
    """Return 3 if any claim is refuted and ``strict``, else 1 if any is undecided, else 0."""
    standings = {verdict.standing for verdict in report.all_verdicts}
    if strict and Standing.REFUTED in standings:
        return 3
    return 1 if Standing.UNDECIDED in standings else 0


def verdict_table(report: Report) -> list[tuple[str, ...]]:
    """Return the verdicts as rows of short text, a header first, for a terminal."""
    several = bool(report.cases)
    rows: list[tuple[str, ...]] = [(*(("case",) if several else ()), "claim", "controller", "standing", "margin")]
    for one in report.all_verdicts:
        unit = one.unit if one.margin is not None and one.unit != "1" else ""
        margin = "-" if one.margin is None else f"{one.margin:.4g} {unit}".rstrip()
        case = (one.case,) if several else ()
        rows.append((*case, one.claim, one.controller or "-", str(one.standing), margin))
    return rows


def tally(report: Report) -> str:
    """Return how many claims have which standing, in one line."""
    counts = {standing: sum(one.standing is standing for one in report.all_verdicts) for standing in Standing}
    return f"{len(report.all_verdicts)} verdicts: " + ", ".join(f"{counts[one]} {one}" for one in Standing)


def fragment(report: Report) -> str:
    """Return the verdicts as an HTML table for a notebook, under how many there are of each standing."""
    colours = {
        Standing.PROVED: "#0b6b43",
        Standing.SUPPORTED: "#0f5a96",
        Standing.REFUTED: "#a8201a",
        Standing.UNDECIDED: "#6b5200",
    }
    left = Markup('<td style="text-align:left">{}</td>')
    rows = [
        Markup("<tr>{}</tr>").format(
            Markup("").join(
                [
                    left.format(Markup("<code>{}</code>").format(one.label)),
                    left.format(one.controller or "–"),
                    left.format(
                        Markup('<b style="color:{}">{} {}</b>').format(
                            colours[one.standing], STANDINGS[one.standing][0], str(one.standing)
                        )
                    ),
                    left.format(
                        f"{shown(one.margin)} {one.unit if one.margin is not None and one.unit != '1' else ''}"
                    ),
                    left.format(one.statement),
                ]
            )
        )
        for one in report.all_verdicts
    ]
    names = ("claim", "controller", "standing", "margin", "statement")
    head = Markup("").join(Markup('<th scope="col" style="text-align:left">{}</th>').format(name) for name in names)
    table = Markup("<p>{}</p><table><thead><tr>{}</tr></thead><tbody>{}</tbody></table>")
    return str(table.format(tally(report), head, Markup("").join(rows)))


def html(report: Report, parts: Sequence[Part]) -> str:
    """Return ``report.html``: one file that fetches nothing and runs nothing, with a section a case."""
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {"number": shown, "breakable": breakable, "setting": setting}
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
        Markup=Markup,
    )
    return clean(page)


def shown(value: float | None) -> str:
    """Return a number in four digits, with a power of ten where it is far from one."""
    if value is None:
        return "–"
    if not math.isfinite(value):
        return "not finite"
    digits, _, exponent = f"{value:.4g}".partition("e")
    digits = digits.replace("-", "−")
    return f"{digits}·10{str(int(exponent)).translate(SUPERSCRIPTS)}" if exponent else digits


def shown_value(value: object, number: Callable[[float], str] = shown) -> str:
    """Return any value of a witness or a setting as short text: of a long row, both ends."""
    if isinstance(value, str) or value is None:
        return "none" if value is None else value
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (np.ndarray, np.generic)):
        return shown_value(value.tolist(), number)
    if isinstance(value, Mapping):
        return f"({', '.join(f'{key} = {shown_value(inner, number)}' for key, inner in value.items())})"
    if isinstance(value, (list, tuple)):
        texts = [shown_value(one, number) for one in (value if len(value) <= FEW else [*value[:3], value[-1]])]
        if len(value) <= FEW:
            return f"[{', '.join(texts)}]"
        return f"[{', '.join(texts[:3])}, …, {texts[3]}] ({len(value)} values)"
    if isinstance(value, int):
        return str(value).replace("-", "−")
    return number(value) if isinstance(value, float) else str(value)


def setting(value: object) -> str:
    """Return a setting's value as text, its numbers in full."""
    return shown_value(value, lambda number: f"{number:.12g}")


def witness(verdict: Verdict) -> list[tuple[str, str]]:
    """Return a verdict's witness as pairs of text."""
    return [(str(key), shown_value(value)) for key, value in (verdict.witness or {}).items()]


def at_a_glance(verdicts: Sequence[Numbered]) -> tuple[list[str], dict[str, dict[str, list[Numbered]]]]:
    """Return the controllers, and by claim and controller the numbered verdicts."""
    controllers = list(dict.fromkeys(one.controller or "" for _, one in verdicts))
    claims: dict[str, dict[str, list[Numbered]]] = {}
    for number, one in verdicts:
        claims.setdefault(one.claim, {}).setdefault(one.controller or "", []).append((number, one))
    return controllers, claims


def breakable(text: str) -> Markup:
    """Return a name or unit that a narrow column may break after its dots, underscores and slashes."""
    return Markup("<wbr>").join(re.findall(r"[^._/]*[._/]?", text))


def _version(report: Report) -> str:
    return str(report.campaign.data.attrs.get("version", ""))


def _stopped(report: Report) -> list[tuple[str, str]]:
    """Return why controllers were refused or stopped, as the run noted it."""
    data = report.campaign.data
    if "stopped" not in data:
        return []
    reasons = zip(data["controller"].values, data["stopped"].values, strict=True)
    return [(str(controller), str(reason)) for controller, reason in reasons if reason]


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
                said = str(error) if isinstance(error, InvalidValue) else f"{type(error).__name__}: {error}"
                log.warning("the figure %s could not be drawn: %s", name, said)
                drawn.append(Drawn(name, figure.caption, 0, 0, None, said))
            else:
                drawn.append(embedded(name, figure.caption, folder))
            advance(1)
    return drawn
