"""Between which ends a normal form lies, whatever its coordinates are: intervals, and what a condition tells."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from itertools import product as combinations
from typing import NamedTuple

import numpy as np

from verification.checks import univariate
from verification.checks.polynomial import Form, Variables, number, product, total
from verification.enclosure import outward
from verification.enclosure.interval import PARTIAL, TOTAL
from verification.enclosure.outward import Span
from workbench.graph import Lookup
from workbench.graph.operations import BOOLEAN

TRUTH, SELECT = "truth", "select"
"""A condition as 0 or 1; a value where a condition holds, and another where not."""
CASES = 6  # conditions of a form whose cases are gone through


class Unbounded(ValueError):
    """Why there is no range, in one line."""


class _Told(NamedTuple):
    """What is known of a form where a condition holds."""

    low: float = -math.inf
    high: float = math.inf
    size: float = 0.0
    """The least magnitude."""

    def also(self, other: _Told) -> _Told:
        return _Told(max(self.low, other.low), min(self.high, other.high), max(self.size, other.size))

    def ends(self) -> tuple[float, float]:
        low = max(self.low, self.size) if self.low >= 0 else self.low
        return low, min(self.high, -self.size) if self.high <= 0 else self.high


def alone(form: Form) -> int | None:
    """Return the variable that a form is, or None where it is anything else."""
    if len(form.terms) != 1:
        return None
    ((powers, coefficient),) = form.terms.items()
    return powers[0][0] if coefficient == 1 and len(powers) == 1 and powers[0][1] == 1 else None


def replaced(form: Form, variable: int, by: Form) -> Form:
    """Return a form with a variable, of power 1 wherever it stands, replaced by another form."""
    found = number(0)
    for powers, coefficient in form.terms.items():
        rest = tuple(one for one in powers if one[0] != variable)
        term = Form({rest: coefficient})
        found = total(found, product(term, by) if len(rest) < len(powers) else term)
    return found


class Ranges:
    """Ranges of the forms over some variables."""

    def __init__(self, variables: Variables, coordinate: Callable[[object], tuple[float, float]]) -> None:
        self.variables, self.coordinate = variables, coordinate
        self._known: dict[int, Span] = {}

    def check(self, divisors: Sequence[Form]) -> None:
        """Raise Unbounded where one of the variables may have no value, or a divisor may be zero."""
        for variable in list(self.variables.meant):
            self.variable(variable)
        for one in divisors:
            span = self.of(one)
            if span.lo[0] <= 0 <= span.hi[0]:
                raise Unbounded("a divisor may be zero")

    def of(self, form: Form) -> Span:
        """Return ends of a form. Raises Unbounded where it may have no value."""
        found = outward.point(0.0)
        with np.errstate(all="ignore"):
            for powers, coefficient in form.terms.items():
                span = _around(coefficient)
                for variable, power in powers:
                    span = outward.mul(span, self._power(self.variable(variable), power))
                found = outward.add(found, span)
        return found

    def _power(self, span: Span, power: int) -> Span:
        raised, bad = outward.power(span, outward.point(float(abs(power))))
        if power < 0:
            raised, bad = outward.div(outward.point(1.0), raised)
        if bad.any():
            raise Unbounded("a divisor may be zero")
        return raised

    def variable(self, variable: int) -> Span:
        """Return ends of a variable."""
        if variable not in self._known:
            self._known[variable] = self._variable(variable)
        return self._known[variable]

    def _variable(self, variable: int) -> Span:
        op, arguments = self.variables.meant[variable]
        if isinstance(op, Lookup):
            raise Unbounded("a table has no enclosure")
        if not isinstance(op, str):
            return _span(*self.coordinate(op))
        if op == TRUTH:
            self.of(arguments[0])
            return _span(0.0, 1.0)
        if op in (SELECT, "if_else_zero"):
            condition, value, *rest = arguments
            self.of(condition)
            otherwise = rest[0] if rest else number(0)
            branches = self._where(condition, value, True), self._where(condition, otherwise, False)
            ends = [one for one in branches if one is not None]
            return _span(min(float(one.lo[0]) for one in ends), max(float(one.hi[0]) for one in ends))
        spans = [self.of(one) for one in arguments]
        with np.errstate(all="ignore"):
            return self._operation(op, spans)

    def _operation(self, op: str, spans: Sequence[Span]) -> Span:
        if op in PARTIAL:
            span, bad = PARTIAL[op][0](*spans)
            if bad.any():
                raise Unbounded(f"{PARTIAL[op][1]} in {op}")
            return span
        if op in TOTAL:
            return TOTAL[op](*spans)
        raise Unbounded(f"the operation {op} has no enclosure")

    def _where(self, condition: Form, value: Form, holds: bool) -> Span | None:
        """Return ends of a value where a condition holds, or does not; None where that cannot be."""
        span = self.of(value)
        low, high = self._told(condition, value, holds).ends()
        low, high = max(low, float(span.lo[0])), min(high, float(span.hi[0]))
        return _span(low, high) if low <= high else None

    def _told(self, condition: Form, value: Form, holds: bool) -> _Told:
        """Return what a condition tells of a value where it holds, or does not."""
        which = alone(condition)
        if which is None:
            return _Told()
        op, arguments = self.variables.meant[which]
        if op == "not":
            return self._told(arguments[0], value, not holds)
        if op == ("and" if holds else "or"):
            return self._told(arguments[0], value, holds).also(self._told(arguments[1], value, holds))
        if op in ("lt", "le"):
            first, second = arguments if holds else arguments[::-1]
            return self._least(first, second, value)
        if op == ("eq" if holds else "ne"):
            first, second = arguments
            return self._least(first, second, value).also(self._least(second, first, value))
        return _Told()

    def _least(self, small: Form, large: Form, value: Form) -> _Told:
        """Return what small <= large tells of a value."""
        told = _Told()
        below, above = small.constant, large.constant
        if below is not None:
            end = float(_around(below).lo[0])
            told = told.also(_Told(low=end) if large.key == value.key else _Told())
            told = told.also(_Told(size=end) if self._is("fabs", large, value) else _Told())
            told = told.also(_Told(low=0.0) if below > 0 and self._is("sign", large, value) else _Told())
        if above is not None:
            end = float(_around(above).hi[0])
            told = told.also(_Told(high=end) if small.key == value.key else _Told())
            told = told.also(_Told(low=-end, high=end) if self._is("fabs", small, value) else _Told())
            told = told.also(_Told(high=0.0) if above < 0 and self._is("sign", small, value) else _Told())
        return told

    def _is(self, op: str, form: Form, value: Form) -> bool:
        """Tell whether a form is an operation on a value."""
        which = alone(form)
        if which is None or self.variables.meant[which][0] != op:
            return False
        return self.variables.meant[which][1][0].key == value.key

    def within(self, form: Form, least: Fraction, most: Fraction) -> str | None:
        """Return why least <= form <= most is not shown, or None.

        A form in one variable is decided exactly, case by case of the conditions in it; one in several is enclosed.
        """
        for case in self._cases(form):
            roots = univariate.roots_of(case, self.variables.meant.get)
            if len(roots) <= 1:
                t = next(iter(roots), None)
                low, high = (None, None) if t is None else (_end(end) for end in self.variable(t))
                low, high = (Fraction(0), Fraction(0)) if t is None else (low, high)
                over = univariate.quotient(case, t, self.variables.meant.get)
                if univariate.between(over, low, high, least, most):
                    continue
            span = self.of(case)
            if not (_exact(span.lo[0]) >= least and _exact(span.hi[0]) <= most):
                return f"it is only known to lie in [{span.lo[0]:.6g}, {span.hi[0]:.6g}]"
        return None

    def _cases(self, form: Form) -> Iterator[Form]:
        """Return a form in every case of the conditions that it is a sum of products of."""
        used = sorted({variable for powers in form.terms for variable, _ in powers})
        below = {variable for powers in form.terms for variable, power in powers if power < 0}
        conditions = [one for one in used if one not in below and self._is_condition(one)][:CASES]
        for case in combinations((0, 1), repeat=len(conditions)):
            one = form
            for variable, holds in zip(conditions, case, strict=True):
                one = replaced(one, variable, number(holds))
            yield one

    def _is_condition(self, variable: int) -> bool:
        op = self.variables.meant[variable][0]
        return isinstance(op, str) and (op in BOOLEAN or op == TRUTH)


def _span(low: float, high: float) -> Span:
    return Span(np.array([low]), np.array([high]))


def _around(value: Fraction) -> Span:
    """Return the doubles around a rational."""
    try:
        near = float(value)
    except OverflowError:
        near = math.inf if value > 0 else -math.inf
    if math.isinf(near):
        largest = float(np.finfo(float).max)
        return _span(largest, math.inf) if near > 0 else _span(-math.inf, -largest)
    if Fraction(near) == value:
        return _span(near, near)
    return _span(math.nextafter(near, -math.inf), math.nextafter(near, math.inf))


def _end(value: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> Fraction | None:
    return Fraction(float(value[0])) if np.isfinite(value[0]) else None


def _exact(value: float) -> Fraction | float:
    return Fraction(float(value)) if math.isfinite(value) else float(value)
