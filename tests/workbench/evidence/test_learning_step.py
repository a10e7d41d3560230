"""The step from plan to plan against the compiled trial itself: every entry by a difference of two campaigns."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from learning_laws import (
    Curved,
    Feeding,
    Forgetting,
    Full,
    Late,
    Older,
    Overall,
    Planned,
    Second,
    Shifted,
    Starting,
)

from models.actuator import Actuator
from models.line import LINES
from models.maglev import Maglev
from models.metro_line import MetroLine
from models.point_mass import PointMass
from models.station_runs import StationRun
from workbench.contracts.law import Law
from workbench.contracts.study import Study
from workbench.contracts.trial_length import TrialLength
from workbench.controllers import CFDL, ICFDL, PD, Increment
from workbench.controllers.fixed_gain import FixedGain
from workbench.controllers.palc import PALC
from workbench.controllers.palc_filtered import FilteredPALC
from workbench.controllers.pid import PID
from workbench.controllers.variable_gain import VariableGain
from workbench.evidence.error_signal import Signal
from workbench.evidence.learning_step import LearningStep, learning_step, memories
from workbench.fold.fold import stream
from workbench.trials.campaign import Campaign, run

N = 24
MATRIX = 0.2 * np.random.default_rng(5).standard_normal((N, N)) + 0.6 * np.eye(N)
SMOOTH = {"force_unit": 1.0, "lam": 1.0, "initial_input": 0.3, "phi0": 0.5, "mu": 1.0, "eta": 0.5}
RIDE = np.sin(np.linspace(0, 2.5, N + 1)) ** 2


def campaign(law: Law, plant: Any, trials: int = 3, **changes: Any) -> Campaign:
    reference = StationRun().samples(plant)[:, : N + 1] if len(plant.outputs) == 2 else RIDE
    study = Study(name="small", plant=plant, reference=reference, controllers={"law": law}, trials=trials, **changes)
    return run(study, show_progress=False)


def step_of(ran: Campaign, *, held: bool = True) -> LearningStep:
    *_, last = memories(ran, "law")
    found = learning_step(ran, "law", last, held=held)
    assert isinstance(found, LearningStep), found
    return found


def two_trials(ran: Campaign, step: LearningStep, v: Any, r: Any = None) -> tuple[Any, Any, Any]:
    """Run the last trial again from other values of what is learned; errors of it and the next, and the next v."""
    one = step.ran.given._replace(length=ran.study.horizon)
    r = ran.study.reference_samples if r is None else r
    memory = step.learned.put(step.ran.memory, v)
    first, second = stream(ran.runner("law").fold, r, [one, one], memory=memory, keep_memory=True)
    return (r - first.y).ravel(order="F"), (r - second.y).ravel(order="F"), step.learned.stacked(second.memory)


def quotients(values: Any, at: Any, size: float) -> Any:
    """Return difference quotients of several vectors, a matrix each, column by column."""
    columns = []
    for one in np.eye(at.size):
        up, down = values(at + size * one), values(at - size * one)
        columns.append([(a - b) / (2 * size) for a, b in zip(up, down, strict=True)])
    return [np.array(column).T for column in zip(*columns, strict=True)]


VARYING = {"trial_length": TrialLength(law="uniform", minimum=18)}
LAWS: list[tuple[str, Law, Any, dict[str, Any], bool]] = [
    # name, law, plant, changes, whether M = I
    ("pd", PD(kp=0.5, kd=0.2, initial_input=0.3), Second(curve=0.1), {}, True),
    ("pd, lengths that vary", PD(kp=0.5, kd=0.2, initial_input=0.3), Second(curve=0.1), VARYING, True),
    ("pd on a plant that is late", PD(kp=0.5, kd=0.2, initial_input=0.3), Late(curve=0.1), {}, True),
    ("icfdl", ICFDL(**SMOOTH), Second(curve=0.1), {}, True),
    ("icfdl, lengths that vary", ICFDL(**SMOOTH), Second(curve=0.1), VARYING, True),
    ("cfdl", CFDL(**SMOOTH), Second(curve=0.1), {}, True),
    ("increment", Increment(**SMOOTH), Second(curve=0.1), {}, True),
    ("increment, filtered", Increment(**SMOOTH, q_cutoff_hz=0.2), Second(curve=0.1), {}, False),
    ("full matrix", Full(matrix=MATRIX), Second(curve=0.1), {}, True),
    ("shifted", Shifted(ahead=2), Second(curve=0.1), {}, True),
    ("shifted by the delay", Shifted(ahead=1), Late(curve=0.1), {}, True),
    ("forgetting", Forgetting(), Second(curve=0.1), {}, False),
    ("older trials", Older(), Second(curve=0.1), {}, False),
    ("curved", Curved(), Second(curve=0.1), {}, True),
    ("feedback", Feeding(), Second(curve=0.1), {}, True),
    ("feedback, noise", Feeding(), Second(curve=0.1), {"noise": 0.01}, True),
    ("feedback, on a plant that is late", Feeding(), Late(curve=0.1), {}, True),
    ("feedback, learned as a whole", Overall(), Second(curve=0.1), {}, True),
    ("initial state", Starting(), Second(curve=0.1), {}, True),
    ("behind a lag", Planned(), Second(curve=0.1), {"actuator": Actuator(lag=1.5)}, True),
    ("icfdl on a train", ICFDL(), PointMass(line=LINES["hilly"]), VARYING, True),
    ("increment on a train", Increment(), PointMass(line=LINES["hilly"]), VARYING, True),
    ("fixed gain, position", FixedGain(learns="position"), MetroLine(), {}, True),
    ("variable gain", VariableGain(), MetroLine(), {}, True),
    ("palc", PALC(), Maglev(), {"continues": True}, True),
    ("palc, late", PALC(late=2), Maglev(), {}, False),
    ("palc, filtered", FilteredPALC(q_cutoff_hz=10.0, lead_s=0.05), Maglev(), {}, False),
]


SIZES = {"variable gain": 1e-6}  # its gain has a kink where the error is zero


@pytest.mark.parametrize(("name", "law", "plant", "changes", "unchanged"), LAWS, ids=[row[0] for row in LAWS])
def test_it_is_the_derivative_of_a_campaigns_step(name, law, plant, changes, unchanged):
    """dv_next/dv, and de/dv of the trial and of the next one, with nothing held but the rest of the memory."""
    ran = campaign(law, plant, **changes)
    step = step_of(ran, held=False)
    size = SIZES.get(name, 1e-5) * max(np.abs(step.v).max(), np.abs(step.next()).max(), 1e-6)
    seen, following, plan = quotients(lambda v: two_trials(ran, step, v), step.v, size)
    exact = step.dense()
    outputs = np.array([step.linear.apply(one) for one in np.eye(step.v.size)]).T
    near = {"rtol": 1e-4, "atol": 2e-5 * np.abs(plan).max()}
    np.testing.assert_allclose(exact, plan, **near)
    np.testing.assert_allclose(-outputs, seen, rtol=1e-4, atol=2e-5 * np.abs(seen).max())
    assert np.abs(seen).max() > 0 and following.shape == seen.shape
    turned = np.array([step.adjoint(one) for one in np.eye(step.v.size)])
    np.testing.assert_allclose(turned, exact, rtol=1e-9, atol=1e-10 * np.abs(exact).max())
    np.testing.assert_allclose(step.next(), two_trials(ran, step, step.v)[2], rtol=1e-12)
    assert step_of(ran).unchanged is unchanged


ERRORS = [row for row in LAWS if row[4] and len(row[2].outputs) == 1 and "feedback" not in row[0]]


@pytest.mark.parametrize(("name", "law", "plant", "changes", "unchanged"), ERRORS, ids=[row[0] for row in ERRORS])
@pytest.mark.parametrize("increment", [False, True], ids=["output", "increment"])
def test_the_error_goes_as_the_map_says_whatever_the_estimate(name, law, plant, changes, unchanged, increment):
    """Every column of I - G L: the reference moved, so that the error of the trial moves, and the next trial run."""
    ran = campaign(law, plant, **changes)
    step = step_of(ran)
    signal = Signal(N, 0, increment=increment)
    gain = signal.slope(step.by_error)
    r = np.array(ran.study.reference_samples)

    def errors(s: Any) -> Any:
        first, second, _ = two_trials(ran, step, step.v, r + signal.error(s, np.zeros(0))[None, :])
        return signal.of @ first, signal.of @ second

    seen, following = quotients(errors, np.zeros(N + 1), 1e-5)
    answer = step.following()  # of the next trial: on a plant that is not linear it is not that of this one
    exact = np.array([one - signal.of @ answer.apply(gain @ one) for one in np.eye(N + 1)]).T
    np.testing.assert_allclose(seen, np.eye(N + 1), atol=1e-9)
    np.testing.assert_allclose(exact, following, rtol=1e-4, atol=2e-5 * np.abs(following).max())


def test_a_zero_error_is_told_with_the_estimate_held():
    """What is learned from no error at all is the plan itself, however the estimate would have moved."""
    step = step_of(campaign(ICFDL(**SMOOTH), Second(curve=0.1)))
    np.testing.assert_allclose(step.next(np.zeros((1, N + 1))), step.v, rtol=1e-14)
    assert np.abs(step.next() - step.v).max() > 1e-4


def test_the_diagonal_of_the_trial_is_that_of_its_matrix():
    for law, plant, degree in (
        (Planned(), Second(curve=0.1), 1),
        (Planned(), Late(curve=0.1), 2),
        (Feeding(), Late(curve=0.1), 2),
    ):
        step = step_of(campaign(law, plant))
        whole = np.array([step.linear.apply(one) for one in np.eye(N)]).T
        assert np.abs(np.triu(whole[degree:], 1)).max() == 0 and np.abs(whole[:degree]).max() == 0
        np.testing.assert_allclose(step.linear.diagonal(degree), np.diag(whole[degree:]), rtol=1e-12)


WITHOUT = [
    ("no learning", PID(kp=0.1, ki=0.0), "does not learn"),
]


@pytest.mark.parametrize(("name", "law", "said"), WITHOUT, ids=[row[0] for row in WITHOUT])
def test_a_law_without_a_step_says_why(name, law, said):
    ran = campaign(law, Second())
    *_, last = memories(ran, "law")
    found = learning_step(ran, "law", last)
    assert isinstance(found, str) and said in found


def test_a_full_matrix_that_is_too_large_is_said_to_be(monkeypatch):
    monkeypatch.setattr("workbench.evidence.learning_step.LARGEST", 20)
    monkeypatch.setattr("workbench.evidence.learning_step.BANDED", 2)
    ran = campaign(Full(matrix=MATRIX), Second())
    *_, last = memories(ran, "law")
    found = learning_step(ran, "law", last)
    assert isinstance(found, str) and "too large (at most 20)" in found
    assert isinstance(learning_step(campaign(Planned(), Second()), "law", last), LearningStep)


def test_a_filter_keeps_its_full_matrix_where_it_is_not_too_large(monkeypatch):
    """The full derivative, column by column in batches, against the sparse one."""
    ran = campaign(Increment(**SMOOTH, q_cutoff_hz=0.2), Second())
    small = step_of(ran).keeps.toarray()
    monkeypatch.setattr("workbench.evidence.learning_step.BANDED", 2)
    np.testing.assert_allclose(step_of(ran).keeps.toarray(), small, rtol=1e-12, atol=1e-14)
