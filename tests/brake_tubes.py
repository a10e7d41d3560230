"""A brake and two small plants, written out here so that the tests depend on no other source."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from workbench.predictive.delayed_plant import DelayedPlant
from workbench.predictive.tube import Tube
from workbench.sets import Polytope, Zonotope

TAU, T, C, DELAY, LEVEL = 0.4, 0.2, -1.07, 5, 0.5 / 1.07


class Brake(NamedTuple):
    A: NDArray[np.float64]
    b: NDArray[np.float64]
    E: NDArray[np.float64]


def brake_matrices() -> Brake:
    """Exact sampling of da/dt = (c u - a) / tau, dv/dt = a - a_r, ds/dt = v; states a, u before, v, s."""
    rate = np.zeros((5, 5))  # a, v, s, u, a_r
    rate[0, 0], rate[0, 3], rate[1, 0], rate[1, 4], rate[2, 1] = -1 / TAU, C / TAU, 1, -1, 1
    flow = expm(rate * T)
    A = np.eye(4)
    A[np.ix_([0, 2, 3], [0, 2, 3])] = flow[:3, :3]
    A[[0, 2, 3], 1] = flow[:3, 3]
    return Brake(A=A, b=A[:, 1].copy(), E=np.array([flow[0, 4], 0, flow[1, 4], flow[2, 4]]))


def brake_tube(config: str = "A", *, low: float = -0.06, high: float = 0.30, **options: bool) -> Tube:
    brake = brake_matrices()
    names = ("a", "u", "v", "s")
    plant = DelayedPlant(A=brake.A, b=brake.b, W=Zonotope.segment(brake.E, low, high), delay=DELAY, names=names)
    least = {"A": 0.0, "B": -1.0}[config] - LEVEL
    bounds = Polytope.box([-np.inf, least, -2, -12], [np.inf, 1 - LEVEL, 2, 12], names=names)
    Q, R = np.diag([0.0, 0, 1, 3]), 10.0
    if config == "B":
        return Tube.from_lqr(plant=plant, bounds=bounds, Q=Q, R=R, **options)
    return Tube.from_lqr(plant=plant, bounds=bounds, Q=Q, R=R, gain_Q=np.diag([0, 0, 1, 0.01]), gain_R=100.0, **options)


def integrator_tube(*, delay: int = 1, reach: float = 0.02) -> Tube:
    """A double integrator with disturbances in both states: a set W with an interior."""
    plant = DelayedPlant(
        A=np.array([[1.0, 0.3], [0.0, 1.0]]),
        b=np.array([0.045, 0.3]),
        W=Zonotope.box([-reach, -reach], [reach, reach]),
        delay=delay,
        names=("s", "v"),
    )
    bounds = Polytope.box([-2, -1], [3, 1], names=("s", "v"))
    return Tube.from_lqr(plant=plant, bounds=bounds, Q=np.eye(2), R=1.0)


TUBES = {"brake A": brake_tube, "brake B": lambda: brake_tube("B"), "integrator": integrator_tube}
