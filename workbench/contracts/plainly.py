"""Parts of a scenario given plainly, as a number or an array, in the kind that a study keeps them in."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from models.array import Array
from models.plant import Plant
from models.quantity import InvalidValue
from workbench.contracts.scenario import (
    ByTrial,
    Departure,
    Disturbance,
    From,
    GaussianByOutput,
    GivenDisturbance,
    GivenInitial,
    GivenNoise,
    Initial,
    Noise,
    NormalNoise,
    Times,
)


def _numbers(name: str, value: object, shapes: str) -> Array:
    """Return what was given as an array of finite numbers, or raise with what it may be."""
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise InvalidValue(f"{name} must be {shapes}, got {value!r}") from None
    if not np.isfinite(array).all():
        raise InvalidValue(f"{name} must be finite, got {value!r}")
    return array


def _rows(array: Array) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(float(entry) for entry in row) for row in array)


def as_noise(value: Noise | ArrayLike, plant: Plant, samples: int) -> Noise:
    """Return noise given plainly: a standard deviation, one an output, or samples (outputs, N + 1)."""
    if isinstance(value, Noise):
        return value
    outputs = len(plant.outputs)
    allowed = (
        f"a Noise, a standard deviation, one for each of the {outputs} output(s) of {plant.name}, or samples of shape "
        f"({outputs}, {samples})"
    )
    array = _numbers("noise", value, allowed)
    if array.ndim == 0:
        if outputs > 1 and len({signal.unit for signal in plant.outputs}) > 1:
            raise InvalidValue(f"noise must be one standard deviation an output, as their units differ, got {value!r}")
        return NormalNoise(sigma=float(array))
    if array.shape == (outputs,):
        return GaussianByOutput(sigmas=tuple(array.tolist()))
    if array.shape == (outputs, samples):
        return GivenNoise(values=_rows(array))
    raise InvalidValue(f"noise must be {allowed}; got shape {array.shape}")


def as_disturbance(value: Disturbance | ArrayLike, plant: Plant, samples: int) -> Disturbance:
    """Return disturbances given plainly: a constant, one a disturbance, or samples (disturbances, N)."""
    if isinstance(value, Disturbance):
        return value
    number = len(plant.disturbances)
    allowed = (
        f"a Disturbance, a constant, one for each of the {number} disturbance(s) of {plant.name}, or samples of shape "
        f"({number}, {samples})"
    )
    array = _numbers("disturbance", value, allowed)
    if array.ndim == 0 and number == 1:
        array = array.reshape(1)
    if array.shape == (number,):
        array = np.repeat(array[:, None], samples, axis=1)
    if array.shape != (number, samples):
        raise InvalidValue(f"disturbance must be {allowed}; got shape {array.shape}")
    return GivenDisturbance(values=_rows(array))


def as_initial(value: Initial | ArrayLike, plant: Plant, trials: int) -> Initial:
    """Return initial states given plainly: one number a state, or one row a trial."""
    if isinstance(value, Initial):
        return value
    number = len(plant.states)
    allowed = (
        f"an Initial, one number for each of the {number} state(s) of {plant.name}, or an array of shape "
        f"({trials}, {number}), a row a trial"
    )
    array = _numbers("initial", value, allowed)
    if array.ndim == 0 and number == 1:
        array = array.reshape(1)
    if array.shape == (number,):
        return From(state=tuple(array.tolist()))
    if array.shape == (trials, number):
        return GivenInitial(states=_rows(array))
    raise InvalidValue(f"initial must be {allowed}; got shape {array.shape}")


def as_plan(value: ArrayLike, inputs: int, samples: int) -> Array:
    """Return first inputs given plainly, (inputs, N): a constant, one an input, or samples (inputs, N) or (N,)."""
    allowed = f"an Inverse, a constant, one for each of {inputs} input(s), or samples of shape ({inputs}, {samples})"
    array = _numbers("first_plan", value, allowed)
    if array.shape in ((), (inputs,)):
        array = np.broadcast_to(array.reshape(-1, 1), (inputs, samples))
    if array.shape == (samples,) and inputs == 1:
        array = array[None, :]
    if array.shape != (inputs, samples):
        raise InvalidValue(f"first_plan must be {allowed}; got shape {array.shape}")
    return array.copy()


def as_departure(name: str, value: object) -> Departure:
    """Return a departure given plainly: a factor, or one a trial."""
    if isinstance(value, Departure):
        return value
    array = _numbers(f"truth.{name}", value, "a Departure, a factor, or factors, one a trial")
    return Times(factor=float(array)) if array.ndim == 0 else ByTrial(factors=tuple(array.ravel().tolist()))
