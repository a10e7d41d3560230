"""Metrics of a ride: accelerations, jerk, energy and forces of any train that has a speed and a force.

What is what is told by the signals' roles, and in which unit by the signals' own: a train's speed may be in km/h.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from models.array import Array
from models.plant import Signal
from models.quantity import InvalidValue
from workbench.contracts.number import finite
from workbench.contracts.study import Measures, Scores, Study
from workbench.trials.metrics import peak, reached_inputs
from workbench.trials.record import INPUT, OUTPUT

JOULES_PER_KWH = 3.6e6
SPEEDS = {"m/s": 1.0, "km/h": 3.6}
"""How much of a unit of speed is 1 m/s."""
FORCES = {"N": 1.0, "kN": 1e-3}
"""How much of a unit of force is 1 N."""


class _Found(NamedTuple):
    """The signal of a role: what it is called, and how much of its unit is one of SI."""

    name: str
    per_si: float
    several: bool


def _of_role(what: str, role: str, signals: Sequence[Signal], units: Mapping[str, float]) -> _Found:
    """Return the first signal that has a role; raise InvalidValue where there is none in a known unit."""
    for signal in signals:
        if signal.role == role and signal.unit in units:
            return _Found(signal.name, units[signal.unit], len(signals) > 1)
    have = ", ".join(f"{one.name} ({one.role or 'no role'}, {one.unit})" for one in signals)
    raise InvalidValue(
        f"the metrics of a ride need an {what} with the role {role} in {' or '.join(units)}, the plant has: {have}"
    )


def speed_of(study: Study) -> _Found:
    """Return the output that is the train's speed."""
    return _of_role("output", "speed", study.plant.outputs, SPEEDS)


def force_of(study: Study) -> _Found:
    """Return the input that is the train's force."""
    return _of_role("input", "force", study.plant.inputs, FORCES)


def _one(values: xr.DataArray, axis: str, found: _Found) -> xr.DataArray:
    return values.sel({axis: found.name}) if found.several else values


def train_scores(study: Study, data: xr.Dataset) -> Scores:
    """Return max_abs_input_n (N) and max_abs_accel_mps2 (m/s^2) over all trials, applied samples only."""
    speed, force = speed_of(study), force_of(study)
    per_second = speed.per_si * float(study.plant.sampling_time)
    at = [signal.name for signal in study.plant.inputs].index(force.name)
    found: Scores = {}
    for controller in map(str, data["controller"].values):
        inputs = reached_inputs(data, controller)
        if force.several:
            inputs = np.take(inputs, at, axis=list(data["input"].dims).index(INPUT) - 1)
        largest = peak(inputs)
        output = _one(data["output"].sel(controller=controller), OUTPUT, speed).values
        found[controller] = {
            "max_abs_input_n": None if largest is None else largest / force.per_si,
            "max_abs_accel_mps2": peak(np.diff(output) / per_second),
        }
    return found


def ride_scores(study: Study, data: xr.Dataset) -> Scores:
    """Return max_jerk (m/s^3), energy_kwh drawn in traction and force_peak (N) of every law's last trial.

    The force is the one that acts behind the actuator. None where the law diverged.
    """
    speed_is, force_is, ts = speed_of(study), force_of(study), float(study.plant.sampling_time)
    found: Scores = {}
    for controller in map(str, data["controller"].values):
        last = data.sel(controller=controller).isel(trial=-1)
        speed: Array = _one(last["output"], OUTPUT, speed_is).values / speed_is.per_si
        force: Array = _one(last["applied"], INPUT, force_is).values[:-1] / force_is.per_si
        power = np.maximum(force * (speed[:-1] + speed[1:]) / 2, 0.0)
        found[controller] = {
            "max_jerk": finite(np.abs(np.diff(speed, 2)).max() / ts**2),
            "energy_kwh": finite(power.sum() * ts / JOULES_PER_KWH),
            "force_peak": finite(np.abs(force).max()),
        }
    return found


RIDE = Measures(
    headings={"max_jerk": "jerk (m/s^3)", "energy_kwh": "energy (kWh)", "force_peak": "force peak (N)"},
    scores=ride_scores,
)
"""What a comparison of laws on a train shows of the last trial."""
