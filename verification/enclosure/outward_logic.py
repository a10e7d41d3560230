"""Comparisons and choices between spans: 0, 1, or [0, 1] where the boxes do not decide."""

import numpy as np

from verification.enclosure.outward import Mask, Span, has_zero, hull


def _truth(surely: Mask, possibly: Mask) -> Span:
    return Span(surely.astype(np.float64), possibly.astype(np.float64))


def less(a: Span, b: Span) -> Span:
    """Enclose ``x < y`` as 0, 1 or undecided."""
    return _truth(a.hi < b.lo, a.lo < b.hi)


def less_equal(a: Span, b: Span) -> Span:
    """Enclose ``x <= y``."""
    return _truth(a.hi <= b.lo, a.lo <= b.hi)


def equal(a: Span, b: Span) -> Span:
    """Enclose ``x == y``."""
    return _truth((a.lo == b.hi) & (a.hi == b.lo), (a.lo <= b.hi) & (b.lo <= a.hi))


def truth(a: Span) -> Span:
    """Enclose ``x != 0``."""
    return _truth(~has_zero(a), ~((a.lo == 0) & (a.hi == 0)))


def negation(a: Span) -> Span:
    """Enclose ``not x``."""
    holds = truth(a)
    return Span(1.0 - holds.hi, 1.0 - holds.lo)


def gate(condition: Span, a: Span) -> Span:
    """Enclose ``x if condition else 0``."""
    holds = truth(condition)
    low = np.where(holds.hi == 0, 0.0, np.where(holds.lo == 1, a.lo, np.minimum(a.lo, 0.0)))
    return Span(low, np.where(holds.hi == 0, 0.0, np.where(holds.lo == 1, a.hi, np.maximum(a.hi, 0.0))))


def select(condition: Span, a: Span, b: Span) -> Span:
    """Enclose ``x if condition else y``."""
    holds = truth(condition)
    yes, no, both = holds.lo == 1, holds.hi == 0, hull(a, b)
    return Span(np.where(yes, a.lo, np.where(no, b.lo, both.lo)), np.where(yes, a.hi, np.where(no, b.hi, both.hi)))
