"""What is left by division, on many boxes at once, rounded outwards."""

from __future__ import annotations

import numpy as np

from verification.enclosure import outward
from verification.enclosure.outward import Mask, Span


def fmod(a: Span, b: Span) -> tuple[Span, Mask]:
    """Enclose the remainder of truncated division, which has the sign of ``x`` and is smaller than ``y``."""
    quotient, bad = outward.div(a, b)
    whole = Span(np.trunc(quotient.lo), np.trunc(quotient.hi))
    limit = outward.magnitude(b).hi
    loose = Span(np.minimum(np.maximum(a.lo, -limit), 0.0), np.maximum(np.minimum(a.hi, limit), 0.0))
    tight = outward.meet(loose, outward.sub(a, outward.mul(whole, b)))
    decided = whole.lo == whole.hi
    return Span(np.where(decided, tight.lo, loose.lo), np.where(decided, tight.hi, loose.hi)), bad


def remainder(a: Span, b: Span) -> tuple[Span, Mask]:
    """Enclose what is left by division with a quotient rounded to the nearest whole number, half to even."""
    quotient, bad = outward.div(a, b)
    nearest = Span(np.rint(quotient.lo), np.rint(quotient.hi))
    divisor = outward.magnitude(b).hi
    half = np.where(divisor / 2 * 2 == divisor, divisor / 2, outward.up(divisor / 2))
    limit = np.minimum(half, outward.magnitude(a).hi)
    loose = Span(-limit, limit)
    tight = outward.meet(loose, outward.sub(a, outward.mul(nearest, b)))
    decided = nearest.lo == nearest.hi
    return Span(np.where(decided, tight.lo, loose.lo), np.where(decided, tight.hi, loose.hi)), bad
