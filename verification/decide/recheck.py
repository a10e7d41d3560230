"""Re-checking what verify wrote: every certificate by the checker, and the verdicts against what it says."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from models.quantity import InvalidValue
from verification.checker.folder import Answer, answers
from verification.checker.reading import Unusable


class Rechecked(NamedTuple):
    """What came of a folder's certificates."""

    answers: Sequence[Answer]
    alone: Sequence[str]
    """What is PROVED in it without a certificate."""

    @property
    def stands(self) -> bool:
        """Whether every certificate was accepted."""
        return all(one.outcome == "accepted" for one in self.answers)

    def lines(self) -> list[str]:
        """Return what came in lines."""
        said = [f"{one.outcome.upper()} {one.claim}: {one.words}" for one in self.answers]
        said += [f"NOT RE-CHECKABLE {one}" for one in self.alone]
        accepted = sum(one.outcome == "accepted" for one in self.answers)
        return [*said, f"{accepted} of {len(self.answers)} certificates accepted, {len(self.alone)} proofs without one"]


def recheck(out: Path) -> Rechecked:
    """Check the certificates of a folder that verify wrote, and that its verdicts say what they show.

    Raises InvalidValue for what is no such folder, or holds certificates of another study or run.
    """
    try:
        found = answers(out)
    except Unusable as error:
        raise InvalidValue(str(error)) from None
    place = out / "verdicts.json"
    try:
        verdicts = json.loads(place.read_text(encoding="utf-8"))
        said = {_label(one): one for one in verdicts if one["standing"] == "PROVED"}
        certified = {label for label, one in said.items() if one["evidence"].get("certificate")}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InvalidValue(f"{place} must be the verdicts that verify wrote, got {type(error).__name__}") from None
    shown = {one.claim for one in found}
    if shown != certified:
        odd = sorted(shown ^ certified)[0]
        raise InvalidValue(f"certificates must be those of the verdicts beside them, and {odd} is in one alone")
    return Rechecked(found, sorted(set(said) - certified))


def _label(verdict: dict[str, object]) -> str:
    controller = verdict["controller"]
    return f"{verdict['claim']} [{verdict['case']}{'' if controller is None else f', {controller}'}]"
