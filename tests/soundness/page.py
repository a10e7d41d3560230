"""The page of docs that a campaign of cases writes, and what it says of where verdicts may be left open."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from soundness.table import Tally, silent, table

PAGE = Path(__file__).resolve().parents[2] / "docs" / "soundness.md"
ABOUT = """# How far verdicts may be relied on

Written by `make soundness`: {cases} random small plants and laws (seed {seed}) whose truth is known by construction. Of
each every general claim is asked, and judged as `workbench verify` does. Truth comes from the parameters and from a
plain loop in NumPy, never from the program; what is PROVED of all trials is held against 200 random campaigns besides.

False PROVED: {proved}. False REFUTED: {refuted}. Broke down: {broke}.

A case has to be decided where all that a claim asks is met by construction, and nothing lies so near an edge that
rounding decides. A true one is decided as PROVED (SUPPORTED where a claim is about what was run), a false one as
REFUTED. A test holds what is decided: where this page does not say otherwise, all are.
"""
WHY: Mapping[str, str] = {
    "theorem1.conclusion": "the slope has no known ends over all states and inputs",
    "A2.lifted": "no two trials are found on either side of a jump, so it is not refuted",
    "increment_limit": "its premise, a funnel, is open",
}
"""Why verdicts are left open, by family, else by claim."""
ROW = re.compile(r"^\| ([^|]+) \| ([^|]+) \| [^|]+ \| [^|]+ \| [^|]* \|$", re.MULTILINE)
SHARE = re.compile(r"^\| ([^|]+) \| (?:(\d+) % of \d+|-) \| (?:(\d+) % of \d+|-) \|$", re.MULTILINE)


def page(found: Tally, seed: int) -> str:
    """Return the page, with the reason why verdicts are left open by family, else by claim."""
    head = ABOUT.format(
        cases=found.cases,
        seed=seed,
        proved=len(found.false_proved),
        refuted=len(found.false_refuted),
        broke=len(found.broke),
    )
    lines = [head, "## By claim", "", *table(found.by_claim(), "claim"), "", "## By family", ""]
    lines += [*table(found.by_family(), "family"), "", "## Where not all are decided", ""]
    lines += ["| claim | family | true cases decided | false cases decided | why |", "|---|---|---|---|---|"]
    for claim, family, true, false in silent(found):
        lines.append(f"| {claim} | {family} | {true} | {false} | {WHY.get(family, WHY.get(claim, ''))} |")
    return "\n".join(lines) + "\n"


def left_open() -> set[tuple[str, str]]:
    """Return claim and family of which the page in docs says that not all cases are decided."""
    found = ROW.findall(PAGE.read_text(encoding="utf-8"))
    return {(claim, family) for claim, family in found if claim not in ("claim", "---")}


def shares() -> Mapping[str, tuple[float, float]]:
    """Return by claim and by family which share of true and of false cases the page says to be decided, 0 for none."""
    found = SHARE.findall(PAGE.read_text(encoding="utf-8"))
    return {name: (int(true or 0) / 100, int(false or 0) / 100) for name, true, false in found}
