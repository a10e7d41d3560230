"""The signal that a law learns on, as a linear map of the output's error."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from models.array import Array
from workbench.evidence.closed_loop import Matrix


class Signal:
    """The learned signal (s(first), ..., s(N)) of an error e(0), ..., e(N): e itself, or e(k) - e(k-1)."""

    def __init__(self, samples: int, first: int, *, increment: bool) -> None:
        self.first, self.increment, self.size = first, increment, samples + 1 - first
        whole = sparse.eye_array(samples + 1, format="csr")
        if increment:
            whole = whole - sparse.eye_array(samples + 1, k=-1, format="csr")
        self.of: Matrix = sparse.csr_array(sparse.csr_array(whole)[first:])

    def error(self, signal: Array, before: Array) -> Array:
        """Return the error (N + 1,) with a signal, and with the samples before it as they are given."""
        rest = np.cumsum(signal) if self.increment else signal
        if self.increment and self.first:
            rest = rest + before[self.first - 1]
        return np.concatenate([before[: self.first], rest])

    def slope(self, by_error: Matrix) -> Matrix:
        """Return the derivative by the signal of what has the derivative ``by_error``, (p, N + 1), by the error.

        For increments, errors are running sums of the signal, so a column is the sum of those from it on, which a law
        that learns on increments leaves banded.
        """
        if not self.increment:
            return sparse.csr_array(by_error[:, self.first :])
        return sparse.csr_array(_tails(sparse.csr_array(by_error))[:, self.first :])


def _tails(matrix: Matrix) -> Matrix:
    """Return the matrix whose column j is the sum of the columns from j on; what cancels is left out."""
    matrix.sort_indices()
    least = 1e-9 * float(np.abs(matrix.data).max(initial=0.0))
    columns, values, ends = [np.zeros(0, dtype=int)], [np.zeros(0)], [0]
    for begin, end in zip(matrix.indptr[:-1], matrix.indptr[1:], strict=True):
        stored = matrix.indices[begin:end]
        sums = np.cumsum(matrix.data[begin:end][::-1])[::-1]
        widths = np.diff(stored, prepend=-1)
        filled = np.repeat(np.where(np.abs(sums) > least, sums, 0.0), widths)
        some = np.flatnonzero(filled)
        columns.append(some)
        values.append(filled[some])
        ends.append(ends[-1] + some.size)
    return sparse.csr_array((np.concatenate(values), np.concatenate(columns), ends), shape=matrix.shape)
