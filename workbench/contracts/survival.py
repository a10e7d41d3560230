"""How many digits of a score survive: when every setting changes a little, and in single precision."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

MOST = 16.0
"""Digits of a double."""


class Survival(NamedTuple):
    """By how much one score changes at most, relative to itself: 0 where not a bit of it does."""

    small: float
    """When every setting changes by a part in 1e12."""
    large: float
    """When every setting changes by a part in 1e6."""
    single: float | None
    """In single precision; None where that was not looked at."""

    @property
    def exact(self) -> bool:
        """Whether not a bit of it changes with the settings: a count, or what no setting reaches."""
        return self.small == 0 and self.large == 0

    @property
    def shown(self) -> str:
        """Whole digits that survive each, ``exact`` where no bit changes, a dash where that was not looked at."""
        words = [_word(change) for change in self]
        return words[0] if len(set(words)) == 1 and self.exact else " / ".join(words)

    def as_json(self) -> dict[str, float | bool | None]:
        """Return the digits as ``scores.json`` holds them."""
        return {
            "settings_1e-12": digits(self.small),
            "settings_1e-6": digits(self.large),
            "single_precision": None if self.single is None else digits(self.single),
            "exact": self.exact,
        }


Survivals = Mapping[str, Mapping[str, Survival]]
"""What survives of scores, by controller and metric."""


def digits(change: float) -> float:
    """Return how many decimal digits survive a relative change, from 0 to 16."""
    return MOST if change == 0 else min(MOST, max(0.0, -math.log10(change)))


def _word(change: float | None) -> str:
    if change is None:
        return "-"
    return "exact" if change == 0 else str(int(digits(change)))
