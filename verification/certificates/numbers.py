"""Certificates of what the study's own settings say: numbers with names, and relations between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import TypeAlias

import numpy as np

from workbench.contracts.certificate import Certificate, Json

Number: TypeAlias = "int | float | Fraction"
Formula: TypeAlias = "Number | str | Sequence[Formula]"
"""A number, a fact's name, or ``(operation, a, b)`` with one of + - * / min max."""
Relation = tuple[str, Formula, Formula]
"""``(sign, left, right)`` with one of < <= = > >=."""


Facts = Mapping[str, tuple[Number, str]]
"""Numbers by name, each with its unit."""


def numbers(says: str, facts: Facts, *holds: Relation) -> Certificate:
    """Return the certificate of relations between facts, each a number with its unit."""
    return Certificate(
        kind="numbers",
        statement={
            "says": says,
            "facts": {name: [written(number), unit] for name, (number, unit) in facts.items()},
            "holds": [[sign, _formula(left), _formula(right)] for sign, left, right in holds],
        },
    )


def written(number: Number) -> str:
    """Return a number as certificates hold it, exactly."""
    if isinstance(number, Fraction):
        return f"{number.numerator}/{number.denominator}" if number.denominator > 1 else str(number.numerator)
    return str(int(number)) if isinstance(number, (int, np.integer)) else float(number).hex()


def _formula(formula: Formula) -> Json:
    if isinstance(formula, str):
        return formula
    if isinstance(formula, (int, float, Fraction, np.number)):
        return written(formula)
    op, a, b = formula
    return [str(op), _formula(a), _formula(b)]
