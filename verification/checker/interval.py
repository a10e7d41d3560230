"""Intervals: pairs of doubles around what is meant, every operation rounded outwards.

None stands for what is not known to exist. Functions are Arb's, at the ends of an interval where they rise.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from flint import arb, ctx

INF = math.inf
Span = tuple[float, float]
Known = Span | None
Rule = Callable[..., Known]
ctx.prec = 80
NONE, ALL, EITHER = (0.0, 0.0), (1.0, 1.0), (0.0, 1.0)


def outward(low: float, high: float) -> Known:
    """Return an interval one double wider at both ends."""
    low, high = math.nextafter(low, -INF), math.nextafter(high, INF)
    return (low, high) if -INF < low <= high < INF else None


def ends(*balls: arb) -> Known:
    """Return an interval around balls."""
    if not all(ball.is_finite() for ball in balls):
        return None
    return outward(min(float(b.lower()) for b in balls), max(float(b.upper()) for b in balls))


def _sum(x: float, y: float) -> Span:
    """Return the doubles around a sum, which are one where it is exact: the error is a double that is computed."""
    near = x + y
    part = near - x
    off = (x - (near - part)) + (y - part)
    return near if off >= 0 else math.nextafter(near, -INF), near if off <= 0 else math.nextafter(near, INF)


def add(a: Span, b: Span) -> Known:
    """Return a + b."""
    low, high = _sum(a[0], b[0])[0], _sum(a[1], b[1])[1]
    return (low, high) if -INF < low <= high < INF else None


def neg(a: Span) -> Span:
    """Return -a."""
    return -a[1], -a[0]


def sub(a: Span, b: Span) -> Known:
    """Return a - b."""
    return add(a, neg(b))


def mul(a: Span, b: Span) -> Known:
    """Return a b."""
    if a == ALL or b == NONE:
        return b
    if b == ALL or a == NONE:
        return a
    four = a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1]
    found = outward(min(four), max(four))
    return (max(found[0], 0.0), found[1]) if found and a[0] >= 0 and b[0] >= 0 else found


def div(a: Span, b: Span) -> Known:
    """Return a / b."""
    if b[0] <= 0 <= b[1]:
        return None
    if a == NONE or b == ALL:
        return a
    four = a[0] / b[0], a[0] / b[1], a[1] / b[0], a[1] / b[1]
    return outward(min(four), max(four))


def magnitude(a: Span) -> Span:
    """Return |a|."""
    return 0.0 if a[0] <= 0 <= a[1] else min(abs(a[0]), abs(a[1])), max(abs(a[0]), abs(a[1]))


def square(a: Span) -> Known:
    """Return a a."""
    low, high = magnitude(a)
    if high == 0 or low == high == 1:
        return low, high
    found = outward(low * low, high * high)
    return found and (max(found[0], 0.0), found[1])


def hull(*spans: Known) -> Known:
    """Return what is around intervals."""
    known = [one for one in spans if one is not None]
    if len(known) < len(spans):
        return None
    return min(one[0] for one in known), max(one[1] for one in known)


def rising(function: Callable[[arb], arb], low: float = -INF, high: float = INF, least: float = -INF) -> Rule:
    """Return the rule of a function that rises where its argument is at least ``least``, with values low to high."""

    def rule(a: Span) -> Known:
        found = ends(function(arb(a[0])), function(arb(a[1]))) if a[0] >= least else None
        return found and (max(found[0], low), min(found[1], high))

    return rule


def wave(function: Callable[[arb], arb], top: float) -> Rule:
    """Return the rule of a wave with maxima at (top + 2 n) pi and minima at (top + 1 + 2 n) pi."""

    def meets(a: Span, at: float) -> bool:  # unsure counts as met
        low, high = ((arb(x) / arb.pi() - at) / 2 for x in a)
        return math.ceil(math.nextafter(float(low.lower()), -INF)) <= math.floor(
            math.nextafter(float(high.upper()), INF)
        )

    def rule(a: Span) -> Known:
        found = ends(function(arb(a[0])), function(arb(a[1])))
        if found is None:
            return None
        return (-1.0 if meets(a, top + 1) else max(found[0], -1.0), 1.0 if meets(a, top) else min(found[1], 1.0))

    return rule


def even(function: Callable[[arb], arb]) -> Rule:
    """Return the rule of an even function that rises from 0 on."""
    return lambda a: rising(function, low=1.0)(magnitude(a))


def power(a: Span, exponent: Span) -> Known:
    """Return a to an exponent that is one number."""
    y = exponent[0]
    if y != exponent[1]:
        return None
    if y == 0:
        return ALL
    if y.is_integer() and abs(y) < 1000:
        base = magnitude(a) if y % 2 == 0 else a
        found = ends(arb(base[0]) ** int(abs(y)), arb(base[1]) ** int(abs(y)))
        if found and y % 2 == 0:
            found = max(found[0], 0.0), found[1]
        return found if y > 0 or found is None else div(ALL, found)
    if a[0] < 0 or (a[0] == 0 and y < 0):
        return None
    at = [arb(0) if x == 0 else arb(x) ** arb(y) for x in a]
    found = ends(*at)
    return found and (max(found[0], 0.0), found[1])


def truth(a: Span) -> Span:
    """Return whether a is other than 0: (0, 0), (1, 1), or (0, 1) where that is not decided."""
    return NONE if a == NONE else EITHER if a[0] <= 0 <= a[1] else ALL


def _equal(a: Span, b: Span) -> Span:
    return float(a[0] == a[1] == b[0] == b[1]), float(a[0] <= b[1] and b[0] <= a[1])


def _other(a: Span) -> Span:
    return 1 - truth(a)[1], 1 - truth(a)[0]


def _ends_of(function: Callable[[float, float], float]) -> Rule:
    """Return the rule of what falls or rises in both arguments together, as the ends of truth values do."""
    return lambda a, b: (function(truth(a)[0], truth(b)[0]), function(truth(a)[1], truth(b)[1]))


def _steps(function: Callable[[float], int]) -> Rule:
    """Return the rule of a function that rises in steps, exactly computed."""
    return lambda a: (float(function(a[0])), float(function(a[1])))


RULES: dict[str, Rule] = {
    "add": add, "sub": sub, "mul": mul, "div": div, "neg": neg, "sq": square, "pow": power, "fabs": magnitude,
    "sqrt": rising(arb.sqrt, 0.0, least=0.0), "exp": rising(arb.exp, 0.0), "expm1": rising(arb.expm1, -1.0),
    "log": lambda a: rising(arb.log)(a) if a[0] > 0 else None,
    "log1p": lambda a: rising(arb.log1p)(a) if a[0] > -1 else None,
    "sin": wave(arb.sin, 0.5), "cos": wave(arb.cos, 0.0), "atan": rising(arb.atan), "tanh": rising(arb.tanh, -1.0, 1.0),
    "sinh": rising(arb.sinh), "cosh": even(arb.cosh), "asinh": rising(arb.asinh), "erf": rising(arb.erf, -1.0, 1.0),
    "fmin": lambda a, b: (min(a[0], b[0]), min(a[1], b[1])), "fmax": lambda a, b: (max(a[0], b[0]), max(a[1], b[1])),
    "sign": _steps(lambda x: (x > 0) - (x < 0)), "floor": _steps(math.floor), "ceil": _steps(math.ceil),
    "lt": lambda a, b: (float(a[1] < b[0]), float(a[0] < b[1])),
    "le": lambda a, b: (float(a[1] <= b[0]), float(a[0] <= b[1])),
    "eq": _equal, "ne": lambda a, b: _other(_equal(a, b)),
    "not": _other, "and": _ends_of(min), "or": _ends_of(max),
    "flat": lambda a: NONE if a[0] == a[1] else None,  # the slope of what has steps, where it is one number
}  # fmt: skip
STEPS = frozenset({"sign", "floor", "ceil", "lt", "le", "eq", "ne", "not", "and", "or"})
