"""Watches over divergence: told of one trial after the other, they say when a law has diverged."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from models.array import Array
from workbench.contracts.record import TrialRecord


def slope_growth(output: int, *, factor: float = 1.05, trials: int = 8) -> Callable[[TrialRecord, Array], str | None]:
    """Return a watch over the slope of an output's error, which D-type learning contracts or does not.

    The law has diverged when the RMS of the error's sample-to-sample change has grown by ``factor`` or more in
    each of the last ``trials`` trials. A rise to the level of measurement noise takes fewer.
    """
    last, run = np.inf, 0

    def watch(left: TrialRecord, reference: Array) -> str | None:
        nonlocal last, run
        change = np.diff(reference[output] - left.y[output])
        size = float(np.sqrt(np.nanmean(change**2)))
        run = run + 1 if size >= factor * last else 0
        last = size
        if run < trials:
            return None
        return f"the error's slope grew by {100 * (factor - 1):.0f} % or more in each of {trials} trials on end"

    return watch
