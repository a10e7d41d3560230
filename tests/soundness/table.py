"""The shares of cases that were decided, by claim and family."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from soundness.ask import Answer


class Share(NamedTuple):
    """Of how many cases that had to be decided how many were."""

    true: int
    true_decided: int
    false: int
    false_decided: int


class Tally(NamedTuple):
    """What a campaign of cases came to."""

    cases: int
    false_proved: Sequence[Answer]
    false_refuted: Sequence[Answer]
    broke: Sequence[Answer]
    shares: Mapping[tuple[str, str], Share]
    """By claim and family."""

    def by_claim(self) -> Mapping[str, Share]:
        return _summed((claim, one) for (claim, _), one in self.shares.items())

    def by_family(self) -> Mapping[str, Share]:
        return _summed((family, one) for (_, family), one in self.shares.items())


def _summed(pairs: Iterable[tuple[str, Share]]) -> Mapping[str, Share]:
    found: dict[str, Share] = {}
    for name, one in pairs:
        found[name] = Share(*map(sum, zip(found.get(name, Share(0, 0, 0, 0)), one, strict=True)))
    return dict(sorted(found.items()))


def tally(answers: Iterable[Answer]) -> Tally:
    kept = list(answers)
    count: dict[tuple[str, str], Counter[str]] = {}
    for one in kept:
        if one.due and one.holds is not None and one.standing != "not made":
            side = "true" if one.holds else "false"
            count.setdefault((one.claim, one.family), Counter()).update(
                [side, *([f"{side}_decided"] if one.decided else [])]
            )
    wrong = [one for one in kept if one.false]
    return Tally(
        cases=len({one.number for one in kept}),
        false_proved=[one for one in wrong if not one.holds],
        false_refuted=[one for one in wrong if one.holds],
        broke=[one for one in kept if one.claim == "broke down"],
        shares={key: Share(*(one[name] for name in Share._fields)) for key, one in sorted(count.items())},
    )


def percent(decided: int, of: int) -> str:
    return f"{100 * decided / of:.0f} % of {of}" if of else "-"


def table(shares: Mapping[str, Share], heading: str) -> list[str]:
    rows = [f"| {heading} | true cases decided | false cases decided |", "|---|---|---|"]
    for name, one in shares.items():
        rows.append(f"| {name} | {percent(one.true_decided, one.true)} | {percent(one.false_decided, one.false)} |")
    return rows


def silent(found: Tally) -> list[tuple[str, str, str, str]]:
    """Return claim, family and shares where not all are decided."""
    return [
        (claim, family, percent(one.true_decided, one.true), percent(one.false_decided, one.false))
        for (claim, family), one in found.shares.items()
        if one.true_decided < one.true or one.false_decided < one.false
    ]
