"""Recorded trajectories of a campaign, and the plant's exact linearisation along them."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from models.array import Array
from models.plant import Plant
from models.quantity import InvalidValue
from workbench.trials.campaign import Campaign


class Trajectories(NamedTuple):
    """What a controller's trials left; samples that a trial did not reach are NaN, except in ``u``."""

    x: Array
    """States, (trials, nx, N + 1)."""
    u: Array
    """The input, planned at every sample, (trials, N)."""
    y: Array
    """The output, (trials, N + 1)."""
    lengths: NDArray[np.int64]
    """Last sample reached, (trials,)."""
    estimate: Array
    """PPD estimate, (trials, N), NaN where the law has none."""
    w: Array
    """Disturbances, (trials, nw, N)."""


def one_channel(plant: Plant) -> str | None:
    """Return why what is computed for one input and one output cannot be computed for a plant, or None."""
    if len(plant.inputs) == len(plant.outputs) == 1:
        return None
    there = [
        f"{len(named)} {word}(s) ({', '.join(one.name for one in named)})"
        for named, word in ((plant.inputs, "input"), (plant.outputs, "output"))
    ]
    return f"this is for one input and one output, {plant.name} has {' and '.join(there)}"


def trials_done(campaign: Campaign, controller: str) -> int:
    """Return how many trials a controller ran before it ended or diverged (the diverging one not counted)."""
    data = campaign.data.sel(controller=controller)
    finite = np.isfinite(data["mse"].values).reshape(data.sizes["trial"], -1).all(axis=1)
    done = int(finite.size if finite.all() else np.argmin(finite))
    diverged = float(data["diverged_at_trial"])
    return done if np.isnan(diverged) else min(done, int(diverged) - 1)


def recorded(campaign: Campaign, controller: str) -> Trajectories:
    """Return a controller's trajectories from the record; trials not run, and one that diverged, are left out.

    States that runs do not record (those of actuators, which begin at zero) come from running the plant again over
    the recorded inputs and disturbances. Raises InvalidValue for a plant with several channels.
    """
    study = campaign.study
    plant = study.plant_that_runs
    if (several := one_channel(plant)) is not None:
        raise InvalidValue(f"of trajectories: {several}; look at one input and one output, as a plant of its own")
    data = campaign.data.sel(controller=controller)
    done = trials_done(campaign, controller)
    lengths = data["trial_length"].values[:done].astype(np.int64)
    u = data["input"].values[:done, :-1]
    inputs = study.inputs()[:done]
    w = np.stack([one.w for one in inputs]) if done else np.zeros((0, len(plant.disturbances), u.shape[1]))
    x = np.zeros((done, len(plant.states), u.shape[1] + 1))
    missing = []
    for i, signal in enumerate(plant.states):
        if signal.recorded:
            x[:, i] = data[f"state_{signal.name}"].values[:done]
        else:
            missing.append(i)
    for trial in range(done if missing else 0):
        begin = x[trial, :, 0].copy()
        if study.continues and trial:
            begin[missing] = x[trial - 1, missing, lengths[trial - 1]]
        again, _ = rollout(plant, begin, np.nan_to_num(u[trial]), w[trial])
        again[:, lengths[trial] + 1 :] = np.nan
        x[trial, missing] = again[missing]
    return Trajectories(x, u, data["output"].values[:done], lengths, data["ppd_estimate"].values[:done, :-1], w)


class Linearisation(NamedTuple):
    """x(k+1) = A x(k) + B u(k), y(k) = C x(k) for differences along a trajectory of N samples."""

    a: Array
    """(N, nx, nx)."""
    b: Array
    """(N, nx), by the input."""
    c: Array
    """(N + 1, nx), of the output."""


class Lineariser:
    """The exact Jacobians of a plant along trajectories of N samples, evaluated all at once.

    Raises InvalidValue for a plant with several channels.
    """

    def __init__(self, plant: Plant, samples: int) -> None:
        if (several := one_channel(plant)) is not None:
            raise InvalidValue(f"of linearisations: {several}; look at one input and one output, as a plant of its own")
        at = plant.symbols()
        x_next = plant.next_state(**at)
        y = plant.measured(at["x"])
        slopes = [ca.jacobian(x_next, at["x"]), ca.jacobian(x_next, at["u"]), ca.jacobian(y, at["x"])]
        one = ca.Function("along", list(at.values()), [ca.densify(slope) for slope in slopes])
        self.samples, self.nx, self.nw = samples, len(plant.states), len(plant.disturbances)
        self._all = one.map(samples + 1)

    def at(self, x: Array, u: Array, w: Array | None = None) -> Linearisation:
        """Return the linearisation along x (nx, N + 1), u (N,) and w (nw, N), zero by default.

        It is NaN where x is, also of a plant whose slopes do not depend on x.
        """
        n, nx = self.samples, self.nx
        inputs = np.zeros((1, n + 1))
        inputs[0, :n] = u
        met = np.zeros((self.nw, n + 1))
        if w is not None:
            met[:, :n] = w
        a, b, c = (value.full() for value in self._all(x, inputs, met, np.arange(n + 1)))
        found = Linearisation(
            a.reshape(nx, n + 1, nx).transpose(1, 0, 2)[:n].copy(), b.T[:n].copy(), c.reshape(1, n + 1, nx)[0].copy()
        )
        gone = np.asarray(np.isnan(x).any(axis=0))
        for value in found:
            value[gone[: len(value)]] = np.nan
        return found


def partial(line: Linearisation, degree: int) -> Array:
    """Return dy(k+d)/du(k) for k = 0..N-d, (N - d + 1,): the exact partial derivative along a trajectory."""
    n = line.b.shape[0]
    last = n - degree + 1
    row = line.c[degree:]
    for step in range(degree - 1, 0, -1):
        row = np.einsum("ki,kij->kj", row, line.a[step : step + last])
    result: Array = np.einsum("ki,ki->k", row, line.b[:last])
    return result


def rollout(plant: Plant, x0: Array, u: Array, w: Array | None = None) -> tuple[Array, Array]:
    """Run a plant over inputs u (N,) from x0 (nx,): states (nx, N + 1) and output (N + 1,).

    ``w`` (nw, N) are the disturbances, zero by default. Raises InvalidValue for a plant with several channels.
    """
    if (several := one_channel(plant)) is not None:
        raise InvalidValue(f"of runs over inputs: {several}; look at one input and one output, as a plant of its own")
    at = plant.symbols()
    n = len(u)
    fold = ca.Function("step", list(at.values()), [plant.next_state(**at)]).mapaccum("rollout", n)
    met = np.zeros((len(plant.disturbances), n)) if w is None else w
    states = fold(np.asarray(x0, dtype=float), np.asarray(u, dtype=float)[None, :], met, np.arange(n)).full()
    x = np.column_stack([np.asarray(x0, dtype=float), states])
    return x, plant.output_function().map(n + 1)(x).full()[0]
