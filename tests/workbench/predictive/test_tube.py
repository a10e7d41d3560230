"""The design of a tube against sums written out, a second equation solver and the conditions of the paper."""

from __future__ import annotations

import numpy as np
import pytest
from brake_tubes import brake_matrices, brake_tube, integrator_tube
from control import dlqr
from scipy.linalg import solve_discrete_are

from models.quantity import InvalidValue
from workbench.predictive.delayed_plant import DelayedPlant
from workbench.predictive.disturbance_model import DisturbanceModel
from workbench.predictive.regulator import decrease, lmi, lqr, terminal_weight, unstabilizable
from workbench.predictive.tube import Tube
from workbench.sets import Polytope, Zonotope

power = np.linalg.matrix_power


def test_gain_agrees_with_python_control(tube):
    K, P = lqr(tube.plant.A, tube.plant.b, tube.Q, tube.R)
    gain, S, _ = dlqr(tube.plant.A, tube.plant.b[:, None], tube.Q, [[tube.R]])
    assert np.allclose(K, -gain[0], atol=1e-9) and np.allclose(P, S, rtol=1e-9)
    A_cl = tube.plant.A + np.outer(tube.plant.b, K)
    assert np.allclose(terminal_weight(A_cl, K, tube.Q, tube.R), P, rtol=1e-7)  # the LQR's own weight


def test_terminal_weight_has_equality_and_the_lmi_agrees(tube):
    scale = np.abs(tube.P).max()
    assert np.abs(decrease(tube.A_cl, tube.K, tube.Q, tube.R, tube.P)).max() <= 1e-9 * scale
    assert np.linalg.eigvalsh(lmi(tube.A_cl, tube.K, tube.Q, tube.R, tube.P))[0] >= -1e-8 * scale
    short = 0.9 * tube.P
    assert np.linalg.eigvalsh(decrease(tube.A_cl, tube.K, tube.Q, tube.R, short))[-1] > 0
    assert np.linalg.eigvalsh(lmi(tube.A_cl, tube.K, tube.Q, tube.R, short))[0] < 0


def test_hurwitz_is_the_wrong_test(brake_a):
    values = np.linalg.eigvals(brake_a.A_cl)
    assert np.abs(values).max() < 1 and values.real.max() > 0  # printed "Hurwitz" would reject this gain


def test_tube_sets_are_the_sums_written_out(tube):
    plant = tube.plant
    directions = np.random.default_rng(0).normal(size=(12, plant.order))

    def support(matrices):
        return sum((plant.W.support(directions @ matrix) for matrix in matrices), np.zeros(12))

    A_l = power(plant.A, plant.delay)
    for i in range(8):
        assert np.allclose(tube.F(i).support(directions), support(power(tube.A_cl, j) @ A_l for j in range(i)))
        for M in range(1, 5):
            held = [power(plant.A, j) @ A_l for j in range(min(i, M))]
            after = [power(tube.A_cl, j) @ A_l for j in range(i - M)]
            expected = support([*(power(tube.A_cl, max(i - M, 0)) @ m for m in held), *after])
            assert np.allclose(tube.R_hold(M, i).support(directions), expected)
    assert np.allclose(tube.R_hold(1, 6).support(directions), tube.F(6).support(directions))


def test_prediction_and_its_error(tube):
    plant, random = tube.plant, np.random.default_rng(1)
    pending = random.normal(size=plant.delay)
    x = start = random.normal(size=plant.order)
    w = plant.W.sample(plant.delay, seed=3)
    for du, push in zip(pending, w, strict=True):
        x = plant.A @ x + plant.b * du + push
    gap = x - plant.predict(start, pending)
    assert plant.prediction_error.contains(gap, tolerance=1e-7)
    assert np.all(tube.bounds.h - tube.X_z.h >= 0) or np.any(plant.W.center != 0)


def test_brake_bounds_by_hand():
    """Without feedback a constant resistance of r moves v by -r l T and s by -r (l T)^2 / 2: l T = 1 s."""
    tube = brake_tube()
    assert np.allclose(tube.bounds.h - tube.X_z.h, [0, 0, 0.06, 0.30, 0.03, 0.15], atol=1e-12)


def test_negative_controls_differ_from_the_tube():
    tube, late, blind = brake_tube(), brake_tube(index_off_by_one=True), brake_tube(ignore_delay=True)
    directions = np.eye(4)
    assert np.allclose(late.F(3).support(directions), tube.F(4).support(directions))
    assert np.allclose(blind.F(1).support(directions), tube.plant.W.support(directions))
    assert np.array_equal(blind.X_z.h, tube.bounds.h)


def test_held_conflicts_name_the_set():
    reasons = brake_tube("B").held_conflicts(15, contained=False)
    assert min(reasons) == 10 and "X_z - R_13^10 is empty: 'u <= 0.53271' and 'u >= -1.46729'" in reasons[10]
    tube = brake_tube("A")
    assert not tube.held_conflicts(15, contained=False)
    reasons = tube.held_conflicts(15)
    assert sorted(reasons) == [12, 13, 14] and reasons[12].startswith("(27) fails: R_27^12 leaves Sigma through 'u")
    face = tube.Sigma.labels.index(tube.held_excess(12, 15).label)
    corner = tube.R_hold(12, 27).extreme(tube.Sigma.H[face])
    assert not tube.Sigma.contains(corner) and np.isclose(tube.Sigma.violation(corner), tube.held_excess(12, 15).share)


def test_shift_makes_a_constant_disturbance_vanish():
    tube = brake_tube()
    E = brake_matrices().E
    model = DisturbanceModel(plant=tube.plant, E=E, Q=tube.Q)
    assert np.allclose(model.shift, [1, 1 / -1.07, 0, 0])  # the brake makes up for a_r: a_c = d, u = d / c
    x, d = np.random.default_rng(0).normal(size=4), 0.17
    after = tube.plant.A @ x + tube.plant.b * 0.3 + E * d
    assert np.isclose(model.estimate(x, 0.3, after), d)
    assert np.allclose(after - model.shift * d, tube.plant.A @ (x - model.shift * d) + tube.plant.b * 0.3)


W0 = Zonotope.point([0.0, 0.0])
DOUBLE = {"A": np.array([[1.0, 1.0], [0.0, 1.0]]), "b": np.array([0.5, 1.0])}


def designed(**change):
    tube = integrator_tube()
    fields = {name: getattr(tube, name) for name in ("plant", "bounds", "Q", "R", "K", "P")}
    return Tube(**{**fields, **change})


FAILURES = {
    "must be stabilisable, got the eigenvalue 1.2": lambda: DelayedPlant(
        A=np.diag([1.2, 0.5]), b=np.array([0.0, 1.0]), W=W0
    ),
    "must be stabilisable, got the eigenvalue 1": lambda: lqr(np.eye(2), [0, 1.0], np.eye(2), 1.0),
    "delay must be a whole number of samples, at least 0, got 2.5": lambda: DelayedPlant(**DOUBLE, W=W0, delay=2.5),
    "delay must be a whole number of samples, at least 0, got -1": lambda: DelayedPlant(**DOUBLE, W=W0, delay=-1),
    "W must lie in the space of the 2 states, got dimension 1": lambda: DelayedPlant(**DOUBLE, W=Zonotope.point([0.0])),
    "the state must be finite, got v = nan": lambda: integrator_tube().plant.predict([0, np.nan], [0.0]),
    r"pending must have shape \(1\), got \(2,\)": lambda: integrator_tube().plant.predict([0, 0], [0.0, 0.0]),
    "A . b K must be Schur .spectral radius below 1., got 1": lambda: designed(K=np.zeros(2)),
    "P must satisfy .19.": lambda: designed(P=np.zeros((2, 2))),
    "Q must be positive semidefinite, got the eigenvalue -1": lambda: designed(Q=-np.eye(2)),
    "Q must be symmetric": lambda: designed(Q=np.array([[1.0, 0.5], [0.0, 1.0]])),
    "R must be positive, got 0": lambda: designed(R=0.0),
    "bounds must be on the plant's 2 states, got dimension 1": lambda: designed(bounds=Polytope.box([-1], [1])),
    "the disturbance alone carries the closed loop beyond 'v <= 1' by 1.45274; make W smaller": lambda: integrator_tube(
        reach=0.3
    ),
    "over 1 samples of delay are empty: 'v <= 1' and 'v >= -1' cannot both hold: they miss by 4": (
        lambda: integrator_tube(reach=3.0)
    ),
    "no stabilising gain|must be Schur": lambda: lqr(DOUBLE["A"], DOUBLE["b"], np.zeros((2, 2)), 1.0),
    "horizon N must be a whole number of at least 2, got 1": lambda: integrator_tube().held_conflicts(1),
    "M must be at least 1, got 0": lambda: integrator_tube().R_hold(0, 3),
    "E must not be zero": lambda: DisturbanceModel(plant=integrator_tube().plant, E=np.zeros(2), Q=np.eye(2)),
    "must leave the plant a rest, got 1 that no input makes up for": lambda: DisturbanceModel(
        plant=DelayedPlant(A=np.diag([1.0, 0.5]), b=np.ones(2), W=W0), E=np.array([1.0, 0.0]), Q=np.eye(2)
    ),
}


@pytest.mark.parametrize("message", sorted(FAILURES))
def test_bad_input_is_told(message):
    with pytest.raises(InvalidValue, match=message):
        FAILURES[message]()


def test_an_unstable_plant_that_the_input_reaches_is_taken():
    plant = DelayedPlant(A=np.array([[1.2]]), b=np.array([1.0]), W=Zonotope.segment([1.0], -0.01, 0.01), delay=2)
    tube = Tube.from_lqr(plant=plant, bounds=Polytope.box([-1], [1]), Q=np.eye(1), R=1.0)
    assert np.allclose(tube.P, solve_discrete_are([[1.2]], [[1.0]], [[1.0]], [[1.0]]))
    assert not unstabilizable(plant.A, plant.b).size
