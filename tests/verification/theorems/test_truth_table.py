"""Every check on small plants: the standing that it must get is known by hand."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from judging import judged, over
from small_plants import small

from models.quantity import InvalidValue
from verification.checks import assumptions, continuity, convergence, error_map, learning_curve
from verification.checks.domain import domain
from verification.checks.wanted import wanted_input
from verification.decide.judge import judge
from verification.decide.verify import verify
from verification.enclosure.box import Box
from verification.theorems.learning import Dossier
from workbench import Study, TrialLength, run
from workbench.contracts.claim import Claim
from workbench.contracts.examination import Examination
from workbench.contracts.finding import Finding, Standing
from workbench.contracts.verdict import Verdict
from workbench.controllers import ICFDL, PD, Increment
from workbench.evidence import ppd, sweeps
from workbench.evidence.trajectory import Lineariser, partial, rollout

STATIC = small("Static", lambda x, u, k: (2 * u,))
SIGN_CHANGING = small("SignChanging", lambda x, u, k: ((u - 1) ** 2,))
DEAD_ZONE = small("DeadZone", lambda x, u, k: (ca.fmax(u - 1, 0) + ca.fmin(u + 1, 0),))
SATURATION = small("Saturation", lambda x, u, k: (ca.fmin(ca.fmax(u, -1), 1),))
KINK = small("Kink", lambda x, u, k: (ca.fabs(u),))
ROOT = small("Root", lambda x, u, k: (ca.sqrt(u),))
STEP = small("Step", lambda x, u, k: (ca.floor(u) + 2 * u,))
DELAYED = small("DelayedGain", lambda x, u, k: (u, x[0]), states=2, output=1)
FIRST_ORDER = small("FirstOrder", lambda x, u, k: (0.9 * x[0] + 0.1 * u,))
INTEGRATOR = small("Integrator", lambda x, u, k: (x[0] + 0.1 * u,))
STATE_AND_TIME = small("StateAndTime", lambda x, u, k: (0.5 * x[0] + (1 + 0.5 * ca.sin(k) + 0.1 * x[0] ** 2) * u,))
UNSTABLE = small("Unstable", lambda x, u, k: (x[0] + 0.1 * x[0] ** 3 + 0.1 * u,))
GROWING = small("Growing", lambda x, u, k: (1.2 * x[0] + 0.1 * u,))
NO_INPUT = small("NoInput", lambda x, u, k: (0.9 * x[0],))

PROVED, SUPPORTED, REFUTED, UNDECIDED = Standing.PROVED, Standing.SUPPORTED, Standing.REFUTED, Standing.UNDECIDED
N = 30
RAMP = 0.2 + 0.8 * np.sin(np.linspace(0, 3, N + 1))


def box(u: tuple[float, float] = (-2.0, 2.0), x: tuple[float, float] = (-1.0, 1.0), states: int = 1) -> Box:
    low, high = np.full(states, x[0]), np.full(states, x[1])
    return Box({"x": (low, high), "u": u, "w": (np.zeros(0), np.zeros(0)), "k": (0.0, float(N))})


def campaign(plant, law=None, *, trials=12, lengths=None, reference=RAMP, **changes):
    law = law or ICFDL(force_unit=1.0, lam=1.0, initial_input=0.3, phi0=0.5, mu=1.0)
    return run(
        Study(
            name="small",
            plant=plant,
            reference=reference,
            controllers={"law": law},
            trials=trials,
            trial_length=lengths or TrialLength(law="fixed"),
            **changes,
        ),
        show_progress=False,
    )


def gather(plant, law=None, **changes):
    ran = campaign(plant, law, **changes)
    return ran, ppd.evidence(ran, "law")


def holds(finding: Finding | Verdict, standing: Standing) -> None:
    assert finding.standing is standing, finding


SLOPES = [
    ("static gain", STATIC, box(), 1, PROVED, PROVED),
    ("sign changes at u = 1", SIGN_CHANGING, box(), 1, PROVED, REFUTED),
    ("sign changes, box on one side", SIGN_CHANGING, box(u=(1.5, 3.0)), 1, PROVED, PROVED),
    ("dead zone", DEAD_ZONE, box(), 1, REFUTED, REFUTED),
    ("dead zone, box outside", DEAD_ZONE, box(u=(1.5, 3.0)), 1, PROVED, PROVED),
    ("saturation", SATURATION, box(), 1, REFUTED, REFUTED),
    ("saturation, box inside", SATURATION, box(u=(-0.5, 0.5)), 1, PROVED, PROVED),
    ("kink", KINK, box(), 1, REFUTED, REFUTED),
    ("square root, pole of the slope", ROOT, box(u=(0.0, 2.0)), 1, REFUTED, PROVED),
    ("square root, away from 0", ROOT, box(u=(0.5, 2.0)), 1, PROVED, PROVED),
    ("jump", STEP, box(u=(0.5, 1.5)), 1, REFUTED, PROVED),
    ("pure delay", DELAYED, box(states=2), 2, PROVED, PROVED),
    ("first order", FIRST_ORDER, box(), 1, PROVED, PROVED),
    ("integrator", INTEGRATOR, box(), 1, PROVED, PROVED),
    ("gain by state and time", STATE_AND_TIME, box(), 1, PROVED, PROVED),
    ("unstable", UNSTABLE, box(), 1, PROVED, PROVED),
]


@pytest.mark.parametrize(("name", "plant", "at", "degree", "a1", "a4"), SLOPES, ids=[row[0] for row in SLOPES])
def test_slope_exists_and_is_positive(name, plant, at, degree, a1, a4):
    assert plant.relative_degree() == degree
    holds(continuity.continuous_slope(plant, at, degree), a1)
    finding = assumptions.sign_partial(plant, SimpleNamespace(degree=degree, increment=False), at)
    if name in ("square root, pole of the slope", "jump"):
        assert finding.standing is not REFUTED  # the slope is positive wherever it exists
    else:
        holds(finding, a4)


@pytest.mark.parametrize("name", ["dead zone", "saturation", "kink"])
def test_witness_of_a_broken_slope_replays(name):
    plant, at = next((row[1], row[2]) for row in SLOPES if row[0] == name)
    witness = continuity.continuous_slope(plant, at).witness
    u, step = witness["point"]["u"][0], witness["step"]
    f = plant.next_output_function()
    left = float(f([0], u - step / 2, [], 0) - f([0], u - 1.5 * step, [], 0)) / step
    right = float(f([0], u + 1.5 * step, [], 0) - f([0], u + step / 2, [], 0)) / step
    assert left == pytest.approx(witness["slope_left"], abs=1e-5)
    assert right == pytest.approx(witness["slope_right"], abs=1e-5)
    assert abs(left - right) > 0.5


RUNS = [
    # plant, A2 printed, A2 lifted, A4 printed, Lemma 1
    ("static gain", STATIC, PROVED, PROVED, PROVED, PROVED),
    ("pure delay", DELAYED, PROVED, PROVED, PROVED, PROVED),
    ("first order", FIRST_ORDER, REFUTED, PROVED, REFUTED, REFUTED),
    ("integrator", INTEGRATOR, REFUTED, PROVED, REFUTED, REFUTED),
    ("unstable", UNSTABLE, REFUTED, PROVED, None, REFUTED),
    ("gain by state and time", STATE_AND_TIME, REFUTED, PROVED, None, REFUTED),
    ("sign changes", SIGN_CHANGING, PROVED, PROVED, None, PROVED),
]


@pytest.mark.parametrize(("name", "plant", "a2", "lifted", "a4", "lemma"), RUNS, ids=[row[0] for row in RUNS])
def test_assumptions_along_trials(name, plant, a2, lifted, a4, lemma):
    law = PD(kp=3.0, kd=3.0, initial_input=0.3) if a4 is REFUTED else None
    if plant is UNSTABLE:
        law = PD(kp=0.05, kd=0.05, initial_input=0.1)
    ran, found = gather(plant, law)
    d = Dossier(ran, "law")
    printed = judged(d, "A2.printed")
    holds(printed, a2)
    if a2 is REFUTED:
        du, ratios = np.array(printed.witness["du"]), np.array(printed.witness["ratios"])
        assert ratios[-1] > 1e3 * found.partial.max() and len(du) > 4
        _replay_unbounded_ratio(ran, printed.witness)
    repaired = judged(d, "A2.lifted")
    holds(repaired, lifted)
    _row_sums_by_unit_inputs(plant, found, repaired)
    if a4 is not None:
        holds(judged(d, "A4.printed"), a4)
    holds(judged(d, "lemma1"), lemma)


def test_an_input_that_is_remembered_for_one_sample_leaves_no_bound():
    """The increment y(k+1) - y(k) of y(k+1) = 2 u(k) is moved by u(k-1), and by no input before."""
    law = Increment(force_unit=1.0, lam=1.0, mu=1.0, initial_input=0.3)
    d = Dossier(campaign(STATIC, law), "law")
    found = judged(d, "A2.printed")
    holds(found, REFUTED)
    assert found.witness["earlier_sample"] == found.witness["sample"] - 1
    holds(judged(d, "lemma1"), REFUTED)


@pytest.mark.parametrize("at", [0.35, 5.0])
def test_a_jump_with_the_input_leaves_no_bound(at):
    """Without memory the ratio is bounded but across a jump: REFUTED where trials came to it, and nowhere else."""
    plant = small("Jumping", lambda x, u, k: (2 * u + ca.if_else(u > at, 0.2, 0.0),))
    d = Dossier(campaign(plant), "law")
    met = d.hull["u"][0] < at < d.hull["u"][1]
    assert met == (at < 1)
    for name in ("A2.printed", "lemma1"):
        found = judged(d, name)
        holds(found, REFUTED if met else PROVED)
        if met:
            holds(judged(d, "A2.lifted"), REFUTED)
            assert found.margin == pytest.approx(-0.2, abs=1e-5) and found.replayed == pytest.approx(-0.2, abs=1e-6)


def _replay_unbounded_ratio(ran, witness):
    """Run both input sequences of the witness with plain numbers and compare the ratios."""
    plant, trial = ran.study.plant_that_runs, witness["trial"]
    plan = ran.data["input"].sel(controller="law", trial=trial).values[:-1]
    f, g = plant.step_function(), plant.output_function()

    def outputs(u):
        x, ys = ca.DM.zeros(len(plant.states)), []
        for k in range(N):
            ys.append(float(g(x)))
            x = f(x, u[k], [], k)
        return np.array([*ys, float(g(x))])

    d = plant.relative_degree()
    for du, ratio in list(zip(witness["du"], witness["ratios"], strict=True))[:4]:
        other = plan.copy()
        other[witness["earlier_sample"]] += witness["kept"]
        other[witness["sample"]] += du
        change = outputs(other) - outputs(plan)
        assert abs(change[witness["sample"] + d] / du) == pytest.approx(ratio, rel=1e-6)


def _row_sums_by_unit_inputs(plant, found, repaired):
    """Compare p along the last trial with a G made column by column from finite differences."""
    plan, x0, d = found.trajectories.u[-1], found.trajectories.x[-1, :, 0], found.degree
    base = rollout(plant, x0, plan)[1]
    columns = []
    for j in range(N - d + 1):
        moved = plan.copy()
        moved[j] += 1e-6
        columns.append((rollout(plant, x0, moved)[1] - base)[d:] / 1e-6)
    assert repaired.witness["row_sum"] == pytest.approx(np.abs(np.array(columns)).sum(axis=0).max(), rel=1e-4)
    assert repaired.bound >= repaired.witness["row_sum"] * (1 - 1e-12)


def test_no_input_is_refused_with_a_reason():
    assert NO_INPUT.relative_degree() is None
    with pytest.raises(InvalidValue, match="the input 'u' of NoInput reaches no output within 200 samples"):
        gather(NO_INPUT)


def test_partial_matches_finite_differences_and_a_wrong_sign_would_not(monkeypatch):
    def agrees() -> bool:
        worst = 0.0
        for plant in (STATE_AND_TIME, DELAYED, UNSTABLE):
            u = 0.2 + 0.1 * np.cos(np.arange(N))
            x, y = rollout(plant, np.zeros(len(plant.states)), u)
            d = plant.relative_degree()
            exact = partial(Lineariser(plant, N).at(x, u), d)
            for k in (0, 7, N - d):
                moved = u.copy()
                moved[k] += 1e-6
                slope = (rollout(plant, x[:, 0], moved)[1][k + d] - y[k + d]) / 1e-6
                worst = max(worst, abs(exact[k] - slope) / abs(slope))
        return worst < 1e-4

    assert agrees()
    true = Lineariser.at
    monkeypatch.setattr(Lineariser, "at", lambda self, x, u: true(self, x, u)._replace(b=-true(self, x, u).b))
    assert not agrees()


def test_only_reached_samples_count_and_a_shifted_mask_would_show():
    ran, found = gather(FIRST_ORDER, trials=10, lengths=TrialLength(law="uniform", minimum=20))
    ends = ran.data["trial_length"].values

    def counts(evidence):
        return np.isfinite(evidence.ds[1:]).sum(axis=1)

    assert len(set(ends)) > 2
    np.testing.assert_array_equal(counts(found), np.minimum(ends[1:], ends[:-1]))
    shifted = ran.data.copy(deep=True)
    for trial, end in enumerate(ends):
        if end < N:
            shifted["output"][0, trial, end + 1] = 0.0
    slipped = ppd.evidence(dataclasses.replace(ran, data=shifted), "law")
    assert (counts(slipped) != np.minimum(ends[1:], ends[:-1])).any()


def test_decomposition_adds_up():
    _, found = gather(UNSTABLE)
    whole = found.partial_midway * found.du + found.carried + found.remainder
    np.testing.assert_allclose(whole[1:], found.ds[1:], atol=1e-15)
    _, linear = gather(FIRST_ORDER)
    assert np.nanmax(np.abs(linear.remainder)) < 1e-14
    _, memoryless = gather(STATIC)
    assert np.nanmax(np.abs(memoryless.carried)) < 1e-14
    usable = np.isfinite(memoryless.ratio) & (np.abs(memoryless.du) > 1e-9)
    np.testing.assert_allclose(memoryless.ratio[usable], 2.0, rtol=1e-6)


def lengths_of(law, drawn, ends=False):
    study = SimpleNamespace(
        horizon=30, scenario=SimpleNamespace(trial_length=law), plant_that_runs=SimpleNamespace(ends=ends)
    )
    return assumptions.trial_lengths(study, drawn)


def test_trial_lengths():
    law = TrialLength(law="uniform", minimum=20)
    drawn = law.draw(30, 400, np.random.default_rng(1))
    holds(lengths_of(law, drawn), SUPPORTED)
    holds(lengths_of(law, np.append(drawn, 20)), REFUTED)  # 20 has probability 0
    holds(lengths_of(law, np.full(400, 25)), REFUTED)  # a sampler that is not uniform
    wrong = SimpleNamespace(
        lengths=(),
        distribution=law.distribution,
        reach_probability=lambda n: np.roll(law.reach_probability(n), 1),
    )
    holds(lengths_of(wrong, drawn), REFUTED)
    loose = SimpleNamespace(lengths=(), distribution=lambda n: (np.array([29, 30]), np.array([0.5, 0.4])))
    holds(lengths_of(loose, drawn), REFUTED)


GAINS = [
    # lam, lambda_min.partial, lambda_min.realised, theorem 1, asymptotic, monotone; rho 1 and gain 2: lambda_min 1
    (2.0, PROVED, SUPPORTED, SUPPORTED, SUPPORTED, SUPPORTED),
    (0.5, REFUTED, REFUTED, SUPPORTED, SUPPORTED, SUPPORTED),
    (0.1, REFUTED, REFUTED, REFUTED, REFUTED, REFUTED),
]


@pytest.mark.parametrize(("lam", "part", "realised", "theorem", "vanishes", "falls"), GAINS)
def test_gain_conditions_on_a_static_gain(lam, part, realised, theorem, vanishes, falls):
    # eta this small keeps phi at sqrt(lam), where the gain rho/(2 sqrt(lam)) is largest
    law = ICFDL(force_unit=1.0, rho=1.0, lam=lam, eta=1e-12, initial_input=0.3, eps=1e-14)
    ran, _ = gather(STATIC, law, trials=6)
    d = Dossier(ran, "law")
    holds(judged(d, "lambda_min.partial"), part)
    holds(judged(d, "lambda_min.realised"), realised)
    holds(judged(d, "theorem1"), theorem)
    holds(error_map.asymptotic(d.error_map, d.reach), vanishes)
    holds(error_map.monotone(d.error_map), falls)
    expected = 1 - 2 / (2 * np.sqrt(lam))
    np.testing.assert_allclose(d.error_map.diagonal, expected, rtol=1e-9)
    assert d.error_map.singular.value == pytest.approx(abs(expected), rel=1e-6)
    np.testing.assert_allclose(d.predicted_mse, d.mse, rtol=1e-6)
    holds(learning_curve.peak(d.mse, d.predicted_mse), SUPPORTED)
    holds(learning_curve.peak(d.mse, d.predicted_mse * 5), REFUTED)


def test_error_map_is_the_map_between_trials():
    """I - G L against the errors of consecutive trials of a linear plant under a law that is linear too."""
    ran, _ = gather(FIRST_ORDER, PD(kp=0.5, kd=0.2, initial_input=0.3), trials=5, reference=RAMP - RAMP[0])
    d = Dossier(ran, "law")
    e = ran.data["error"].values[0][:, 1:]
    for i in range(4):
        np.testing.assert_allclose(e[i] - d.error_map.lifted.apply(d.error_map.gain @ e[i]), e[i + 1], atol=1e-12)
    dense = np.array([d.error_map.lifted.apply(d.error_map.gain @ column) for column in np.eye(N)]).T
    largest = np.linalg.svd(np.eye(N) - dense)[1][0]
    assert d.error_map.singular.value == pytest.approx(largest, rel=1e-8)
    assert d.error_map.singular.residual < 1e-6


def test_without_a_map_its_reason_is_told():
    assert error_map.monotone("the law does not learn").standing is UNDECIDED
    assert error_map.asymptotic("the law does not learn", np.ones(N)).method == "the law does not learn"


def test_estimator():
    _, found = gather(FIRST_ORDER)
    holds(convergence.estimator_bounded(found), SUPPORTED)
    turned = found.estimate.copy()
    turned[3, 4] *= -1
    holds(convergence.estimator_bounded(dataclasses.replace(found, estimate=turned)), REFUTED)


def roomy(plant, found):
    """The box of the run, wide enough to hold the trajectory that follows the reference too."""
    at = dict(domain(plant, found.trajectories))
    for name, room in (("x", 1.0), ("u", 3.0)):
        low, high = at[name]
        at[name] = (np.minimum(low, -room), np.maximum(high, room))
    return Box(at)


def increments(rho: float = 0.5, lam: float = 1.0) -> Increment:
    return Increment(force_unit=1.0, rho=rho, lam=lam, initial_input=0.3, mu=1.0)


THEOREM = [
    # plant, law, increment_monotone, increment_weighted
    ("integrator: no row sum at all", INTEGRATOR, increments(), PROVED, PROVED),
    ("integrator, gain too large", INTEGRATOR, increments(rho=1.0, lam=1e-4), UNDECIDED, UNDECIDED),
    ("first order: r < b", FIRST_ORDER, increments(), PROVED, PROVED),
    ("static gain: every increment undoes the last", STATIC, increments(), UNDECIDED, PROVED),
    ("unstable: r > b", UNSTABLE, increments(), None, PROVED),
]


@pytest.mark.parametrize(("name", "plant", "law", "sup", "weighted"), THEOREM, ids=[row[0] for row in THEOREM])
def test_increment_theorem(name, plant, law, sup, weighted):
    ran, found = gather(plant, law, trials=8)
    d = over(Dossier(ran, "law"), roomy(plant, found))
    plain = judged(d, "increment_monotone")
    if sup is not None:
        holds(plain, sup)
    assert plain.standing is not SUPPORTED
    heavy = judged(d, "increment_weighted")
    holds(heavy, weighted)
    if heavy.standing is PROVED:
        assert heavy.witness["a"] <= heavy.witness["largest_a"] <= 1
        assert heavy.held.tries >= 100


def test_increment_theorem_is_refuted_where_rows_outweigh_the_diagonal():
    ran, _ = gather(GROWING, increments(), trials=3)
    found = judged(Dossier(ran, "law"), "increment_monotone")
    holds(found, REFUTED)
    assert found.witness["row_sum"] > found.witness["b"]
    assert found.replayed == pytest.approx(found.margin, rel=1e-6)


def test_input_error_contracts_as_the_theorem_says():
    """The proved factor against the input errors of a linear plant whose wanted input is known."""
    ran, found = gather(FIRST_ORDER, increments(), trials=8)
    witness = judged(over(Dossier(ran, "law"), roomy(FIRST_ORDER, found)), "increment_monotone").witness
    y = np.concatenate([[0.0], RAMP[1:] - RAMP[0]])
    wanted = (y[1:] - 0.9 * y[:-1]) / 0.1
    np.testing.assert_allclose(wanted_input(ran.study).u, wanted, rtol=1e-9)
    largest = np.abs(wanted - found.trajectories.u).max(axis=1)
    assert (largest[1:] <= largest[:-1] * (1 + 1e-12)).all()
    assert (largest[1:] / largest[:-1]).max() <= 1 - (1 - witness["factor_at_phi0"]) * 0.2


def test_sweep_finds_the_boundary():
    law = ICFDL(force_unit=1.0, rho=1.0, lam=1.0, eta=1e-12, initial_input=0.3, eps=1e-14)
    ran = campaign(STATIC, law, trials=40)
    found = sweeps.sweep(ran, "law", "lam", np.logspace(-3, 1, 41))
    predicted = (1.0 * 2.0) ** 2 / 16  # factor -1 at lam = (rho b)^2/16
    assert sweeps.boundary(found) == pytest.approx(predicted, rel=0.3)
    assert sweeps.boundary(found) > predicted


def test_a_check_that_crashes_is_undecided():
    def crash() -> Finding:
        raise ZeroDivisionError("division by zero")

    verdict = judge(Claim(name="small.crash", statement="", source="", check=crash))
    assert verdict.standing is UNDECIDED and "ZeroDivisionError" in verdict.method
    assert "division by zero" not in verdict.method
    with pytest.raises(ValueError, match="refuted with a witness"):
        Finding(margin=-1.0, method="")


def test_what_goes_round_the_verdicts_may_fail_without_losing_them():
    def crash(*_: Any) -> Any:
        raise ZeroDivisionError("division by zero")

    claims = [Claim(name="small.holds", statement="", source="", check=lambda: Finding(grounds="settings", margin=1.0))]
    broken = Examination(claims=claims, conclude=crash, figures=crash, tables=crash, scores=crash)
    report = verify(campaign(STATIC, trials=2), broken, show_progress=False)
    assert [verdict.standing for verdict in report.verdicts] == [PROVED]
    assert len(report.conclusion) == 4 and all("ZeroDivisionError" in line for line in report.conclusion)
    assert not report.figures and not report.tables and not report.scores


def test_claims_of_ones_own_can_be_given():
    claims = [Claim(name="small.own", statement="", source="", check=lambda: Finding(margin=1.0))]
    report = verify(campaign(STATIC, trials=2), claims, show_progress=False)
    assert [(verdict.claim, verdict.standing) for verdict in report.verdicts] == [("small.own", SUPPORTED)]


def test_a_law_that_filters_its_plan_is_not_proved_as_without_its_filter():
    law = Increment(force_unit=1.0, lam=1.0, initial_input=0.3, q_cutoff_hz=0.1)
    d = Dossier(campaign(FIRST_ORDER, law, trials=3, reference=np.sin(np.linspace(0, 3, 61))), "law")
    for name in ("increment_monotone", "increment_weighted"):
        found = judged(d, name)
        assert found.standing is UNDECIDED and "without its filter" in found.method
