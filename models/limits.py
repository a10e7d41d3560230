"""What limits a plant's inputs, told to whoever commands them."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import casadi as ca


class Limits(NamedTuple):
    """The range of a command that has an effect, and the rate at which it can change; the same for every input.

    Infinite where there is no limit. The values are numbers, or CasADi values where a limit is a symbol.
    """

    lower: Any = -math.inf
    """Least input, in the input's unit."""
    upper: Any = math.inf
    """Largest input, in the input's unit."""
    rate: Any = math.inf
    """Largest rate of change, in the input's unit per s."""

    def tightened(self, lower: Any = None, upper: Any = None, rate: Any = None) -> Limits:
        """Return the limits with further ones, of which each may be None for no limit."""
        return Limits(
            self.lower if lower is None else _extreme(max, ca.fmax, self.lower, lower),
            self.upper if upper is None else _extreme(min, ca.fmin, self.upper, upper),
            self.rate if rate is None else _extreme(min, ca.fmin, self.rate, rate),
        )

    def scaled(self, unit: Any) -> Limits:
        """Return the limits of a command that is counted in a unit (above 0) of the input."""
        return Limits(*(limit / unit for limit in self))


def _extreme(plain: Any, symbolic: Any, one: Any, other: Any) -> Any:
    numbers = isinstance(one, (int, float)) and isinstance(other, (int, float))
    return plain(one, other) if numbers else symbolic(one, other)
