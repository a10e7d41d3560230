"""What is said of the error between trials, beside campaigns that are simply run: long ones, and pairs of them."""

from __future__ import annotations

import dataclasses
from typing import Any

import casadi as ca
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
from models.quantity import InvalidValue, declared
from verification.checks import error_map, learning_curve
from verification.checks.error_map import PLAN
from verification.checks.error_map_replay import replay_monotone
from verification.checks.spectral_radius import spectral_radius
from verification.checks.trial_map import ErrorMap
from verification.theorems.dossier import Dossier
from workbench.contracts.finding import Standing
from workbench.contracts.law import Decision, Law
from workbench.contracts.study import Study
from workbench.contracts.trial_length import TrialLength
from workbench.controllers import CFDL, ICFDL, PD, Increment
from workbench.evidence.error_signal import Signal
from workbench.fold.fold import stream
from workbench.trials.campaign import Campaign, run

SUPPORTED, REFUTED, UNDECIDED = Standing.SUPPORTED, Standing.REFUTED, Standing.UNDECIDED
N = 24
RIDE = np.sin(np.linspace(0, 2.5, N + 1)) ** 2
LONG = 4000  # trials, in which what vanishes has vanished
SMOOTH = {"force_unit": 1.0, "lam": 1.0, "initial_input": 0.3, "phi0": 0.5, "mu": 1.0}
LARGE = {**SMOOTH, "lam": 1e-3, "phi0": 0.1, "eta": 1e-9}
RNG = np.random.default_rng(5)
MATRIX = 0.2 * RNG.standard_normal((N, N)) + 1.2 * np.eye(N)
SECOND = Second()


def answers(plant: Any, degree: int = 1) -> Any:
    """The plant's matrix, (m, m), by unit inputs."""
    step, output = plant.step_function(), plant.output_function()
    columns = []
    for one in np.eye(N):
        x, y = ca.DM.zeros(len(plant.states)), []
        for k in range(N):
            x = step(x, one[k], [], k)
            y.append(float(output(x)))
        columns.append(y)
    whole = np.array(columns).T
    return whole[degree - 1 :, : N - degree + 1]


INVERSE = 0.4 * np.linalg.inv(answers(SECOND))


def dossier(law: Law, plant: Any = SECOND, trials: int = 6, **changes: Any) -> Dossier:
    reference = changes.pop("reference", RIDE)
    study = Study(name="small", plant=plant, reference=reference, controllers={"law": law}, trials=trials, **changes)
    return Dossier(run(study, show_progress=False), "law")


def map_of(d: Dossier) -> ErrorMap:
    found = d.error_map
    assert isinstance(found, ErrorMap), found
    return found


def in_the_end(campaign: Campaign, signal: Signal) -> float:
    """The learned signal's rms error after very many trials over that of the first, infinite where it diverges."""
    study, runner = campaign.study, campaign.runner("law")
    first = last = np.nan
    for left in stream(runner.fold, study.reference_samples, [study.inputs()[0]] * LONG):
        last = float(np.sqrt(np.mean((signal.of @ (study.reference_samples - left.y)[0]) ** 2)))
        first = last if np.isnan(first) else first
        if not last < 1e100:
            return np.inf
    return last / first


LAWS: list[tuple[str, Law, Any, Standing, Standing]] = [
    # name, law, plant, the error vanishes, the norm falls: as they must come out
    ("pd", PD(kp=0.8, kd=0.3, initial_input=0.3), SECOND, SUPPORTED, REFUTED),
    ("pd, small gain", PD(kp=0.1, kd=0.0, initial_input=0.3), SECOND, SUPPORTED, SUPPORTED),
    ("a gain that grows first", Planned(gain=3.8), SECOND, UNDECIDED, REFUTED),
    ("a gain that is too large", Planned(gain=4.2), SECOND, REFUTED, REFUTED),
    ("a gain of the wrong sign", Planned(gain=-0.1), SECOND, REFUTED, REFUTED),
    ("late, and it looks one sample short", Planned(gain=0.8), Late(), REFUTED, REFUTED),
    ("late, and it looks as far", Shifted(gain=0.3, ahead=1), Late(), SUPPORTED, SUPPORTED),
    ("it looks too far", Shifted(gain=0.5, ahead=1), SECOND, REFUTED, REFUTED),
    ("icfdl", ICFDL(**SMOOTH), SECOND, SUPPORTED, SUPPORTED),
    (
        "cfdl, too large a step",
        CFDL(rho=1.0, **{**SMOOTH, "lam": 1e-3, "phi0": 0.1, "eta": 1e-9}),
        SECOND,
        REFUTED,
        REFUTED,
    ),
    ("increment", Increment(**SMOOTH), SECOND, SUPPORTED, SUPPORTED),
    ("increment, filtered", Increment(**SMOOTH, q_cutoff_hz=0.2), SECOND, REFUTED, None),
    ("full: a share of the inverse", Full(matrix=INVERSE), SECOND, SUPPORTED, SUPPORTED),
    ("full: any", Full(matrix=MATRIX), SECOND, None, None),
    ("full: any, other sign", Full(matrix=-MATRIX), SECOND, REFUTED, REFUTED),
    ("forgetting", Forgetting(keep=0.9, gain=0.3), SECOND, REFUTED, SUPPORTED),
    ("older trials", Older(gain=0.3), SECOND, SUPPORTED, None),
    ("older trials, too large", Older(gain=5.0), SECOND, REFUTED, REFUTED),
    ("feedback", Feeding(gain=0.3), SECOND, SUPPORTED, SUPPORTED),
    ("feedback, too large", Feeding(gain=4.5), SECOND, REFUTED, REFUTED),
    ("feedback, learned as a whole", Overall(gain=0.5), SECOND, None, None),
    ("initial state", Starting(gain=0.3), SECOND, SUPPORTED, None),
    ("initial state, too large", Starting(gain=4.5), SECOND, REFUTED, REFUTED),
]
STARTS = {"initial": (0.2, 0.1)}


@pytest.mark.parametrize(("name", "law", "plant", "vanishes", "falls"), LAWS, ids=[row[0] for row in LAWS])
def test_what_is_said_is_what_long_campaigns_show(name, law, plant, vanishes, falls):
    changes = STARTS if "initial state" in name else {}
    d = dossier(law, plant, trials=150 if "filtered" in name else 6, **changes)
    found = map_of(d)
    finding = error_map.asymptotic(found, d.reach)
    end = in_the_end(d.campaign, found.signal)
    assert vanishes is None or finding.standing is vanishes, finding
    if finding.standing is SUPPORTED:
        assert end < 1e-6
    elif finding.standing is REFUTED:
        assert end > 1e-6
        left = finding.witness.get("limit_error_rms")
        assert left is None or left / finding.witness["first_error_rms"] == pytest.approx(end, rel=1e-3)
    else:
        assert d.mse[-1] > d.mse[0]  # what the map says of a linear plant is left open by the run alone
    eigenvalues = np.abs(np.linalg.eigvals(found.dense)).max()
    if not found.triangular and found.never_changed is None:
        assert found.radius.low <= eigenvalues * (1 + 1e-6) and eigenvalues <= found.radius.high * (1 + 1e-6)
    norms = error_map.monotone(found)
    assert falls is None or norms.standing is falls, norms
    exact = np.linalg.norm(_oracle(d, found), 2)
    assert found.singular.value == pytest.approx(exact, rel=1e-5)
    assert norms.standing is (REFUTED if exact > 1 + 1e-9 else SUPPORTED if exact < 1 - 1e-9 else UNDECIDED)
    assert norms.margin is None or norms.margin == pytest.approx(1 - exact, abs=1e-5)


def _oracle(d: Dossier, found: ErrorMap) -> Any:
    """The map between trials by runs of the compiled trial: no derivative is asked for. The plant is linear."""
    study, ran, learned = d.study, found.step.ran, found.step.learned
    fold, r = d.campaign.runner("law").fold, study.reference_samples
    given = ran.given._replace(length=N)

    def two(v: Any, move: Any) -> Any:
        lefts = list(stream(fold, r + move, [given, given], memory=learned.put(ran.memory, v), keep_memory=True))
        return [(r + move - left.y)[0] for left in lefts], learned.stacked(lefts[1].memory)

    v, size = found.step.v, 1e-3
    if not found.unchanged:
        return np.array(
            [(two(v + size * one, 0)[1] - two(v - size * one, 0)[1]) / (2 * size) for one in np.eye(v.size)]
        ).T
    of = found.signal.of
    if not found.step.loop.law.asks_reference:
        moves = [size * found.signal.error(one, np.zeros(found.signal.first)) for one in np.eye(found.signal.size)]
        ends = [[two(v, s * move[None, :])[0][1] for s in (1, -1)] for move in moves]
        return np.array([of @ (up - down) / (2 * size) for up, down in ends]).T
    pairs = [[two(v + s * size * one, 0)[0] for s in (1, -1)] for one in np.eye(v.size)]
    seen, after = (np.array([of @ (p[0][i] - p[1][i]) / (2 * size) for p in pairs]).T for i in (0, 1))
    return np.asarray(after @ np.linalg.inv(seen))


def test_on_a_curved_plant_it_is_the_next_trial_that_answers():
    """Long before the law has settled the answer of the next trial is not that of the last one."""
    d = dossier(Planned(gain=1.2), Second(curve=0.3), trials=2, reference=3 * RIDE)
    found = map_of(d)
    assert found.singular.value == pytest.approx(np.linalg.norm(_oracle(d, found), 2), rel=1e-5)


REPLAYED = [(name, law, plant) for name, law, plant, *_ in LAWS]
REPLAYED += [
    ("pd, curved plant", PD(kp=0.8, kd=0.3, initial_input=0.3), Second(curve=0.1)),
    ("icfdl, curved plant", ICFDL(**SMOOTH), Second(curve=0.1)),
    ("increment, curved plant", Increment(**SMOOTH), Second(curve=0.1)),
    ("filtered, curved plant", Increment(**SMOOTH, q_cutoff_hz=0.2), Second(curve=0.1)),
    ("feedback, curved plant", Feeding(gain=0.5), Second(curve=0.1)),
    ("curved law", Curved(gain=0.5), Second(curve=0.1)),
    ("late, curved plant", Shifted(gain=0.3, ahead=1), Late(curve=0.1)),
    ("initial state, curved plant", Starting(gain=0.3), Second(curve=0.1)),
]


@pytest.mark.parametrize(("name", "law", "plant"), REPLAYED, ids=[row[0] for row in REPLAYED])
def test_a_witness_is_replayed_on_the_compiled_trial(name, law, plant):
    d = dossier(law, plant, **(STARTS if "initial state" in name else {}))
    found = map_of(d)
    finding = error_map.monotone(found)
    if finding.standing is UNDECIDED:
        pytest.skip("nothing was found that could be replayed")
    margin = replay_monotone(d.campaign, "law", finding.witness)
    assert 1 - margin == pytest.approx(found.singular.value, rel=0.03)
    assert (margin < 0) == (finding.standing is REFUTED)
    assert len(finding.witness["vector"]) == (found.signal.size if found.unchanged else found.step.learned.size)
    other = dict(finding.witness) | {"vector": RNG.standard_normal(len(finding.witness["vector"])).tolist()}
    assert 1 - replay_monotone(d.campaign, "law", other) <= found.singular.value * 1.03


def test_a_witness_that_cannot_be_replayed_says_so():
    d = dossier(Planned(gain=3.8))
    witness = dict(error_map.monotone(map_of(d)).witness)
    for broken in ({"vector": []}, {"trial": 99}, {"trial": None}):
        with pytest.raises(InvalidValue, match=r"the witness must|a witness is replayed"):
            replay_monotone(d.campaign, "law", witness | broken)


def test_the_residual_counts_against_a_norm_that_falls():
    found = map_of(dossier(Planned(gain=0.1)))

    def said(value: float, residual: float) -> Any:
        return error_map.monotone(
            dataclasses.replace(found, singular=found.singular._replace(value=value, residual=residual))
        )

    assert said(0.9999, 0.001).standing is UNDECIDED
    assert said(0.9, 0.0999).standing is SUPPORTED and said(0.9, 0.05).margin == pytest.approx(0.05)
    assert said(1.2, 0.5).standing is REFUTED and said(1.2, 0.5).margin == pytest.approx(-0.2)
    assert said(1 - 1e-12, 0.0).standing is SUPPORTED and said(1.0, 0.0).standing is UNDECIDED


def test_a_law_that_fell_is_never_supported():
    """All diagonal entries are in (-1, 1), and yet the run falls before it could settle."""
    d = dossier(Planned(gain=3.8), trials=40, divergence_factor=3.0)
    found = map_of(d)
    assert found.fell is not None and np.abs(found.diagonal).max() < 1
    finding = error_map.asymptotic(found, d.reach)
    assert finding.standing is UNDECIDED and f"diverged at trial {found.fell}" in finding.method
    steady = map_of(dossier(Planned(gain=0.1)))
    assert error_map.monotone(steady).standing is SUPPORTED
    for fallen in (dataclasses.replace(steady, fell=3),):
        assert error_map.monotone(fallen).standing is UNDECIDED
        assert error_map.asymptotic(fallen, d.reach).standing is UNDECIDED
    grown = dataclasses.replace(steady, mse=np.array([1.0, 0.5, 2.0]))
    assert error_map.asymptotic(grown, d.reach).standing is UNDECIDED
    assert (
        error_map.asymptotic(dataclasses.replace(steady, mse=np.array([1e-30, 2e-30])), d.reach).standing is SUPPORTED
    )


def test_a_norm_that_rose_in_the_record_is_not_said_to_fall():
    d = dossier(Planned(gain=3.8))
    found = map_of(d)
    norms = np.linalg.norm(d.campaign.data["error"].values[0][:, 1:], axis=1)
    assert found.rose[1] == pytest.approx((norms[1:] / norms[:-1]).max()) and found.rose[1] > 1
    calm = dataclasses.replace(found, singular=found.singular._replace(value=0.5, residual=0.0))
    assert error_map.monotone(calm).standing is UNDECIDED
    assert map_of(dossier(Planned(gain=0.1))).rose is None


def test_an_error_at_the_beginning_that_the_law_learns_from_is_left_at_the_limit():
    """e(0) is no plan's to change; a law that learns from it goes on until e(1) makes up for it."""
    d = dossier(PD(kp=0.8, kd=0.3, initial_input=0.3), reference=RIDE + 0.2)
    finding = error_map.asymptotic(d.error_map, d.reach)
    assert finding.standing is REFUTED
    end = in_the_end(d.campaign, map_of(d).signal)
    assert finding.witness["limit_error_rms"] / finding.witness["first_error_rms"] == pytest.approx(end, rel=1e-6)


@declared
class Deciding(Planned):
    """A law that decides in numbers."""

    act = Law.act

    def decide(self, memory: Any, state: Any, seen: Any) -> Any:
        return Decision(np.asarray(ca.DM(memory.u))[:, seen.k]), state


def test_a_law_without_a_derivative_is_left_open_with_the_reason():
    d = dossier(Deciding())
    assert isinstance(d.error_map, str) and "has no derivative" in d.error_map
    for finding in (error_map.monotone(d.error_map), error_map.asymptotic(d.error_map, d.reach)):
        assert finding.standing is UNDECIDED and "decides in numbers" in finding.method


def test_a_map_that_is_too_large_for_its_matrix_is_settled_by_its_norm_or_not_at_all(monkeypatch):
    monkeypatch.setattr("verification.checks.trial_map.LARGEST", 10)
    d = dossier(Full(matrix=MATRIX))
    finding = error_map.asymptotic(d.error_map, d.reach)
    assert finding.standing is UNDECIDED and "too large" in finding.method
    e = dossier(Full(matrix=0.1 * INVERSE + 1e-3 * np.eye(N, k=1)))
    assert map_of(e).singular.value < 1
    assert error_map.asymptotic(e.error_map, e.reach).standing is SUPPORTED


def test_a_sample_that_saturates_keeps_its_error():
    """Along the last trial an input at its limit does nothing, so the map has the eigenvalue 1 there."""
    d = dossier(Planned(gain=0.3), trials=60, actuator=Actuator(upper=0.4))
    found = map_of(d)
    finding = error_map.asymptotic(found, d.reach)
    assert found.triangular and finding.standing is REFUTED
    assert found.diagonal[finding.witness["sample"]] == 1
    assert found.step.loop.rows.u[0, finding.witness["sample"]] > 0.4


RADII = [
    ("random", np.random.default_rng(1).standard_normal((30, 30)) / 8),
    ("rotation", 0.99 * np.array([[np.cos(1), -np.sin(1)], [np.sin(1), np.cos(1)]])),
    ("growing rotation", 1.001 * np.array([[np.cos(1), -np.sin(1)], [np.sin(1), np.cos(1)]])),
    ("nearly one", np.diag([0.9999, -0.5])),
    ("just above one", np.diag([1.0001, -0.5])),
    ("far from normal", 0.9 * np.eye(6) + 0.3 * np.eye(6, k=1)),
    ("nilpotent", np.eye(9, k=1)),
    ("zero", np.zeros((4, 4))),
]


@pytest.mark.parametrize(("name", "matrix"), RADII, ids=[row[0] for row in RADII])
def test_the_radius_is_enclosed(name, matrix):
    exact = {"far from normal": 0.9, "nilpotent": 0.0}.get(name, np.abs(np.linalg.eigvals(matrix)).max())
    low, high = spectral_radius(matrix)
    assert low <= exact * (1 + 1e-12) and exact <= high * (1 + 1e-12)
    assert high < 1 or low > 1 or exact == 1


def test_what_rounding_hides_is_not_settled():
    """Eigenvalues of this matrix are computed to lie far above 1; they are all 0.5."""
    rng = np.random.default_rng(0)
    turn = np.linalg.qr(rng.standard_normal((60, 60)))[0]
    matrix = turn @ (0.5 * np.eye(60) + 40 * np.eye(60, k=1)) @ turn.T
    assert np.abs(np.linalg.eigvals(matrix)).max() > 2
    low, high = spectral_radius(matrix)
    assert low <= 1 <= high
    assert spectral_radius(np.eye(3)) == (pytest.approx(1.0), pytest.approx(1.0))
    assert spectral_radius(np.full((2, 2), np.nan)) == (0.0, np.inf)


PREDICTED = [
    ("pd", PD(kp=0.8, kd=0.3, initial_input=0.3), SECOND),
    ("it grows first", Planned(gain=3.8), SECOND),
    ("late", Shifted(gain=0.3, ahead=1), Late()),
    ("full", Full(matrix=INVERSE), SECOND),
    ("forgetting", Forgetting(keep=0.9, gain=0.3), SECOND),
    ("feedback", Feeding(gain=0.3), SECOND),
    ("older trials", Older(gain=0.3), SECOND),
    ("initial state", Starting(gain=0.3), SECOND),
    ("increment, filtered", Increment(**{**SMOOTH, "eta": 1e-12}, q_cutoff_hz=0.2), SECOND),
    ("increment", Increment(**{**SMOOTH, "eta": 1e-12}), SECOND),
]


@pytest.mark.parametrize("lengths", ["fixed", "uniform"])
@pytest.mark.parametrize(("name", "law", "plant"), PREDICTED, ids=[row[0] for row in PREDICTED])
def test_of_a_linear_plant_and_law_the_learning_curve_is_predicted(name, law, plant, lengths):
    if lengths == "uniform" and (name in ("older trials",) or "filtered" in name):
        pytest.skip("what a cut trial leaves them is not a map of its reached errors alone")
    minimum = None if lengths == "fixed" else 15
    changes = STARTS if "initial state" in name else {}
    d = dossier(law, plant, trial_length=TrialLength(law=lengths, minimum=minimum), **changes)
    np.testing.assert_allclose(d.predicted_mse, d.mse, rtol=1e-6, atol=1e-12)


RISING = np.array([1.0, 5.0, 40.0, 3.0, 0.1])
FALLING = np.array([1.0, 0.3, 0.1, 0.03, 0.01])
CURVES = [
    # observed, predicted, standing
    ("a peak that is met", RISING, RISING * 0.5, SUPPORTED),
    ("a peak that is missed", RISING, np.array([1.0, 2.0, 10.0, 3.0, 0.1]), REFUTED),
    ("only the first trial is as large", np.array([39.0, 5.0, 40.0]), np.array([39.0, 5.0, 4.0]), REFUTED),
    ("a peak, and the map diverges", RISING, np.array([1.0, 1e9, np.nan, np.nan, np.nan]), REFUTED),
    ("it falls as predicted", FALLING, FALLING * np.array([1, 2, 0.5, 2, 0.5]), SUPPORTED),
    ("it falls much slower", FALLING, np.array([1.0, 0.03, 1e-3, 3e-5, 1e-6]), REFUTED),
    ("a quarter of it was predicted", FALLING, FALLING * np.array([1, 0.25, 0.25, 0.25, 0.25]), REFUTED),
    ("it falls, and was predicted to rise", FALLING, np.array([1.0, 3.0, 9.0, 27.0, 81.0]), REFUTED),
    ("it falls, and the map diverges", FALLING, np.array([1.0, 3.0, np.nan, np.nan, np.nan]), REFUTED),
    ("rounding is not compared", np.array([1.0, 0.1, 1e-28, 2e-29]), np.array([1.0, 0.1, 1e-20, 1e-40]), SUPPORTED),
    ("no error at all", np.zeros(3), np.zeros(3), UNDECIDED),
    ("no prediction", RISING, np.zeros(0), UNDECIDED),
]


@pytest.mark.parametrize(("name", "observed", "predicted", "standing"), CURVES, ids=[row[0] for row in CURVES])
def test_a_prediction_can_fail(name, observed, predicted, standing):
    assert learning_curve.peak(observed, predicted).standing is standing
    rises = observed.argmax() > 0
    assert (learning_curve.no_rise(observed) is None) == rises
    if not rises:
        assert "no rise" in learning_curve.no_rise(observed)


def test_the_norm_of_a_filtered_plan_is_said_to_be_that():
    finding = error_map.monotone(dossier(Forgetting(keep=0.9, gain=0.3)).error_map)
    assert PLAN in finding.method and finding.witness["of"] == PLAN
    assert "error of the output" in error_map.monotone(dossier(Planned(gain=0.1)).error_map).method
