"""What limits a plant's inputs, told to whoever commands them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias, cast

import casadi as ca

from models.errors import InvalidValue
from models.expression import Expression, Number

Limit: TypeAlias = Number | Sequence[float | None] | None
"""A limit as it is given: the same for every input, one an input, or none (as one of the inputs may have)."""


class Limits(NamedTuple):
    """The range of a command that has an effect, and the rate at which it can change.

    Each is a number, or a CasADi value where it is a symbol: the same for every input, or a column with one an input.
    Infinite where there is no limit.
    """

    lower: Number = -math.inf
    """Least input, in the input's unit."""
    upper: Number = math.inf
    """Largest input, in the input's unit."""
    rate: Number = math.inf
    """Largest rate of change, in the input's unit per s."""

    def tightened(self, lower: Limit = None, upper: Limit = None, rate: Limit = None) -> Limits:
        """Return the limits with further ones, of which each may be None for no limit."""
        return Limits(
            _extreme(max, ca.fmax, self.lower, limit_column(lower, -math.inf)),
            _extreme(min, ca.fmin, self.upper, limit_column(upper, math.inf)),
            _extreme(min, ca.fmin, self.rate, limit_column(rate, math.inf)),
        )

    def scaled(self, unit: Number) -> Limits:
        """Return the limits of a command that is counted in a unit (above 0) of the input."""
        return Limits(*(limit / unit for limit in self))


def limit_column(limit: Limit, none: float) -> Number:
    """Return a limit as a number, or as a column with one an input; ``none`` where there is none."""
    if limit is None:
        return none
    if isinstance(limit, (tuple, list)):
        numbers = [none if entry is None else float(entry) for entry in limit]
        return numbers[0] if len(numbers) == 1 else cast(Expression, ca.DM(numbers))
    return cast(Number, limit)


def check_inputs(name: str, limit: Limit, inputs: int) -> None:
    """Raise InvalidValue, naming the limit, where it has not one entry an input."""
    if isinstance(limit, (tuple, list)) and len(limit) != inputs:
        raise InvalidValue(f"{name} must be one number, or one an input ({inputs}), got {len(limit)}")


def _extreme(
    plain: Callable[[float, float], float],
    symbolic: Callable[[Number, Number], Expression],
    one: Number,
    other: Number,
) -> Number:
    if isinstance(one, (int, float)) and isinstance(other, (int, float)):
        return plain(one, other)
    if isinstance(other, (int, float)) and math.isinf(other):
        return one
    return symbolic(one, other)
