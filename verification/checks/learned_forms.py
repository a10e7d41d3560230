"""What a law computes for one sample, in normal forms over the coordinates of what it learns from."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from types import MappingProxyType

from verification.checks.form_range import SELECT, TRUTH, Ranges, alone, replaced
from verification.checks.learned_graph import MEMORY, Learned, OtherForm, Place
from verification.checks.polynomial import Form, Powers, Variables, negative, number, product, total
from workbench.graph import OPERATIONS, Arithmetic
from workbench.graph.operations import BOOLEAN, CONSTANT, INPUT, LOOKUP

LARGE = 4000
"""Operations behind the plan of one sample, above which a law is taken to learn from the trial as a whole."""
TERMS = 64
"""Products of a normal form, above which it is not multiplied out."""
ROUNDS = 16
"""Conditions that are taken apart before a change is taken as it is."""
SIGNAL = Place("signal", 0, 0)
"""The error of what is learned on, at k + 1."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Column:
    """Some nodes that belong to one sample."""

    learned: Learned
    k: int
    targets: Sequence[int]

    @cached_property
    def order(self) -> tuple[int, ...]:
        """The nodes behind the targets, in an order that is the same for samples that are alike."""
        nodes = self.learned.graph.nodes
        found: list[int] = []
        seen: set[int] = set()
        stack = [(place, False) for place in reversed(self.targets)]
        while stack:
            place, done = stack.pop()
            if done:
                found.append(place)
            elif place not in seen:
                seen.add(place)
                stack.append((place, True))
                stack += [(arg, False) for arg in reversed(nodes[place].args)]
            if len(seen) > LARGE:
                raise OtherForm(f"the next plan of sample {self.k} depends on more than {LARGE} operations")
        return tuple(found)

    @cached_property
    def content(self) -> tuple[object, ...]:
        """What is computed, with columns counted from the sample: samples with the same content are alike."""
        nodes = self.learned.graph.nodes
        at = {place: i for i, place in enumerate(self.order)}
        found: list[object] = []
        for place in self.order:
            node = nodes[place]
            if node.op == INPUT:
                found.append(self._seen(self.learned.places[node.which]))
            else:
                found.append((node.op, node.value.hex(), node.which, *(at[arg] for arg in node.args)))
        return (*found, *(at[target] for target in self.targets))

    def _seen(self, place: Place) -> object:
        """Return a coordinate as it is seen from the sample, or the number that it always is."""
        if place in self.learned.constants:
            return self.learned.constants[place]
        wide = place.port not in self.learned.memory or self.learned.memory[place.port].shape[1] > 1
        return place.port, place.row, place.column - self.k if wide else "one"


@dataclass(frozen=True, kw_only=True, eq=False)
class Forms:
    """The targets of a column in normal forms, for a trial that reached k + 1, that did not, or that may have."""

    column: Column
    reached: bool | None
    variables: Variables = field(default_factory=lambda: Variables(0))
    divisors: list[Form] = field(default_factory=list)
    """What was divided by, which must not be zero even where it cancels."""

    @cached_property
    def values(self) -> tuple[Form, ...]:
        """The targets. Raises OtherForm for a number in them that is not finite."""
        graph, values = self.column.learned.graph, dict[int, Form]()
        arithmetic = self._arithmetic
        for place in self.column.order:
            node = graph.nodes[place]
            arguments = [values[arg] for arg in node.args]
            if node.op == INPUT:
                values[place] = self._coordinate(self.column.learned.places[node.which])
            elif node.op == CONSTANT:
                try:
                    values[place] = number(node.value)
                except (ValueError, OverflowError):
                    raise OtherForm(f"a number behind the plan of sample {self.column.k} is not finite") from None
            elif node.op == LOOKUP:
                lookup = graph.lookups[node.which]
                values[place] = arithmetic.lookup(graph.table_of(node), lookup, arguments)
            else:
                try:
                    values[place] = arithmetic.operations[node.op](*arguments)
                except ZeroDivisionError:
                    raise OtherForm(f"a zero divides behind the plan of sample {self.column.k}") from None
        return tuple(values[target] for target in self.column.targets)

    def _coordinate(self, place: Place) -> Form:
        learned, k = self.column.learned, self.column.k
        if place in learned.constants:
            return number(learned.constants[place])
        if place.port == "r":
            return total(self._coordinate(place._replace(port="y")), self._coordinate(place._replace(port="e")))
        if place.port == "reached":
            if not learned.varying_lengths or (self.reached and place.column <= k + 1):
                return number(1)
            if self.reached is False and place.column > k:
                return number(0)
        if self.reached is not None and place.port == "e" and place.column == k + 1:
            signal = self.variables.opaque(SIGNAL)
            return total(signal, self._coordinate(place._replace(column=k))) if learned.increment else signal
        return self.variables.opaque(place)

    @cached_property
    def signal(self) -> int:
        """The variable that is the error of what is learned on."""
        which = alone(self.variables.opaque(SIGNAL))
        assert which is not None, "a variable is one"
        return which

    def apart(self, form: Form, wanted: Callable[[Powers], bool]) -> Form:
        """Return a form with the conditions taken apart that stand in products that are not wanted."""
        for _ in range(ROUNDS):
            unwanted = [powers for powers in form.terms if not wanted(powers)]
            inner = next((found for powers in unwanted if (found := self._conditional(form, powers)) is not None), None)
            if inner is None:
                break
            form = replaced(form, *inner)
        return form

    def _conditional(self, form: Form, powers: Powers) -> tuple[int, Form] | None:
        """Return a value under a condition in a product, with what it is: a condition, 0 or 1, times a value."""
        for variable, _ in powers:
            op, arguments = self.variables.meant[variable]
            if op not in (SELECT, "if_else_zero"):
                continue
            if any(one == variable and power != 1 for every in form.terms for one, power in every):
                continue
            condition, value = arguments[0], arguments[1]
            otherwise = arguments[2] if op == SELECT else number(0)
            gap = total(value, negative(otherwise))
            return variable, total(otherwise, product(self._truth(condition), gap))
        return None

    def _truth(self, condition: Form) -> Form:
        """Return 1 where a condition holds, else 0."""
        which = alone(condition)
        if which is not None and self.variables.meant[which][0] in BOOLEAN:
            return condition
        return self.variables.opaque(TRUTH, condition)

    def without_signal(self, powers: Powers) -> bool:
        """Tell whether the error of what is learned on is no factor of a product."""
        return all(variable != self.signal or power < 1 for variable, power in powers)

    def divided(self, form: Form) -> Form:
        """Return a form, every product of which has the error of what is learned on as a factor, without it."""
        found: dict[Powers, Fraction] = {}
        for powers, coefficient in form.terms.items():
            rest = tuple((v, p - (v == self.signal)) for v, p in powers if (v, p) != (self.signal, 1))
            found[rest] = coefficient
        return Form(found)

    def words(self, form: Form) -> str:
        """Return the first product of a form in words."""
        powers, coefficient = next(iter(form.terms.items()))
        factors = [f"{float(coefficient):.4g}"]
        for variable, power in powers:
            factors.append(self._word(variable) + (f"^{power}" if power != 1 else ""))
        return " ".join(factors) + (" and more" if len(form.terms) > 1 else "")

    def _word(self, variable: int) -> str:
        op, arguments = self.variables.meant[variable]
        if isinstance(op, Place):
            return "e_s(k+1)" if op == SIGNAL else f"{op.port.removeprefix(MEMORY)}({op.column})"
        inner = sorted({v for one in arguments for powers in one.terms for v, _ in powers})
        names = [self._word(v) for v in inner[:3]]
        return f"{op}({', '.join(names)}{', ...' if len(inner) > 3 else ''})"[:80]

    @cached_property
    def _arithmetic(self) -> Arithmetic[Form]:
        """What operations mean: values under opposite conditions are one, squares stay, large products too."""
        base, opaque = self.variables.arithmetic, self.variables.opaque

        def times(a: Form, b: Form) -> Form:
            if len(a.terms) > 1 and a.key == b.key:
                return opaque("sq", a)
            if len(a.terms) * len(b.terms) > TERMS:
                return opaque("mul", a, b)
            return product(a, b)

        def inverse(a: Form) -> Form:
            self.divisors.append(a)
            return self.variables.inverse(a)

        def divided(a: Form, b: Form) -> Form:
            return times(a, inverse(b))

        def both(a: Form, b: Form) -> Form:
            return self._settled(a, b, 1) or base.operations["and"](a, b)

        def either(a: Form, b: Form) -> Form:
            return self._settled(a, b, 0) or base.operations["or"](a, b)

        def power(a: Form, exponent: Form) -> Form:
            whole = exponent.constant
            if whole == 2:
                return times(a, a)
            return opaque("pow", a, exponent) if len(a.terms) > 1 else base.operations["pow"](a, exponent)

        own: dict[str, Callable[..., Form]] = {
            "add": self._sum,
            "mul": times,
            "sq": lambda a: times(a, a),
            "div": divided,
            "inv": inverse,
            "pow": power,
            "constpow": power,
            "and": both,
            "or": either,
        }
        return Arithmetic(
            operations=MappingProxyType({op: own.get(op) or base.operations[op] for op in OPERATIONS}),
            constant=base.constant,
            lookup=base.lookup,
        )

    def _settled(self, a: Form, b: Form, neutral: int) -> Form | None:
        """Return "and" (neutral 1) or "or" (neutral 0) of two conditions of which one is known, or None."""
        for one, other in ((a, b), (b, a)):
            known = one.constant
            if known is not None:
                whole = other.constant
                rest = self._truth(other) if whole is None else number(bool(whole))
                return rest if bool(known) == bool(neutral) else number(1 - neutral)
        return None

    def _sum(self, a: Form, b: Form) -> Form:
        first, second = self._guard(a), self._guard(b)
        if first is not None and second is not None:
            (c, value), (d, other) = first, second
            if self._negates(d, c):
                return self.variables.opaque(SELECT, c, value, other)
            if self._negates(c, d):
                return self.variables.opaque(SELECT, d, other, value)
        return total(a, b)

    def _guard(self, form: Form) -> tuple[Form, Form] | None:
        which = alone(form)
        if which is None or self.variables.meant[which][0] != "if_else_zero":
            return None
        condition, value = self.variables.meant[which][1]
        return condition, value

    def _negates(self, d: Form, c: Form) -> bool:
        """Tell whether d is not c."""
        which = alone(d)
        if which is None:
            return False
        op, arguments = self.variables.meant[which]
        return op == "not" and arguments[0].key == c.key


def ranges(forms: Forms, between: Callable[[str], tuple[float, float]]) -> Ranges:
    """Return the ranges of a column's forms; ``between`` gives that of a field of the memory."""
    ages: Mapping[str, tuple[str, int]] = forms.column.learned.ages
    free = float("-inf"), float("inf")

    def coordinate(place: object) -> tuple[float, float]:
        assert isinstance(place, Place), "what is no operation is a coordinate"
        if place.port == "reached" or ages.get(place.port, ("", 0))[0] == "reached":
            return 0.0, 1.0
        return between(place.port) if place.port in forms.column.learned.memory else free

    return Ranges(forms.variables, coordinate)
