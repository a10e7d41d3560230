"""The page of docs that a campaign of cases writes."""

from __future__ import annotations

from soundness.table import Tally, silent, table

ABOUT = """# How far verdicts may be relied on

Written by `make soundness`: {cases} random small plants and laws (seed {seed}) whose truth is known by construction. Of
each every general claim is asked, and judged as `workbench verify` does. Truth comes from the parameters and from a
plain loop in NumPy, never from the program; what is PROVED of all trials is held against 200 random campaigns besides.

False PROVED: {proved}. False REFUTED: {refuted}. Broke down: {broke}.

A case has to be decided where all that a claim asks is met by construction, and nothing lies so near an edge that
rounding decides. A true one is decided as PROVED (SUPPORTED where a claim is about what was run), a false one as
REFUTED.
"""


def page(found: Tally, seed: int) -> str:
    """Return the page."""
    head = ABOUT.format(
        cases=found.cases,
        seed=seed,
        proved=len(found.false_proved),
        refuted=len(found.false_refuted),
        broke=len(found.broke),
    )
    lines = [head, "## By claim", "", *table(found.by_claim(), "claim"), "", "## By family", ""]
    lines += [
        *table(found.by_family(), "family"),
        "",
        "## Where fewer than nine in ten are decided",
        "",
        *silent(found),
    ]
    return "\n".join(lines) + "\n"
