"""Scales, all powers of two, under which the numbers of a problem are alike whatever units it came in.

A scaling by powers of two is exact, so nothing is lost by it. The scales are least squares of logarithms, as Curtis and
Reid proposed ("On the automatic scaling of matrices for Gaussian elimination", J. Inst. Maths Applics 10, 1972): that
minimum follows every change of units, where norms of rows and columns in turn need not.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from workbench.sets.array import Array

RIDGE = 1e-10
"""What fixes the parts that no entry ties together, relative to the equations: too weak to move those that are tied."""

FAINT = 1e-4
"""What a faint row weighs: far more than what fixes the rest, far less than the others."""

LARGEST_EXPONENT = 400.0
"""Scales stay within 2^+-400, so that the product of two is still a number."""


class Scales(NamedTuple):
    """Powers of two: rows_i M_ij columns_j has entries near one, the largest of each row between 1/2 and 1."""

    rows: Array
    columns: Array


def powers_of_two(exponents: Array) -> Array:
    """2 to the nearest whole of each exponent."""
    scales: Array = np.exp2(np.rint(np.clip(exponents, -LARGEST_EXPONENT, LARGEST_EXPONENT)))
    return scales


def balanced(matrix: Array, *, beside: Array | None = None, faint: Array | None = None) -> Scales:
    """Scales for the rows and columns of `matrix`, shape (m, p).

    Parameters
    ----------
    matrix
        Finite; zeros have no say.
    beside
        One more column, shape (m,), that has a say in the scales of the others: the right-hand side of an inequality,
        which tells the size of a variable that nothing else ties to the rest.
    faint
        One more row, shape (p,), that has a say only in what the others leave open: a cost.
    """
    m, p = matrix.shape
    size = np.zeros((m + 1, p + 1))
    size[:m, :p] = np.abs(matrix)
    if beside is not None:
        size[:m, p] = np.abs(beside)
    if faint is not None:
        size[m, :p] = np.abs(faint)
    known = size > 0
    logs = np.log2(size, out=np.zeros_like(size), where=known)
    weights = known.astype(np.float64)
    weights[m] *= FAINT
    per_row = weights.sum(axis=1)
    per_row[per_row == 0] = 1.0
    # the rows eliminated: of r_i = -mean over j of (log + c_j) remain as many equations as there are columns
    shares = weights / per_row[:, None]
    equations = -weights.T @ shares
    equations[np.diag_indices_from(equations)] += weights.sum(axis=0) + RIDGE * (m + 1)
    pulled = weights * logs
    columns = np.linalg.solve(equations, shares.T @ pulled.sum(axis=1) - pulled.sum(axis=0))
    columns = np.rint(columns)[:p]
    inner = np.where(known, logs, -np.inf)[:m, :p] + columns
    top = np.max(inner, axis=1, initial=-np.inf)
    rows = -np.ceil(np.where(np.isfinite(top), top, 0.0))
    return Scales(rows=powers_of_two(rows), columns=powers_of_two(columns))


def state_units(A: Array, *columns: Array) -> Array:
    """Units, shape (n,), in which the states of x+ = A x + b u + ... are alike: take x_i / units_i as the state.

    Parameters
    ----------
    A
        Shape (n, n); its diagonal has no unit and no say.
    columns
        What else tells the units of the states, each of shape (n,) up to a factor: b, half-widths of a disturbance.
    """
    n = len(A)
    coupling = np.abs(A) * ~np.eye(n, dtype=bool)
    unknowns = n + len(columns)
    equations, targets = RIDGE * np.eye(unknowns), np.zeros(unknowns)

    def alike(i: int, j: int, log: float) -> None:  # units_i - units_j = log
        equations[i, i] += 1.0
        equations[j, j] += 1.0
        equations[i, j] -= 1.0
        equations[j, i] -= 1.0
        targets[i] += log
        targets[j] -= log

    for i, j in np.argwhere(coupling > 0):
        alike(int(i), int(j), float(np.log2(coupling[i, j])))
    for index, column in enumerate(columns):
        for i in np.flatnonzero(column):
            alike(int(i), n + index, float(np.log2(abs(column[i]))))
    return powers_of_two(np.asarray(np.linalg.solve(equations, targets)[:n], dtype=np.float64))
