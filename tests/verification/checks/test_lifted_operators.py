"""The lifted operators and bounds against dense ones: G from the trial's own derivative, L from differences."""

from __future__ import annotations

import subprocess
import sys
from typing import Any, ClassVar, NamedTuple

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.actuator import Delayed
from models.line import LINES
from models.metro_line import MetroLine
from models.plant import Plant
from models.point_mass import PointMass
from models.quantity import declared
from models.station_runs import StationRun
from models.transfer import Transfer
from verification.checks import convergence
from verification.checks.row_sums import off_diagonal, slope_bounds
from verification.enclosure.box import Box
from workbench.contracts.law import Law, Task, Trial
from workbench.contracts.study import Study
from workbench.contracts.trial_length import TrialLength
from workbench.controllers import CFDL, ICFDL, PD, Increment
from workbench.controllers.fixed_gain import FixedGain
from workbench.controllers.variable_gain import VariableGain
from workbench.evidence import ppd
from workbench.evidence.learning_operator import gain, memories
from workbench.evidence.lifted import Lifted, largest_singular_value
from workbench.evidence.trajectory import Linearisation, Lineariser, rollout
from workbench.fold.fold import build
from workbench.trials.campaign import run

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


PLANNING = [
    # name, law, plant, lengths
    ("pd", PD(force_unit=10.0), TRAIN, "uniform"),
    ("icfdl", ICFDL(), TRAIN, "uniform"),
    ("cfdl", CFDL(), TRAIN, "fixed"),
    ("increment", Increment(), TRAIN, "uniform"),
    ("fixed gain on the position", FixedGain(learns="position"), MetroLine(), "fixed"),
    ("fixed gain on the speed", FixedGain(), MetroLine(), "fixed"),
]
DENSE = [
    ("increment, filtered", Increment(q_cutoff_hz=1.0), TRAIN, "uniform"),
    ("variable gain, by the mean error", VariableGain(), MetroLine(), "fixed"),
]


def small(law: Any, plant: Plant, lengths: str, samples: int = 40) -> Any:
    study = Study(
        name="small",
        plant=plant,
        reference=StationRun().samples(plant)[:, : samples + 1]
        if len(plant.outputs) == 2
        else 3 * np.sin(np.linspace(0, 1.5, samples + 1)) ** 2,
        controllers={"law": law},
        trials=4,
        trial_length=TrialLength(law=lengths, minimum=30 if lengths == "uniform" else None),
    )
    return run(study, show_progress=False)


def meant(plant: Plant) -> str | None:
    """The output whose errors the gain is asked for: of several the first."""
    return plant.outputs[0].name if len(plant.outputs) > 1 else None


@pytest.mark.parametrize(("name", "law", "plant", "lengths"), PLANNING, ids=[row[0] for row in PLANNING])
def test_learning_gain_is_the_difference_quotient_of_learn(name, law, plant, lengths):
    """L against ``learn`` itself with one error moved at a time, the output (and so the estimate) held."""
    campaign = small(law, plant, lengths)
    study, n = campaign.study, campaign.study.horizon
    r = study.reference_samples
    *_, (memory, left) = memories(campaign, "law")
    length = left.length
    exact = gain(campaign, "law", memory, left, length, output=meant(plant)).toarray()
    reached = (np.arange(n + 1) <= length).astype(float)[None, :]
    kept = type(law.start(Task(ca.DM(r), study.plant.sampling_time)))(*(ca.DM(value) for value in memory))

    def plan(e: Any) -> Any:
        y = np.where(reached > 0, left.y, np.nan)
        learned = law.learn(kept, Trial(ca.DM(r), ca.DM(y), ca.DM(e), ca.DM(left.u), ca.DM(reached), ()))
        columns = [field if field.shape[1] == 1 else field[:, :n] for field in map(ca.DM, learned)]
        now = [
            type(learned)(*(column if column.shape[1] == 1 else column[:, k] for column in columns)) for k in range(n)
        ]
        return np.array(
            [float(ca.vertcat(law.act(one, (), r[:, k], r[:, k + 1], r[:, k])[0])[0]) for k, one in enumerate(now)]
        )

    error = np.where(reached > 0, r - left.y, np.nan)
    quotient = np.zeros_like(exact)
    for k in range(int(length) + 1):
        up, down = error.copy(), error.copy()
        up[0, k] += 0.5
        down[0, k] -= 0.5
        quotient[:, k] = plan(up) - plan(down)
    scale = max(np.abs(quotient).max(), 1e-12)
    np.testing.assert_allclose(exact, quotient, rtol=1e-7, atol=1e-9 * scale)
    assert (np.abs(quotient).max() > 1e-6) == (name != "fixed gain on the speed")


@pytest.mark.parametrize(("name", "law", "plant", "lengths"), DENSE, ids=[row[0] for row in DENSE])
def test_a_law_whose_plan_mixes_all_samples_has_no_banded_gain(name, law, plant, lengths):
    campaign = small(law, plant, lengths)
    *_, (memory, left) = memories(campaign, "law")
    assert gain(campaign, "law", memory, left, left.length, output=meant(plant)) is None


class Plan(NamedTuple):
    u: Any


class Sum(NamedTuple):
    y: Any


@declared
class Summing(Law):
    """A law that learns between trials and sums what it measures within them."""

    source: ClassVar[str] = "made for tests, 2026"
    learns_on: ClassVar[str] = "output"

    def start(self, task: Any) -> Plan:
        return Plan(ca.DM.zeros(1, task.samples))

    def ready(self, memory: Plan) -> Sum:
        return Sum(ca.DM(0))

    def act(self, memory_k: Plan, state: Sum, r: Any, r_next: Any, y: Any) -> tuple[Any, Sum]:
        return memory_k.u - 0.1 * state.y, Sum(state.y + y)

    def learn(self, memory: Plan, trial: Trial) -> Plan:
        return Plan(memory.u + 0.1 * trial.e[1:])


@declared
class Starting(Summing):
    """A law that learns where a trial begins, and does not act within it."""

    ready = Law.ready

    def act(self, memory_k: Plan, state: Any, r: Any, r_next: Any, y: Any) -> tuple[Any, Any]:
        return memory_k.u, ()

    def place(self, memory: Plan, x0: Any) -> Any:
        return x0 + 0.1 * memory.u[0]


@declared
class Leaning(Summing):
    """A law that feeds back within the trial, and keeps nothing there."""

    ready = Law.ready

    def act(self, memory_k: Plan, state: Any, r: Any, r_next: Any, y: Any) -> tuple[Any, Any]:
        return memory_k.u + 0.5 * (r - y), ()


NO_MAP = [
    (Summing(), "acts within the trial"),
    (Leaning(), "acts within the trial"),
    (Starting(), "moves the state in which a trial begins"),
]


@pytest.mark.parametrize(("law", "said"), NO_MAP, ids=["acts within", "feeds back", "moves the start"])
def test_a_law_that_does_more_than_plan_has_no_such_map(law, said):
    campaign = small(law, PLANTS[2][1], "fixed")
    found = convergence.error_map(campaign, ppd.evidence(campaign, "law"))
    assert isinstance(found, str) and said in found
