"""Fuzzy rules as symbolic expressions: named memberships, min for AND, max for aggregation.

Rules are data: which terms of the inputs lead to which term of the output. Inference works on SX, MX and DM
alike, so a law that uses rules compiles like any other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import reduce
from itertools import pairwise
from typing import Any, NamedTuple

import casadi as ca

from models.quantity import InvalidValue, count, declared, given


class Membership(NamedTuple):
    """A shape on the axis of a signal: ``degree(z)`` in [0, 1] for a number or a CasADi value z."""

    shape: str
    corners: tuple[float, ...]

    def degree(self, z: Any) -> Any:
        """Return how far z belongs to the set."""
        return SHAPES[self.shape](z, *self.corners)


def s_shaped(low: float, high: float) -> Membership:
    """Return the spline that rises from 0 at ``low`` to 1 at ``high``: two parabolas that meet at 1/2."""
    return Membership("s", _rising("s_shaped", low, high))


def z_shaped(low: float, high: float) -> Membership:
    """Return the spline that falls from 1 at ``low`` to 0 at ``high``: 1 - s_shaped."""
    return Membership("z", _rising("z_shaped", low, high))


def triangle(left: float, top: float, right: float) -> Membership:
    """Return the triangle that is 0 outside (left, right) and 1 at ``top``."""
    return Membership("triangle", _rising("triangle", left, top, right))


def _rising(what: str, *corners: float) -> tuple[float, ...]:
    if any(a >= b for a, b in pairwise(corners)):
        raise InvalidValue(f"{what} needs corners in rising order, got {corners}")
    return corners


def _s(z: Any, low: float, high: float) -> Any:
    width = high - low
    rising, falling = 2 * ((z - low) / width) ** 2, 1 - 2 * ((z - high) / width) ** 2
    inside = ca.if_else(z <= (low + high) / 2, rising, falling)
    return ca.if_else(z <= low, 0, ca.if_else(z >= high, 1, inside))


def _z(z: Any, low: float, high: float) -> Any:
    return 1 - _s(z, low, high)


def _triangle(z: Any, left: float, top: float, right: float) -> Any:
    return ca.fmax(0, ca.fmin((z - left) / (top - left), (right - z) / (right - top)))


SHAPES: Mapping[str, Callable[..., Any]] = {"s": _s, "z": _z, "triangle": _triangle}


class Rule(NamedTuple):
    """If every named input belongs to its term, the output belongs to ``then``."""

    when: Mapping[str, str]
    then: str


@declared
class Rules:
    """Inputs and output with named terms, the rules between them, and the points that the output is cut into."""

    inputs: Mapping[str, Mapping[str, Membership]] = given(doc="the terms of every input, by name")
    output: Mapping[str, Membership] = given(doc="the terms of the output, by name")
    rules: tuple[Rule, ...] = given(doc="the rules")
    low: float = given(default=-1.0, doc="smallest value of the output")
    high: float = given(default=1.0, doc="largest value of the output")
    points: int = count(default=101, doc="points of the output's axis", least=2)

    def check(self) -> None:
        """Raise InvalidValue where a rule names an input or a term that there is not."""
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

    @property
    def axis(self) -> tuple[float, ...]:
        """The points of the output's axis."""
        last = self.points - 1
        return tuple(self.low + (self.high - self.low) * index / last for index in range(self.points))

    def strengths(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return how far each output term is called for: max over its rules of the min over the inputs."""
        degrees = {
            (name, term): membership.degree(values[name])
            for name, terms in self.inputs.items()
            for term, membership in terms.items()
        }
        fired: dict[str, Any] = {}
        for rule in self.rules:
            strength = reduce(ca.fmin, [degrees[pair] for pair in rule.when.items()])
            fired[rule.then] = ca.fmax(fired[rule.then], strength) if rule.then in fired else strength
        return fired

    def aggregated(self, values: Mapping[str, Any]) -> list[Any]:
        """Return the degree of the inferred set at every point of the axis: implication by min, union by max."""
        fired = self.strengths(values)
        degrees = []
        for z in self.axis:
            level: Any = 0.0
            for term, strength in fired.items():
                height = float(self.output[term].degree(z))
                if height > 0:
                    level = ca.fmax(level, ca.fmin(strength, height))
            degrees.append(level)
        return degrees

    def mean_of_maxima(self, **values: Any) -> Any:
        """Return the mean of the points with the largest degree, given every input by name.

        The largest degree is the max over terms of min(strength, the term's height); a point has it where a term
        that is called for so far is at least so high. That is exact, and cheaper than ``aggregated``.
        """
        fired = self.strengths(values)
        heights = {term: [float(self.output[term].degree(z)) for z in self.axis] for term in fired}
        top = reduce(ca.fmax, [ca.fmin(strength, max(heights[term])) for term, strength in fired.items()])
        needed = {term: ca.if_else(strength >= top, top, math.inf) for term, strength in fired.items()}
        total, weighted = 0.0, 0.0
        for index, z in enumerate(self.axis):
            reaching = [heights[term][index] >= needed[term] for term in fired if heights[term][index] > 0]
            one = reduce(ca.logic_or, reaching) if reaching else 0.0
            total, weighted = total + one, weighted + z * one
        return weighted / total
