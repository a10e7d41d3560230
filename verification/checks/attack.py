"""Trying to break what was proved: recorded trials, and plans made for it, held against the proved numbers.

Plans are bang-bang between the ends of the set, held at an end, random, and small departures from recorded ones. A
trial counts up to the sample at which it leaves the set, for which nothing was proved. What the doubles of a run round
is carried as noise through the same recursion as the inputs are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from models.array import Array
from models.plant import Plant
from verification.checks.increment import factor, gain_range, largest_gain
from verification.checks.row_sums import SlopeBounds, carried_rounding, off_diagonal
from verification.checks.wanted import Wanted
from verification.enclosure.box import Box
from workbench.contracts.claim import Held
from workbench.contracts.law import Estimator
from workbench.evidence.ppd import learned_signal
from workbench.evidence.trajectory import Lineariser, Trajectories, partial

PLANS = 100
ROUNDED = 2.0**-46
"""What one step rounds, of the largest magnitudes of its box: 64 units in the last place."""
SPARE = 1e-9  # of a bound: digits that are not looked at
CHECKED = 25  # recorded trials whose slopes are looked at, evenly chosen


class Tried(NamedTuple):
    """Trials that were run or recorded, with how far each stayed in the set."""

    x: Array
    """(trials, nx, N + 1)."""
    u: Array
    """(trials, N)."""
    y: Array
    """(trials, N + 1)."""
    inside: NDArray[np.int64]
    """How many samples k = 0, 1, ... each was in the set with state and input, (trials,)."""


def recorded(taken: Trajectories, box: Box) -> Tried:
    """Return the recorded trials, up to where each ended."""
    ended = _inside(box, taken.x, taken.u)
    return Tried(taken.x, taken.u, taken.y, np.minimum(ended, taken.lengths))


def tried(plant: Plant, box: Box, begun: Array, w: Array, base: Sequence[Array], seed: int = 0) -> Tried:
    """Run plans made to break a bound from a state ``begun`` (nx,) under disturbances w (nw, N)."""
    plans = made(box, base, w.shape[1], np.random.default_rng(seed))
    at = plant.symbols()
    n, count = w.shape[1], plans.shape[0]
    step = ca.Function("step", list(at.values()), [plant.next_state(**at)])
    fold = step.mapaccum("tried", n).map(count)
    starts = np.tile(np.asarray(begun, dtype=float)[:, None], (1, count))
    with np.errstate(all="ignore"):
        states = fold(starts, plans.reshape(1, -1), np.tile(w, (1, count)), np.tile(np.arange(n), count)).full()
    nx = len(plant.states)
    x = np.concatenate([starts.T[:, :, None], states.reshape(nx, count, n).transpose(1, 0, 2)], axis=2)
    measured = plant.output_function().map(count * (n + 1))(x.transpose(1, 0, 2).reshape(nx, -1)).full()
    return Tried(x, plans, measured[0].reshape(count, n + 1), _inside(box, x, plans))


def made(box: Box, base: Sequence[Array], samples: int, rng: np.random.Generator) -> Array:
    """Return plans, (PLANS, samples), inside the set's range of the input."""
    low, high = (float(end.ravel()[0]) for end in box["u"])
    plans = [np.full(samples, low), np.full(samples, high)]
    while len(plans) < PLANS:
        kind = len(plans) % 4
        period = int(rng.integers(1, max(2, samples // 2)))
        sides = rng.integers(0, 2, samples // period + 1).repeat(period)[:samples] * 2.0 - 1
        if kind == 0:
            plans.append(np.where(sides > 0, high, low))
        elif kind == 1:
            plans.append(rng.uniform(low, high, samples))
        else:
            size = (high - low) * 10.0 ** rng.uniform(-6, -0.5)
            near = base[int(rng.integers(len(base)))] if len(base) else np.full(samples, (low + high) / 2)
            plans.append(np.clip(near + size * sides, low, high))
    return np.array(plans)


def _inside(box: Box, x: Array, u: Array) -> NDArray[np.int64]:
    """Return how many samples of each trial lie in the set, counted from the first."""
    low, high = (end.reshape(1, -1, 1) for end in box["x"])
    n = u.shape[1]
    within: NDArray[np.bool_] = np.logical_and(x >= low, x <= high)
    states = np.all(within[:, :, :n], axis=1)
    inputs = (u >= float(box["u"][0].ravel()[0])) & (u <= float(box["u"][1].ravel()[0]))
    both = states & inputs
    first = np.argmin(both, axis=1).astype(np.int64)
    return np.where(both.all(axis=1), np.int64(n), first)


def _largest(trials: Tried) -> float:
    """Return the largest output met while trials were in the set."""
    met = [np.abs(y[: count + 1]).max() for y, count in zip(trials.y, trials.inside, strict=True)]
    return float(max(met, default=0.0))


def rounding(slopes: SlopeBounds, box: Box, samples: int, output: float) -> Array:
    """Return what rounding may add to a difference of the learned signal, (samples,); ``output`` its magnitude."""
    size = np.maximum(*(np.abs(end).ravel() for end in box["x"]))
    return 2 * carried_rounding(slopes, samples, ROUNDED * np.maximum(size, 1e-300), ROUNDED * output)


def held_row_sums(p: float, slopes: SlopeBounds, box: Box, trials: Tried, degree: int, increment: bool) -> Held:
    """Hold |ds(k+d)| <= p max over j <= k of |du(j)| against every two trials that follow each other."""
    return _held_differences(p, slopes, box, trials, degree, increment, np.maximum.accumulate)


def held_ratios(p: float, slopes: SlopeBounds, box: Box, trials: Tried, degree: int, increment: bool) -> Held:
    """Hold |ds(k+d)| <= p |du(k)| against every two trials that follow each other."""
    return _held_differences(p, slopes, box, trials, degree, increment, np.abs)


def held_finite(plant: Plant, trials: Tried, w: Array, degree: int) -> Held:
    """Look for a point along trials, while they are in the set, at which the slope is no number."""
    n = trials.u.shape[1]
    along = Lineariser(plant, n)
    missing: dict[str, object] = {}
    for i in range(trials.u.shape[0]):
        count = max(0, int(trials.inside[i] - degree + 1))
        slope = partial(along.at(trials.x[i], trials.u[i], w), degree)[:count]
        if not np.isfinite(slope).all():
            missing = {"trial": i + 1, "sample": int(np.argmin(np.isfinite(slope)))}
    return Held(trials.u.shape[0], -float(len(missing)), missing)


def _held_differences(
    p: float,
    slopes: SlopeBounds,
    box: Box,
    trials: Tried,
    degree: int,
    increment: bool,
    moved_by: Callable[[Array], Array],
) -> Held:
    n = trials.u.shape[1]
    m = n - degree + 1
    spare = rounding(slopes, box, n, _largest(trials))[:m]
    with np.errstate(invalid="ignore"):  # plans may drive a plant beyond all numbers, after they left the set
        signal = learned_signal(trials.y, increment)
    looked, worst, place = 0, np.inf, {}
    for i in range(1, trials.u.shape[0]):
        both = int(min(trials.inside[i], trials.inside[i - 1]) - degree + 1)
        if both < 1:
            continue
        looked += 1
        moved = moved_by(np.abs(trials.u[i] - trials.u[i - 1]))[:both]
        answer = np.abs(signal[i][degree : degree + both] - signal[i - 1][degree : degree + both])
        room = p * (1 + SPARE) * moved + spare[:both] - answer
        k = int(np.nanargmin(room)) if np.isfinite(room).any() else 0
        if room[k] < worst:
            worst = float(room[k])
            place = {"pair": [i, i + 1], "sample": k, "largest_du": float(moved[k]), "ds": float(answer[k])}
    return Held(looked, worst if np.isfinite(worst) else 0.0, place)


def held_slopes(
    low: float, high: float, plant: Plant, trials: Tried, w: Array, degree: int, increment: bool = False
) -> Held:
    """Hold low <= ds(k+d)/du(k) <= high against the exact derivative along trials, while they are in the set."""
    n = trials.u.shape[1]
    along = Lineariser(plant, n)
    chosen = np.unique(np.linspace(0, trials.u.shape[0] - 1, max(CHECKED, PLANS)).astype(int))
    looked, worst, place = 0, np.inf, {}
    scale = SPARE * max(abs(low), abs(high))
    for i in chosen:
        count = int(trials.inside[i] - degree + 1)
        if count < 1:
            continue
        looked += 1
        slope = partial(along.at(trials.x[i], trials.u[i], w), degree)[:count]
        room = np.minimum(slope - low, high - slope) + scale
        k = int(np.nanargmin(room)) if np.isfinite(room).any() else 0
        if room[k] < worst:
            worst, place = float(room[k]), {"trial": int(i) + 1, "sample": k, "slope": float(slope[k])}
    return Held(looked, worst if np.isfinite(worst) else 0.0, place)


def held_contraction(
    law: Estimator, slopes: SlopeBounds, wanted: Wanted, box: Box, run: Tried, estimates: Array, made_: Tried, a: float
) -> Held:
    """Hold the contraction of the (weighted) input error against recorded trials, and against one step from plans.

    ``estimates`` are those that the recorded trials were run with, (trials, N). From each plan one trial is learned
    with gains drawn between 0 and the largest.
    """
    n = wanted.study.horizon
    weights = a ** np.arange(n)
    r = float(off_diagonal(slopes, n, a).max())
    target = np.diff(wanted.study.reference_samples[0])
    near = 1e-9 * float(np.ptp(wanted.u) or 1.0)
    spare = largest_gain(law) * rounding(slopes, box, n, float(np.abs(wanted.study.reference_samples).max())) + near
    looked, worst, place = 0, np.inf, {}

    def hold(u: Array, following: Array, gains: Array, count: int, what: dict[str, object]) -> None:
        nonlocal looked, worst, place
        looked += count > 0
        d, left = (np.abs(wanted.u - one) * weights for one in (u, following))
        room = factor(slopes, r, gains) * np.maximum.accumulate(d) * (1 + SPARE) + spare * weights - left
        room = room[:count]
        k = int(room.argmin()) if count else 0
        if count and room[k] < worst:
            worst, place = float(room[k]), {**what, "sample": k, "error": float(d[k]), "next": float(left[k])}

    for i in range(run.u.shape[0] - 1):
        gains = np.nan_to_num(gain_range(law, estimates[i + 1]))
        hold(run.u[i], run.u[i + 1], gains, int(run.inside[i]), {"trial": i + 1})
    rng = np.random.default_rng(1)
    for i in range(made_.u.shape[0]):
        gains = largest_gain(law) * rng.uniform(0, 1, n) * (rng.uniform(0, 1, n) < 0.9)
        with np.errstate(all="ignore"):
            following = made_.u[i] + gains * (target - np.diff(made_.y[i]))
        hold(made_.u[i], following, gains, int(made_.inside[i]), {"plan": i + 1})
    return Held(looked, worst if np.isfinite(worst) else 0.0, place)
