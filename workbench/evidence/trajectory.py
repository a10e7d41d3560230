"""Recorded trajectories of a campaign, and the plant's exact linearisation along them."""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from models.plant import Plant
from workbench.trials.campaign import Campaign


class Trajectories(NamedTuple):
    """What a controller's trials left; samples that a trial did not reach are NaN, except in ``u``."""

    x: Any
    """States, (trials, nx, N + 1)."""
    u: Any
    """First input, planned at every sample, (trials, N)."""
    y: Any
    """First output, (trials, N + 1)."""
    lengths: Any
    """Last sample reached, (trials,)."""
    estimate: Any
    """PPD estimate, (trials, N), NaN where the law has none."""


def trials_done(campaign: Campaign, controller: str) -> int:
    """Return how many trials a controller ran before it ended or diverged (the diverging one not counted)."""
    data = campaign.data.sel(controller=controller)
    finite = np.isfinite(data["mse"].values)
    done = int(finite.size if finite.all() else np.argmin(finite))
    diverged = float(data["diverged_at_trial"])
    return done if np.isnan(diverged) else min(done, int(diverged) - 1)


def recorded(campaign: Campaign, controller: str) -> Trajectories:
    """Return a controller's trajectories from the record; trials not run, and one that diverged, are left out.

    States that runs do not record (those of actuators, which begin at zero) come from running the plant again over
    the recorded inputs.
    """
    plant = campaign.study.plant
    data = campaign.data.sel(controller=controller)
    done = trials_done(campaign, controller)
    first = {signal.name: "" if i == 0 else f"_{signal.name}" for i, signal in enumerate(plant.outputs)}
    lengths = data["trial_length"].values[:done].astype(int)
    u = data["input"].values[:done, :-1]
    names = [f"output{first[s.name]}" if s.name in first else f"state_{s.name}" for s in plant.states]
    x = np.zeros((done, len(names), u.shape[1] + 1))
    for i, name in enumerate(names):
        if name in data:
            x[:, i] = data[name].values[:done]
    missing = [i for i, name in enumerate(names) if name not in data]
    for trial in range(done if missing else 0):
        again, _ = rollout(plant, x[trial, :, 0], np.nan_to_num(u[trial]))
        again[:, lengths[trial] + 1 :] = np.nan
        x[trial, missing] = again[missing]
    return Trajectories(
        x,
        u,
        data["output"].values[:done],
        lengths,
        data["ppd_estimate"].values[:done, :-1],
    )


class Linearisation(NamedTuple):
    """x(k+1) = A x(k) + B u(k), y(k) = C x(k) for differences along a trajectory of N samples."""

    a: Any
    """(N, nx, nx)."""
    b: Any
    """(N, nx), first input."""
    c: Any
    """(N + 1, nx), first output."""


class Lineariser:
    """The exact Jacobians of a plant along trajectories of N samples, evaluated all at once."""

    def __init__(self, plant: Plant, samples: int) -> None:
        at = plant.symbols()
        x_next = plant.next_state(**at)
        y = plant.measured(at["x"])
        slopes = [ca.jacobian(x_next, at["x"]), ca.jacobian(x_next, at["u"][0]), ca.jacobian(y[0], at["x"])]
        one = ca.Function("along", list(at.values()), [ca.densify(slope) for slope in slopes])
        self.samples, self.nx, self.nu = samples, len(plant.states), len(plant.inputs)
        self._w = np.zeros((len(plant.disturbances), samples + 1))
        self._all = one.map(samples + 1)

    def at(self, x: Any, u: Any) -> Linearisation:
        """Return the linearisation along x (nx, N + 1) and u (N,); what is NaN in x stays NaN."""
        n, nx = self.samples, self.nx
        inputs = np.zeros((self.nu, n + 1))
        inputs[0, :n] = u
        a, b, c = (value.full() for value in self._all(x, inputs, self._w, np.arange(n + 1)))
        return Linearisation(a.reshape(nx, n + 1, nx).transpose(1, 0, 2)[:n], b.T[:n], c.reshape(1, n + 1, nx)[0])


def partial(line: Linearisation, degree: int) -> Any:
    """Return dy(k+d)/du(k) for k = 0..N-d, (N - d + 1,): the exact partial derivative along a trajectory."""
    n = line.b.shape[0]
    last = n - degree + 1
    row = line.c[degree:]
    for step in range(degree - 1, 0, -1):
        row = np.einsum("ki,kij->kj", row, line.a[step : step + last])
    result: Any = np.einsum("ki,ki->k", row, line.b[:last])
    return result


def rollout(plant: Plant, x0: Any, u: Any) -> tuple[Any, Any]:
    """Run a plant over inputs u (N,) from x0 (nx,): states (nx, N + 1) and first output (N + 1,)."""
    at = plant.symbols()
    n = len(u)
    fold = ca.Function("step", list(at.values()), [plant.next_state(**at)]).mapaccum("rollout", n)
    inputs = np.zeros((len(plant.inputs), n))
    inputs[0] = u
    states = fold(np.asarray(x0, dtype=float), inputs, np.zeros((len(plant.disturbances), n)), np.arange(n)).full()
    x = np.column_stack([np.asarray(x0, dtype=float), states])
    return x, plant.output_function().map(n + 1)(x).full()[0]
