"""Exact identities between expressions: both sides in one normal form, with rational coefficients.

The normal form is a polynomial in the inputs, of which whole powers below zero are allowed too. What is no polynomial
(a root, a table, a quotient by a sum) becomes a variable of its own, the same for the same function of the same
arguments. Two sides with one normal form are equal wherever they exist; two sides with different ones may still be.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from models.expression import Expression
from verification.certificates.identity import identity
from workbench.contracts.certificate import Certificate
from workbench.contracts.claim import Held
from workbench.contracts.finding import Finding, Grounds, undecided
from workbench.graph import OPERATIONS, RATIONALS, Arithmetic, Graph, Lookup, Table, evaluate, read

Powers = tuple[tuple[int, int], ...]
"""A product of variables: (variable, power) in order, without powers of zero."""
APART = 1e-9
"""Sides that are further apart than this share of the larger one differ by more than rounding."""
ATTACKED = 1e-6
"""The same where numbers are drawn at random, and large terms may cancel."""


class Form(NamedTuple):
    """A sum of products of variables, each with a rational coefficient that is not zero."""

    terms: Mapping[Powers, Fraction]

    @property
    def is_zero(self) -> bool:
        """Whether it is zero, whatever the variables are."""
        return not self.terms

    @property
    def constant(self) -> Fraction | None:
        """Its value, where it depends on no variable."""
        return None if self.terms.keys() - {()} else self.terms.get((), Fraction(0))

    @property
    def degree(self) -> int:
        """The largest sum of powers in a product."""
        return max((sum(max(power, 0) for _, power in powers) for powers in self.terms), default=0)

    @property
    def key(self) -> frozenset[tuple[Powers, Fraction]]:
        """What equal forms share."""
        return frozenset(self.terms.items())


def number(value: Fraction | float) -> Form:
    """Return a number."""
    exact = Fraction(value)
    return Form({(): exact} if exact else {})


def total(a: Form, b: Form) -> Form:
    """Return a sum."""
    terms = dict(a.terms)
    for powers, coefficient in b.terms.items():
        terms[powers] = terms.get(powers, Fraction(0)) + coefficient
    return Form({powers: one for powers, one in terms.items() if one})


def _times(a: Powers, b: Powers) -> Powers:
    together = dict(a)
    for variable, power in b:
        together[variable] = together.get(variable, 0) + power
    return tuple(sorted((variable, power) for variable, power in together.items() if power))


def product(a: Form, b: Form) -> Form:
    """Return a product, multiplied out."""
    terms: dict[Powers, Fraction] = {}
    for left, c in a.terms.items():
        for right, d in b.terms.items():
            powers = _times(left, right)
            terms[powers] = terms.get(powers, Fraction(0)) + c * d
    return Form({powers: one for powers, one in terms.items() if one})


def negative(a: Form) -> Form:
    """Return a form with its sign turned."""
    return Form({powers: -one for powers, one in a.terms.items()})


@dataclass
class Variables:
    """The variables of one normal form: the coordinates first, then what is no polynomial in them."""

    count: int
    known: dict[tuple[object, ...], int] = field(default_factory=dict)
    meant: dict[int, tuple[object, tuple[Form, ...]]] = field(default_factory=dict)
    """What each variable that is no coordinate stands for: an operation and its arguments."""

    def opaque(self, op: object, *arguments: Form) -> Form:
        """Return the variable that stands for an operation on arguments."""
        key = (op, *(one.key for one in arguments))
        if key not in self.known:
            self.known[key] = self.count
            self.meant[self.count] = op, arguments
            self.count += 1
        return Form({((self.known[key], 1),): Fraction(1)})

    def inverse(self, a: Form) -> Form:
        """Return 1/a: of a single product exactly, else a variable."""
        if len(a.terms) != 1:
            return self.opaque("inv", a)
        ((powers, coefficient),) = a.terms.items()
        return Form({tuple((variable, -power) for variable, power in powers): 1 / coefficient})

    def power(self, a: Form, exponent: Form) -> Form:
        """Return a to a power: multiplied out where that is a small whole number, else a variable."""
        whole = exponent.constant
        if whole is None or whole.denominator != 1 or not 0 <= whole <= 8:
            return self.opaque("pow", a, exponent)
        result = number(1)
        for _ in range(int(whole)):
            result = product(result, a)
        return result

    def operation(self, op: str) -> Callable[..., Form]:  # of as many arguments as the operation has
        """Return what an operation without a normal form does: numbers it computes, the rest is a variable."""
        exact = RATIONALS.operations.get(op)

        def made(*arguments: Form) -> Form:
            numbers = [one.constant for one in arguments]
            if exact is not None and all(one is not None for one in numbers):
                return number(exact(*numbers))
            if op == "if_else_zero" and numbers[0] is not None:
                return arguments[1] if numbers[0] else number(0)
            return self.opaque(op, *arguments)

        return made

    @cached_property
    def arithmetic(self) -> Arithmetic[Form]:
        """What a graph's operations mean in normal forms."""
        own: dict[str, Callable[..., Form]] = {
            "assign": lambda a: a,
            "add": total,
            "sub": lambda a, b: total(a, negative(b)),
            "mul": product,
            "neg": negative,
            "twice": lambda a: product(number(2), a),
            "sq": lambda a: product(a, a),
            "div": lambda a, b: product(a, self.inverse(b)),
            "inv": self.inverse,
            "pow": self.power,
            "constpow": self.power,
        }
        return Arithmetic(
            operations=MappingProxyType({op: own.get(op) or self.operation(op) for op in OPERATIONS}),
            constant=number,
            lookup=self._table,
        )

    def _table(self, table: Table, lookup: Lookup, arguments: Sequence[Form]) -> Form:
        return self.opaque(lookup, *arguments)


def forms(function: ca.Function | Graph) -> dict[str, list[list[Form]]]:
    """Return the normal forms of a Function's outputs by name, rows of entries.

    Raises ValueError for a Function that is no graph, or with a number in it that is not finite.
    """
    graph = function if isinstance(function, Graph) else read(function)
    if not all(math.isfinite(node.value) for node in graph.nodes):
        raise ValueError(f"{graph.name} must be made of finite numbers to be exact")
    variables = Variables(graph.coordinates)
    coordinates = [Form({((i, 1),): Fraction(1)}) for i in range(graph.coordinates)]
    values = evaluate(graph, coordinates, variables.arithmetic)
    found = {}
    for result in graph.outputs:
        rows = [[number(0)] * result.shape[1] for _ in range(result.shape[0])]
        for entry in result.entries:
            rows[entry.row][entry.column] = values[entry.node]
        found[result.name] = rows
    return found


@dataclass(frozen=True, kw_only=True)
class Identity:
    """Two expressions of the same symbols that are claimed to be equal, and numbers at which to compare them."""

    left: Expression
    right: Expression
    at: Mapping[str, tuple[Expression, ArrayLike]]
    """Every symbol by name, with the number that it has where the sides are compared."""
    method: str
    """What the sides are made of."""

    @cached_property
    def _sides(self) -> ca.Function:
        symbols = [symbol for symbol, _ in self.at.values()]
        return ca.Function("sides", symbols, [self.left, self.right], list(self.at), ["left", "right"])

    @cached_property
    def _gap(self) -> Form:
        symbols = [symbol for symbol, _ in self.at.values()]
        gap = ca.Function("gap", symbols, [self.left - self.right], list(self.at), ["gap"])
        return forms(gap)["gap"][0][0]

    def share(self, numbers: Mapping[str, object]) -> float:
        """Return how far the sides are apart at numbers, as a share of the larger one, computed by CasADi."""
        values = {name: np.asarray(numbers[name], dtype=float) for name in self.at}
        left, right = (float(side) for side in self._sides(*values.values()))
        return abs(left - right) / max(abs(left), abs(right)) if left != right else 0.0

    def certificate(self, says: str) -> Certificate:
        """Return the certificate of the identity, which says so. Raises NotCertified for sides that are no graph."""
        return identity(says, self._sides)

    def replay(self, witness: Mapping[str, object]) -> float:
        """Return the margin at a witness: below zero where the sides differ by more than rounding."""
        return APART - self.share(witness)

    def held(self, tries: int = 100) -> Held:
        """Hold the identity against the compiled sides at numbers drawn around those of ``at``."""
        rng = np.random.default_rng(0)
        least: float = ATTACKED
        where: dict[str, object] = {}
        for _ in range(tries):
            drawn = {name: np.asarray(value, dtype=float) for name, (_, value) in self.at.items()}
            drawn = {name: value * rng.uniform(0.5, 1.5, value.shape) for name, value in drawn.items()}
            room = ATTACKED - self.share(drawn)
            if not where or room < least:
                least, where = room, {name: value.tolist() for name, value in drawn.items()}
        return Held(tries, least, where)

    def finding(self) -> Finding:
        """Prove the identity by its normal form, or find that the sides differ at the numbers."""
        if self._gap.is_zero:
            return Finding(
                grounds=Grounds.ALGEBRA,
                holds=self._gap.is_zero,
                method=f"{self.method}; in rational arithmetic the two sides have one normal form: all terms cancel",
            )
        numbers = {name: np.asarray(value, dtype=float).tolist() for name, (_, value) in self.at.items()}
        share = self.share(numbers)
        if not share > APART:
            return undecided(
                f"{len(self._gap.terms)} terms of degree up to {self._gap.degree} do not cancel, yet the sides agree "
                "at the numbers that were tried: other numbers would decide",
                **numbers,
            )
        return Finding(
            grounds=Grounds.ALGEBRA,
            margin=APART - share,
            unit="share of the larger side",
            method=f"{self.method}; the two sides differ at the numbers of the witness",
            witness=numbers,
        )
