"""The Lyapunov function of periodic adaptive learning: its decrease over a period, as algebra and as measured.

V = S^2/2 + integral over one period of (d - d_hat)^2 / (2 k M), k = gamma M.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import product

import numpy as np

from models.array import Array
from workbench.contracts.verdict import Finding, Standing, undecided

GRID = tuple(Fraction(n, 7) for n in (1, 3, 4, 10))
"""Values for every variable: one more than the largest degree (3) of the identity in any of them."""


def rate(S: Fraction, phi: Fraction, alpha: Fraction, gamma: Fraction, mass: Fraction) -> Fraction:
    """Return dV/dt with phi = d - d_hat, where d is periodic and S' = -alpha S - phi/M."""
    k = gamma * mass
    before = phi - k * S  # d - d_hat(t - P)
    return S * (-alpha * S - phi / mass) + (phi**2 - before**2) / (2 * k * mass)


def identity(alpha: float, gamma: float, factor: float = 0.5) -> Finding:
    """Prove that dV/dt is -(alpha + factor gamma) S^2, or find where it is not.

    Times 2 k M both sides are polynomials, of degree at most 3 in every variable: two such polynomials that agree on a
    grid of four values a variable are the same. The arithmetic is rational, hence exact. factor is 1/2 in the exact
    identity and 0 in the paper's.
    """
    share = Fraction(factor)
    for S, phi, a, g, M in product(GRID, repeat=5):
        gap = rate(S, phi, a, g, M) + (a + share * g) * S**2
        if gap != 0:
            place = {"S": S, "phi": phi, "alpha": a, "gamma": g, "M": M, "gap": gap}
            return Finding(
                standing=Standing.REFUTED,
                method="exact rational arithmetic; the true decrease is -(alpha + gamma/2) S^2",
                margin=-abs((float(share) - 0.5) * gamma / (alpha + float(share) * gamma)),
                unit="share of the decrease",
                witness={name: float(value) for name, value in place.items()},
            )
    return Finding(
        standing=Standing.PROVED,
        method="a polynomial identity, checked in rational arithmetic on a grid finer than its degrees",
        margin=alpha + float(share) * gamma,
        unit="1/s",
    )


def decrease(
    S: Array, d: Array, d_hat: Array, step: float, alpha: float, gamma: float, mass: float
) -> tuple[Array, Array]:
    """Return the measured change of V from each period to the next, and the predicted one; shape (periods - 1,).

    S has shape (periods, N + 1), d and d_hat (periods, N), in m/s and N; step is the sampling time in s.
    """
    stored = ((d - d_hat) ** 2).sum(axis=1) * step / (2 * gamma * mass**2)
    V = S[:, -1] ** 2 / 2 + stored
    predicted = -(alpha + gamma / 2) * (S[:, :-1] ** 2).sum(axis=1) * step
    return np.diff(V), predicted[1:]


def measured(changes: Array, predicted: Array) -> Finding:
    """Judge the measured changes of V, none of which may be a rise, and tell how far from the identity they are."""
    if changes.size == 0 or not np.isfinite(changes).all():
        return undecided("fewer than two whole periods were recorded")
    deviation = np.abs(changes / predicted - 1)
    worst = int(np.argmax(changes / np.abs(predicted)))
    falls = bool((changes < 0).all())
    return Finding(
        standing=Standing.SUPPORTED if falls else Standing.REFUTED,
        method="V of every period of the run; the exact identity, which takes d to be periodic, is met within "
        f"{100 * deviation[0]:.2g} % in period 2 and {100 * deviation.max():.2g} % at worst",
        margin=float(-changes[worst] / np.abs(predicted[worst])),
        unit="share of the predicted decrease",
        witness={
            "period": worst + 2,
            "change_of_V": changes[worst],
            "predicted": predicted[worst],
            "largest_deviation": deviation.max(),
        },
    )
