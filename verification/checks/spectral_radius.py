"""Between which two numbers the spectral radius of a full matrix lies, by squaring it again and again.

For every k the radius lies below ||T^k||^(1/k), in any norm, and above (|trace T^k| / n)^(1/k). Rounding is carried
along as a bound in the Frobenius norm: where it has eaten what the powers say, the two numbers stay as they were.
Eigenvalues are not asked for: those of a matrix that is far from normal, as maps between trials are, can be wrong in
the first digit without a sign of it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from models.array import Array

SQUARINGS = 40  # T^(2^40) tells a radius of 1 - 1e-9 from 1
SHARPER = 8  # further squarings once it is settled on which side of 1 the radius lies


class Radius(NamedTuple):
    """A spectral radius lies between the two, the rounding of the matrix itself aside."""

    low: float
    high: float


def spectral_radius(matrix: Array) -> Radius:
    """Return what bounds the spectral radius of a square matrix; (0, inf) for one that is not finite."""
    n = len(matrix)
    power, log, k = np.array(matrix, dtype=float), 0.0, 1
    if not np.isfinite(power).all():
        return Radius(0.0, np.inf)
    error, low, high, settled = 0.0, 0.0, np.inf, 0
    for _ in range(SQUARINGS):
        size = float(np.linalg.norm(power))
        high = min(high, _root(size + error, log, k))
        low = max(low, _root((abs(float(np.trace(power))) - np.sqrt(n) * error) / n, log, k))
        settled += high < 1 or low > 1
        if error >= size or settled > SHARPER or high - low < 1e-12:
            break
        power, error, log = power / size, error / size, log + np.log(size)
        power, error = power @ power, 2 * error + error**2 + n * 2.0**-52
        log, k = 2 * log, 2 * k
    return Radius(low, high)


def _root(value: float, log: float, k: int) -> float:
    """Return (value e^log)^(1/k), 0 for a value that is not above 0, infinite where that is what it comes to."""
    if value <= 0:
        return 0.0
    exponent = (np.log(value) + log) / k
    return float(np.exp(exponent)) if exponent < 700 else float(np.inf)
