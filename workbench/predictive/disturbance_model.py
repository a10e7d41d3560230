"""A disturbance of known direction: estimated, predicted through the delay, and compensated at rest."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from models.quantity import InvalidValue
from workbench.predictive.delayed_plant import DelayedPlant
from workbench.sets.array import Array, checked
from workbench.sets.balance import state_units

REST_TOLERANCE = 1e-9
"""How far a rest may miss, relative to the terms that cancel, the states in units in which the plant is near one."""

FREE_TOLERANCE = 1e-10
"""Which singular values of I - A are zero but for rounding, relative to the largest, in the same units."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DisturbanceModel:
    """x(k+1) = A x(k) + b du(k-l) + E d(k), with E known and d a number that changes slowly.

    Parameters
    ----------
    plant
        A, b and the delay l.
    E
        Direction of the disturbance, shape (n,), not zero.
    Q
        Which errors the shifted rest is to keep small, shape (n, n): the weight of the cost.

    Raises
    ------
    InvalidValue
        If no rest under a constant d exists: the input cannot make up for a disturbance in that direction.
    """

    plant: DelayedPlant
    E: Array
    Q: Array

    def __post_init__(self) -> None:
        n = self.plant.order
        object.__setattr__(self, "E", checked("E", self.E, (n,)))
        object.__setattr__(self, "Q", checked("Q", self.Q, (n, n)))
        if not np.any(self.E):
            raise InvalidValue("E must not be zero: there is nothing to estimate")
        drift = np.eye(n) - self.plant.A
        gap = np.abs(drift @ self.shift - self.E)
        terms = (np.abs(drift) @ np.abs(self.shift) + np.abs(self.E)) / self._units
        if np.any(gap / self._units > REST_TOLERANCE * terms.max()):
            raise InvalidValue(
                f"a constant disturbance along E must leave the plant a rest, got {gap.max():.3g} that no input makes "
                "up for"
            )

    @cached_property
    def _units(self) -> Array:
        return state_units(self.plant.A, self.plant.b, self.E)

    @cached_property
    def shift(self) -> Array:
        """delta, shape (n,): with e - delta d in place of e, a constant d drops out of the error's equation.

        (I - A) delta = E leaves the integrators' states open; they are chosen to make delta'Q delta least. If that is
        not zero the plant comes to rest off the reference, by delta d, and no choice of the law can help it.
        """
        units = self._units
        gap = np.eye(self.plant.order) - self.plant.A * units / units[:, None]
        some = np.linalg.lstsq(gap, self.E / units, rcond=None)[0]
        _, size, vectors = np.linalg.svd(gap)
        free = vectors[size <= FREE_TOLERANCE * size[0]].T
        weight = self.Q * np.outer(units, units)
        value, basis = np.linalg.eigh(weight / (np.abs(weight).max(initial=0.0) or 1.0))
        root = np.sqrt(np.clip(value, 0, None))[:, None] * basis.T
        step = np.linalg.lstsq(root @ free, -root @ some, rcond=None)[0] if free.size else np.zeros(0)
        return checked("shift", (some + free @ step) * units, (self.plant.order,))

    def estimate(self, before: ArrayLike, du: float, after: ArrayLike) -> float:
        """d(k-1) from the errors at k-1 and k, shape (n,), and du(k-1-l): least squares along E."""
        before = self.plant.require_state(before)
        surprise = self.plant.require_state(after) - self.plant.A @ before - self.plant.b * du
        return float(self.E @ surprise / (self.E @ self.E))

    def centered(self, e: ArrayLike, d: ArrayLike) -> Array:
        """Where the cost should see the plant, shape (n,).

        Parameters
        ----------
        e
            The error e(k) = z(k) - x_s(k+l) predicted without disturbance, shape (n,).
        d
            d(k) ... d(k+l), shape (l+1,): the first l carry the prediction on, the last is compensated.
        """
        e = self.plant.require_state(e)
        d = checked("d", d, (self.plant.delay + 1,))
        carried = np.zeros(self.plant.order)
        for now in d[:-1]:
            carried = self.plant.A @ carried + self.E * now
        moved: Array = e + carried - self.shift * d[-1]
        return moved
