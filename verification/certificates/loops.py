"""Certificates of linear loops: matrices that are positive definite, each made of others by a formula."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction

from flint import fmpq_mat

from verification.certificates.matrices import Formula, Matrix, formula_of, lines_of, rational
from verification.certificates.numbers import Number
from verification.checker.matrices import formula, is_positive
from workbench.contracts.certificate import Certificate
from workbench.contracts.claim import NotCertified


def definite(says: str, matrices: Mapping[str, Matrix], positive: Sequence[Formula]) -> Certificate:
    """Return the certificate that matrices are symmetric and positive definite. Raises NotCertified where not."""
    given = {name: fmpq_mat(rational(one)) for name, one in matrices.items()}
    for one in positive:
        value, words = formula(formula_of(one), given)
        if value.nrows() != value.ncols() or not is_positive(value):
            raise NotCertified(f"{words} is not positive definite")
    return Certificate(
        kind="definite",
        statement={
            "says": says,
            "matrices": {name: lines_of(one) for name, one in matrices.items()},
            "positive": [formula_of(one) for one in positive],
        },
    )


def contracting(
    says: str, matrices: Mapping[str, Matrix], loop: Formula, radius: Fraction, norm: Matrix
) -> Certificate:
    """Return the certificate that every eigenvalue of a loop is smaller than a radius in modulus.

    It is so where r'P r - M'P M is positive definite, P (``norm``) being so and r the radius times the unit matrix.
    """
    size = len(norm)
    scaled: list[list[Number]] = [[radius if i == j else 0 for j in range(size)] for i in range(size)]
    falls: Formula = ("-", ("'", "r", ("*", "P", "r")), ("'", loop, ("*", "P", loop)))
    return definite(says, {**matrices, "P": norm, "r": scaled}, ["P", falls])
