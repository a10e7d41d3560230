"""Changes of units: the same problem told in other numbers, for tests that want the same answer."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from workbench.predictive.delayed_plant import DelayedPlant
from workbench.predictive.tube import Tube
from workbench.sets import Polytope, Zonotope

Factors = Callable[[int], NDArray[np.float64]]


def _one(index: int, factor: float) -> Factors:
    def factors(n: int) -> NDArray[np.float64]:
        c = np.ones(n)
        c[index % n] = factor
        return c

    return factors


STATES: dict[str, Factors] = {
    "as it is": np.ones,
    "all 1e-9": lambda n: np.full(n, 1e-9),
    "all 1e-4": lambda n: np.full(n, 1e-4),
    "all 1e9": lambda n: np.full(n, 1e9),
    "first 1e-9": _one(0, 1e-9),
    "first 1e9": _one(0, 1e9),
    "last 1e-9": _one(-1, 1e-9),
    "last 1e9": _one(-1, 1e9),
    "apart": lambda n: np.logspace(9, -9, n) if n > 1 else np.array([1e9]),
    "apart by thirds": lambda n: 3.0 ** (np.arange(n) * 5 - 11),
}
"""By what each of n states is multiplied: x -> c x."""


class Units(NamedTuple):
    """States are multiplied by c, shape (n,), increments of the input by `push`, costs by `worth`."""

    c: NDArray[np.float64]
    push: float = 1.0
    worth: float = 1.0

    def zonotope(self, Z: Zonotope) -> Zonotope:
        return Zonotope(center=Z.center * self.c, generators=Z.generators * self.c[:, None])

    def polytope(self, X: Polytope) -> Polytope:
        return Polytope(H=X.H / self.c, h=X.h, labels=X.labels).normalized()

    def loop(self, A):
        return np.asarray(A) * self.c[:, None] / self.c

    def plant(self, plant: DelayedPlant) -> DelayedPlant:
        return DelayedPlant(
            A=self.loop(plant.A),
            b=plant.b * self.c / self.push,
            W=self.zonotope(plant.W),
            delay=plant.delay,
            names=plant.names,
        )

    def weight(self, Q):
        return self.worth * np.asarray(Q) / np.outer(self.c, self.c)

    def tube(self, tube: Tube, **options: bool) -> Tube:
        return Tube(
            plant=self.plant(tube.plant),
            bounds=self.polytope(tube.bounds),
            Q=self.weight(tube.Q),
            R=self.worth * tube.R / self.push**2,
            K=self.push * tube.K / self.c,
            P=self.weight(tube.P),
            **options,
        )


TUBE_UNITS: dict[str, Callable[[int], Units]] = {
    "as it is": lambda n: Units(np.ones(n)),
    "all 1e-9": lambda n: Units(np.full(n, 1e-9)),
    "all 1e9": lambda n: Units(np.full(n, 1e9)),
    "all 1e-9, input too": lambda n: Units(np.full(n, 1e-9), 1e-9),
    "all 1e9, input 1e-9": lambda n: Units(np.full(n, 1e9), 1e-9),
    "first 1e9, cost 1e-9": lambda n: Units(_one(0, 1e9)(n), 1.0, 1e-9),
    "last 1e-9, input 1e9, cost 1e9": lambda n: Units(_one(-1, 1e-9)(n), 1e9, 1e9),
    "apart": lambda n: Units(STATES["apart"](n), 7.0, 1e-6),
}
