"""The learning curve of a run beside that which the map between trials, frozen at the last one, predicts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from models.array import Array
from verification.checks.trial_map import ErrorMap
from workbench.contracts.finding import Finding, Grounds, undecided
from workbench.contracts.number import finite
from workbench.evidence.closed_loop import product

LOST = 1e300  # a factor that is not finite is counted as this
FLOOR = 1e-12  # of the first mean square error: learning curves are compared above this


def no_rise(observed: Array) -> str | None:
    """Return why there is no peak to predict: the largest mean square error is that of the first trial; or None."""
    usable = np.where(np.isfinite(observed), observed, -1.0)
    if usable.size and int(usable.argmax()) > 0:
        return None
    return "the mean square error is largest in the first trial, so there is no rise to predict"


def peak(observed: Array, predicted: Array) -> Finding:
    """The frozen map predicts the largest MSE of the later trials within a factor of 3.

    Where the first trial's is the largest (:func:`no_rise`) there is no peak, and the whole learning curves are
    compared: by the geometric mean, over the trials after the first, of the factor between them.
    """
    if not np.size(predicted):
        return undecided("there is no map between trials to predict with")
    if no_rise(observed) is not None:
        return learning_curve(observed, predicted)
    usable = np.isfinite(observed)
    seen = float(np.max(observed[usable]))
    later = np.nan_to_num(predicted[1:], nan=-1.0, posinf=np.inf)
    said = float(later.max())
    witness = {
        "observed_peak": seen,
        "observed_at_trial": int(np.where(usable, observed, -1).argmax()) + 1,
        "predicted_peak": finite(said),
        "predicted_at_trial": int(later.argmax()) + 2,
    }
    ratio = max(seen / said, said / seen) if said > 0 and seen > 0 and np.isfinite(said) else np.inf
    return Finding(
        grounds=Grounds.RUN,
        tries=int(usable.sum()),
        weak=True,
        margin=max(3 - ratio, -LOST),
        unit="factor",
        witness=witness,
        method="the map frozen at the last trial, run from the first trial with the recorded trial lengths; "
        + (f"the peaks differ by a factor of {ratio:.3g}" if np.isfinite(ratio) else "it predicts no such peak")
        + ", the margin is 3 minus the factor",
    )


def learning_curve(observed: Array, predicted: Array) -> Finding:
    """The frozen map predicts the MSE of the later trials within a factor of 3, in the geometric mean.

    Both are counted no lower than a part in 1e12 of the first trial's, and trials after the first in which both have
    reached that are left out: below it there is rounding.
    """
    floor = FLOOR * float(observed[0])
    both = np.array([np.maximum(np.nan_to_num(one[1:], nan=np.inf), floor) for one in (observed, predicted)])
    low = np.flatnonzero((both <= floor).all(axis=0))
    both = both[:, : low[0] + 1] if low.size else both
    if not both.size or not floor > 0:
        return undecided("there is no later trial, or no error, to compare the prediction with")
    with np.errstate(invalid="ignore", divide="ignore"):
        factors = np.abs(np.log(both[0] / both[1]))
    mean = float(np.exp(factors.mean())) if np.isfinite(factors).all() else np.inf
    worst = int(np.nan_to_num(factors, nan=np.inf).argmax())
    return Finding(
        grounds=Grounds.RUN,
        tries=both.shape[1],
        weak=True,
        margin=max(3 - mean, -LOST),
        unit="factor",
        witness={
            "factor": finite(mean),
            "trials_compared": both.shape[1],
            "worst_at_trial": worst + 2,
            "observed": finite(both[0, worst]),
            "predicted": finite(both[1, worst]),
        },
        method="the MSE is largest in the first trial, so learning curves are compared in place of peaks: the map "
        "frozen at the last trial, run from the first trial with the recorded trial lengths; "
        + (f"they differ by a factor of {mean:.3g} in the geometric mean" if np.isfinite(mean) else "it diverges")
        + ", the margin is 3 minus the factor",
    )


def predicted_mse(found: ErrorMap, lengths: NDArray[np.int64]) -> Array:
    """Return the MSE by trial that the frozen map predicts from the first trial and the trial lengths.

    v_next = v^ + M (v - v_last) + L (s - s_last), v^ what the law learned from the last trial run to the horizon.
    """
    step, signal = found.step, found.signal
    learned, base = step.next(), product(signal.of, step.error[0])
    v, result = found.first_v, np.full(len(lengths), np.nan)
    samples = np.arange(signal.first, signal.first + signal.size)
    for i, length in enumerate(lengths):
        e = found.first - step.linear.apply(v - found.first_v)
        result[i] = np.mean(e[1 : length + 1] ** 2)
        if not np.isfinite(result[i]) or result[i] > 1e30:
            break
        known = np.where(samples <= length, product(signal.of, e), 0.0)
        v = learned + product(step.keeps, v - step.v) + product(found.gain, known - base)
    return result
