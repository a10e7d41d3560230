"""Which matrices are proved to be Schur: those inside the unit circle, and none with an eigenvalue on or beyond it."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from verification.enclosure.exact_schur import certifies, closed_loop, proved_radius, proved_schur

HALF, ONE = Fraction(1, 2), Fraction(1)
SHEAR = [[ONE, ONE], [Fraction(0), ONE]]


def of_radius(radius: float, n: int, seed: int) -> list[list[Fraction]]:
    """Return a full matrix with this spectral radius, but for rounding."""
    rng = np.random.default_rng(seed)
    matrix = rng.standard_normal((n, n))
    matrix *= radius / np.abs(np.linalg.eigvals(matrix)).max()
    return [[Fraction(entry) for entry in row] for row in matrix.tolist()]


@pytest.mark.parametrize("n", [1, 2, 4, 6])
@pytest.mark.parametrize(("radius", "schur"), [(0.3, True), (0.9, True), (0.999, True), (1.001, False), (3.0, False)])
def test_a_matrix_is_proved_by_its_radius(n, radius, schur):
    for seed in range(5):
        matrix = of_radius(radius, n, seed)
        assert proved_schur(matrix) is schur
        found = proved_radius(matrix)
        assert (found is not None) is schur
        assert found is None or radius * (1 - 1e-9) < found < 1


@pytest.mark.parametrize("matrix", [[[ONE]], [[-ONE]], [[Fraction(2)]], SHEAR], ids=str)
def test_nothing_certifies_what_is_not_inside(matrix):
    rng, n = np.random.default_rng(0), len(matrix)
    for _ in range(50):
        root = rng.standard_normal((n, n))
        P = [[Fraction(entry) for entry in row] for row in (root @ root.T + 1e-3 * np.eye(n)).tolist()]
        assert not certifies([[P[min(i, j)][max(i, j)] for j in range(n)] for i in range(n)], matrix)


def test_no_certificate_is_that_is_not_positive():
    for P in ([[-ONE]], [[Fraction(0)]]):
        assert not certifies(P, [[HALF]])
    assert certifies([[ONE]], [[HALF]])


def test_a_closed_loop_is_exact():
    assert closed_loop([[0.1, 1.0], [0.0, 0.3]], [0.0, 0.7], [0.2, -0.5]) == [
        [Fraction(0.1), 1],
        [Fraction(0.7) * Fraction(0.2), Fraction(0.3) - Fraction(0.7) * HALF],
    ]
