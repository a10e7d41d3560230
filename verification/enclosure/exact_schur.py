"""Is a matrix Schur? Proved in exact arithmetic: floats are rationals, a Lyapunov inequality is decided on them."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

Rows = list[list[Fraction]]


Row = Sequence[float]
Matrix = Sequence[Row]

SHARES = (Fraction(99, 100), Fraction(1, 2), Fraction(1, 100))
"""Which share of the distance from the estimated radius to 1 is tried to be proved, the largest first."""


def closed_loop(A: Matrix, b: Row, K: Row) -> Rows:
    """Return A + b K exactly, for float arrays A (n, n), b (n,), K (n,)."""
    n = len(b)
    return [[Fraction(A[i][j]) + Fraction(b[i]) * Fraction(K[j]) for j in range(n)] for i in range(n)]


class Contraction(NamedTuple):
    """A number r below 1 and a norm P > 0 with r^2 P - M'P M > 0: eigenvalues of M are smaller than r in modulus."""

    radius: Fraction
    norm: Rows


def contraction(M: Rows) -> Contraction | None:
    """Return how M is proved to contract, or None, which says that no proof was found, not that M is unstable."""
    radius = _estimated_radius(M)
    if not radius < 1:
        return None
    for share in SHARES:
        bound = 1 - share * (1 - Fraction(radius))
        norm = proved_norm([[entry / bound for entry in row] for row in M])
        if norm is not None:
            return Contraction(bound, norm)
    return None


def proved_radius(M: Rows) -> Fraction | None:
    """Return a number below 1 that every eigenvalue of M is proved to be smaller than in modulus, or None."""
    found = contraction(M)
    return None if found is None else found.radius


def proved_schur(M: Rows) -> bool:
    """Tell whether every eigenvalue of M is proved to have modulus below 1; False proves nothing."""
    return proved_norm(M) is not None


def proved_norm(M: Rows) -> Rows | None:
    """Return P for which P > 0 and P - M'P M > 0 hold exactly: then every eigenvalue of M has modulus below 1.

    P is found in floating point and symmetrised; None says that this P proves nothing, not that M is unstable.
    """
    if not _estimated_radius(M) < 1:
        return None
    try:
        found = np.asarray(solve_discrete_lyapunov(_floats(M).T, np.eye(len(M))))
    except np.linalg.LinAlgError:
        return None
    if not np.isfinite(found).all():
        return None
    norm = [[Fraction(found[min(i, j), max(i, j)]) for j in range(len(M))] for i in range(len(M))]
    return norm if certifies(norm, M) else None


def certifies(P: Rows, M: Rows) -> bool:
    """Tell whether a symmetric P shows that M is Schur: P > 0 and P - M'P M > 0, both exactly."""
    PM = _product(P, M)
    less = [
        [P[i][j] - _dot([row[i] for row in M], [row[j] for row in PM]) for j in range(len(M))] for i in range(len(M))
    ]
    return _positive_definite(P) and _positive_definite(less)


def _floats(M: Rows) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    return np.array([[float(entry) for entry in row] for row in M]).reshape(len(M), len(M))


def _estimated_radius(M: Rows) -> float:
    floats = _floats(M)
    return float(np.abs(np.linalg.eigvals(floats)).max()) if np.isfinite(floats).all() else np.inf


def _product(first: Rows, second: Rows) -> Rows:
    columns = list(zip(*second, strict=True))
    return [[_dot(row, column) for column in columns] for row in first]


def _dot(first: Sequence[Fraction], second: Sequence[Fraction]) -> Fraction:
    return sum((a * b for a, b in zip(first, second, strict=True)), Fraction(0))


def _positive_definite(matrix: Rows) -> bool:
    """Tell whether a symmetric matrix is positive definite: every pivot of its elimination is positive."""
    rows = [list(row) for row in matrix]
    for i in range(len(rows)):
        if rows[i][i] <= 0:
            return False
        for j in range(i + 1, len(rows)):
            factor = rows[j][i] / rows[i][i]
            rows[j] = [a - factor * c for a, c in zip(rows[j], rows[i], strict=True)]
    return True
