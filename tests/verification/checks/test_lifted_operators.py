"""The lifted plant and its bounds against dense ones: G from the trial's own derivative."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.actuator import Delayed
from models.line import LINES
from models.plant import Plant
from models.point_mass import PointMass
from models.transfer import Transfer
from verification.checks.row_sums import off_diagonal, slope_bounds
from verification.enclosure.box import Box
from workbench.controllers import PD
from workbench.evidence.lifted import Lifted, largest_singular_value
from workbench.evidence.trajectory import Linearisation, Lineariser, rollout
from workbench.fold.fold import build

N = 120
TRAIN = PointMass(line=LINES["hilly"])
UNDER_WAY = [60.0, 650.0]  # km/h and m: grades begin and end within the trial
PLANTS: list[tuple[str, Plant, list[float], int]] = [
    ("train", TRAIN, UNDER_WAY, 1),
    (
        "train with a dead time of 3 samples",
        Delayed(plant=TRAIN, dead_time=3 * TRAIN.sampling_time),
        [*UNDER_WAY, 0.0, 0.0, 0.0],
        4,
    ),
    ("second order", Transfer(numerator=(2.0,), denominator=(1.0, 0.6, 4.0)), [0.3, -0.2], 1),
]


def dense(plant: Plant, x0: list[float], u: Any, increment: bool) -> Any:
    """Return every output's derivative by every input, (N + 1, N), from the trial Function that campaigns run."""
    fold = build(plant, PD(force_unit=1.0), u.size)
    slope = fold.trial.factory("slope", fold.trial.name_in(), ["jac:y:memory_u"])
    begun = fold.start.call({"r": np.zeros((1, u.size + 1)), "sampling_time": 1.0, "p": ca.DM(fold.values)})
    given = {
        **{name: begun[name] for name in fold.memory},
        "memory_u": u,
        "x0": x0,
        "length": u.size,
        "r": np.zeros((1, u.size + 1)),
        "w": 0,
        "noise": 0,
        "p": fold.values,
    }
    given = {name: value for name, value in given.items() if name in slope.name_in() and 0 not in slope.size_in(name)}
    full = ca.DM(slope.call(given)["jac_y_memory_u"]).full()
    return np.vstack([np.full((1, u.size), np.nan), np.diff(full, axis=0)]) if increment else full


@pytest.mark.parametrize("increment", [False, True], ids=["output", "increment"])
@pytest.mark.parametrize(("name", "plant", "x0", "degree"), PLANTS, ids=[row[0] for row in PLANTS])
def test_lifted_plant_is_the_derivative_of_the_trial(name, plant, x0, degree, increment):
    rng = np.random.default_rng(3)
    u = rng.normal(size=N) * (1e5 if "train" in name else 1.0)
    assert plant.relative_degree() == degree
    whole = Lifted(Lineariser(plant, N).at(rollout(plant, x0, u)[0], u), degree, increment=increment)
    m = whole.size
    exact = dense(plant, x0, u, increment)[degree:, :m]
    scale = np.abs(exact).max()
    assert exact.shape == (m, m) and np.abs(np.triu(exact, 1)).max() == 0
    applied = np.array([whole.apply(column) for column in np.eye(m)]).T
    np.testing.assert_allclose(applied, exact, rtol=1e-9, atol=1e-12 * scale)
    np.testing.assert_allclose(
        np.array([whole.adjoint(row) for row in np.eye(m)]), exact, rtol=1e-9, atol=1e-12 * scale
    )
    np.testing.assert_allclose(whole.diagonal(), np.diag(exact), rtol=1e-9)
    off, own = whole.row_sums()
    np.testing.assert_allclose(off, np.abs(np.tril(exact, -1)).sum(axis=1), rtol=1e-9, atol=1e-12 * scale)
    np.testing.assert_allclose(own, np.abs(np.diag(exact)), rtol=1e-9)
    largest = np.linalg.svd(exact)[1][0]
    found = largest_singular_value(whole.apply, whole.adjoint, m, np.inf)
    assert found.value == pytest.approx(largest, rel=1e-8)


BOUNDS = [
    # plant, ranges of the states and of the input
    ("flat", PointMass(line=LINES["flat"]), ([-10.0, 0.0], [80.0, 3500.0]), (-4e5, 4e5)),
    ("hilly", TRAIN, ([0.0, 0.0], [80.0, 3500.0]), (-4e5, 4e5)),
    ("second order", Transfer(numerator=(2.0,), denominator=(1.0, 0.6, 4.0)), ([-1.0, -1.0], [1.0, 1.0]), (-1.0, 1.0)),
]


@pytest.fixture(scope="module")
def bounded() -> dict[tuple[str, bool], Any]:
    found = {}
    for name, plant, x, u in BOUNDS:
        box = Box({"x": (np.array(x[0]), np.array(x[1])), "u": u, "w": (np.zeros(0), np.zeros(0)), "k": (0.0, 60.0)})
        for increment in (False, True):
            found[name, increment] = slope_bounds(plant, box, increment=increment)
    return found


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.8, 1.0))
@pytest.mark.parametrize("increment", [False, True], ids=["output", "increment"])
@pytest.mark.parametrize(("name", "plant", "x", "u"), BOUNDS, ids=[row[0] for row in BOUNDS])
def test_row_sum_bounds_hold_for_every_state_in_the_box(bounded, name, plant, x, u, increment, seed, weight):
    """States drawn anywhere in the box at every sample: more than any trajectory can do."""
    n = 60
    rng = np.random.default_rng(seed)
    states = rng.uniform(np.array(x[0])[:, None], np.array(x[1])[:, None], (2, n + 1))
    line = Lineariser(plant, n).at(states, rng.uniform(*u, n))
    whole = Lifted(line, 1, increment=increment)
    g = np.array([whole.apply(column) for column in np.eye(n)]).T
    powers = weight ** np.maximum(np.subtract.outer(np.arange(n), np.arange(n)), 0)
    slopes = bounded[name, increment]
    assert slopes.reason is None
    assert (np.abs(np.tril(g * powers, -1)).sum(axis=1) <= off_diagonal(slopes, n, weight) * (1 + 1e-12)).all()
    assert (np.diag(g) >= slopes.gain_low * (1 - 1e-12)).all()
    assert (np.diag(g) <= slopes.gain_high * (1 + 1e-12)).all()


def test_row_sum_bound_would_show_a_bound_that_is_too_small(bounded):
    """The bound is reached where the slopes do not vary, so a smaller one would be beaten."""
    plant, slopes = BOUNDS[2][1], bounded["second order", False]
    one = Lineariser(plant, 60).at(np.zeros((2, 61)), np.zeros(60))
    positive = Linearisation(np.abs(one.a), np.abs(one.b), np.abs(one.c))
    np.testing.assert_allclose(Lifted(positive).row_sums()[0], off_diagonal(slopes, 60), rtol=1e-9)


MEMORY = """
import resource, sys
import numpy as np
from models.point_mass import PointMass
from workbench.evidence.lifted import Lifted, largest_singular_value
from workbench.evidence.trajectory import Lineariser

n = int(sys.argv[1])
plant = PointMass()
u = 1e5 * np.cos(np.arange(n) / n)
x = np.stack([np.linspace(0, 70, n + 1), np.linspace(0, 3500, n + 1)])
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for increment in (False, True):
    g = Lifted(Lineariser(plant, n).at(x, u), 1, increment=increment)
    found = largest_singular_value(g.apply, g.adjoint, g.size, np.inf)
    assert found.residual < 1e-3 * found.value
g.row_sums()
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024)
"""


def test_memory_is_linear_in_the_samples():
    """At N = 20 000 a dense matrix takes 3.2 GB, the lifted plant a hundredth."""

    def megabytes(samples: int) -> float:
        done = subprocess.run(
            [sys.executable, "-c", MEMORY, str(samples)], capture_output=True, text=True, timeout=300, check=True
        )
        return float(done.stdout)

    assert megabytes(20_000) < 150
