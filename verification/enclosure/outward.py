"""Interval arithmetic on many boxes at once, rounded outwards.

A `Span` holds two float64 arrays; element ``i`` stands for every real number in ``[lo[i], hi[i]]``. Infinite ends
mean "unbounded", never "attains infinity", which is why ``0 * inf`` counts as ``0`` below.

Why the results are rigorous:

* ``+ - * /`` and ``sqrt`` of IEEE 754 doubles are correctly rounded, so the true value lies within one step of
  the float. The step outwards is left out only where an error-free transformation (Knuth's two-sum, Dekker's
  two-product) shows on which side the true value lies, and only inside the exponent range where those are exact.
* Library functions such as ``exp`` are *not* correctly rounded. They are evaluated by Arb ball arithmetic at the
  ends of the interval, and the float that comes back is compared with the ball before it is believed.
* Where a function is not monotone, its turning points are located with a margin that exceeds the error of locating
  them; an extremum that may be in the interval counts as in.
"""

from collections.abc import Callable
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np
from flint import arb, ctx
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Point = Callable[..., arb]  # of one number, or of two

PRECISION = 80  # bits of the balls: 27 more than a double, so that the outward step is rarely wasted
_EXACT_SUM = 2.0**1000  # two-sum is exact below this, since none of its steps can overflow
_EXACT_FACTOR = 2.0**990  # the same for the splitting inside two-product
_EXACT_PRODUCT = 2.0**-900  # above this no partial product of two-product underflows
_SPLITTER = 2.0**27 + 1.0


class Span(NamedTuple):
    """Lower and upper ends of an array of intervals."""

    lo: Array
    hi: Array


def down(x: Array) -> Array:
    """Return the next float below."""
    return np.nextafter(x, -np.inf)


def up(x: Array) -> Array:
    """Return the next float above."""
    return np.nextafter(x, np.inf)


def arithmetic_is_ieee() -> bool:
    """Say whether this process rounds to nearest and keeps subnormals, on which everything here stands."""
    tiny, half_ulp = np.array([5e-324, 2.0**-1022]), np.array([2.0**-53, 3 * 2.0**-53, -(2.0**-53)])
    nearest = np.array([1.0, 1.0, -1.0]) + half_ulp == [1.0, 1.0 + 2.0**-51, -1.0]
    return bool(np.all(tiny * np.array([1.0, 0.5]) > 0) and np.all(nearest))


def point(value: float) -> Span:
    """Return the interval that holds one float only."""
    ends = np.array([value])
    return Span(ends, ends)


def full(like: Array) -> Span:
    """Return the whole real line, shaped like an array."""
    return Span(np.full_like(like, -np.inf), np.full_like(like, np.inf))


def hull(a: Span, b: Span) -> Span:
    """Return the smallest interval around both."""
    return Span(np.minimum(a.lo, b.lo), np.maximum(a.hi, b.hi))


def meet(a: Span, b: Span) -> Span:
    """Return the intersection of two enclosures of the same quantity."""
    return Span(np.maximum(a.lo, b.lo), np.minimum(a.hi, b.hi))


def magnitude(a: Span) -> Span:
    """Enclose ``|x|``."""
    low, high = np.abs(a.lo), np.abs(a.hi)
    return Span(np.where(has_zero(a), 0.0, np.minimum(low, high)), np.maximum(low, high))


def has_zero(a: Span) -> Mask:
    """Say which intervals hold zero."""
    return np.asarray((a.lo <= 0) & (a.hi >= 0))


# ------------------------------------------------------------------ arithmetic


def _two_sum(a: Array, b: Array) -> tuple[Array, Array]:
    """Return the rounded sum and its exact error (nan where that is not known)."""
    s = a + b
    t = s - a
    error = (a - (s - t)) + (b - t)
    return s, np.where((np.abs(s) < _EXACT_SUM) & (np.abs(a) < _EXACT_SUM), error, np.nan)


def _two_product(a: Array, b: Array) -> tuple[Array, Array]:
    """Return the rounded product and its exact error (nan where that is not known)."""
    p = a * b
    high_a, high_b = _SPLITTER * a, _SPLITTER * b
    high_a, high_b = high_a - (high_a - a), high_b - (high_b - b)
    low_a, low_b = a - high_a, b - high_b
    error = ((high_a * high_b - p) + high_a * low_b + low_a * high_b) + low_a * low_b
    size = np.abs(p)
    known = (size > _EXACT_PRODUCT) & (np.maximum(np.maximum(np.abs(a), np.abs(b)), size) < _EXACT_FACTOR)
    zero = (a == 0) | (b == 0)
    return np.where(zero, 0.0, p), np.where(known, error, np.where(zero, 0.0, np.nan))


def _outward(value: Array, error: Array) -> Span:
    """Return the floats around ``value + error``; an unknown (nan) error widens both ways."""
    return Span(np.where(error >= 0, value, down(value)), np.where(error <= 0, value, up(value)))


def _ends(value: Array, error: Array) -> Span:
    """Return the float below the first ``value + error`` and the float above the second."""
    (low, high), (low_error, high_error) = value, error
    return Span(np.where(low_error >= 0, low, down(low)), np.where(high_error <= 0, high, up(high)))


def add(a: Span, b: Span) -> Span:
    """Enclose ``x + y``."""
    shape = (2, *np.broadcast_shapes(a.lo.shape, a.hi.shape, b.lo.shape, b.hi.shape))
    x, y = np.empty(shape), np.empty(shape)  # both ends at once: most arrays are short, so calls are what costs
    x[0], x[1], y[0], y[1] = a.lo, a.hi, b.lo, b.hi
    return _ends(*_two_sum(x, y))


def sub(a: Span, b: Span) -> Span:
    """Enclose ``x - y``."""
    return add(a, neg(b))


def neg(a: Span) -> Span:
    """Enclose ``-x``."""
    return Span(-a.hi, -a.lo)


def twice(a: Span) -> Span:
    """Enclose ``2 x``."""
    return add(a, a)


def _corners(a: Span, b: Span) -> list[tuple[Array, Array]]:
    return list(product([a.lo] if a.lo is a.hi else [a.lo, a.hi], [b.lo] if b.lo is b.hi else [b.lo, b.hi]))


def _widest(spans: list[Span]) -> Span:
    result = spans[0]
    for span in spans[1:]:
        result = hull(result, span)
    return result


def _by_corners(a: Span, b: Span) -> Span:
    """Enclose ``x y`` by the products of all ends."""
    return _widest([_outward(*_two_product(x, y)) for x, y in _corners(a, b)])


def mul(a: Span, b: Span) -> Span:
    """Enclose ``x y`` for independent factors.

    Where a factor keeps its sign, signs say at which ends the least and the largest product lie, the same as all four
    corners would give. Where both factors may have either sign, or ends are no ends, all corners are looked at.
    """
    for one, other in ((a, b), (b, a)):
        if one.lo.shape == (1,) and one.lo[0] == one.hi[0] and abs(one.lo[0]) == 1:  # most slopes of sums
            return other if one.lo[0] > 0 else neg(other)
    a_plus, a_minus, b_plus, b_minus = a.lo >= 0, a.hi <= 0, b.lo >= 0, b.hi <= 0
    known = (a_plus | a_minus | b_plus | b_minus) & (a.lo <= a.hi) & (b.lo <= b.hi)
    x, y = np.empty((2, *known.shape)), np.empty((2, *known.shape))
    x[0] = np.where(b_plus | (a_minus & ~b_minus), a.lo, a.hi)
    y[0] = np.where(a_plus | (b_minus & ~a_minus), b.lo, b.hi)
    x[1] = np.where((a_minus | b_minus) & ~b_plus, a.lo, a.hi)
    y[1] = np.where((a_minus | b_minus) & ~a_plus, b.lo, b.hi)
    low, high = _ends(*_two_product(x, y))
    if not known.all():
        widest = _by_corners(a, b)
        low, high = np.where(known, low, widest.lo), np.where(known, high, widest.hi)
    # an underflow must not make a product of nonnegative factors negative
    return Span(np.where(a_plus & b_plus, np.maximum(low, 0.0), low), high)


def square(a: Span) -> Span:
    """Enclose ``x**2``; never below zero."""
    size = magnitude(a)
    low, high = (_outward(*_two_product(x, x)) for x in size)
    return Span(np.maximum(low.lo, 0.0), high.hi)


def _quotient(a: Array, b: Array) -> Span:
    q = a / b
    q = np.where(np.isnan(q), 0.0, q)  # inf / inf: the other corners bound the quotient, as in 0 * inf
    back, error = _two_product(q, b)
    exact = (back == a) & (error == 0)
    return _outward(q, np.where(exact, 0.0, np.nan))


def div(a: Span, b: Span) -> tuple[Span, Mask]:
    """Enclose ``x / y``; fails where the divisor may be zero."""
    result = _widest([_quotient(x, y) for x, y in _corners(a, b)])
    signless = (a.lo >= 0) & (b.lo > 0)
    return Span(np.where(signless, np.maximum(result.lo, 0.0), result.lo), result.hi), has_zero(b)


def sqrt(a: Span) -> tuple[Span, Mask]:
    """Enclose the square root; fails where the argument may be negative."""
    ends = []
    for x in a:
        root = np.sqrt(np.maximum(x, 0.0))
        back, error = _two_product(root, root)
        ends.append(_outward(root, np.where((back == x) & (error == 0), 0.0, np.nan)))
    return Span(np.maximum(ends[0].lo, 0.0), ends[1].hi), a.lo < 0


# ------------------------------------------------------------------ functions by balls


def floats_around(ball: arb) -> tuple[float, float]:
    """Return floats at or outside the two ends of a ball, each compared with the ball before it is believed."""
    low, high = (float(ball.lower()), float(ball.upper())) if ball.is_finite() else (-np.inf, np.inf)
    while low > -np.inf and not arb(low) <= ball:
        low = float(down(np.float64(low)))  # type: ignore[arg-type]  # a scalar is an array of no dimension here
    while high < np.inf and not arb(high) >= ball:
        high = float(up(np.float64(high)))  # type: ignore[arg-type]  # likewise
    return low, high


def _at(function: Point, *arguments: Array) -> Span:
    """Enclose a function at points, calling Arb once for each distinct point."""
    if all(one.shape == (1,) for one in arguments):  # as sets that are carried ask, again and again
        with ctx.workprec(PRECISION):
            low, high = floats_around(function(*(arb(float(one[0])) for one in arguments)))
        return Span(np.array([low]), np.array([high]))
    columns = np.stack(np.broadcast_arrays(*arguments))
    distinct, where = np.unique(columns, axis=1, return_inverse=True)
    with ctx.workprec(PRECISION):
        ends = np.array([floats_around(function(*map(arb, column))) for column in distinct.T.tolist()])
    low, high = ends.reshape(-1, 2).T[:, where.reshape(-1)]
    return Span(low, high)


def _rising(function: Point, floor: float, ceiling: float, a: Span) -> Span:
    """Enclose an increasing function whose values lie in ``[floor, ceiling]``."""
    return Span(np.maximum(_at(function, a.lo).lo, floor), np.minimum(_at(function, a.hi).hi, ceiling))


def _rising_inside(
    function: Point, inside: Callable[[Span], Mask], known: float, floor: float, a: Span
) -> tuple[Span, Mask]:
    """Enclose an increasing function that exists on a part of the line only; fails where the interval leaves it.

    Failed elements are evaluated at `known`, a point of the domain, so that Arb is never asked outside it.
    """
    bad = ~inside(a)
    safe = Span(np.where(bad, known, a.lo), np.where(bad, known, a.hi))
    return _rising(function, floor, np.inf, safe), bad


def acos(a: Span) -> tuple[Span, Mask]:
    """Enclose the arc cosine, a decreasing function."""
    bad = (a.lo < -1) | (a.hi > 1)
    inside = Span(np.where(bad, 0.0, a.lo), np.where(bad, 0.0, a.hi))
    return Span(np.maximum(_at(arb.acos, inside.hi).lo, 0.0), _at(arb.acos, inside.lo).hi), bad


def cosh(a: Span) -> Span:
    """Enclose the hyperbolic cosine."""
    return _rising(arb.cosh, 1.0, np.inf, magnitude(a))


def hypot(a: Span, b: Span) -> Span:
    """Enclose ``sqrt(x**2 + y**2)``, which grows with both magnitudes."""
    (a_low, a_high), (b_low, b_high) = magnitude(a), magnitude(b)
    return Span(np.maximum(_at(_length, a_low, b_low).lo, 0.0), _at(_length, a_high, b_high).hi)


def _length(x: arb, y: arb) -> arb:
    return (x * x + y * y).sqrt()


def _meets_lattice(a: Span, offset: float, period: float) -> Mask:
    """Say where ``offset + k period`` may lie in the interval for some integer ``k``.

    Both constants are within 2**-52 of the multiples of pi they stand for, and the quotient takes two rounded
    operations more, so its error stays below 5 * 2**-53 (1 + |quotient|); the margin is three times that.
    """
    low, high = (a.lo - offset) / period, (a.hi - offset) / period
    margin = 15 * 2.0**-53 * (1.0 + np.maximum(np.abs(low), np.abs(high)))
    return np.asarray(~(np.ceil(low - margin) > np.floor(high + margin)))


def _wave(function: Point, top: float, a: Span) -> Span:
    """Enclose sine or cosine, whose maxima lie at ``top + 2 k pi`` and minima half a period on."""
    ends = hull(_at(function, a.lo), _at(function, a.hi))
    low = np.where(_meets_lattice(a, top - np.pi, 2 * np.pi), -1.0, np.maximum(ends.lo, -1.0))
    return Span(low, np.where(_meets_lattice(a, top, 2 * np.pi), 1.0, np.minimum(ends.hi, 1.0)))


def tan(a: Span) -> tuple[Span, Mask]:
    """Enclose the tangent; fails where a pole may lie in the interval."""
    bad = _meets_lattice(a, np.pi / 2, np.pi)
    return _rising(arb.tan, -np.inf, np.inf, Span(np.where(bad, 0.0, a.lo), np.where(bad, 0.0, a.hi))), bad


def atan2(y: Span, x: Span) -> Span:
    """Enclose the angle of ``(x, y)``; the whole circle where the cut (y = 0, x <= 0) may be touched.

    Away from the cut the angle is monotone along every edge of the box and has no stationary point inside it, so
    its extremes lie at the corners.
    """
    corners = [_at(lambda v, w: arb.atan2(v, w), v, w) for v, w in _corners(y, x)]
    pi = floats_around(arb.pi())[1]
    result = meet(_widest(corners), Span(np.array([-pi]), np.array([pi])))
    cut = has_zero(y) & (x.lo <= 0)
    return Span(np.where(cut, -pi, result.lo), np.where(cut, pi, result.hi))


def power(a: Span, b: Span) -> tuple[Span, Mask]:
    """Enclose ``x**y``.

    An exponent that is one integer is taken for every base, except zero to a negative power. Any other exponent
    asks for a positive base; zero is let in where the exponent stays positive. On such a box the power is monotone
    in either variable while the other is held, so its extremes lie at the corners.
    """
    if b.lo.size == 1 and b.lo[0] == b.hi[0] and float(b.lo[0]).is_integer():
        return _integer_power(a, int(b.lo[0]))
    lo, hi, exp_lo, exp_hi = (np.array(v) for v in np.broadcast_arrays(*a, *b))
    result = full(lo)
    good = (lo > 0) | ((lo == 0) & (exp_lo > 0))
    bad = ~good
    if good.any():
        base, exponent = Span(lo[good], hi[good]), Span(exp_lo[good], exp_hi[good])
        corners = _widest([_at(_power_at, x, y) for x, y in product(base, exponent)])
        result.lo[good], result.hi[good] = np.maximum(corners.lo, 0.0), corners.hi
    for n in set(exp_lo[~good & (exp_lo == exp_hi) & (exp_lo == np.rint(exp_lo))].tolist()):
        rows = ~good & (exp_lo == n) & (exp_hi == n)
        part, part_bad = _integer_power(Span(lo[rows], hi[rows]), int(n))
        result.lo[rows], result.hi[rows], bad[rows] = part.lo, part.hi, part_bad
    return result, bad


def _power_at(x: arb, y: arb) -> arb:
    return x if x == 0 else x**y  # zero to a positive power is zero


def _integer_power(a: Span, n: int) -> tuple[Span, Mask]:
    if n == 0:
        return Span(np.ones_like(a.lo), np.ones_like(a.hi)), np.zeros(a.lo.shape, dtype=bool)
    if n < 0:
        positive, _ = _integer_power(a, -n)
        return div(point(1.0), positive)
    base = magnitude(a) if n % 2 == 0 else a
    result = _rising(lambda x: x**n, -np.inf, np.inf, base)
    return (Span(np.maximum(result.lo, 0.0), result.hi) if n % 2 == 0 else result), np.zeros(a.lo.shape, dtype=bool)


def copysign(a: Span, b: Span) -> Span:
    """Enclose the magnitude of ``x`` with the sign of ``y``; both signs where ``y`` may be zero, signed as it is."""
    size = magnitude(a)
    plus, minus = b.lo > 0, b.hi < 0
    return Span(np.where(plus, size.lo, -size.hi), np.where(minus, -size.lo, size.hi))


def _inside(low: float, high: float) -> Callable[[Span], Mask]:
    return lambda a: (a.lo > low) & (a.hi < high)


exp = partial(_rising, arb.exp, 0.0, np.inf)
sin = partial(_wave, arb.sin, np.pi / 2)
cos = partial(_wave, arb.cos, 0.0)
tanh = partial(_rising, arb.tanh, -1.0, 1.0)
erf = partial(_rising, arb.erf, -1.0, 1.0)
expm1 = partial(_rising, arb.expm1, -1.0, np.inf)
sinh = partial(_rising, arb.sinh, -np.inf, np.inf)
asinh = partial(_rising, arb.asinh, -np.inf, np.inf)
atan = partial(_rising, arb.atan, -np.inf, np.inf)
log = partial(_rising_inside, arb.log, lambda a: a.lo > 0, 1.0, -np.inf)
log1p = partial(_rising_inside, arb.log1p, lambda a: a.lo > -1, 0.0, -np.inf)
asin = partial(_rising_inside, arb.asin, lambda a: (a.lo >= -1) & (a.hi <= 1), 0.0, -np.inf)
atanh = partial(_rising_inside, arb.atanh, _inside(-1.0, 1.0), 0.0, -np.inf)
erfinv = partial(_rising_inside, arb.erfinv, _inside(-1.0, 1.0), 0.0, -np.inf)
acosh = partial(_rising_inside, arb.acosh, lambda a: a.lo >= 1, 1.0, 0.0)
