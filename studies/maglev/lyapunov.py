"""The Lyapunov function of periodic adaptive learning, as a run shows it: its fall from period to period.

V = S^2/2 + integral over one period of (d - d_hat)^2 / (2 k M), k = gamma M.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from models.array import Array
from workbench.contracts.finding import Finding, undecided


class Fall(NamedTuple):
    """The change of V from each period to the next, and what the identity says of it; (periods - 1,) each."""

    changes: Array
    predicted: Array
    whole: int
    """Periods that were run to their end."""
    planned: int

    @property
    def refusal(self) -> str | None:
        """Why nothing can be told of it."""
        if self.changes.size == 0:
            return "fewer than two whole periods were recorded: give more"
        return None if (self.predicted < 0).all() else "S is zero through a whole period, so V has nothing to fall by"


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


def falls(fall: Fall) -> Finding:
    """Judge the measured changes of V, none of which may be a rise."""
    if (why := fall.refusal) is not None:
        return undecided(why)
    if fall.whole < fall.planned:
        return stopped(fall)
    worst = int(np.argmax(fall.changes / np.abs(fall.predicted)))
    return Finding(
        tries=fall.changes.size,
        method=f"V at the end of each of the {fall.whole} periods of the run",
        margin=float(-fall.changes[worst] / np.abs(fall.predicted[worst])),
        unit="share of the predicted decrease",
        witness={
            "period": worst + 2,
            "change_of_V": fall.changes[worst],
            "predicted": fall.predicted[worst],
        },
    )


def follows(fall: Fall, allowed: float) -> Finding:
    """Judge how far the measured changes of V depart from the identity."""
    if (why := fall.refusal) is not None:
        return undecided(why)
    if fall.whole < fall.planned:
        return stopped(fall)
    deviation = np.abs(fall.changes / fall.predicted - 1)
    worst = int(np.argmax(deviation))
    return Finding(
        tries=fall.changes.size,
        method=f"V of each of the {fall.whole} periods of the run, under a force held over a sample: its change is "
        f"that of the identity within {100 * deviation[0]:.2g} % in period 2 and {100 * deviation[worst]:.2g} % at "
        f"worst, in period {worst + 2}",
        margin=float(allowed - deviation[worst]),
        unit="share of the predicted decrease",
        weak=True,
        bound=float(deviation[worst]),
        bound_unit="share of the predicted decrease",
        witness={
            "period": worst + 2,
            "change_of_V": fall.changes[worst],
            "predicted": fall.predicted[worst],
        },
    )


def stopped(fall: Fall) -> Finding:
    """Return the refutation of a claim on every period by a run that was stopped."""
    return Finding(
        holds=fall.whole == fall.planned,
        method=f"the law was stopped as diverged after {fall.whole} of {fall.planned} periods",
        witness={"whole_periods": fall.whole, "periods": fall.planned},
    )
