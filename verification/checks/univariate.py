"""A quotient of polynomials in one variable between two ends: decided exactly, over rationals, by Sturm's theorem."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import pairwise

from verification.checks.polynomial import Form

Polynomial = Sequence[Fraction]
"""Coefficients, the constant first; the last is not zero; empty: the polynomial is zero."""
Meaning = Callable[[int], tuple[object, tuple[Form, ...]] | None]
"""What a variable stands for, None for a coordinate."""
End = Fraction | None
"""An end of an interval; None: there is none."""


def plus(a: Polynomial, b: Polynomial, share: Fraction = Fraction(1)) -> list[Fraction]:
    """Return a + share b."""
    zero = Fraction(0)
    long = max(len(a), len(b))
    both = [(a[i] if i < len(a) else zero) + share * (b[i] if i < len(b) else zero) for i in range(long)]
    while both and not both[-1]:
        both.pop()
    return both


def times(a: Polynomial, b: Polynomial) -> list[Fraction]:
    """Return a b."""
    found: list[Fraction] = []
    for i, one in enumerate(a):
        found = plus(found, [Fraction(0)] * i + list(b), one)
    return found


def _value(p: Polynomial, at: Fraction) -> Fraction:
    value = Fraction(0)
    for one in reversed(p):
        value = value * at + one
    return value


def _divided(a: Polynomial, b: Polynomial) -> tuple[list[Fraction], list[Fraction]]:
    """Return quotient and remainder."""
    quotient, rest = [Fraction(0)] * max(len(a) - len(b) + 1, 0), list(a)
    while len(rest) >= len(b):
        place, share = len(rest) - len(b), rest[-1] / b[-1]
        quotient[place] = share
        rest = plus(rest, [Fraction(0)] * place + list(b), -share)
    return quotient, rest


def _sign(p: Polynomial, at: End, above: bool) -> int:
    """Return the sign of a polynomial at an end, at infinity where there is none (``above``: the upper one)."""
    if at is not None:
        value = _value(p, at)
    else:
        value = p[-1] if above or len(p) % 2 else -p[-1]
    return (value > 0) - (value < 0)


def positive(p: Polynomial, low: End, high: End) -> bool:
    """Tell whether a polynomial is positive wherever low <= t <= high."""
    if not p or _sign(p, low, above=False) <= 0 or _sign(p, high, above=True) <= 0:
        return False
    chain = [list(p), _slope(p)]
    while chain[-1]:
        chain.append([-one for one in _divided(chain[-2], chain[-1])[1]])
    chain.pop()

    def changes(at: End, above: bool) -> int:
        signs = [sign for one in chain if (sign := _sign(one, at, above))]
        return sum(a != b for a, b in pairwise(signs))

    return changes(low, above=False) == changes(high, above=True)


def never_negative(p: Polynomial, low: End, high: End) -> bool:
    """Tell whether a polynomial is zero or more wherever low <= t <= high: it may touch zero, and may be it."""
    if not p:
        return True
    if low is not None and low == high:
        return _value(p, low) >= 0
    rest = _odd(p)
    for end, factor in ((low, Fraction(1)), (high, Fraction(-1))):
        if end is not None and not _value(rest, end):  # t - low and high - t are zero or more
            rest, _ = _divided(rest, [-end * factor, factor])
    return positive(rest, low, high)


def _odd(p: Polynomial) -> list[Fraction]:
    """Return a polynomial without the squares that divide it: the same sign wherever it is not zero."""
    common = _shared(p, _slope(p))
    simple, _ = _divided(p, common)
    found, power = [Fraction(1)], 1
    while len(simple) > 1:
        left = _shared(simple, common)
        if power % 2:
            found = times(found, _divided(simple, left)[0])
        simple, common, power = left, _divided(common, left)[0], power + 1
    return [one * p[-1] / found[-1] for one in found]


def _slope(p: Polynomial) -> list[Fraction]:
    return [i * one for i, one in enumerate(p)][1:]


def _shared(a: Polynomial, b: Polynomial) -> list[Fraction]:
    """Return the greatest common divisor."""
    first, second = list(a), list(b)
    while second:
        first, second = second, _divided(first, second)[1]
    return [one / first[-1] for one in first]


def between(over: tuple[Polynomial, Polynomial], low: End, high: End, least: Fraction, most: Fraction) -> bool:
    """Tell whether least <= n/d <= most is shown for low <= t <= high, where ``over`` is (n, d)."""
    n, d = over
    if not positive(d, low, high):
        n, d = [-one for one in n], [-one for one in d]
    return (
        positive(d, low, high)
        and never_negative(plus(n, d, -least), low, high)
        and never_negative(plus([-one for one in n], d, most), low, high)
    )


def roots_of(form: Form, meaning: Meaning) -> set[int]:
    """Return the variables that a form depends on, those in squares and denominators for these."""
    found: set[int] = set()
    for variable in {variable for powers in form.terms for variable, _ in powers}:
        meant = meaning(variable)
        if meant is not None and meant[0] in ("inv", "sq"):
            found |= roots_of(meant[1][0], meaning)
        else:
            found.add(variable)
    return found


def quotient(form: Form, t: int | None, meaning: Meaning) -> tuple[list[Fraction], list[Fraction]]:
    """Return a form that depends on one variable (:func:`roots_of`) as numerator and denominator."""
    n: list[Fraction] = []
    d = [Fraction(1)]
    for powers, coefficient in form.terms.items():
        above, below = [coefficient], [Fraction(1)]
        for variable, power in powers:
            top, bottom = _factor(variable, t, meaning)
            if power < 0:
                top, bottom = bottom, top
            for _ in range(abs(power)):
                above, below = times(above, top), times(below, bottom)
        n, d = plus(times(n, below), times(above, d)), times(d, below)
    return n, d


def _factor(variable: int, t: int | None, meaning: Meaning) -> tuple[list[Fraction], list[Fraction]]:
    if variable == t:
        return [Fraction(0), Fraction(1)], [Fraction(1)]
    meant = meaning(variable)
    assert meant is not None, "roots_of has said that there is no other variable"
    top, bottom = quotient(meant[1][0], t, meaning)
    return (bottom, top) if meant[0] == "inv" else (times(top, top), times(bottom, bottom))
