"""Is a matrix Schur? Proved in exact arithmetic: floats are rationals, a Lyapunov inequality is decided on them."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

Rows = list[list[Fraction]]


Row = Sequence[float]
Matrix = Sequence[Row]


def closed_loop(A: Matrix, b: Row, K: Row) -> Rows:
    """Return A + b K exactly, for float arrays A (n, n), b (n,), K (n,)."""
    n = len(b)
    return [[Fraction(A[i][j]) + Fraction(b[i]) * Fraction(K[j]) for j in range(n)] for i in range(n)]


def proved_schur(M: Rows) -> bool:
    """Tell whether P > 0 and P - M'P M > 0 hold exactly for some P: then every eigenvalue of M has modulus below 1.

    P is found in floating point and symmetrised; False says that this P proves nothing, not that M is unstable.
    """
    floats = np.array([[float(entry) for entry in row] for row in M])
    if np.abs(np.linalg.eigvals(floats)).max() >= 1:
        return False
    found = np.asarray(solve_discrete_lyapunov(floats.T, np.eye(len(M))))
    P = [[Fraction(found[min(i, j), max(i, j)]) for j in range(len(M))] for i in range(len(M))]
    PM = _product(P, M)
    less = [
        [P[i][j] - _dot([row[i] for row in M], [row[j] for row in PM]) for j in range(len(M))] for i in range(len(M))
    ]
    return _positive_definite(P) and _positive_definite(less)


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
