"""Normal forms of a graph's quantities: polynomials with rational coefficients, on demand where one of them is zero.

What is no polynomial (a root, a comparison, a quotient by more than a number) becomes an *atom*: a variable of its
own, the same for the same operation on equal arguments. Two quantities with one normal form are equal wherever both
exist; two with different ones may still be equal. Where a polynomial is known to be zero its leading product is
replaced by the rest, so that what is a multiple of it vanishes, inside of atoms too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from types import MappingProxyType
from typing import NamedTuple

from workbench.graph import OPERATIONS, RATIONALS, Arithmetic, Graph, Lookup, Table, evaluate

Product = tuple[tuple[int, int], ...]
"""A product of variables: (variable, power) in order, powers above zero."""
MOST_TERMS = 400
MOST_STEPS = 1000
MOST_POWER = 16

_AT_ZERO: Mapping[str, int] = MappingProxyType(
    {
        **dict.fromkeys(("sin", "tan", "asin", "atan", "sinh", "tanh", "asinh", "atanh", "erf", "erfinv"), 0),
        **dict.fromkeys(("expm1", "log1p", "sqrt"), 0),
        **dict.fromkeys(("exp", "cos", "cosh"), 1),
    }
)
"""What functions are at zero."""
_AT_ONE: Mapping[str, int] = MappingProxyType({"log": 0, "acos": 0, "acosh": 0, "sqrt": 1})


class NoForm(ValueError):
    """Why there is no normal form: it would be too long, or a number has no value."""


class Form(NamedTuple):
    """A sum of products, each with a coefficient that is not zero."""

    terms: Mapping[Product, Fraction]

    @property
    def constant(self) -> Fraction | None:
        """Its value, where it depends on no variable."""
        return None if self.terms.keys() - {()} else self.terms.get((), Fraction(0))

    @property
    def key(self) -> frozenset[tuple[Product, Fraction]]:
        """What equal forms share."""
        return frozenset(self.terms.items())


def number(value: Fraction | float) -> Form:
    """Return the form of a number; raises NoForm for one that is not finite."""
    try:
        exact = Fraction(value)
    except (ValueError, OverflowError):
        raise NoForm(f"{value} is no number to compute with") from None
    return Form({(): exact} if exact else {})


def added(a: Form, b: Form, factor: Fraction = Fraction(1)) -> Form:
    """Return a + factor b."""
    terms = dict(a.terms)
    for product, coefficient in b.terms.items():
        terms[product] = terms.get(product, Fraction(0)) + factor * coefficient
    return Form({product: one for product, one in terms.items() if one})


def _times(a: Product, b: Product) -> Product:
    together = dict(a)
    for variable, power in b:
        together[variable] = together.get(variable, 0) + power
    return tuple(sorted(together.items()))


def multiplied(a: Form, b: Form) -> Form:
    """Return the product of two forms."""
    if len(a.terms) * len(b.terms) > MOST_TERMS:
        raise NoForm(f"more than {MOST_TERMS} terms")
    result = Form({})
    for product, coefficient in a.terms.items():
        moved = {_times(product, other): one for other, one in b.terms.items()}
        result = added(result, Form(moved), coefficient)
    return result


def _order(product: Product) -> tuple[int, tuple[tuple[int, int], ...]]:
    """Return what products are ordered by: the sum of powers, then the powers of the first variables."""
    return sum(power for _, power in product), tuple((-variable, power) for variable, power in product)


class Atoms:
    """The variables: the coordinates first, then what is no polynomial in them."""

    def __init__(self, coordinates: int) -> None:
        self.count = coordinates
        self._known: dict[tuple[object, ...], int] = {}
        self.within: dict[int, frozenset[int]] = {}
        """The variables inside of each atom."""

    def atom(self, op: object, *arguments: Form) -> Form:
        """Return the atom that stands for an operation on arguments."""
        key = (op, *(one.key for one in arguments))
        if key not in self._known:
            self._known[key] = self.count
            self.within[self.count] = frozenset().union(*(self.inside(one) for one in arguments))
            self.count += 1
        return Form({((self._known[key], 1),): Fraction(1)})

    def inside(self, form: Form) -> frozenset[int]:
        """Return all variables of a form, those inside of its atoms too."""
        own = frozenset(variable for product in form.terms for variable, _ in product)
        return own.union(*(self.within.get(variable, frozenset()) for variable in own))


class Ring:
    """Normal forms, where ``zero`` is a form that is zero and not a number, if one is given."""

    def __init__(self, atoms: Atoms, zero: Form | None = None) -> None:
        self.atoms = atoms
        self._leading: Product | None = None
        if zero is not None:
            if zero.constant is not None:
                raise NoForm("a number is zero everywhere or nowhere")
            self._leading = self._alone(zero) or max(zero.terms, key=_order)
            coefficient = zero.terms[self._leading]
            rest = {product: -one / coefficient for product, one in zero.terms.items() if product != self._leading}
            self._rest = Form(rest)

    def _alone(self, zero: Form) -> Product | None:
        """Return a variable that the form can be solved for: it stands in it once, by itself."""
        for product in sorted(zero.terms, key=_order):
            if len(product) == 1 and product[0][1] == 1:
                rest = Form({other: one for other, one in zero.terms.items() if other != product})
                if product[0][0] not in self.atoms.inside(rest):
                    return product
        return None

    def reduced(self, form: Form) -> Form:
        """Return the normal form where ``zero`` is zero."""
        if self._leading is None:
            return form
        for _ in range(MOST_STEPS):
            found = next((one for one in form.terms if self._divides(one)), None)
            if found is None:
                return form
            powers = dict(found)
            for variable, power in self._leading:
                powers[variable] -= power
            cofactor: Product = tuple((variable, power) for variable, power in sorted(powers.items()) if power)
            coefficient = form.terms[found]
            form = Form({product: one for product, one in form.terms.items() if product != found})
            form = added(form, multiplied(Form({cofactor: coefficient}), self._rest))
        raise NoForm(f"not reduced in {MOST_STEPS} steps")

    def _divides(self, product: Product) -> bool:
        powers = dict(product)
        return all(powers.get(variable, 0) >= power for variable, power in self._leading or ())

    def _power(self, base: Form, exponent: Form) -> Form:
        whole, value = exponent.constant, base.constant
        if whole is not None and value == 0:
            if whole < 0:
                raise NoForm("zero has no negative power")
            return number(0 if whole else 1)
        if whole is None or whole.denominator != 1 or not 0 <= whole <= MOST_POWER:
            return self.atoms.atom("pow", base, exponent)
        result = number(1)
        for _ in range(int(whole)):
            result = self.reduced(multiplied(result, base))
        return result

    def _inverse(self, form: Form) -> Form:
        if form.constant is None:
            return self.atoms.atom("inv", form)
        if form.constant == 0:
            raise NoForm("zero has no inverse")
        return number(1 / form.constant)

    def _operation(self, op: str) -> Callable[..., Form]:  # of as many arguments as the operation has
        """Return what an operation without a form does: of numbers it is computed, the rest is an atom."""
        exact = RATIONALS.operations.get(op)

        def made(*arguments: Form) -> Form:
            values = [one.constant for one in arguments]
            if exact is not None and all(value is not None for value in values):
                try:
                    return number(exact(*values))
                except (ValueError, ZeroDivisionError) as error:
                    raise NoForm(str(error)) from None
            if op == "if_else_zero" and (values[0] is not None or values[1] == 0):
                return arguments[1] if values[0] else number(0)
            if op in ("fmin", "fmax") and arguments[0].key == arguments[1].key:
                return arguments[0]
            for at, table in ((0, _AT_ZERO), (1, _AT_ONE)):
                if values == [at] and op in table:
                    return number(table[op])
            return self.atoms.atom(op, *arguments)

        return made

    def arithmetic(self) -> Arithmetic[Form]:
        """Return what a graph's operations mean in normal forms."""

        def kept(operation: Callable[..., Form]) -> Callable[..., Form]:  # of any number of arguments
            return lambda *arguments: self.reduced(operation(*arguments))

        own: dict[str, Callable[..., Form]] = {
            "assign": lambda a: a,
            "add": added,
            "sub": lambda a, b: added(a, b, Fraction(-1)),
            "mul": multiplied,
            "neg": lambda a: added(number(0), a, Fraction(-1)),
            "twice": lambda a: added(a, a),
            "sq": lambda a: multiplied(a, a),
            "div": lambda a, b: multiplied(a, self._inverse(b)),
            "inv": self._inverse,
            "pow": self._power,
            "constpow": self._power,
        }
        return Arithmetic(
            operations=MappingProxyType({op: kept(own.get(op) or self._operation(op)) for op in OPERATIONS}),
            constant=number,
            lookup=self._lookup,
        )

    def _lookup(self, table: Table, lookup: Lookup, arguments: Sequence[Form]) -> Form:
        return self.atoms.atom((table, lookup), *arguments)

    def forms(self, graph: Graph, targets: Sequence[int]) -> dict[int, Form]:
        """Return the normal forms of nodes and of what they depend on. Raises NoForm where one has none."""
        coordinates = [self.reduced(Form({((i, 1),): Fraction(1)})) for i in range(graph.coordinates)]
        return evaluate(graph, coordinates, self.arithmetic(), targets)
