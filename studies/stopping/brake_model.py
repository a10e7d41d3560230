"""The linear model of the braking train that the predictive laws plan with, taken from the plant's own equations."""

from __future__ import annotations

from typing import Literal, NamedTuple

import casadi as ca
import numpy as np
from scipy.linalg import expm

from models.brake import Brake, Motion
from models.braking_curve import BrakingCurve
from workbench.sets.array import Array

STATES = ("a", "u", "v", "s")
"""x = [a_c(k), u(k-l-1), v(k), s(k)] in m/s^2, 1, m/s and m; the paper's u(k-l) contradicts its own b."""

UNITS = ("m/s^2", "1", "m/s", "m")

Method = Literal["zoh", "euler"]


class BrakeModel(NamedTuple):
    """x(k+1) = A x(k) + b du(k-l) + E a_r(k), du the increment of the command."""

    A: Array
    """Shape (4, 4)."""
    b: Array
    """Shape (4,)."""
    E: Array
    """Shape (4,)."""


def brake_model(brake: Brake, method: Method = "zoh") -> BrakeModel:
    """Return the sampled model of a brake.

    ``zoh`` is exact for a command and a resistance that are constant over a sample: the matrix exponential of the
    Jacobians of the plant's right-hand side, with the resistance as an input. ``euler`` is the paper's: the brake
    exactly, speed and position by an explicit Euler step.
    """
    motion, held = ca.SX.sym("motion", 3), ca.SX.sym("held", 2)
    rates = ca.vertcat(*brake.rates(Motion(motion[0], motion[1], motion[2]), held[0], held[1]))
    slopes = ca.Function("slopes", [motion, held], [ca.jacobian(rates, motion), ca.jacobian(rates, held)])
    F, G = (np.asarray(value.full()) for value in slopes(np.zeros(3), np.zeros(2)))
    T = brake.sampling_time
    Phi, Gamma = zero_order_hold(F, G, T)
    if method == "euler":
        Phi[1:], Gamma[1:] = (np.eye(3) + T * F)[1:], T * G[1:]
    at = [STATES.index(name) for name in ("a", "v", "s")]
    A, E = np.eye(4), np.zeros(4)
    A[np.ix_(at, at)], A[at, 1], E[at] = Phi, Gamma[:, 0], Gamma[:, 1]
    return BrakeModel(A=A, b=A[:, 1].copy(), E=E)


def zero_order_hold(F: Array, G: Array, T: float) -> tuple[Array, Array]:
    """Return (Phi, Gamma) of x(k+1) = Phi x + Gamma u for dx/dt = F x + G u, u held over T seconds; exact."""
    n, m = G.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = F, G
    flow = expm(block * T)
    return flow[:n, :n], flow[:n, n:]


def reference_state(brake: Brake, curve: BrakingCurve, k: int) -> Array:
    """Return x_s(k), shape (4,): the curve with the acceleration and the command that hold it without resistance."""
    v, s = curve.at(k * brake.sampling_time)
    return np.array([-curve.deceleration, -curve.deceleration / brake.full_brake, v, s])
