"""What a check says about a claim."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from enum import StrEnum
from typing import SupportsFloat

import numpy as np
import xarray as xr

from workbench.contracts.number import finite

DEFAULT = "default"
"""The case that is the study as it is declared."""


class Standing(StrEnum):
    """How a claim stands after a check.

    PROVED: symbolically, by outward-rounded interval arithmetic over a stated box, or by exact algebra.
    SUPPORTED: sampled, nothing against it found. REFUTED: with a witness that can be replayed. UNDECIDED: the
    method could not tell, or the check failed.
    """

    PROVED = "PROVED"
    SUPPORTED = "SUPPORTED"
    REFUTED = "REFUTED"
    UNDECIDED = "UNDECIDED"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Finding:
    """What a check found: the part of a verdict that the check itself knows.

    ``margin`` is how far the claim is from failing (negative where it fails) in ``unit``; ``witness`` is the very
    place and values that refute it or are tightest; ``method`` says how it was found, or why nothing was.
    """

    standing: Standing
    method: str
    margin: float | None = None
    unit: str = ""
    witness: Mapping[str, object] | None = None

    def __post_init__(self) -> None:
        """Raise ValueError for a refutation that nobody could replay, and for a witness with a function in it."""
        if self.standing is Standing.REFUTED and not self.witness:
            raise ValueError("a claim is refuted with a witness, got none")
        _plain(self.witness)


def undecided(reason: str) -> Finding:
    """Return the finding of a check that could not tell, with its reason."""
    return Finding(standing=Standing.UNDECIDED, method=reason)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Claim:
    """A statement of a paper (or its repair), and the check that looks at it."""

    name: str
    """Dotted, beginning with the study: ``NAME.A4.printed``."""
    statement: str
    source: str
    """Paper and equation or assumption."""
    check: Callable[[], Finding]
    controller: str | None = None


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

    @property
    def label(self) -> str:
        """The claim's name, with the case where that is not the study as declared."""
        return self.claim if self.case == DEFAULT else f"{self.claim} ({self.case})"

    def as_json(self) -> dict[str, object]:
        """Return the verdict as ``verdicts.json`` holds it; numbers that are not finite become null."""
        return {
            "claim": self.claim,
            "case": self.case,
            "controller": self.controller,
            "statement": self.statement,
            "source": self.source,
            "standing": str(self.standing),
            "margin": _plain(self.margin),
            "unit": self.unit,
            "witness": _plain(self.witness),
            "method": self.method,
        }


def _plain(value: object) -> object:
    """Return a value in JSON's types."""
    if value is None or isinstance(value, (str, bool)):
        return value
    if isinstance(value, Mapping):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if isinstance(value, (np.ndarray, np.generic, xr.DataArray)):
        return _plain(np.asarray(value).tolist())
    if isinstance(value, (list, tuple)):
        return [_plain(inner) for inner in value]
    if isinstance(value, int):
        return value
    if isinstance(value, SupportsFloat):
        try:
            return finite(value)
        except (TypeError, ValueError, RuntimeError, NotImplementedError):
            return str(value)
    if callable(value):  # what would give a value stands where the value was meant
        raise ValueError(f"a witness holds values, got the function {value!r}")
    return str(value)
