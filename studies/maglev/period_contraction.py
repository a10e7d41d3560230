"""By what factor the error of a periodic learning law changes from one period to the next, by frequency."""

from __future__ import annotations

from fractions import Fraction
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.array import Array
from workbench.contracts.finding import Finding, Grounds


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
    same recursion and is free of what a filtered law leaves for ever. NaN where there are fewer than three periods,
    or where S did not change.
    """
    S = np.diff(S, axis=0)
    if S.shape[0] < 2:
        return float("nan")
    line = round(w * period / (2 * np.pi))
    lines = slice(max(1, line - half_width), line + half_width + 1)
    size = np.linalg.norm(np.abs(np.fft.rfft(S, axis=1))[:, lines], axis=1)
    count = min(last, size.size - 1)
    if size[-1 - count] == 0:
        return float("nan")
    return float((size[-1] / size[-1 - count]) ** (1 / count))


def sampled_gain(alpha: float, lam: float, k: float, mass: float, step: float) -> Finding:
    """Tell whether the sampled errors are stable under a held force, and up to which step; k in N per m/s.

    e_v' = -(alpha + lam + k/M) e_v - lam (alpha + k/M) e_x, the right-hand side held over a step, e_x' = e_v. The
    characteristic polynomial has its roots inside the unit circle where step < 2/(alpha + lam + k/M) and
    step < 2 (alpha + lam + k/M)/(lam (alpha + k/M)) (Jury). The arithmetic is rational, hence exact.
    """
    margin = -least_excess(alpha, lam, k, mass, step)
    largest = step + float(margin)
    return Finding(
        grounds=Grounds.ALGEBRA,
        method="rational arithmetic on the errors' equations under a held force: the roots lie inside the unit circle "
        f"for steps below {largest:.2g} s",
        margin=float(margin),
        unit="s",
        bound=largest,
        bound_unit="s",
        witness={"alpha": alpha, "lambda": lam, "k": k, "mass": mass, "step": step, "largest_step": largest},
    )


def least_excess(alpha: float, lam: float, k: float, mass: float, step: float) -> Fraction:
    """Return by how much the step exceeds the largest that is stable, s, exactly."""
    learned = Fraction(k) / Fraction(mass)
    by_speed = Fraction(alpha) + Fraction(lam) + learned
    by_position = Fraction(lam) * (Fraction(alpha) + learned)
    return Fraction(step) - min(2 / by_speed, 2 * by_speed / by_position)
