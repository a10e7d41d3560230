"""A claim with what its check found, as it stands in reports and files."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from hashlib import sha256

from workbench.contracts.claim import Expected, Held, Range, Role
from workbench.contracts.finding import Grounds, Standing, plain

DEFAULT = "default"
"""The case that is the study as it is declared."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Premise:
    """A premise of a verdict, as it was found."""

    claim: str
    statement: str
    standing: Standing
    method: str


@dataclasses.dataclass(frozen=True, kw_only=True)
class NotMade:
    """A claim that has no meaning here, with the declared property that it lacks."""

    claim: str
    controller: str | None
    statement: str
    source: str
    lacks: str
    case: str = DEFAULT

    def as_json(self) -> dict[str, object]:
        """Return it as ``verdicts.json`` holds it: without a standing."""
        return {
            "claim": self.claim,
            "case": self.case,
            "controller": self.controller,
            "statement": self.statement,
            "source": self.source,
            "standing": None,
            "not_made": self.lacks,
        }


@dataclasses.dataclass(frozen=True, kw_only=True)
class Verdict:
    """A claim with what its check found."""

    claim: str
    controller: str | None
    statement: str
    source: str
    standing: Standing
    margin: float | None
    unit: str
    witness: Mapping[str, object] | None
    method: str
    case: str = DEFAULT
    """The study's case that was looked at."""
    role: Role = Role.REQUIREMENT
    bound: float | None = None
    """What was bounded or measured, in ``bound_unit``."""
    bound_unit: str = ""
    grounds: Grounds = Grounds.RUN
    tries: int = 1
    premises: Sequence[Premise] = ()
    scope: Mapping[str, Range] = dataclasses.field(default_factory=dict)
    held: Held | None = None
    """How a proved number was held against runs."""
    replayed: float | None = None
    """The margin that the witness of a refutation gave when it was replayed."""
    expected: Expected | None = None
    certificate: str = ""
    """The hash of the certificate that was accepted, empty where there is none."""
    sentence: str = ""
    """What the certificate shows, in the words of the program that re-checked it."""
    unchecked: str = ""
    """Why what the method showed was not re-checked: it is SUPPORTED at most where a certificate is demanded."""
    contradiction: str = ""
    """How runs contradict what was proved: a fault of the program, never of the study."""

    @property
    def sentence_hash(self) -> str:
        """The hash of what the certificate shows."""
        return sha256(self.sentence.encode()).hexdigest()

    @property
    def label(self) -> str:
        """The claim's name, with the case where that is not the study as declared."""
        return self.claim if self.case == DEFAULT else f"{self.claim} ({self.case})"

    @property
    def key(self) -> tuple[str, str, str | None]:
        """What no two verdicts of a report share."""
        return self.claim, self.case, self.controller

    @property
    def departs(self) -> bool:
        """Whether it stands otherwise than is expected.

        A claim of which nothing is expected must not be refuted; a negative control must.
        """
        if self.expected is None:
            return (self.standing is Standing.REFUTED) is not (self.role is Role.CONTROL)
        return self.standing is not self.expected.standing

    @property
    def left_open(self) -> bool:
        """Whether it is UNDECIDED and was not expected to be."""
        meant = self.expected is not None and self.expected.standing is Standing.UNDECIDED
        return self.standing is Standing.UNDECIDED and not meant

    @property
    def measured(self) -> str:
        """What was bounded or measured, in words; empty where there is no such number."""
        if self.bound is None:
            return ""
        if not math.isfinite(self.bound):
            return "not finite"
        return f"{self.bound:.4g} {self.bound_unit}".rstrip()

    def as_json(self) -> dict[str, object]:
        """Return the verdict as ``verdicts.json`` holds it; numbers that are not finite become null."""
        proved = self.standing is Standing.PROVED
        expected = self.expected
        return {
            "claim": self.claim,
            "case": self.case,
            "controller": self.controller,
            "statement": self.statement,
            "source": self.source,
            "role": str(self.role),
            "standing": str(self.standing),
            "margin": plain(self.margin),
            "unit": self.unit,
            "bound": plain(self.bound),
            "bound_unit": self.bound_unit,
            "witness": plain(self.witness),
            "replayed": plain(self.replayed),
            "method": self.method,
            "scope": {name: plain(one._asdict()) for name, one in self.scope.items()},
            "premises": [
                {"claim": p.claim, "statement": p.statement, "standing": str(p.standing), "method": p.method}
                for p in self.premises
            ],
            "expected": None if expected is None else str(expected.standing),
            "because": "" if expected is None else expected.why,
            "published": "" if expected is None else expected.published,
            "measured": self.measured,
            "evidence": {
                "grounds": str(self.grounds),
                **({"tries": self.tries} if not self.grounds.proves else {}),
                **({"checked": bool(self.certificate)} if proved or self.unchecked else {}),
                **(
                    {"certificate": self.certificate, "sentence": self.sentence, "sentence_hash": self.sentence_hash}
                    if self.certificate
                    else {}
                ),
                **({"unchecked": self.unchecked} if self.unchecked else {}),
                **({"held_against": self.held.tries, "least_room": plain(self.held.margin)} if self.held else {}),
                **({"contradiction": self.contradiction} if self.contradiction else {}),
            },
        }
