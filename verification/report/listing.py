"""A report as lines for a terminal and as a table for a notebook."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from markupsafe import Markup

from verification.report.gate import named
from verification.report.words import STANDINGS, measure, survives
from workbench.contracts.finding import Standing
from workbench.contracts.verdict import DEFAULT, Verdict

if TYPE_CHECKING:
    from verification.report.write import Report

MARK = "departs"
"""What stands beside a verdict that departs from what is expected."""
CONTRADICTION = "contradicted"
"""What stands beside a proof that runs contradict."""
_COLOURS = {
    Standing.PROVED: "#0b6b43",
    Standing.SUPPORTED: "#0f5a96",
    Standing.REFUTED: "#a8201a",
    Standing.UNDECIDED: "#6b5200",
}


def mark(report: Report, one: Verdict) -> str:
    """Return what stands beside a verdict: that runs contradict it, that it departs, or nothing."""
    if one.contradiction:
        return CONTRADICTION
    return MARK if report.gate.departure(one) else ""


def verdict_table(report: Report) -> list[tuple[str, ...]]:
    """Return the verdicts as rows of short text, a header first, for a terminal."""
    several = bool(report.cases)
    marks = [mark(report, one) for one in report.all_verdicts]
    header = (*(("case",) if several else ()), "claim", "controller", "standing", "margin")
    rows: list[tuple[str, ...]] = [(*header, "") if any(marks) else header]
    for one, marked in zip(report.all_verdicts, marks, strict=True):
        margin = "-" if one.margin is None else _margin(one.margin, one.unit)
        case = (one.case,) if several else ()
        row = (*case, one.claim, one.controller or "-", str(one.standing), margin)
        rows.append((*row, marked) if any(marks) else row)
    return rows


def digit_table(report: Report) -> list[tuple[str, ...]]:
    """Return how many digits of the scores survive as rows of short text, a header first; empty where none is known."""
    metrics = list(dict.fromkeys(metric for row in report.digits.values() for metric in row))
    rows = [(metric, *(survives(report.digits, name, metric) for name in report.digits)) for metric in metrics]
    return [("digits", *report.digits), *rows] if rows else []


def _margin(margin: float, unit: str) -> str:
    number = f"{margin:.4g}" if math.isfinite(margin) else "not finite"
    return f"{number} {unit if unit != '1' else ''}".rstrip()


def tally(report: Report) -> str:
    """Return how many claims have which standing, in one line."""
    counts = {standing: sum(one.standing is standing for one in report.all_verdicts) for standing in Standing}
    without = len(report.all_not_made)
    return (
        f"{len(report.all_verdicts)} verdicts: "
        + ", ".join(f"{counts[one]} {one}" for one in Standing)
        + (f"; {without} {'claim' if without == 1 else 'claims'} not made" if without else "")
    )


def fallen(report: Report) -> list[str]:
    """Return which laws were refused, stopped or diverged, a line each."""
    lines = []
    for one in (report, *report.cases.values()):
        case = "" if one.case == DEFAULT else f", case {one.case}"
        lines += [f"{controller}{case}: {reason}" for controller, reason in one.stopped]
    return lines


def told(report: Report) -> list[str]:
    """Return contradictions, then departures, then what was left open, a line each."""
    verdicts, gate = report.all_verdicts, report.gate
    contradicted = [f"CONTRADICTION: {named(one.key)}: {one.contradiction}" for one in verdicts if one.contradiction]
    departing = [one for one in report.departures if one.key not in {v.key for v in verdicts if v.contradiction}]
    departs = {one.key for one in departing}
    opened = [
        f"left open: {named(one.key)}: {one.method}"
        for one in verdicts
        if gate.leaves_open(one) and not one.contradiction and one.key not in departs
    ]
    return [*contradicted, *(f"departs: {one.line}" for one in departing), *opened]


def fragment(report: Report) -> str:
    """Return the verdicts as an HTML table for a notebook, under how many there are of each standing."""
    left = Markup('<td style="text-align:left">{}</td>')
    rows = []
    for one in report.all_verdicts:
        marked = mark(report, one)
        standing = Markup('<b style="color:{}">{} {}</b>').format(
            _COLOURS[one.standing], STANDINGS[one.standing][0], str(one.standing)
        )
        if marked:
            standing += Markup(" <em>({})</em>").format(marked)
        cells = (
            Markup("<code>{}</code>").format(one.label),
            one.controller or "–",
            standing,
            measure(one.margin, one.unit),
            one.statement,
        )
        rows.append(Markup("<tr>{}</tr>").format(Markup("").join(left.format(cell) for cell in cells)))
    names = ("claim", "controller", "standing", "margin", "statement")
    head = Markup("").join(Markup('<th scope="col" style="text-align:left">{}</th>').format(name) for name in names)
    lines = [*fallen(report), *told(report)]
    about = Markup("<ul>{}</ul>").format(Markup("").join(Markup("<li>{}</li>").format(line) for line in lines))
    table = Markup("<p>{}</p>{}<table><thead><tr>{}</tr></thead><tbody>{}</tbody></table>")
    return str(table.format(tally(report), about if lines else "", head, Markup("").join(rows)))
