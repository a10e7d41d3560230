"""Tracking MPC against least squares, another solver, and in closed loop on linear and nonlinear plants."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import piqp
import pytest

from models.actuator import Delayed, Saturated
from models.plant import Plant, signals
from models.point_mass import PointMass
from models.quantity import InvalidValue, declared, quantity
from workbench.fold import TrialInput
from workbench.predictive.tracking_mpc import Last, TrackingMPC, stepped_trial


@declared
class Cart(Plant):
    """Speed and position under a force, disturbed by a constant that nobody tells the law."""

    source: ClassVar[str] = "test, 2022"
    states = signals(speed="m/s", position="m")
    inputs = signals(force="N")
    outputs = signals(position="m")
    disturbances = signals(push="N")
    sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)
    drag: float = quantity(default=0.2, unit="1/s", doc="drag", least=0)

    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        speed, position = x
        after = speed + self.sampling_time * (u.force + w.push - self.drag * speed)
        return after, position + self.sampling_time * after

    def output(self, x: Any) -> Any:
        return (x.position,)


def written_out(law, x, before, u, y, ahead):
    """The same problem by simulating every unit move on the increments and least squares over all of them."""
    T, drag = 0.1, 0.2
    A = np.array([[1 - T * drag, 0], [T * (1 - T * drag), 1]])
    B, C = np.array([T, T * T]), np.array([0.0, 1.0])

    def outputs(dx, moves):
        path, level = [], y
        for move in moves:
            dx = A @ dx + B * move
            level = level + C @ dx
            path.append(level)
        return np.array(path)

    free = outputs(x - before, np.zeros(law.N)) - ahead
    gains = np.stack([outputs(np.zeros(2), row) - y for row in np.eye(law.N)], axis=1)
    H = 2 * (law.error_weight * gains.T @ gains + law.move_weight * np.eye(law.N))
    total = np.tril(np.ones((law.N, law.N)))
    solver = piqp.DenseSolver()
    solver.settings.eps_abs = solver.settings.eps_rel = 1e-12
    low, high = np.full(law.N, law.lower - u), np.full(law.N, law.upper - u)
    f = 2 * law.error_weight * gains.T @ free
    solver.setup(np.asfortranarray(H), f, None, None, np.asfortranarray(total), low, high)
    assert solver.solve() == piqp.PIQP_SOLVED
    return u + solver.result.x[0]


@pytest.mark.parametrize("limit", [100.0, 0.3])
def test_input_agrees_with_another_solver(limit):
    law = TrackingMPC(N=12, move_weight=0.02, lower=-limit, upper=limit)
    made, random = law.prepare(Cart(), [0, 0], [0]), np.random.default_rng(0)
    for _ in range(20):
        x, before, u, ahead = (
            random.normal(size=2),
            random.normal(size=2),
            random.uniform(-0.3, 0.3),
            random.normal(size=12),
        )
        decided, last, reason = made.decide(Last(before, np.array([u])), x, x[1:], ahead[None])
        assert decided[0] == pytest.approx(written_out(law, x, before, u, x[1], ahead), abs=1e-6)
        assert reason == "" and last.u[0] == decided[0] and abs(decided[0]) <= limit


def trial(plant, law, r, push=0.0, **options):
    n = r.shape[1] - 1
    nw, nx = len(plant.disturbances), len(plant.states)
    one = TrialInput(n, np.zeros(nx), np.full((nw, n), push), np.zeros((len(plant.outputs), n + 1)))
    return stepped_trial(plant, law, r, one, **options)


def test_a_constant_disturbance_leaves_no_offset():
    r = np.minimum(np.arange(201) * 0.02, 1.0)[None, :]
    left = trial(Cart(), TrackingMPC(N=20, move_weight=0.01), r, push=-0.4)
    assert abs(left.y[0, -1] - 1) < 1e-4 and left.u[0, -1] == pytest.approx(0.4, abs=1e-3)
    assert left.mse == pytest.approx(np.mean((r - left.y)[0, 1:] ** 2))


def test_limits_are_kept_and_actuators_recorded():
    r = np.ones((1, 121))
    plant = Saturated(plant=Delayed(plant=Cart(), samples=3), lower=-0.5, upper=0.5)
    left = trial(plant, TrackingMPC(N=25, move_weight=0.05, lower=-0.4, upper=0.4), r)
    assert np.abs(left.u).max() <= 0.4 and left.applied.shape == left.u.shape
    assert abs(left.y[0, -1] - 1) < 0.02


def test_it_tracks_a_nonlinear_train():
    plant = PointMass()
    r = np.minimum(np.arange(301) * 0.3, 60.0)[None, :]
    law = TrackingMPC(N=10, error_weight=1.0, move_weight=1e-12, lower=-400e3, upper=400e3)
    left = trial(plant, law, r, prepared=law.prepare(plant, [10.0, 100.0], [0.0]))
    assert np.abs(r - left.y)[0, 20:].max() < 0.2


def test_a_trial_that_ends_early_is_missing_after_its_end():
    one = TrialInput(5, np.zeros(2), np.zeros((1, 10)), np.zeros((1, 11)))
    left = stepped_trial(Cart(), TrackingMPC(N=5), np.ones((1, 11)), one)
    assert np.isfinite(left.y[0, :6]).all() and np.isnan(left.y[0, 6:]).all() and np.isnan(left.u[0, 5:]).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"N": 0}, "N must lie in"),
        ({"lower": 1.0, "upper": 1.0}, "lower must be below upper"),
        ({"move_weight": 0}, "move_weight must lie in"),
    ],
)
def test_bad_settings_are_told(change, message):
    with pytest.raises(InvalidValue, match=message):
        TrackingMPC(**change)


def test_a_horizon_within_the_dead_time_and_a_lost_state_are_told():
    with pytest.raises(InvalidValue, match="horizon N must exceed the dead time of delayed, got 3"):
        TrackingMPC(N=3).prepare(Delayed(plant=Cart(), samples=3), [0] * 5, [0])
    made = TrackingMPC(N=3).prepare(Cart(), [0, 0], [0])
    with pytest.raises(InvalidValue, match="x must be finite, got nan"):
        made.decide(Last(np.zeros(2), np.zeros(1)), [np.nan, 0], [0.0], np.zeros((1, 3)))
