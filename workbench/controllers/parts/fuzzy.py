"""Fuzzy rules as symbolic expressions: named memberships, min for AND, max for aggregation.

Rules are data: which terms of the inputs lead to which term of the output. Inference works on SX, MX and DM
alike, so a law that uses rules compiles like any other. A compiled law cannot refuse a sample at which no rule
fires; so that is settled when the rules are made: they cover every input, or they declare a default.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import reduce
from itertools import pairwise, product
from typing import NamedTuple

import casadi as ca

from models.expression import Expression, Number
from models.quantity import InvalidValue, count, declared, given
from workbench.controllers.parts.rows import column

Corners = tuple[float, ...]


class Membership(NamedTuple):
    """A shape on the axis of a signal: ``degree(z)`` in [0, 1] for a number or a CasADi value z."""

    shape: str
    corners: Corners

    def degree(self, z: Number) -> Number:
        """Return how far z belongs to the set."""
        return SHAPES[self.shape].degree(z, self.corners)

    @property
    def support(self) -> Support:
        """Where the degree is positive, in double precision."""
        return SHAPES[self.shape].support(self.corners)


class Support(NamedTuple):
    """An interval from ``low`` to ``high``, infinite ends allowed; the ends belong to it where they are closed."""

    low: float
    high: float
    low_closed: bool = False
    high_closed: bool = False

    def holds(self, z: float) -> bool:
        """Return whether z lies in the interval."""
        return self.low < z < self.high or (z == self.low and self.low_closed) or (z == self.high and self.high_closed)


class Shape(NamedTuple):
    """How a degree, and the interval where it is positive, come from corners."""

    degree: Callable[[Number, Corners], Number]
    support: Callable[[Corners], Support]


def s_shaped(low: float, high: float) -> Membership:
    """Return the spline that rises from 0 at ``low`` to 1 at ``high``: two parabolas that meet at 1/2."""
    return Membership("s", _rising("s_shaped", low, high))


def z_shaped(low: float, high: float) -> Membership:
    """Return the spline that falls from 1 at ``low`` to 0 at ``high``: 1 - s_shaped."""
    return Membership("z", _rising("z_shaped", low, high))


def triangle(left: float, top: float, right: float) -> Membership:
    """Return the triangle that is 0 outside (left, right) and 1 at ``top``.

    A side may be upright: ``triangle(0, 0, 5)`` is 0 below 0, 1 at 0 and falls to 0 at 5.
    """
    return Membership("triangle", _ordered("triangle", left, top, right))


def trapezoid(left: float, first: float, last: float, right: float) -> Membership:
    """Return the trapezoid that is 0 outside (left, right) and 1 from ``first`` to ``last``; sides may be upright."""
    return Membership("trapezoid", _ordered("trapezoid", left, first, last, right))


def left_shoulder(top: float, right: float) -> Membership:
    """Return the line that is 1 up to ``top`` and falls to 0 at ``right``."""
    return Membership("left_shoulder", _rising("left_shoulder", top, right))


def right_shoulder(left: float, top: float) -> Membership:
    """Return the line that rises from 0 at ``left`` and is 1 from ``top`` on."""
    return Membership("right_shoulder", _rising("right_shoulder", left, top))


def gaussian(center: float, width: float) -> Membership:
    """Return exp(-((z - center) / width)^2 / 2); beyond 38 widths it is 0 in double precision."""
    _finite("gaussian", center, width)
    if width <= 0:
        raise InvalidValue(f"gaussian needs a positive width, got {width}")
    return Membership("gaussian", (center, width))


def _finite(what: str, *corners: float) -> tuple[float, ...]:
    if not all(math.isfinite(corner) for corner in corners):
        raise InvalidValue(f"{what} needs finite numbers, got {corners}")
    return corners


def _rising(what: str, *corners: float) -> tuple[float, ...]:
    if any(a >= b for a, b in pairwise(_finite(what, *corners))):
        raise InvalidValue(f"{what} needs corners in rising order, got {corners}")
    return corners


def _ordered(what: str, *corners: float) -> tuple[float, ...]:
    if any(a > b for a, b in pairwise(_finite(what, *corners))) or corners[0] == corners[-1]:
        raise InvalidValue(
            f"{what} needs corners in rising order, equal ones only where a side is upright, got {corners}"
        )
    return corners


def _s(z: Number, corners: Corners) -> Number:
    low, high = corners
    width = high - low
    rising, falling = 2 * ((z - low) / width) ** 2, 1 - 2 * ((z - high) / width) ** 2
    inside = ca.if_else(z <= (low + high) / 2, rising, falling)
    return ca.if_else(z <= low, 0, ca.if_else(z >= high, 1, inside))


def _z(z: Number, corners: Corners) -> Number:
    return 1 - _s(z, corners)


def _triangle(z: Number, corners: Corners) -> Number:
    left, top, right = corners
    return ca.fmax(0, ca.fmin(_rise(z, left, top), _fall(z, top, right)))


def _trapezoid(z: Number, corners: Corners) -> Number:
    left, first, last, right = corners
    return ca.fmax(0, ca.fmin(1, ca.fmin(_rise(z, left, first), _fall(z, last, right))))


def _rise(z: Number, left: float, top: float) -> Number:
    return (z - left) / (top - left) if left < top else ca.if_else(z >= top, 1, 0)


def _fall(z: Number, top: float, right: float) -> Number:
    return (right - z) / (right - top) if top < right else ca.if_else(z <= top, 1, 0)


def _left_shoulder(z: Number, corners: Corners) -> Number:
    top, right = corners
    return ca.fmax(0, ca.fmin(1, _fall(z, top, right)))


def _right_shoulder(z: Number, corners: Corners) -> Number:
    left, top = corners
    return ca.fmax(0, ca.fmin(1, _rise(z, left, top)))


def _gaussian(z: Number, corners: Corners) -> Number:
    center, width = corners
    return ca.exp(-(((z - center) / width) ** 2) / 2)


SHAPES: Mapping[str, Shape] = {
    # squares of what is smaller than these shares of the width are lost beside 1, or are 0 themselves
    "s": Shape(_s, lambda at: Support(at[0] + 1e-150 * (at[1] - at[0]), math.inf)),
    "z": Shape(_z, lambda at: Support(-math.inf, at[1] - 1e-8 * (at[1] - at[0]))),
    "triangle": Shape(_triangle, lambda at: Support(at[0], at[2], at[0] == at[1], at[1] == at[2])),
    "trapezoid": Shape(_trapezoid, lambda at: Support(at[0], at[3], at[0] == at[1], at[2] == at[3])),
    "left_shoulder": Shape(_left_shoulder, lambda at: Support(-math.inf, at[1])),
    "right_shoulder": Shape(_right_shoulder, lambda at: Support(at[0], math.inf)),
    "gaussian": Shape(_gaussian, lambda at: Support(at[0] - 38 * at[1], at[0] + 38 * at[1])),
}


class Rule(NamedTuple):
    """If every named input belongs to its term, the output belongs to ``then``."""

    when: Mapping[str, str]
    then: str


@declared
class Rules:
    """Inputs and output with named terms, the rules between them, and the points that the output is cut into.

    Raises
    ------
    InvalidValue
        If a rule names what there is not, an output term that a rule ends in is 0 at every point of the axis, the axis
        is not in order, or no rule fires at some input while no ``default`` is declared.
    """

    inputs: Mapping[str, Mapping[str, Membership]] = given(doc="the terms of every input, by name")
    output: Mapping[str, Membership] = given(doc="the terms of the output, by name")
    rules: tuple[Rule, ...] = given(doc="the rules")
    low: float = given(default=-1.0, doc="smallest value of the output")
    high: float = given(default=1.0, doc="largest value of the output")
    points: int = count(default=101, doc="points of the output's axis", least=2)
    default: float | None = given(default=None, doc="the output where no rule fires; none if one always does")

    def check(self) -> None:
        """Raise InvalidValue where a rule cannot be read, or leaves the output open."""
        if not self.rules:
            raise InvalidValue("rules must hold at least one rule, got none")
        for rule in self.rules:
            if not rule.when:
                raise InvalidValue(f"a rule needs at least one input, got none before {rule.then!r}")
            for name, term in rule.when.items():
                if name not in self.inputs:
                    raise InvalidValue(f"a rule names the input {name!r}; the inputs are: {', '.join(self.inputs)}")
                if term not in self.inputs[name]:
                    known = ", ".join(self.inputs[name])
                    raise InvalidValue(f"a rule names the term {term!r} of {name}; its terms are: {known}")
            if rule.then not in self.output:
                raise InvalidValue(f"a rule ends in the term {rule.then!r}; the output's are: {', '.join(self.output)}")
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise InvalidValue(f"low must be below high, both finite, got low {self.low} and high {self.high}")
        for term in dict.fromkeys(rule.then for rule in self.rules):
            if not any(float(self.output[term].degree(z)) > 0 for z in self.axis):
                raise InvalidValue(
                    f"the output term {term!r} is 0 at each of the {self.points} points from {self.low:g} to "
                    f"{self.high:g}; take more points, or make it wider"
                )
        if self.default is None:
            gap = self.uncovered()
            if gap is not None:
                where = ", ".join(f"{name} = {value:.6g}" for name, value in gap.items())
                raise InvalidValue(f"no rule fires at {where}; let terms overlap there, or declare a default output")
        elif not self.low <= self.default <= self.high:
            raise InvalidValue(f"default must lie in [{self.low:g}, {self.high:g}], got {self.default}")

    def uncovered(self) -> dict[str, float] | None:
        """Return an input, by name, at which no rule fires, or None if one fires wherever the inputs are.

        Which terms have a positive degree changes only at the ends of their supports: one input in each piece between
        them, and each end itself, stand for all.
        """
        pieces = {name: self._pieces(name) for name in dict.fromkeys(name for rule in self.rules for name in rule.when)}
        for chosen in product(*pieces.values()):
            live = {name: terms for name, (terms, _) in zip(pieces, chosen, strict=True)}
            if not any(all(term in live[name] for name, term in rule.when.items()) for rule in self.rules):
                return {name: z for name, (_, z) in zip(pieces, chosen, strict=True)}
        return None

    def _pieces(self, name: str) -> list[tuple[frozenset[str], float]]:
        """The sets of terms that are positive together at some z, least sets only, and such a z."""
        supports = {term: membership.support for term, membership in self.inputs[name].items()}
        ends = sorted({end for s in supports.values() for end in (s.low, s.high) if math.isfinite(end)}) or [0.0]
        beyond = max(1.0, ends[-1] - ends[0])
        points = [*ends, *((a + b) / 2 for a, b in pairwise(ends)), ends[0] - beyond, ends[-1] + beyond]
        found: dict[frozenset[str], float] = {}
        for z in points:
            found.setdefault(frozenset(term for term, support in supports.items() if support.holds(z)), z)
        return [(terms, z) for terms, z in found.items() if not any(other < terms for other in found)]

    @property
    def axis(self) -> tuple[float, ...]:
        """The points of the output's axis."""
        last = self.points - 1
        return tuple(self.low + (self.high - self.low) * index / last for index in range(self.points))

    def strengths(self, values: Mapping[str, Number]) -> dict[str, Number]:
        """Return how far each output term is called for: max over its rules of the min over the inputs."""
        if values.keys() != self.inputs.keys():
            raise InvalidValue(f"the inputs are {', '.join(self.inputs)}, got {', '.join(values) or 'none'}")
        degrees = {
            (name, term): membership.degree(values[name])
            for name, terms in self.inputs.items()
            for term, membership in terms.items()
        }
        fired: dict[str, Number] = {}
        for rule in self.rules:
            strength = reduce(ca.fmin, [degrees[pair] for pair in rule.when.items()])
            fired[rule.then] = ca.fmax(fired[rule.then], strength) if rule.then in fired else strength
        return fired

    def aggregated(self, values: Mapping[str, Number]) -> list[Number]:
        """Return the degree of the inferred set at every point of the axis: implication by min, union by max."""
        fired = self.strengths(values)
        degrees = []
        for z in self.axis:
            level: Number = 0.0
            for term, strength in fired.items():
                height = float(self.output[term].degree(z))
                if height > 0:
                    level = ca.fmax(level, ca.fmin(strength, height))
            degrees.append(level)
        return degrees

    def mean_of_maxima(self, **values: Number) -> Expression:
        """Return the mean of the points with the largest degree, given every input by name; ``default`` if none fires.

        The largest degree is the max over terms of min(strength, the term's height); a point has it where a term
        that is called for so far is at least so high. That is exact, and cheaper than ``aggregated``.
        """
        fired = self.strengths(values)
        heights = {term: [float(self.output[term].degree(z)) for z in self.axis] for term in fired}
        top = reduce(ca.fmax, [ca.fmin(strength, max(heights[term])) for term, strength in fired.items()])
        needed = {term: ca.if_else(strength >= top, top, math.inf) for term, strength in fired.items()}
        total: Number = 0.0
        weighted: Number = 0.0
        for index, z in enumerate(self.axis):
            reaching = [heights[term][index] >= needed[term] for term in fired if heights[term][index] > 0]
            one = reduce(ca.logic_or, reaching) if reaching else 0.0
            total, weighted = total + one, weighted + z * one
        mean = weighted / total
        return column(mean if self.default is None else ca.if_else(top > 0, mean, self.default))

    def centroid(self, **values: Number) -> Expression:
        """Return the centre of area of the inferred set, given every input by name; ``default`` if no rule fires."""
        degrees = self.aggregated(values)
        area = sum(degrees)
        moment = sum(z * degree for z, degree in zip(self.axis, degrees, strict=True))
        if self.default is None:
            return column(moment / area)
        return column(ca.if_else(area > 0, moment / ca.if_else(area > 0, area, 1), self.default))
