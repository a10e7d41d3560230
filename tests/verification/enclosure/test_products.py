"""Products and sums of intervals against exact arithmetic: the doubles next to the true ends on their sides."""

from __future__ import annotations

import math
from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from verification.enclosure import outward
from verification.enclosure.outward import Span

ENDS = [-np.inf, -1e290, -3.0, -1.1, -1 / 3, -1e-170, -5e-324, -0.0, 0.0, 2.0**-1022, 1e-9, 0.1, 1.0, 1e155, np.inf]
PAIRS = [(low, high) for low, high in product(ENDS, ENDS) if low < high or (low == high and math.isfinite(low))]
KNOWN = Fraction(2) ** -890, Fraction(2) ** 980
"""Between these sizes the error of rounding is known; beyond them a step outwards more is allowed."""


def cases() -> tuple[Span, Span]:
    """Every two intervals between the ends above, and random ones about zero and away from it."""
    table = np.array([(*a, *b) for a, b in product(PAIRS, PAIRS)]).T
    rng = np.random.default_rng(7)
    drawn = np.sort(rng.standard_normal((2, 2, 2000)) + rng.integers(-2, 3, (2, 1, 2000)), axis=1).reshape(4, -1)
    a_low, a_high, b_low, b_high = np.hstack([table, drawn])
    return Span(a_low, a_high), Span(b_low, b_high)


def exact(x: float, y: float) -> Fraction | float:
    """Return the product; of nothing and what is not bounded it is nothing."""
    if x == 0 or y == 0:
        return Fraction(0)
    return x * y if math.isinf(x) or math.isinf(y) else Fraction(x) * Fraction(y)


def astray(found: float, true: Fraction | float, sign: int) -> bool:
    """Say whether an end (the upper one by sign 1) is not the double next to the true one on its side."""
    if sign * found < sign * true:
        return True
    if true != 0 and not KNOWN[0] < abs(true) < KNOWN[1]:
        return False
    nearest = float(true)
    beyond = sign * Fraction(nearest) >= sign * true
    return found != (nearest if beyond else float(np.nextafter(nearest, sign * np.inf)))


def multiplied(a: Span, b: Span) -> Span:
    with np.errstate(all="ignore"):
        return outward.mul(a, b)


def missed(a: Span, b: Span) -> list[tuple[float, ...]]:
    found, wrong = multiplied(a, b), []
    for low, high, *ends in zip(*found, *a, *b, strict=True):
        corners = [exact(x, y) for x, y in product(ends[:2], ends[2:])]
        if astray(low, min(corners), -1) or astray(high, max(corners), 1):
            wrong.append((low, high, *ends))
    return wrong


def test_products_are_those_of_the_worst_corners():
    assert missed(*cases()) == []


def test_sums_are_those_of_the_ends():
    a, b = cases()
    drawn = np.isfinite([*a, *b]).all(axis=0)
    a, b = (Span(one.lo[drawn], one.hi[drawn]) for one in (a, b))
    found = outward.add(a, b)
    for low, high, *ends in zip(*found, *a, *b, strict=True):
        a_low, a_high, b_low, b_high = map(Fraction, ends)
        assert not astray(low, a_low + b_low, -1) and not astray(high, a_high + b_high, 1), ends


def test_one_interval_meets_many():
    a, b = cases()
    many = multiplied(Span(a.lo[:1], a.hi[:1]), b)
    each = multiplied(Span(np.repeat(a.lo[:1], b.lo.size), np.repeat(a.hi[:1], b.lo.size)), b)
    np.testing.assert_array_equal(many, each)


@pytest.mark.parametrize("place", range(4))
def test_what_is_no_number_is_in_no_product(place):
    ends = np.array([[1.0], [2.0], [3.0], [4.0]])
    ends[place] = np.nan
    found = multiplied(Span(*ends[:2]), Span(*ends[2:]))
    assert np.isnan(found).all()
