"""How large things are on a plant, from its believed model and the reference: where laws begin to be tuned."""

from __future__ import annotations

import math
from typing import NamedTuple

import casadi as ca
import numpy as np

from models.array import Array
from models.plant import Plant
from models.quantity import InvalidValue
from workbench.contracts.law import Task

FARTHEST = 200  # samples after which an input that has reached no output is given up
PUBLISHED = 26.0
"""The largest output that the fuzzy immune laws were published with: their unit is a 26th of the largest reference."""


class Scales(NamedTuple):
    """What the plant and the task say about the size of things.

    Of several channels, input i acting on output i, each number is the geometric mean over the channels.
    """

    rate: float
    """Input that changes the output by one unit a second; negative where the output falls with the input."""
    step: float
    """Input that changes the output by one unit at the first sample that it reaches."""
    largest: float
    """Largest reference, in output units."""
    decay: float
    """dy(k+1)/dy(k) at half the largest reference."""


def believed(task: Task) -> Plant:
    """Return the plant that a task tells of; raise InvalidValue where it tells of none."""
    if task.model is None:
        raise InvalidValue("scales follow from a model of the plant, and the task tells of none: give it one")
    return task.model


def scales(task: Task) -> Scales:
    """Return the scales of a task whose plant has as many inputs as outputs.

    The slope is the exact derivative dy(k+d)/du(k) of the model at its relative degree d, at rest, or at half the
    largest reference where it vanishes at rest. Raises InvalidValue for other plants, and where an input does nothing.
    """
    plant = believed(task)
    if len(plant.inputs) != len(plant.outputs):
        raise InvalidValue(
            f"scales are those of a plant with as many inputs as outputs, {plant.name} has {len(plant.inputs)} and "
            f"{len(plant.outputs)}"
        )
    largest = np.abs(np.asarray(ca.DM(task.reference).full())).max(axis=1)
    slopes = [_slope(plant, i, float(largest[i]), min(FARTHEST, task.samples)) for i in range(len(plant.inputs))]
    decays = [_decay(plant, i, float(largest[i])) for i in range(len(slopes))]
    ts = float(plant.sampling_time)
    return Scales(
        _mean([ts / slope for slope in slopes]),
        _mean([1 / slope for slope in slopes]),
        _mean([max(float(one), 1e-9) for one in largest]),
        _mean(decays),
    )


def _mean(values: list[float]) -> float:
    """Return the geometric mean, negative where most values are; a single value is its own."""
    if len(values) == 1:
        return values[0]
    sign = -1.0 if sum(value < 0 for value in values) > len(values) / 2 else 1.0
    return sign * float(np.exp(np.mean([np.log(max(abs(value), 1e-300)) for value in values])))


def _slope(plant: Plant, i: int, largest: float, limit: int) -> float:
    """Return dy(k+d)/du(k) of a channel; raise InvalidValue where it does not exist."""
    effect = plant.first_effect(limit=limit, output=plant.outputs[i].name, input=plant.inputs[i].name)
    slope = 0.0 if effect is None else effect.slope_at_rest
    if effect is not None and not (slope and math.isfinite(slope)):
        slope = float(effect.slope(x=at_output(plant, largest / 2, i))["dy_du"])
    if not (slope and math.isfinite(slope)):
        raise InvalidValue(
            f"{plant.inputs[i].name} of {plant.name} must reach {plant.outputs[i].name} within {limit} samples, and "
            f"with a slope that is finite and not 0, got {slope if effect else 'no effect'}: look at step and output"
        )
    return slope


def at_output(plant: Plant, value: float, output: int = 0) -> Array:
    """Return the smallest state at which a linear output has a value, (states,); 0 where it is flat at rest."""
    x = plant.symbols()["x"]
    slope = ca.Function("slope", [x], [ca.jacobian(plant.measured(x), x)])
    row = np.asarray(slope(np.zeros(len(plant.states))).full())[output]
    square = float(row @ row)
    return value * row / square if square > 0 and math.isfinite(square) else np.zeros(len(plant.states))


def _decay(plant: Plant, output: int, largest: float) -> float:
    """Return dy(k+1)/dy(k) of an output at half its largest reference; 1 where it is no function of the state."""
    along, x = at_output(plant, 1.0, output), at_output(plant, largest / 2, output)
    if not along.any():
        return 1.0
    slope = plant.derivative("x", of="y_next")(x, [0.0] * len(plant.inputs), [0.0] * len(plant.disturbances), 0)
    row = np.asarray(slope.full())[output]
    return float(row[along != 0] @ along[along != 0])
