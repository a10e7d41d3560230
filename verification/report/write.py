"""What ``workbench verify`` writes: HTML, JSON and JUnit XML from a report's content. Nothing is computed here."""

from __future__ import annotations

import base64
import dataclasses
import io
import json
import logging
import math
import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import jinja2
from markupsafe import Markup

from models.quantity import InvalidValue
from verification.report.junit import junit
from verification.report.notation import clean
from verification.report.typeset import Typeset, typeset
from workbench.contracts.examination import Figure, Table
from workbench.contracts.number import finite
from workbench.contracts.study import Progress
from workbench.contracts.verdict import Standing, Verdict
from workbench.trials import progress, settings
from workbench.trials.campaign import Campaign, figure_file, write_figures
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
SMALL_SVG = 60_000
"""Bytes up to which a figure stands in the page as SVG; a larger one stands there as PNG."""
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
log = logging.getLogger(__name__)


class Drawn(NamedTuple):
    """A figure as the page shows it: where it stands as a file, its size in CSS pixels, its content in the page."""

    name: str
    caption: str
    width: int
    height: int
    data: Markup | None
    failure: str = ""


class Equations(NamedTuple):
    """The equations of one plant, or why they could not be typeset."""

    path: str
    source: str
    typeset: Typeset | None
    failure: str = ""


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
        return write(self, folder)

    def _repr_html_(self) -> str:
        """Return the verdicts as a table, which notebooks show."""
        return fragment(self)


def write(report: Report, folder: str | os.PathLike[str], *, show_progress: bool = True) -> Path:
    """Replace a folder by all that ``workbench verify`` writes, all or nothing; return the folder.

    Raises InvalidValue where it cannot be written, or holds what no run wrote.
    """
    with replacing(folder) as draft:
        report.campaign.record(draft)
        write_into(report, draft, show_progress=show_progress)
    return Path(folder)


def write_into(report: Report, draft: Path, *, show_progress: bool = True) -> None:
    """Write scores.json, the study's documents, figures/, verdicts.json, verdicts.xml and report.html into a folder.

    The record is written by :meth:`workbench.trials.campaign.Campaign.record`, before anything is verified. A figure
    that cannot be drawn leaves its reason in the report.
    """
    campaign, scores = report.campaign, scores_json(report)
    _text(draft / "verdicts.json", json.dumps(verdicts_json(report), indent=2, allow_nan=False))
    _text(draft / "verdicts.xml", junit(campaign.study.name, _version(report), report.verdicts))
    _text(draft / "scores.json", json.dumps(scores, indent=2, allow_nan=False))
    campaign.write_documents(draft)
    figures = _drawn(report, draft / "figures", progress.bar if show_progress else progress.silent)
    _text(draft / "report.html", html(report, figures, scores["scores"]))


def verdicts_json(report: Report) -> list[dict[str, Any]]:
    """Return the content of ``verdicts.json``."""
    return [verdict.as_json() for verdict in report.verdicts]


def scores_json(report: Report) -> dict[str, Any]:
    """Return the content of ``scores.json``: the campaign's metrics, with those that the checks add."""
    content = report.campaign.scores_json()
    for controller, metrics in report.scores.items():
        row = content["scores"].setdefault(controller, {})
        row.update({name: finite(value) for name, value in metrics.items()})
    return content


def exit_status(report: Report, *, strict: bool = False) -> int:
    """Return 3 if any claim is refuted and ``strict``, else 1 if any is undecided, else 0."""
    standings = {verdict.standing for verdict in report.verdicts}
    if strict and Standing.REFUTED in standings:
        return 3
    return 1 if Standing.UNDECIDED in standings else 0


def verdict_table(report: Report) -> list[tuple[str, ...]]:
    """Return the verdicts as rows of short text, a header first, for a terminal."""
    rows: list[tuple[str, ...]] = [("claim", "controller", "standing", "margin")]
    for one in report.verdicts:
        unit = one.unit if one.margin is not None and one.unit != "1" else ""
        margin = "-" if one.margin is None else f"{one.margin:.4g} {unit}".rstrip()
        rows.append((one.claim, one.controller or "-", str(one.standing), margin))
    return rows


def tally(report: Report) -> str:
    """Return how many claims have which standing, in one line."""
    counts = {standing: sum(one.standing is standing for one in report.verdicts) for standing in Standing}
    return f"{len(report.verdicts)} verdicts: " + ", ".join(f"{counts[one]} {one}" for one in Standing)


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
                    left.format(Markup("<code>{}</code>").format(one.claim)),
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
        for one in report.verdicts
    ]
    names = ("claim", "controller", "standing", "margin", "statement")
    head = Markup("").join(Markup('<th scope="col" style="text-align:left">{}</th>').format(name) for name in names)
    table = Markup("<p>{}</p><table><thead><tr>{}</tr></thead><tbody>{}</tbody></table>")
    return str(table.format(tally(report), head, Markup("").join(rows)))


def html(report: Report, figures: Sequence[Drawn], scores: Mapping[str, Mapping[str, float | None]]) -> str:
    """Return ``report.html``: one file that fetches nothing and runs nothing."""
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {"number": shown, "breakable": breakable, "setting": setting}
    template = environment.from_string(files(__package__).joinpath("report.html.j2").read_text(encoding="utf-8"))
    study = report.campaign.study
    counts = {standing: sum(one.standing is standing for one in report.verdicts) for standing in Standing}
    controllers, claims = at_a_glance(report.verdicts)
    page = template.render(
        study=study,
        version=_version(report),
        standings=[(standing, STANDINGS[standing][1], counts[standing]) for standing in Standing],
        signs={standing: STANDINGS[standing][0] for standing in Standing},
        conclusion=report.conclusion,
        verdicts=report.verdicts,
        controllers=controllers,
        claims=claims,
        equations=list(_equations(study)),
        settings=settings.rows(study),
        tables=report.tables,
        metrics=list(dict.fromkeys(metric for row in scores.values() for metric in row)),
        scores=scores,
        stopped=_stopped(report),
        figures=figures,
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


def shown_value(value: Any, number: Callable[[float], str] = shown) -> str:
    """Return any value of a witness or a setting as short text: of a long row, both ends."""
    if isinstance(value, str) or value is None:
        return "none" if value is None else value
    if isinstance(value, bool):
        return "true" if value else "false"
    if hasattr(value, "tolist"):
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


def setting(value: Any) -> str:
    """Return a setting's value as text, its numbers in full."""
    return shown_value(value, lambda number: f"{number:.12g}")


def witness(verdict: Verdict) -> list[tuple[str, str]]:
    """Return a verdict's witness as pairs of text."""
    return [(str(key), shown_value(value)) for key, value in (verdict.witness or {}).items()]


def at_a_glance(verdicts: Sequence[Verdict]) -> tuple[list[str], dict[str, dict[str, list[tuple[int, Verdict]]]]]:
    """Return the controllers, and by claim and controller the numbered verdicts."""
    controllers = list(dict.fromkeys(one.controller or "" for one in verdicts))
    claims: dict[str, dict[str, list[tuple[int, Verdict]]]] = {}
    for number, one in enumerate(verdicts, 1):
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


def _equations(study: Any) -> Iterator[Equations]:
    for path, plant in plants_of(study):
        source = str(getattr(plant, "source", ""))
        try:
            yield Equations(path, source, typeset(plant))
        except Exception as error:
            # Equations beyond typesetting must not cost the verdicts.
            said = str(error) if isinstance(error, InvalidValue) else f"{type(error).__name__}: {error}"
            yield Equations(path, source, None, said)


def _drawn(report: Report, folder: Path, shown: Progress) -> list[Drawn]:
    """Draw every figure once, as files, and return what the page shows of each."""
    from workbench.trials.glyphs import said_together

    folder.mkdir()
    plain = {name: Figure(caption=_titled(name), draw=draw) for name, draw in report.campaign.figures().items()}
    figures = dict(report.figures) | {name: one for name, one in plain.items() if name not in report.figures}
    drawn: list[Drawn] = []
    with said_together(), shown(len(figures), "figures") as advance:
        for name, figure in figures.items():
            try:
                write_figures({name: figure.draw}, folder)
            except OSError:
                raise
            except Exception as error:
                log.warning("the figure %s could not be drawn: %s: %s", name, type(error).__name__, error)
                drawn.append(Drawn(name, figure.caption, 0, 0, None, f"{type(error).__name__}: {error}"))
            else:
                drawn.append(_embedded(name, figure.caption, folder))
            advance(1)
    return drawn


def _embedded(name: str, caption: str, folder: Path) -> Drawn:
    file = folder / figure_file(name)
    svg = file.with_name(f"{file.name}.svg").read_bytes()
    box = [float(number) for number in ET.fromstring(svg).attrib["viewBox"].split()]
    if len(svg) <= SMALL_SVG:
        small, kind = svg, "svg+xml"
    else:
        small, kind = _in_few_colours(file.with_name(f"{file.name}.png")), "png"
    data = Markup(f"data:image/{kind};base64,{base64.b64encode(small).decode('ascii')}")
    return Drawn(name, caption, round(box[2] * 96 / 72), round(box[3] * 96 / 72), data)


def _in_few_colours(file: Path) -> bytes:
    """Return a PNG with a palette, about a third of the size."""
    from PIL import Image

    written = io.BytesIO()
    with Image.open(file) as image:
        image.convert("RGB").quantize(128, dither=Image.Dither.NONE).save(written, "PNG", optimize=True)
    return written.getvalue()


def _titled(name: str) -> str:
    words = [word.upper() if word in ("mse", "ppd", "rms") else word for word in name.split("_")]
    text = " ".join(words)
    return f"{text[:1].upper()}{text[1:]}."
