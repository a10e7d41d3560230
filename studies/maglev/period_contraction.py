"""By what factor the error of a periodic learning law changes from one period to the next, by frequency."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.array import Array
from workbench.contracts.verdict import Finding, Standing


class Loop(NamedTuple):
    """What the prediction needs: gains in 1/s, lag and dead time in s, and the filter and lead of the learning."""

    alpha: float
    lam: float
    gamma: float
    lag: float
    delay: float
    step: float
    """Sampling time in s; holding the force adds half of it to the dead time."""
    filtered: bool
    cutoff_hz: float | None
    lead: float


def learned_to_error(w: Array, loop: Loop) -> NDArray[np.complex128]:
    """Return L(jw): S over d_hat/M with the PD loop closed through lag and dead time; w in rad/s.

    Without them it is 1/(jw + alpha). The running resistance's slope, small beside the gains, is left out.
    """
    s = 1j * np.asarray(w, dtype=float)
    actuator = np.exp(-s * (loop.delay + loop.step / 2)) / (1 + loop.lag * s)
    return actuator * (s + loop.lam) / (s**2 + actuator * ((loop.alpha + loop.lam) * s + loop.alpha * loop.lam))


def factor(w: Array, loop: Loop) -> Array:
    """Return by what S is multiplied from one period to the next at w rad/s (magnitude), same shape as w.

    PALC learns with the S of the same instant: 1/(1 + gamma L). The filtered law learns between periods:
    Q (1 - gamma L exp(jw lead)), Q the zero-phase filter.
    """
    L = learned_to_error(w, loop)
    if not loop.filtered:
        within: Array = np.abs(1 / (1 + loop.gamma * L))
        return within
    q = 1.0 if loop.cutoff_hz is None else low_pass_gain(w, loop.cutoff_hz, loop.step)
    between: Array = np.abs(q * (1 - loop.gamma * L * np.exp(1j * w * loop.lead)))
    return between


def low_pass_gain(w: Array, cutoff_hz: float, step: float) -> Array:
    """Return the gain of the forward-backward second-order Butterworth filter at w rad/s."""
    warped: Array = np.tan(w * step / 2) / np.tan(np.pi * cutoff_hz * step)
    return 1 / (1 + warped**4)


def frequencies(period: float, step: float, limit_hz: float = 5.0) -> Array:
    """Return the harmonics of the period in rad/s up to ``limit_hz`` or half the sampling frequency."""
    top = min(limit_hz, 0.45 / step)
    harmonics: Array = 2 * np.pi * np.arange(1, int(top * period) + 1, dtype=np.float64) / period
    return harmonics


def worst(period: float, loop: Loop) -> tuple[float, float]:
    """Return the harmonic (rad/s) with the largest factor, and that factor."""
    w = frequencies(period, loop.step)
    values = factor(w, loop)
    at = int(np.argmax(values))
    return float(w[at]), float(values[at])


def observed(S: Array, period: float, w: float, last: int = 5, half_width: int = 3) -> float:
    """Return the growth a period of the change of S around w rad/s: geometric mean over the last periods.

    S has shape (periods, samples), the samples making up one period. Its change from period to period follows the
    same recursion and is free of what a filtered law leaves for ever. NaN where there are fewer than three periods.
    """
    S = np.diff(S, axis=0)
    if S.shape[0] < 2:
        return float("nan")
    line = round(w * period / (2 * np.pi))
    lines = slice(max(1, line - half_width), line + half_width + 1)
    size = np.linalg.norm(np.abs(np.fft.rfft(S, axis=1))[:, lines], axis=1)
    count = min(last, size.size - 1)
    return float((size[-1] / size[-1 - count]) ** (1 / count))


def sampled_gain(alpha: float, k: float, mass: float, step: float) -> Finding:
    """Tell whether S+ = S - step (alpha + k/M) S is stable, k in N per m/s, and the largest step that would be."""
    largest = 2 / (alpha + k / mass)
    in_one = alpha / (alpha + k / mass**2)
    return Finding(
        standing=Standing.PROVED if largest > step else Standing.REFUTED,
        method="exact: the pole of S under a held force is 1 - step (alpha + k/M), stable for step (alpha + k/M) < 2; "
        f"read as a gain per mass (k/M^2) it would shrink S to a share of {in_one:.1g} in a single period",
        margin=largest - step,
        unit="s",
        witness={"k": k, "step": step, "pole": 1 - step * (alpha + k / mass), "largest_step": largest},
    )
