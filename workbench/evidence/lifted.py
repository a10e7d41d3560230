"""The lifted system: a whole trial's inputs mapped to its outputs, in memory linear in the samples.

G maps input differences (u(0), ..., u(m-1)) to differences of the learned signal (s(d), ..., s(N)), m = N - d + 1,
d the relative degree; s is y, or its increment y(k) - y(k-1). G is lower triangular and is never formed: products
go through the banded system that the linearised plant is.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse
from scipy.sparse import linalg

from models.array import Array
from workbench.evidence.trajectory import Linearisation, partial

VECTORS = 60  # kept by the iteration: singular values that lie close together need many
SMALLEST = 4  # rows, below which there is nothing to iterate on
Product = Callable[[Array], Array]
"""A linear operator by its products."""


class SingularValue(NamedTuple):
    """The largest singular value of an operator, with what is known about its error."""

    value: float
    """Rayleigh quotient of ``vector``, below the true value up to rounding."""
    residual: float
    """Some singular value lies within this distance of ``value``."""
    upper: float
    """The true largest singular value lies below this."""
    vector: Array
    """The input that is amplified by ``value``."""


class Lifted:
    """G along one trajectory. ``increment`` takes the signal y(k) - y(k-1) in place of y(k)."""

    def __init__(self, line: Linearisation, degree: int = 1, *, increment: bool = False) -> None:
        self.line, self.degree, self.increment = line, degree, increment
        n, nx = line.b.shape
        self.size = n - degree + 1
        rows, columns, values = [], [], []
        steps = np.arange(n)
        for i in range(nx):
            for j in range(nx):
                rows.append((steps + 1) * nx + i)
                columns.append(steps * nx + j)
                values.append(-line.a[:, i, j])
        identity = np.arange((n + 1) * nx)
        dynamics = sparse.csc_matrix(
            (
                np.concatenate([*values, np.ones(identity.size)]),
                (np.concatenate([*rows, identity]), np.concatenate([*columns, identity])),
            )
        )
        # its stub knows no transposed solution
        self._solver: Any = linalg.splu(
            dynamics, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": False}
        )
        at = np.repeat(np.arange(n), nx)
        self._b = sparse.csr_matrix((line.b.ravel(), (np.arange(nx, (n + 1) * nx), at)), shape=((n + 1) * nx, n))
        ends = np.repeat(np.arange(n + 1), nx)
        outputs = sparse.csr_matrix((line.c.ravel(), (ends, np.arange((n + 1) * nx))), shape=(n + 1, (n + 1) * nx))
        if increment:
            outputs = outputs[1:] - outputs[:-1]
            outputs = sparse.vstack([sparse.csr_matrix((1, (n + 1) * nx)), outputs])
        self._c = sparse.csr_matrix(outputs)

    def apply(self, du: Array) -> Array:
        """Return G du, (m,), for du (m,)."""
        full = np.zeros(self.line.b.shape[0])
        full[: self.size] = du
        return np.asarray((self._c @ self._solver.solve(self._b @ full))[self.degree :])

    def adjoint(self, ds: Array) -> Array:
        """Return G' ds, (m,), for ds (m,)."""
        full = np.zeros(self.line.b.shape[0] + 1)
        full[self.degree :] = ds
        return np.asarray((self._b.T @ self._solver.solve(self._c.T @ full, trans="T"))[: self.size])

    def diagonal(self) -> Array:
        """Return the diagonal of G: the exact partial derivative ds(k+d)/du(k), (m,)."""
        return partial(self.line, self.degree)

    def row_sums(self) -> tuple[Array, Array]:
        """Return for every row of |G| its sum without the diagonal, and its diagonal entry, each (m,).

        Time grows with the square of the samples, memory linearly: the columns are carried along the trajectory.
        """
        n, nx = self.line.b.shape
        reach = np.zeros((nx, n))
        rows = np.zeros(n + 1)
        diagonal = np.zeros(n + 1)
        for k in range(n):
            before = self.line.c[k] @ reach[:, :k] if self.increment else 0.0
            reach[:, :k] = self.line.a[k] @ reach[:, :k]
            reach[:, k] = self.line.b[k]
            entries = self.line.c[k + 1] @ reach[:, : k + 1]
            if self.increment:
                entries[:k] -= before
            own = k + 1 - self.degree
            if own >= 0:
                diagonal[k + 1] = abs(entries[own])
                rows[k + 1] = np.abs(entries[: own + 1]).sum() - diagonal[k + 1]
        return rows[self.degree :], diagonal[self.degree :]


def largest_singular_value(
    apply: Product, adjoint: Product, size: int, upper: float, *, seed: int = 0, tolerance: float = 1e-6
) -> SingularValue:
    """Return the largest singular value of a (size, size) operator by Lanczos iteration on its products.

    ``upper`` is a bound known otherwise, e.g. sqrt(largest row sum * largest column sum).
    """
    if size < SMALLEST:
        vector = np.linalg.svd(np.array([apply(one) for one in np.eye(size)]).T)[2][0]
    else:
        square = linalg.LinearOperator((size, size), matvec=lambda v: adjoint(apply(np.ravel(v))), dtype=float)
        start = np.random.default_rng(seed).standard_normal(size)
        _, right = linalg.eigsh(square, k=1, v0=start, ncv=min(size, VECTORS), tol=tolerance, which="LA")
        vector = right[:, 0] / np.linalg.norm(right[:, 0])
    image = apply(vector)
    value = float(np.linalg.norm(image))
    residual = float(np.linalg.norm(adjoint(image) - value**2 * vector)) / value if value else 0.0
    return SingularValue(value, residual, upper, vector)
