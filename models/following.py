"""The inputs with which a plant follows a reference: its inverse, sample after sample."""

from __future__ import annotations

import casadi as ca
import numpy as np

from models.array import Array
from models.errors import InvalidValue
from models.plant import Plant

STEPS = 60  # of Newton's method, a sample
CLOSE = 1e-9  # of the wanted output's size


def following(plant: Plant, reference: Array, x0: Array) -> Array:
    """Return inputs (nu, N) with which the outputs of an undisturbed plant are the reference from sample 1 on.

    ``reference`` has shape (ny, N + 1), ``x0`` (nx,). The input of sample k makes y(k + 1) right, by Newton's method.
    Raises InvalidValue where there are not as many inputs as outputs, or no input is found at some sample, as where
    the output answers later than at the next sample.
    """
    if len(plant.inputs) != len(plant.outputs):
        raise InvalidValue(
            f"only a plant with as many inputs as outputs has an inverse, {plant.name} has {len(plant.inputs)} and "
            f"{len(plant.outputs)}: give the first plan as numbers"
        )
    at = plant.symbols()
    x_next = plant.next_state(**at)
    y = plant.measured(x_next)
    step = ca.Function("step", list(at.values()), [x_next, y, ca.jacobian(y, at["u"])])
    w, x, u = np.zeros(len(plant.disturbances)), np.asarray(x0, dtype=float), np.zeros(len(plant.inputs))
    inputs = np.empty((len(plant.inputs), reference.shape[1] - 1))
    for k, wanted in enumerate(reference.T[1:]):
        miss = np.full(len(plant.outputs), np.inf)
        following_state = x
        for _ in range(STEPS):
            values = [value.full() for value in step(x, u, w, k)]
            following_state, miss, slope = values[0].ravel(), wanted - values[1].ravel(), values[2]
            whole = np.isfinite(miss).all() and np.isfinite(slope).all()
            if not whole or np.linalg.matrix_rank(slope) < len(u) or _close(miss, wanted):
                break
            u = u + np.linalg.solve(slope, miss)
        if not _close(miss, wanted):
            raise InvalidValue(
                f"no input was found with which {plant.name} follows the reference at sample {k + 1}: give the first "
                "plan as numbers"
            )
        inputs[:, k], x = u, following_state
    return inputs


def _close(miss: Array, wanted: Array) -> bool:
    return bool((np.abs(miss) <= CLOSE * np.maximum(1.0, np.abs(wanted))).all())
