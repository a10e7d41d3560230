"""Linear loops by python-control: are they stable, and from which gain on are they not."""

from __future__ import annotations

import numpy as np
from control import StateSpace

from models.quantity import InvalidValue


def critical_gain(loop: StateSpace, most: float = 1e6) -> float:
    """Return the least gain K > 0 at which 1 + K L(z) has a root on the unit circle, infinity if there is none.

    ``loop`` is a discrete-time python-control system L with one input and output whose closed loop is stable for
    small K. K is bisected on the closed loop's poles to a relative 1e-12.
    """
    if not loop.isdtime(strict=True):
        raise InvalidValue("critical_gain needs a discrete-time loop")

    def radius(gain: float) -> float:
        return spectral_radius(gain * loop)

    low = 1e-3
    if radius(low) >= 1:
        raise InvalidValue("critical_gain needs a loop that is stable for small gains")
    high = low
    while radius(high) < 1:
        low, high = high, 1.1 * high
        if high > most:
            return float("inf")
    while high - low > 1e-12 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if radius(middle) < 1 else (low, middle)
    return (low + high) / 2


def spectral_radius(loop: StateSpace) -> float:
    """Return the largest magnitude of the closed loop's poles, 1 + L(z) = 0; below 1 the loop is stable."""
    import control

    return float(np.abs(control.feedback(loop, 1).poles()).max())


def observed(system: StateSpace) -> StateSpace:
    """Return a python-control StateSpace without the states that cannot reach its output, such as a position.

    A state reaches the output if it stands in it, or in the next value of a state that does: exact zeros decide.
    """
    import control

    a, c = np.asarray(system.A), np.asarray(system.C)
    kept = (c != 0).any(axis=0)
    while (grown := kept | (a[kept] != 0).any(axis=0)).sum() > kept.sum():
        kept = grown
    return control.StateSpace(a[np.ix_(kept, kept)], np.asarray(system.B)[kept], c[:, kept], system.D, system.dt)


def positional_pid(kp: float, ki: float, kd: float, sampling_time: float) -> StateSpace:
    """Return python-control's StateSpace of kp + ki Ts/(1 - z^-1) + kd (1 - z^-1)/Ts."""
    import control

    numerator = [kp + ki * sampling_time + kd / sampling_time, -kp - 2 * kd / sampling_time, kd / sampling_time]
    return control.ss(control.TransferFunction(numerator, [1, -1, 0], sampling_time))


def incremental_pid(ki: float, kd: float, sampling_time: float) -> StateSpace:
    """Return python-control's StateSpace of C(z) = (1 - z^-1 + ki + kd (1 - z^-1)^2)/(1 - z^-1).

    In state space, because a chain of delays is badly conditioned as a ratio of polynomials.
    """
    import control

    return control.ss(control.TransferFunction([1 + ki + kd, -1 - 2 * kd, kd], [1, -1, 0], sampling_time))
