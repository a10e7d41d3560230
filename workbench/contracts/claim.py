"""What is claimed: a statement with its premises, its scope, the check that looks at it, and what is expected of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from typing import NamedTuple

from models.errors import InvalidValue
from workbench.contracts.certificate import Certificate
from workbench.contracts.finding import Finding, Standing


class Role(StrEnum):
    """What a claim is for.

    PRINTED: a paper says so. REPAIRED: what holds in its place, or a theorem of ours. OUTCOME: what a run shows.
    REQUIREMENT: what the user needs. CONTROL: a statement that must be refuted, which shows that the check can fail.
    """

    PRINTED = "as printed"
    REPAIRED = "repaired"
    OUTCOME = "outcome"
    REQUIREMENT = "requirement"
    CONTROL = "negative control"


class Range(NamedTuple):
    """An interval that a claim speaks of, with its unit."""

    low: float
    high: float
    unit: str = ""


class Held(NamedTuple):
    """What came of holding a proved number against runs."""

    tries: int
    """Trials and plans that were looked at."""
    margin: float
    """The least room that was left to the proved number, rounding allowed for; negative: it is contradicted."""
    witness: Mapping[str, object]
    """Where that was."""


class NotCertified(Exception):
    """What was proved has no certificate, with the reason in a sentence."""


Certify = Callable[[Finding, Mapping[str, Certificate]], Certificate]
"""Makes the certificate of what was proved, from the finding and the premises' certificates, by the claims' names.

Raises NotCertified where it cannot.
"""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Claim:
    """A statement of a paper (or its repair), and the check that looks at it.

    A theorem is a claim with premises: claims of their own, looked at first. One that is refuted or undecided leaves
    the conclusion UNDECIDED, and a conclusion is at most as strong as its weakest premise.
    """

    name: str
    """Dotted, beginning with the study: ``NAME.A4.printed``."""
    statement: str
    source: str
    """Paper and equation or assumption."""
    check: Callable[[], Finding]
    controller: str | None = None
    role: Role = Role.REQUIREMENT
    premises: Sequence[Claim] = ()
    rests_on: Sequence[Claim] = ()
    """What a proof rests on besides: looked at where the claim holds. A refutation, which is replayed, needs none."""
    lacks: str = ""
    """The declared property without which the claim has no meaning here; it is then not made."""
    scope: Callable[[], Mapping[str, Range]] = dict
    """The intervals for which a proof speaks, by what they are of."""
    replay: Callable[[Mapping[str, object]], float] | None = None
    """The margin at a witness, computed anew from the witness alone; None: the check is done again on another run."""
    attack: Callable[[Finding], Held] | None = None
    """Holds what was proved against the record, and against plans made to break it."""
    certify: Certify | None = None
    """Makes the certificate of what was proved, which another program re-checks; None: this kind has none."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Expected:
    """What is expected of a claim in a case as shipped, written by hand, with the reason.

    Raises InvalidValue for a standing that there is not, and where no reason is given.
    """

    standing: Standing
    why: str
    """Why; for UNDECIDED: what would decide it."""
    role: Role | None = None
    """What the claim is for; None: as the claim itself says."""
    controllers: Sequence[str] = ()
    """For which controllers; empty: for all."""
    cases: Sequence[str] = ()
    """In which cases; empty: in all."""
    published: str = ""
    """What was published, where a number or an order was."""

    def __post_init__(self) -> None:
        if self.standing not in list(Standing):
            raise InvalidValue(f"an expected standing must be one of {', '.join(Standing)}, got {self.standing!r}")
        if not self.why.strip():
            raise InvalidValue(f"what is expected must say why, got {self.why!r} for {self.standing}")
        object.__setattr__(self, "standing", Standing(self.standing))

    def speaks_of(self, controller: str | None, case: str) -> bool:
        """Tell whether it is about a controller in a case."""
        return (not self.controllers or controller in self.controllers) and (not self.cases or case in self.cases)


Expectations = Mapping[str, Sequence[Expected]]
"""What is expected, by the claim's name without its study's: the last entry that speaks of a verdict is meant."""


def expected_of(table: Expectations, claim: str, controller: str | None, case: str) -> Expected | None:
    """Return what is expected of a claim (its full name) for a controller in a case, or None where nothing is said."""
    meant = [one for one in table.get(claim.split(".", 1)[-1], ()) if one.speaks_of(controller, case)]
    return meant[-1] if meant else None
