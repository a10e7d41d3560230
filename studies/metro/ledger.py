"""The readings ledger: what each reading of a paper's units makes of its comparison.

``python -m studies.metro.ledger`` prints it for the metro study as the Markdown table that the README shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from models.point_mass import READINGS
from models.quantity import rebuilt
from workbench.contracts import settings
from workbench.contracts.study import Study
from workbench.trials.simulation import mse_by_trial

UNITS = {"icfdl": (1.0, 10.0, 100.0, 1000.0, 10_000.0), "pd": (1.0, 10.0)}


class Entry(NamedTuple):
    """One law in one force unit under one reading of the units."""

    reading: str
    force_unit: float
    """In newtons."""
    law: str
    first: float
    """Mean square error of the first trial."""
    last: float | None
    """Mean square error of the last trial, None where the law diverged."""
    largest: float | None
    """Largest mean square error of all trials, None where the law diverged."""
    trials: int
    """Trials that ran."""


def ledger(study: Study, readings: Sequence[str] = tuple(READINGS)) -> list[Entry]:
    """Run icfdl and pd of a metro study under every reading of the units, in every force unit."""
    entries = []
    for reading in readings:
        read = settings.changed(study, {"plant": {"reading": reading}})
        for name, units in UNITS.items():
            laws = [rebuilt(read.controllers[name], {"force_unit": unit}) for unit in units]
            for unit, (mse, reason) in zip(units, mse_by_trial(read, name, laws), strict=True):
                last, largest = (None, None) if reason else (mse[-1], max(mse))
                entries.append(Entry(reading, unit, name, mse[0], last, largest, len(mse)))
    return entries


def supported(entry: Entry, entries: Sequence[Entry]) -> str:
    """Return in plain words which of the paper's claims an entry supports.

    The claims: the error falls from trial to trial, and that of icfdl ends below that of pd (Fig. 7), pd with the
    published gains in newtons.
    """
    if entry.last is None or entry.largest is None:
        return f"neither: diverges, stopped at trial {entry.trials}"
    falls = "falls" if entry.last < entry.first else "does not fall"
    transient = (
        f" after rising to {entry.largest / entry.first:.1f} x the first" if entry.largest > 1.05 * entry.first else ""
    )
    if entry.law == "pd":
        return f"the error {falls}{transient}"
    (pd,) = (e for e in entries if e.law == "pd" and e.reading == entry.reading and e.force_unit == 1)
    if pd.last is None:
        return f"the error {falls}{transient}; pd in newtons diverges, so there is no order to compare"
    if entry.last < pd.last:
        return f"both: the error {falls}{transient}, and ends below pd's (Fig. 7)"
    return f"the error {falls}{transient}, but ends above pd's, against Fig. 7"


def markdown(entries: Sequence[Entry]) -> str:
    """Return the ledger as a Markdown table."""
    lines = [
        "| reading | force unit (N) | law | last MSE | largest MSE | which claims it supports |",
        "|---|---:|---|---:|---:|---|",
    ]
    for entry in entries:
        numbers = ["diverged" if mse is None else f"{mse:.3g}" for mse in (entry.last, entry.largest)]
        cells = [entry.reading, f"{entry.force_unit:g}", entry.law, *numbers, supported(entry, entries)]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    from studies.metro.study import STUDY

    print(markdown(ledger(STUDY)))
