"""What a check found, and how it stands: the standing follows from the grounds and the margin's sign."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from enum import StrEnum
from typing import SupportsFloat

import numpy as np
import xarray as xr

from workbench.contracts.number import finite


class Standing(StrEnum):
    """How a claim stands after a check.

    PROVED: for everything in a stated scope, on grounds that prove. SUPPORTED: tried or searched, nothing against it
    found. REFUTED: with a witness that was replayed. UNDECIDED: the method could not tell, a premise is not met, or
    the check failed.
    """

    PROVED = "PROVED"
    SUPPORTED = "SUPPORTED"
    REFUTED = "REFUTED"
    UNDECIDED = "UNDECIDED"


STRENGTH = (Standing.UNDECIDED, Standing.SUPPORTED, Standing.PROVED)
"""What holds, from the weakest to the strongest: a conclusion is at most as strong as its weakest premise."""


class Grounds(StrEnum):
    """What a finding rests on.

    SETTINGS: the study's own settings, compared or computed exactly. ALGEBRA: exact arithmetic on symbols, matrices or
    rationals. ENUMERATION: every one of finitely many cases. INDUCTION: a step from each sample or trial to the next.
    ENCLOSURE: outward-rounded bounds over a whole set. RUN: what was recorded. TRIES: so many draws or starts.
    SEARCH: the worst that a search came upon. NUMERICS: a floating-point computation without a bound of its error.
    """

    SETTINGS = "settings"
    ALGEBRA = "algebra"
    ENUMERATION = "enumeration"
    INDUCTION = "induction"
    ENCLOSURE = "enclosure"
    RUN = "run"
    TRIES = "tries"
    SEARCH = "search"
    NUMERICS = "numerics"

    @property
    def proves(self) -> bool:
        """Whether what holds on these grounds holds for the whole scope."""
        return self in _PROVING


_PROVING = frozenset({Grounds.SETTINGS, Grounds.ALGEBRA, Grounds.ENUMERATION, Grounds.INDUCTION, Grounds.ENCLOSURE})


@dataclasses.dataclass(frozen=True, kw_only=True)
class Finding:
    """What a check found: the part of a verdict that the check itself knows.

    ``margin`` is how far the claim is from failing, in ``unit``: negative where it fails, and at 0 too unless the
    claim is ``weak`` (it says "at most", not "below"). A claim that has no size says in ``holds`` whether it holds.
    ``bound`` is what was bounded or measured, in ``bound_unit``. ``witness`` is the very place and values that refute
    the claim or are tightest, all that a replay needs; ``method`` says how it was found. Where nothing could be told
    ``reason`` says why, and what would tell.

    Raises ValueError for a claim that fails without a witness, for grounds of tries without their number, and for a
    witness with a function in it.
    """

    grounds: Grounds = Grounds.RUN
    method: str = ""
    margin: float | None = None
    unit: str = ""
    weak: bool = False
    holds: bool | None = None
    bound: float | None = None
    bound_unit: str = ""
    tries: int = 1
    """How many draws, starts or runs stand behind it, where it does not prove."""
    witness: Mapping[str, object] | None = None
    reason: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "grounds", Grounds(self.grounds))
        if self.fails and not self.witness:
            raise ValueError("a claim is refuted with a witness, got none")
        if not self.grounds.proves and self.tries < 1:
            raise ValueError(f"{self.grounds} must be at least one, got {self.tries}")
        plain(self.witness)

    @property
    def fails(self) -> bool:
        """Whether the claim was found to be false."""
        return self.standing is Standing.REFUTED

    @property
    def standing(self) -> Standing:
        """How the claim stands by this finding alone: premises and replays may only weaken it."""
        if self.reason:
            return Standing.UNDECIDED
        if self.margin is None:
            if self.holds is None:
                return Standing.UNDECIDED
            met = self.holds
        elif math.isnan(self.margin):
            return Standing.UNDECIDED
        else:
            met = self.margin > 0 or (self.weak and self.margin == 0)
        if not met:
            return Standing.REFUTED
        return Standing.PROVED if self.grounds.proves else Standing.SUPPORTED


def undecided(
    reason: str,
    *,
    margin: float | None = None,
    unit: str = "",
    beside: Mapping[str, object] | None = None,
    **besides: object,
) -> Finding:
    """Return the finding of a check that could not tell, with its reason; ``besides`` are values that stand beside."""
    values = {**(beside or {}), **besides}
    return Finding(
        grounds=Grounds.NUMERICS, method=reason, reason=reason, margin=margin, unit=unit, witness=values or None
    )


def plain(value: object) -> object:
    """Return a value in JSON's types; numbers that are not finite become null.

    Raises ValueError for a function, which would stand where its value was meant.
    """
    if value is None or isinstance(value, (str, bool)):
        return value
    if isinstance(value, Mapping):
        return {str(key): plain(inner) for key, inner in value.items()}
    if isinstance(value, (np.ndarray, np.generic, xr.DataArray)):
        return plain(np.asarray(value).tolist())
    if isinstance(value, (list, tuple)):
        return [plain(inner) for inner in value]
    if isinstance(value, int):
        return value
    if isinstance(value, SupportsFloat):
        try:
            return finite(value)
        except (TypeError, ValueError, RuntimeError, NotImplementedError):
            return str(value)
    if callable(value):
        raise ValueError(f"a witness holds values, got the function {value!r}")
    return str(value)
