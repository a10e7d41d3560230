"""What a verification is held against: what is expected of its claims, or a former verdicts.json."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from models.quantity import InvalidValue
from verification.report.words import meant
from workbench.contracts.claim import Role
from workbench.contracts.finding import Standing
from workbench.contracts.verdict import NotMade, Verdict

CONTRADICTED, DEPARTED, OPEN, FINE = 70, 3, 1, 0
"""Exit status, the first that is true: runs contradict a proof, a claim departs, one is open, nothing of these."""
Key = tuple[str, str, str | None]
"""Claim, case and controller."""
Baseline = Mapping[Key, Standing]


class Departure(NamedTuple):
    """A claim that stands otherwise than it should, in words."""

    key: Key
    expected: str
    because: str
    found: str

    @property
    def what(self) -> str:
        """What was expected and what was found, in one line."""
        return f"expected {self.expected} because {self.because}, found {self.found}"

    @property
    def line(self) -> str:
        """The same with claim, controller and case before it."""
        return f"{named(self.key)}: {self.what}"


@dataclass(frozen=True, kw_only=True)
class Gate:
    """What a report is held against.

    With a ``baseline``, what a former verification found is expected too: a verdict of it that is no longer there
    departs, one that it does not know does not. ``changed`` says that settings, seed or draws are not those as
    shipped, for which expectations were written: the gate then looks at requirements only, or at the baseline.
    """

    strict: bool = False
    """Whether what departs from the study's own expectations fails; what departs from a baseline always does."""
    baseline: Baseline | None = None
    changed: bool = False
    case: str = ""
    """The only case that was asked for; empty: all."""

    def departure(self, one: Verdict) -> Departure | None:
        """Return how a verdict departs from the baseline, or else from what its study expects, or None."""
        former = None if self.baseline is None else self.baseline.get(one.key)
        if former is not None and one.standing is not former:
            return Departure(one.key, str(former), "the baseline has it so", str(one.standing))
        if not (one.departs and self._looks_at(one)):
            return None
        expected, because = meant(one)
        return Departure(one.key, expected, because, str(one.standing))

    def leaves_open(self, one: Verdict) -> bool:
        """Tell whether a verdict is UNDECIDED that was not expected to be."""
        former = None if self.baseline is None else self.baseline.get(one.key)
        known = former is Standing.UNDECIDED
        return one.left_open and not known and (self._looks_at(one) or former is not None)

    def gone(self, verdicts: Sequence[Verdict], not_made: Sequence[NotMade]) -> Iterator[Departure]:
        """Give the verdicts of the baseline that are no longer there."""
        there = {one.key for one in verdicts}
        lacking = {(one.claim, one.case, one.controller): one.lacks for one in not_made}
        for key, standing in (self.baseline or {}).items():
            if key not in there and self.case in ("", key[1]):
                found = f"none, as it lacks {lacking[key]}" if key in lacking else "none"
                yield Departure(key, str(standing), "the baseline has it so", found)

    def departures(self, verdicts: Sequence[Verdict], not_made: Sequence[NotMade] = ()) -> list[Departure]:
        """Return everything that departs."""
        return [*(said for one in verdicts if (said := self.departure(one))), *self.gone(verdicts, not_made)]

    def status(self, verdicts: Sequence[Verdict], not_made: Sequence[NotMade] = ()) -> int:
        """Return the exit status that belongs to verdicts."""
        if any(one.contradiction for one in verdicts):
            return CONTRADICTED
        counted = self if self.strict else self._of_the_baseline
        if (self.strict or self.baseline is not None) and counted.departures(verdicts, not_made):
            return DEPARTED
        return OPEN if any(self.leaves_open(one) for one in verdicts) else FINE

    @property
    def _of_the_baseline(self) -> Gate:
        """The same gate without the study's own expectations."""
        return Gate(baseline=self.baseline, changed=True, case=self.case)

    def _looks_at(self, one: Verdict) -> bool:
        """Tell whether what the study expects of a verdict counts."""
        return not self.changed or (self.baseline is None and one.role is Role.REQUIREMENT)


def named(key: Key) -> str:
    """Return claim, controller and case in words."""
    claim, case, controller = key
    return ", ".join([claim, *([controller] if controller else []), f"case {case}"])


def baseline_of(file: Path, study: str, case: str = "") -> Baseline:
    """Read a former verdicts.json of a study; what it says was not made is no verdict.

    ``case`` is the only case that is looked at, empty for all. Raises InvalidValue in one line for what is no such
    file, for one of another study, and for one that holds no verdict to compare with.
    """
    wanted = f"a baseline is a verdicts.json that workbench verify wrote, got {file}"
    try:
        content: object = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise InvalidValue(f"{wanted}, which cannot be read: {error.strerror}") from None
    except ValueError:
        raise InvalidValue(f"{wanted}, which is no JSON") from None
    if not isinstance(content, list):
        raise InvalidValue(f"{wanted}, which holds no list of verdicts")
    found: dict[Key, Standing] = {}
    named_in: list[str] = []
    for place, one in enumerate(content, 1):
        match one:
            case {"claim": str(claim), "case": str(), "controller": str() | None, "standing": None}:
                named_in.append(claim)
            case {"claim": str(claim), "case": str(where), "controller": str() | None as controller, "standing": said}:
                if said not in list(Standing):
                    raise InvalidValue(f"{wanted}, whose entry {place} has the standing {said!r}")
                named_in.append(claim)
                found[claim, where, controller] = Standing(said)
            case _:
                raise InvalidValue(f"{wanted}, whose entry {place} is no verdict: it needs claim, case and controller")
    if named_in and not any(claim.startswith(f"{study}.") for claim in named_in):
        others = ", ".join(dict.fromkeys(claim.partition(".")[0] for claim in named_in))
        raise InvalidValue(f"{wanted}, which speaks of {others}, not of {study}: give one of this study")
    there = list(dict.fromkeys(where for _, where, _ in found))
    if not there:
        raise InvalidValue(f"{wanted}, which holds no verdict to compare with")
    if case and case not in there:
        raise InvalidValue(f"{wanted}, which holds no verdict of case {case!r}; its cases are: {', '.join(there)}")
    return found
