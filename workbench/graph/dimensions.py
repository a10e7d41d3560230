"""Dimensions as an arithmetic over the graph: what a node's value is measured in, and where two do not agree.

Signals and quantities carry a dimension; bare numbers are free: they have whatever dimension is wanted of them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from fractions import Fraction
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

from workbench.graph.graph import Graph
from workbench.graph.operations import BOOLEAN, CONSTANT, INPUT, LOOKUP

if TYPE_CHECKING:
    from pint import UnitRegistry

Powers = tuple[tuple[str, Fraction], ...]
"""Exponents of base dimensions, by name in alphabetical order; () is a pure number."""
ALIKE = {"add", "sub", "fmin", "fmax", "fmod", "remainder", "hypot", "lt", "le", "eq", "ne", "atan2"}
"""Operations on two values of one dimension."""
KEPT = {"assign", "neg", "twice", "fabs", "floor", "ceil", "copysign"}
PURE = {"exp", "expm1", "log", "log1p", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh"}
PURE |= {"asinh", "acosh", "atanh", "erf", "erfinv"}
"""Operations on pure numbers, whose value is one."""


class Dimension(NamedTuple):
    """What a value is measured in."""

    powers: Powers | None
    """None where it is free."""
    number: float | None = None
    """The value of a bare number."""


FREE = Dimension(None)
NUMBER = Dimension(())


class Mismatch(NamedTuple):
    """A node whose arguments do not agree."""

    node: int
    reason: str


@cache
def parsed(unit: str) -> Powers | None:
    """Return the dimension of a unit, e.g. ``N s/m`` or ``(m/s)^2``; None for words that are no unit."""
    text = _in_python(unit)
    if text in ("", "1"):
        return () if text else None
    try:
        found = _registry().parse_units(text).dimensionality
    except Exception:  # words of all kinds: whatever the library makes of them, they are no unit
        return None
    return _sorted({name: Fraction(str(power)).limit_denominator(1000) for name, power in found.items()})


@cache
def how_many(unit: str, of: str) -> float | None:
    """Return how many of a unit make one of another, 60 for ``1/min`` of ``1/s``; None where that means nothing."""
    if unit == of:
        return 1.0
    try:
        one = _registry().Quantity(1.0, _in_python(of)).to(_in_python(unit)).magnitude
    except Exception:  # words of all kinds, as above, and units of another dimension
        return None
    return float(f"{one:.15g}")  # 15 digits are exact where the units are decimals of each other


@cache
def _registry() -> UnitRegistry[float]:
    from pint import UnitRegistry  # loading it takes as long as all the rest

    return UnitRegistry()


def _in_python(unit: str) -> str:
    """Return a unit with its powers and products written out: ``N s^2/m`` is ``N*s**2/m``."""
    text = unit.replace("^", "**").replace("²", "**2").replace("³", "**3").strip()
    return re.sub(r"(?<=[\w)])\s+(?=[\w(])", "*", text)


def _sorted(powers: Mapping[str, Fraction]) -> Powers:
    return tuple(sorted((name, power) for name, power in powers.items() if power))


def _product(a: Powers, b: Powers, sign: int = 1) -> Powers:
    powers = dict(a)
    for name, power in b:
        powers[name] = powers.get(name, Fraction(0)) + sign * power
    return _sorted(powers)


def _power(a: Powers, exponent: Fraction) -> Powers:
    return _sorted({name: power * exponent for name, power in a})


def words(powers: Powers | None) -> str:
    """Return a dimension in words, e.g. ``length/time^2``."""
    if powers is None:
        return "free"
    above = [_factor(name, power) for name, power in powers if power > 0]
    below = [_factor(name, -power) for name, power in powers if power < 0]
    return ("*".join(above) or "1") + "".join(f"/{one}" for one in below)


def _factor(name: str, power: Fraction) -> str:
    plain = name.strip("[]")
    return plain if power == 1 else f"{plain}^{power}"


def dimensions(graph: Graph, coordinates: Sequence[Powers | None]) -> tuple[list[Dimension], list[Mismatch]]:
    """Return the dimension of every node, given those of the inputs' coordinates, and where arguments do not agree.

    What does not agree is free from there on, so that one slip is told once.
    """
    found: list[Dimension] = []
    wrong: list[Mismatch] = []
    for place, node in enumerate(graph.nodes):
        if node.op == INPUT:
            found.append(Dimension(coordinates[node.which]))
        elif node.op == CONSTANT:
            found.append(Dimension(None, node.value))
        elif node.op == LOOKUP:
            found.append(FREE)
        else:
            made = _operation(node.op, [found[arg] for arg in node.args])
            if isinstance(made, str):
                wrong.append(Mismatch(place, f"{graph.describe(place)}: {made}"))
            found.append(FREE if isinstance(made, str) else made)
    return found, wrong


def _operation(op: str, args: Sequence[Dimension]) -> Dimension | str:
    """Return the dimension of an operation's value, or why its arguments do not agree."""
    powers = [arg.powers for arg in args]
    first = powers[0]
    if op in ALIKE:
        known = [one for one in powers if one is not None]
        if len(set(known)) > 1:
            return f"{words(known[0])} and {words(known[1])} do not agree"
        if op in BOOLEAN or op == "atan2":
            return NUMBER
        return Dimension(known[0]) if known else FREE
    if op in KEPT:
        return Dimension(first)
    if op in PURE:
        return f"{op} takes a pure number, got {words(first)}" if first else NUMBER
    if op in BOOLEAN or op == "sign":
        return NUMBER
    if op == "if_else_zero":
        return Dimension(powers[1])
    if op in ("pow", "constpow") and powers[1]:
        return f"an exponent must be a pure number, got {words(powers[1])}"
    if first is None or (len(powers) > 1 and op in ("mul", "div") and powers[1] is None):
        return FREE
    if op in ("mul", "div"):
        return Dimension(_product(first, powers[1] or (), 1 if op == "mul" else -1))
    if op in ("inv", "sq", "sqrt"):
        return Dimension(_power(first, {"inv": Fraction(-1), "sq": Fraction(2), "sqrt": Fraction(1, 2)}[op]))
    return _raised(first, args[1])


def _raised(base: Powers, exponent: Dimension) -> Dimension:
    if exponent.number is not None:
        return Dimension(_power(base, Fraction(exponent.number).limit_denominator(1000)))
    return NUMBER if base == () else FREE
