"""Metrics of the variable-gain study, from its Dataset."""

from __future__ import annotations

import numpy as np
import xarray as xr

from models.array import Array
from workbench.contracts.number import finite
from workbench.contracts.study import Scores, Study
from workbench.trials.record import OUTPUT

POSITION_TOLERANCE, SPEED_TOLERANCE = 0.1, 0.01
"""What ``trials_to_tolerance`` asks for, m and m/s."""


def peaks(data: xr.Dataset, controller: str, output: str) -> Array:
    """Return the largest magnitude of an output's error in every trial, NaN where the trial was not run."""
    largest: Array = abs(data["error"].sel({"controller": controller, OUTPUT: output})).max("sample").values
    return largest


def scores(study: Study, data: xr.Dataset) -> Scores:
    """Return the metrics of every controller.

    max_position_error_first|last (m), max_speed_error_first|last (m/s), of the last trial that the study has (None
    where the law had diverged); trials_to_tolerance: the first trial from which on both stay within 0.1 m and
    0.01 m/s; initial_position_ratio: initial position error of trial 2 over that of trial 1.
    """
    table: Scores = {}
    for name in map(str, data["controller"].values):
        position, speed = peaks(data, name, "position"), peaks(data, name, "speed")
        start = data["error"].sel({"controller": name, OUTPUT: "position"}).isel(sample=0).values
        within = (position < POSITION_TOLERANCE) & (speed < SPEED_TOLERANCE)
        outside = np.flatnonzero(~within)
        first = outside[-1] + 2 if outside.size else 1
        table[name] = {
            "max_position_error_first": finite(position[0]),
            "max_position_error_last": finite(position[-1]),
            "max_speed_error_first": finite(speed[0]),
            "max_speed_error_last": finite(speed[-1]),
            "trials_to_tolerance": finite(first) if first <= position.size else None,
            "initial_position_ratio": finite(start[1] / start[0]) if start.size > 1 and start[0] else None,
        }
    return table
