"""Replaying a refutation that was written: its witness, once more, on the study as it is now."""

from __future__ import annotations

import difflib
import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from models.quantity import InvalidValue
from verification.decide.judge import EXACT, once_more
from verification.decide.verify import AnotherRun, examination_of
from verification.report.gate import Key, named
from verification.report.words import shown_value
from verification.report.write import CASES
from workbench.contracts.claim import Claim
from workbench.contracts.finding import Finding, Standing, plain
from workbench.contracts.number import finite
from workbench.contracts.study import Study
from workbench.contracts.verdict import DEFAULT
from workbench.trials.campaign import Campaign, load
from workbench.trials.replay import unchanged

AGREES = 1e-6
"""How far two replays of one witness may differ, relative to the margin."""
Entry = Mapping[str, object]
"""A verdict as ``verdicts.json`` holds it."""


@dataclass(frozen=True, kw_only=True)
class Replay:
    """A refutation that was replayed."""

    claim: str
    case: str
    controller: str | None
    statement: str
    witness: Mapping[str, object]
    then: float | None
    """The margin that the witness gave when the verdict was given; None where the claim has no size."""
    now: float | None
    unit: str
    stands: bool
    """Whether the claim fails at its witness again, with the same margin."""
    reason: str
    """Why it stands or not, in words."""

    def lines(self) -> Iterator[str]:
        """Give what a terminal shows."""
        yield f"{named((self.claim, self.case, self.controller))}: {self.statement}"
        for name, value in self.witness.items():
            yield f"witness: {name} = {shown_value(value)}"
        for word, margin in (("then", self.then), ("now", self.now)):
            yield f"margin {word}: {'no number' if margin is None else f'{margin:.12g} {self.unit}'.rstrip()}"
        yield f"The refutation {'stands' if self.stands else 'does not stand'}: {self.reason}."


def replay(
    folder: str | os.PathLike[str],
    claim: str,
    controller: str | None = None,
    case: str | None = None,
    *,
    study: Study | None = None,
) -> Replay:
    """Replay the witness of a refuted claim from a folder that ``workbench verify`` or ``Report.save`` wrote.

    ``claim`` is its name, with or without its study's; ``case`` is by default the one that lies at the top of the
    folder. ``study`` is needed for a study of one's own. The claim is made again on the record; where it has no replay
    of its own, its check is done again on the campaign run again. Raises InvalidValue in one line for a folder of
    something else, for a claim that is not there or not refuted, and for a study that changed since.
    """
    entries = _entries(Path(folder))
    top = load(Path(folder), study)
    case = case or top.study.case or DEFAULT
    entry = _meant(entries, claim, controller, case)
    campaign = top if case == (top.study.case or DEFAULT) else load(Path(folder) / CASES / case, study)
    unchanged(campaign)
    key = _key(entry)
    made, again = _claim(campaign, key)
    witness, then = entry["witness"], _number(entry.get("replayed"), entry.get("margin"))
    if not isinstance(witness, dict):
        raise InvalidValue(f"{named(key)} must have a witness to be replayed, got {witness!r}: verify the study again")
    weak = then is not None and then < 0  # one at 0 would not have been refuted if 0 were allowed
    found = once_more(made, witness, weak=weak, again=None if _is_exact(entry) else again)
    stands, reason = _compared(then, found)
    if stands and plain(found.witness) != witness:
        stands, reason = False, "the claim fails again, but at another place than its witness"
    return Replay(
        claim=key[0],
        case=key[1],
        controller=key[2],
        statement=made.statement,
        witness=witness,
        then=then,
        now=None if found.margin is None else finite(found.margin),
        unit=str(entry.get("unit", "")),
        stands=stands,
        reason=reason,
    )


def _is_exact(entry: Entry) -> bool:
    """Tell whether a verdict rests on what another run could not change."""
    evidence = entry.get("evidence")
    return isinstance(evidence, dict) and evidence.get("grounds") in [str(one) for one in EXACT]


def _compared(then: float | None, found: Finding) -> tuple[bool, str]:
    """Tell whether a finding refutes the claim as it was refuted, and say why."""
    now = None if found.margin is None else finite(found.margin)
    if found.standing is Standing.UNDECIDED:
        return False, found.reason or "the margin at the witness is no number"
    if found.standing is not Standing.REFUTED:
        return False, "the claim does not fail at its witness"
    if (then is None) is not (now is None):
        return False, f"the margin was {shown_value(then)} and is {shown_value(now)}"
    if then is not None and now is not None and not math.isclose(then, now, rel_tol=AGREES, abs_tol=0.0):
        return False, f"the claim fails at its witness, but by another margin: they differ by {abs(then - now):.3g}"
    return True, "the claim fails at its witness again" + ("" if then is None else ", by the same margin")


def _entries(folder: Path) -> list[Entry]:
    """Return what ``verdicts.json`` of a folder holds."""
    wanted = f"replay takes a folder that workbench verify wrote, got {folder}"
    file = folder / "verdicts.json"
    if not file.is_file():
        raise InvalidValue(f"{wanted}, in which there is no verdicts.json")
    try:
        content: object = json.loads(file.read_text(encoding="utf-8"))
    except ValueError:
        raise InvalidValue(f"{wanted}, whose verdicts.json is no JSON") from None
    if not isinstance(content, list) or not all(isinstance(one, dict) and _NAMES <= one.keys() for one in content):
        raise InvalidValue(f"{wanted}, whose verdicts.json holds no list of verdicts")
    return content


_NAMES = {"claim", "case", "controller", "standing"}


def _meant(entries: Sequence[Entry], claim: str, controller: str | None, case: str) -> Entry:
    """Return the one refuted verdict that is meant, or raise InvalidValue that says how the claim stands."""
    of_claim = [one for one in entries if claim in (one["claim"], str(one["claim"]).split(".", 1)[-1])]
    if not of_claim:
        known = list(dict.fromkeys(str(one["claim"]) for one in entries))
        named_so = {name.split(".", 1)[-1]: name for name in known} | {name: name for name in known}
        close = difflib.get_close_matches(claim, named_so, n=3, cutoff=0.5)
        near = list(dict.fromkeys(named_so[name] for name in close))
        hint = f"did you mean {' or '.join(near)}?" if near else f"its claims are: {', '.join(known) or 'none'}"
        raise InvalidValue(f"there is no claim {claim!r} in this folder; {hint}")
    claim = str(of_claim[0]["claim"])
    cases = list(dict.fromkeys(str(one["case"]) for one in of_claim))
    if case not in cases:
        raise InvalidValue(f"there is no claim {claim} in case {case!r}; it is there in: {', '.join(cases)}")
    in_case = [one for one in of_claim if one["case"] == case]
    chosen = [one for one in in_case if controller in (None, one["controller"])]
    if not chosen:
        laws = ", ".join(str(one["controller"]) for one in in_case if one["controller"]) or "no controller"
        raise InvalidValue(f"{claim} in case {case} is a claim about {laws}, got {controller!r}")
    refuted = [one for one in chosen if one["standing"] == str(Standing.REFUTED)]
    if len(refuted) > 1:
        laws = ", ".join(str(one["controller"]) for one in refuted)
        raise InvalidValue(f"{claim} in case {case} is REFUTED for several controllers: give --controller, of {laws}")
    if not refuted:
        stands = "; ".join(f"{named(_key(one))}, {_stands(one)}" for one in chosen)
        others = list(dict.fromkeys(named(_key(one)) for one in of_claim if one["standing"] == str(Standing.REFUTED)))
        besides = f" (it is for {'; '.join(others)})" if others else ""
        raise InvalidValue(f"only a claim that is REFUTED can be replayed, got {stands}{besides}")
    return refuted[0]


def _stands(one: Entry) -> str:
    return f"not made, as it lacks {one.get('not_made')}" if one["standing"] is None else str(one["standing"])


def _key(one: Entry) -> Key:
    controller = one["controller"]
    return str(one["claim"]), str(one["case"]), None if controller is None else str(controller)


def _number(*values: object) -> float | None:
    """Return the first that is a number."""
    return next((float(one) for one in values if isinstance(one, (int, float))), None)


def _claim(campaign: Campaign, key: Key) -> tuple[Claim, AnotherRun]:
    """Return the claim as the study makes it now, and what does its check on another run."""
    for full in (False, True):  # the long sweeps may have made it
        for one in examination_of(campaign, full=full).claims:
            if (one.name, one.controller) == (key[0], key[2]) and not one.lacks:
                return one, AnotherRun(campaign, full)
    raise InvalidValue(f"{named(key)} must be a claim that the study makes, but it makes none such any more")
