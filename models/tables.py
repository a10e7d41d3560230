"""Rows of numbers, and ranges by name, as fields hold them: brought into one form, or refused in one line."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from types import MappingProxyType

import numpy as np

from models.errors import InvalidValue

Ends = tuple[float | None, float | None]
"""The least and the largest value of a range; None is no end."""
AS_IN = '{"NAME": [0, 1]}'


def said(value: object) -> str:
    """Return what came, in one line."""
    return " ".join(repr(value).split())


def row_of(name: str, value: object) -> tuple[float, ...]:
    """Return a row of finite numbers, or raise with what came."""
    try:
        if not isinstance(value, Iterable):
            raise TypeError
        numbers = tuple(map(float, value))
    except (TypeError, ValueError, OverflowError):
        raise InvalidValue(f"{name} must be a row of numbers, got {said(value)}") from None
    if not all(map(math.isfinite, numbers)):
        raise InvalidValue(f"{name} must hold finite numbers only, got one that is not")
    return numbers


def ranges_of(name: str, value: object, *, open_ends: bool) -> Mapping[str, Ends]:
    """Return ranges by name, or raise with what came; where ``open_ends``, one end of each may be None."""
    if not isinstance(value, Mapping):
        raise InvalidValue(f"{name} must give a pair [low, high] by name, as in {AS_IN}; got {said(value)}")
    return MappingProxyType({_word(name, one): _ends(name, one, pair, open_ends) for one, pair in value.items()})


def _word(name: str, one: object) -> str:
    if not isinstance(one, str):
        raise InvalidValue(f"{name} must give a pair [low, high] by name, as in {AS_IN}; got the name {said(one)}")
    return one


def _ends(name: str, one: str, pair: object, open_ends: bool) -> Ends:
    what = "a pair [low, high] of finite numbers" + (", one of which may be null," if open_ends else "")
    wrong = InvalidValue(f"{name} must give {what} for {one!r}, got {said(pair)}")
    if not isinstance(pair, (list, tuple, np.ndarray)) or np.ndim(pair) != 1 or len(pair) != 2:
        raise wrong
    low, high = (_end(entry, wrong, open_ends) for entry in pair)
    if low is None and high is None:
        raise wrong
    if low is not None and high is not None and low > high:
        raise InvalidValue(f"{name} must give low at most high for {one!r}, got {said(pair)}")
    return low, high


def _end(entry: object, wrong: InvalidValue, open_ends: bool) -> float | None:
    if entry is None and open_ends:
        return None
    if isinstance(entry, bool) or not isinstance(entry, (int, float, np.integer, np.floating)):
        raise wrong
    try:
        number = float(entry)
    except OverflowError:
        raise wrong from None
    if not math.isfinite(number):
        raise wrong
    return number
