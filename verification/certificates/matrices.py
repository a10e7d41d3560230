"""Matrices and formulas of them, as certificates hold them: doubles are taken as the rationals that they are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

from flint import fmpq

from verification.certificates.numbers import Number, written
from workbench.contracts.certificate import Json

Formula: TypeAlias = "str | tuple[str, Formula, Formula | int]"
"""A matrix's name, ``(op, a, b)`` with one of + - * ' (a' b), or ``("^", a, power)``."""
Matrix = Sequence[Sequence[Number]]


def rational(matrix: Matrix) -> list[list[fmpq]]:
    """Return a matrix in rationals."""
    return [[fmpq(*one.as_integer_ratio()) for one in line] for line in matrix]


def lines_of(matrix: Matrix) -> list[list[str]]:
    """Return a matrix as a certificate holds it."""
    return [[written(one) for one in line] for line in matrix]


def formula_of(formula: Formula | int) -> Json:
    """Return a formula as a certificate holds it."""
    return formula if isinstance(formula, (str, int)) else [formula[0], *map(formula_of, formula[1:])]
