"""Metrics of the stopping study, from its Dataset."""

from __future__ import annotations

import numpy as np
import xarray as xr

from studies.stopping.settings import own
from workbench.contracts.number import finite
from workbench.contracts.study import Scores, Study

UPDATE = 1e-6
"""|du| above which a sample counts as an update of the command."""
SWITCH = 1e-3
"""|du| above which it counts as a switch of the brake."""


def scores(study: Study, data: xr.Dataset) -> Scores:
    """Return the metrics of every law.

    stop_error_cm; rms_speed_error, max_speed_error (m/s); updates, switches: samples whose |du| exceeds 1e-6, 1e-3;
    max_jerk (m/s^3) of the brake; total_variation of the command; qps_solved; infeasible: samples without a plan.
    """
    result: Scores = {}
    for name in data["controller"].values:
        one = data.sel(controller=name)
        kept = one["speed"].notnull().values
        if not kept.any():  # refused
            continue
        error, du = one["speed_error"].values[kept], np.abs(one["increment"].values[kept])
        stop = float(one["stop_position"]) - own(study).curve.stop_position
        result[str(name)] = {
            "stop_error_cm": finite(100 * stop),
            "rms_speed_error": finite(np.sqrt(np.mean(error**2))),
            "max_speed_error": finite(np.abs(error).max()),
            "updates": float((du > UPDATE).sum()),
            "switches": float((du > SWITCH).sum()),
            "max_jerk": finite(one["peak_jerk"].max()),
            "total_variation": finite(du.sum()),
            "qps_solved": finite(one["qps"].sum()),
            "infeasible": finite(one["infeasible"].sum()),
        }
    return result
