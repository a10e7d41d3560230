"""Slips in the checks: margins, premises, sets that hold every trial, and what is replayed or held against runs."""

from __future__ import annotations

import dataclasses
from fractions import Fraction
from functools import cache
from itertools import pairwise
from types import SimpleNamespace

import casadi as ca
import control
import numpy as np
from brake_tubes import integrator_tube
from judging import judged
from learning_laws import Full, Plan, Planned, Second, Starting
from scipy import stats
from small_plants import small

from models.plant import Signal
from models.quantity import declared
from slips.planting import Slip
from verification.checks import assumptions, attack, error_map, feasibility, increment, limit, predictive, tube
from verification.checks.across_jump import _inside
from verification.checks.assumption_replays import ratio_at, replay_across
from verification.checks.continuity import continuous_slope, jump_reached
from verification.checks.convergence import adaptation, lambda_min, lambda_realised
from verification.checks.delayed import delayed_box, delayed_step
from verification.checks.envelope import Bounds, Ends, Envelope, held_inside
from verification.checks.error_map_replay import replay_monotone
from verification.checks.estimate_form import _parameters
from verification.checks.funnel import Maker, around, parts_of
from verification.checks.funnel_curve import Curve, curve, falls
from verification.checks.initial_state import held_against
from verification.checks.jump import find_jump
from verification.checks.learning_curve import learning_curve, peak
from verification.checks.linear_loop import critical_gain
from verification.checks.lipschitz import lipschitz
from verification.checks.polynomial import Identity
from verification.checks.premises import plan_alone, same_but_for_the_input
from verification.checks.row_sums import SlopeBounds, off_diagonal, slope_bounds, state_reach
from verification.checks.settled import no_noise, whole_trials
from verification.checks.shares import about_all, most_that_fail
from verification.checks.slope import slope
from verification.checks.spectral_radius import spectral_radius
from verification.checks.univariate import never_negative, positive
from verification.checks.update import held_update, learns_as_declared
from verification.checks.values import values_of
from verification.checks.wanted import follows, wanted_input
from verification.enclosure.box import Box
from verification.enclosure.recursion import Carried
from verification.theorems.dossier import Dossier
from workbench import Study, run
from workbench.contracts.claim import Range
from workbench.contracts.finding import Finding, Grounds, Standing
from workbench.contracts.law import LearningGain
from workbench.contracts.scenario import UniformNoise
from workbench.contracts.scope import scope_of
from workbench.contracts.trial_length import TrialLength
from workbench.controllers import ICFDL, Increment
from workbench.controllers.parts.rows import known
from workbench.graph import call, read
from workbench.predictive.delayed_plant import DelayedPlant
from workbench.sets import Polytope, Zonotope

N = 8
PROVED, SUPPORTED, REFUTED = Standing.PROVED, Standing.SUPPORTED, Standing.REFUTED
RAMP = np.linspace(0.0, 1.0, N + 1) ** 2
STEADY = small("Steady", lambda x, u, k: (0.9 * x[0] + 0.5 * u,))
SUM = small("Sum", lambda x, u, k: (x[0] + 0.5 * u,))


def study(plant=STEADY, law=None, trials=4, **more):
    """A short study of one law."""
    return Study(
        name="small", plant=plant, reference=more.pop("reference", RAMP), trials=trials,
        controllers={"law": law or Planned()}, **more,
    )  # fmt: skip


def dossier(*args, **more):
    """The file of a law that has just run."""
    return Dossier(run(study(*args, **more), show_progress=False), "law")


def increments(**more):
    return Increment(**{"force_unit": 1.0, "rho": 0.5, "lam": 1.0, "mu": 1.0, "initial_input": 0.3} | more)


@cache
def estimated():
    """The record of a law that estimates, over trials of different lengths."""
    law = ICFDL(force_unit=1.0, rho=0.5, lam=1.0, mu=1.0, initial_input=0.3)
    return run(study(law=law, trials=6, trial_length=TrialLength(minimum=4)), show_progress=False)


def evidence():
    return Dossier(estimated(), "law").evidence


# ------------------------------------------------------------------ numbers of a run


def peaks_that_differ_by_four():
    assert peak(np.array([1.0, 4.0, 1.0]), np.array([1.0, 1.0, 1.0])).standing is REFUTED


def curves_that_differ_by_four():
    assert learning_curve(np.array([8.0, 4.0, 4.0]), np.array([8.0, 1.0, 1.0])).standing is REFUTED


def a_small_lambda_is_refuted():
    large = lambda_realised(evidence())
    assert (large.margin > 0) == (evidence().estimator.lam > (0.5 * large.bound) ** 2 / 4)


def the_factor_lies_above_zero():
    law = evidence().estimator
    b, phi = 0.7, np.linspace(1e-3, 10, 2000)
    lam = lambda_min(law, b) * (1 + 1e-9)
    assert (law.rho * phi / (lam + phi**2) * b < 1).all()


def resets_are_those_of_the_record():
    found, e = adaptation(evidence()), evidence()
    law, later = e.estimator, np.isfinite(e.du)
    share = law.eta * e.du**2 / (law.mu + e.du**2)
    assert np.allclose(found.share[later], share[later], rtol=1e-12)
    factor = 1 - law.rho * e.estimate / (law.lam + e.estimate**2) * e.ratio
    usable = np.isfinite(e.ratio)
    assert np.allclose(found.factor[usable], factor[usable], rtol=1e-12)


def one_length_alone_is_no_distribution():
    even = study(trial_length=TrialLength(minimum=2), trials=2)
    assert assumptions.trial_lengths(even, np.full(200, 3)).standing is REFUTED


def ratios_below_zero_are_refuted():
    e = evidence()
    turned = dataclasses.replace(e, ratio=-np.abs(e.ratio))
    assert assumptions.sign_printed(Second(), turned, Box({"x": (0.0, 1.0)})).standing is REFUTED


def a_slope_below_zero_is_no_proof():
    d = dossier(plant=small("Falling", lambda x, u, k: (0.5 * x[0] - u,)))
    assert assumptions.sign_partial(d.plant, d.evidence, d.box).standing is not PROVED


def lifted_rows_bound_differences():
    d = dossier()
    found = assumptions.lipschitz_lifted(d.plant, d.evidence, d.slopes, d.box)
    assert d.attack_row_sums(found).margin >= 0
    off, own = assumptions.lifted_along(d.plant, d.evidence).row_sums()
    assert found.bound >= (off + own).max() * (1 - 1e-12)


JUMPING = small("Jumping", lambda x, u, k: (2 * u + ca.if_else(u > 0.35, 0.2, 0.0),))


def a_jump_refutes():
    d = dossier(plant=JUMPING, law=Planned(first=0.3))
    assert judged(d, "A2.lifted").standing is REFUTED


def two_plans_within_the_row_sums_refute_nothing():
    d = dossier(plant=small("Direct", lambda x, u, k: (2 * u,)))
    witness = {"trial": 1, "sample": 3, "plans": [[0.1] * N, [0.2] * N]}
    assert replay_across(d.plant, d.evidence, witness) > -1e-9


def what_left_the_scope_is_no_witness():
    box = Box({"x": (-1.0, 1.0), "u": (-1.0, 1.0), "w": 0.0, "k": (0.0, 4.0)}, whole=("k",))
    x, plan = np.array([[0.0, 0.5, 1.5, 0.5, 0.0]]), np.zeros(4)
    assert _inside(box, [x, x], (plan, plan)) == 1


def a_hidden_state_jumps():
    plant = small("Hidden", lambda x, u, k: (0.5 * x[0] + u, x[0] + ca.if_else(x[1] > 0.35, 0.2, 0.0)), states=2)
    box = Box({"x": ([-1.0, -1.0], [1.0, 1.0]), "u": (-1.0, 1.0), "w": np.zeros(0), "k": (0.0, 4.0)}, whole=("k",))
    assert jump_reached(plant, box)


def a_kept_input_moves_the_output():
    d = dossier(plant=small("Direct", lambda x, u, k: (u,)))
    still = dataclasses.replace(d.evidence, du=np.zeros_like(d.evidence.du), ds=np.ones_like(d.evidence.ds))
    assert assumptions.data_model(d.plant, still, d.box).standing is REFUTED


def a_ratio_is_that_of_the_record():
    e = evidence()
    trial, sample = (int(i) for i in np.argwhere(np.isfinite(e.ratio))[-1])
    assert np.isclose(ratio_at(STEADY, e, e.witness(trial, sample)), e.ratio[trial, sample], rtol=1e-6)


def the_scope_is_wider_than_the_run():
    d = dossier()
    low, high = d.hull["x"]
    least, most = d.box["x"]
    assert (least < low).all() and (most > high).all()


# ------------------------------------------------------------------ maps between trials


def an_upper_band():
    return np.diag(np.full(N, 0.5)) + np.diag(np.full(N - 1, 1.2), 1)


def a_norm_that_grows_is_refuted():
    d = dossier(law=Full(matrix=-1.5 * np.eye(N)), trials=2, plant=SUM)
    assert error_map.monotone(d.error_map).standing is REFUTED


def its_replay_says_so_too():
    d = dossier(law=Full(matrix=-1.5 * np.eye(N)), trials=2, plant=SUM)
    found = error_map.monotone(d.error_map)
    norm = np.linalg.norm(d.error_map.dense, 2)
    assert np.isclose(replay_monotone(d.campaign, "law", found.witness), 1 - norm, rtol=1e-3)


def what_looks_ahead_is_not_triangular():
    d = dossier(law=Full(matrix=an_upper_band()), trials=2)
    found = d.error_map
    radius = float(np.abs(np.linalg.eigvals(found.dense)).max())
    assert found.radius.low <= radius * (1 + 1e-6) and radius <= found.radius.high * (1 + 1e-6)


def a_residual_counts():
    d = dossier(trials=2)
    near = d.error_map.singular._replace(value=0.9, residual=0.2)
    assert error_map.monotone(dataclasses.replace(d.error_map, singular=near)).standing is not SUPPORTED


def a_law_that_fell_does_not_converge():
    d = dossier(trials=3)
    grown = dataclasses.replace(d.error_map, mse=np.array([1.0, 2.0, 3.0]))
    assert error_map.asymptotic(grown, d.reach).standing is not SUPPORTED


def the_radius_is_bounded_from_both_sides():
    rng = np.random.default_rng(0)
    for scale in (0.3, 0.9, 1.1):
        matrix = scale * rng.standard_normal((5, 5)) / 2
        radius, found = float(np.abs(np.linalg.eigvals(matrix)).max()), spectral_radius(matrix)
        assert found.low <= radius * (1 + 1e-9) and radius <= found.high * (1 + 1e-9)


# ------------------------------------------------------------------ row sums, increments and limits

SLOPES = SlopeBounds(
    a=np.array([[0.5]]),
    b=np.array([1.0]),
    c=np.array([0.3]),
    gain_low=1.0,
    gain_high=1.0,
    steepest=None,
    reason=None,
    gain_reason=None,
)
INPUTS = SimpleNamespace(study=SimpleNamespace(horizon=N), missing=0)


def law_of(gain):
    """The estimator of a law with a largest gain."""
    return SimpleNamespace(rho=1.0, lam=1 / (4 * gain**2), force_unit=1.0, first_estimate=lambda: 1 / (2 * gain))


def box_of(plant):
    return Box({"x": (0.0, 1.0), "u": (0.0, 1.0), "w": (np.zeros(0),) * 2, "k": (0.0, N - 1.0)}, whole=("k",))


def weights_are_applied_once():
    for weight in (1.0, 0.7):
        rows = off_diagonal(SLOPES, N, weight)
        true = [sum(0.3 * 0.5 ** (k - 1 - j) * weight ** (k - j) for j in range(k)) for k in range(N)]
        assert np.allclose(rows, true, rtol=1e-12, atol=0) and (rows >= true).all()


def states_move_by_what_moves_them():
    found = state_reach(SLOPES, np.array([2.0]), 3)
    assert (found[0] >= [0.0, 2.0, 3.0, 3.5]).all()


def a_jump_has_no_row_sums():
    plant = small("Jumping", lambda x, u, k: (ca.sign(x[0]) + u,))
    around_zero = Box({**box_of(plant), "x": (-1.0, 1.0)}, ("k",))
    assert slope_bounds(plant, around_zero).reason


def row_sums_count_for_the_largest_gain():
    found = increment.monotone(law_of(1.6), SLOPES, INPUTS, STEADY, box_of(STEADY))
    assert found.standing is not PROVED  # l_max (b + r) is above 2


def weighted_rows_add_to_the_slope():
    steep = dataclasses.replace(SLOPES, c=np.array([0.6]))
    assert increment.weighted(law_of(1.5), steep, STEADY, box_of(STEADY), N).standing is not PROVED


def the_weight_leaves_its_share():
    a = increment.largest_weight(dataclasses.replace(SLOPES, c=np.array([2.0])), N, 0.5)
    assert off_diagonal(dataclasses.replace(SLOPES, c=np.array([2.0])), N, a).max() < 0.5


def an_input_error_grows_by_its_factor():
    found = increment.factor(SLOPES, 0.4, np.array([0.1, 1.9]))
    assert np.allclose(found, [1 - 0.1 * 0.6, 1.9 * 1.4 - 1])


def a_gain_of_two_and_a_half_does_not_contract():
    assert isinstance(limit.contracting(LearningGain(0.1, 2.5), 1.0, 1.0), str)


def errors_that_rise_are_seen():
    assert limit.transient(np.array([1.0, 2.0, 0.5]), 3, "1").standing is REFUTED


def the_last_sample_is_reached_least():
    rare = study(trial_length=TrialLength(law="table", minimum=5, probabilities=(0.5, 0.4, 0.1)))
    assert np.isclose(limit.unreached(rare).margin, 0.1)


def steps_of_the_proof_are_held():
    jumped = limit.held_at_first_sample(np.array([1.0, 0.9]), LearningGain(0.5, 0.6), (1.0, 1.0), 1.0)
    assert jumped.margin < 0  # between 0.4 and 0.5 of the error is left, not 0.9


def the_slope_is_that_of_every_sample():
    plant = small("Periodic", lambda x, u, k: (0.5 * x[0] + (1 + 0.5 * ca.sin(k)) * u,))
    low, high = limit.slope_everywhere(plant, N)
    true = 1 + 0.5 * np.sin(np.arange(N))
    assert low <= true.min() and true.max() <= high


# ------------------------------------------------------------------ funnels


def maker(noise=0.0, **more):
    one = study(**{"plant": SUM, "law": increments()} | more, noise=UniformNoise(largest=noise))
    return Maker(one, LearningGain(0.1, 0.5), scope_of(one), np.full(N, 0.3))


def noise_counts_twice():
    gained = np.diff(RAMP)
    found = maker(noise=0.01).question().wanted
    assert (found[:, 0] <= gained - 0.0199).all() and (found[:, 1] >= gained + 0.0199).all()


def sets(low, high):
    states, inputs = np.tile([low, high], (N + 1, 1)), np.tile([low, high], (N, 1))
    return Carried(x=states[:, None, :], y=states, u=inputs, target=inputs, slope=inputs, after=inputs, ended="fine",
                   sample=N)  # fmt: skip


def the_hull_holds_every_part():
    found = around([sets(0.0, 1.0), sets(2.0, 3.0)])
    for ends in (found.x[:, 0], found.y, found.u, found.target, found.slope, found.after):
        assert (ends == [0.0, 3.0]).all()


def parts_cover_a_range():
    parts = parts_of({"mass": Range(1.0, 2.0, "kg")}, ["mass"])
    ends = [(one["mass"].low, one["mass"].high) for one in parts]
    assert ends[0][0] == 1 and ends[-1][1] == 2 and all(a[1] == b[0] for a, b in pairwise(ends))


def a_domain_has_two_sides():
    plant = small("Bounded", lambda x, u, k: (x[0] + 0.5 * u,), inputs=(Signal("u", "1", domain=(0.0, 1.0)),))
    for low, high in ((-0.5, 0.5), (0.5, 1.5)):
        assert not isinstance(maker(plant=plant).of_use(sets(low, high)), Carried)


def the_curve_lies_above_the_run():
    one, lengths = maker(), np.full(4, N)
    question = one.question()
    found = SimpleNamespace(sets=one.carry(question), same=(), gain=one.gain)
    bounds = curve(one, found, lengths, N)
    mse = run(study(plant=SUM, law=increments()), show_progress=False).data["mse"].values[0]
    assert (bounds.common >= mse[:4]).all() and (bounds.own >= mse[:4]).all()


def a_curve_that_does_not_fall_is_no_proof():
    flat = Curve(common=np.array([1.0, 1.0]), own=np.array([1.0, 1.0]), last=N, final=None, rounded=True)
    assert falls(flat, "1").standing is Standing.UNDECIDED


def everything_reached_lies_within():
    reached = Ends.none(1, 2)
    reached.take(np.array([[0.0, 5.0]]), 0, 0)
    reached.take(np.array([[0.0, 0.0]]), 0, 0)
    envelope = Envelope(states=reached, inputs=reached, increments=reached, mse=np.zeros(1), mse_by=np.zeros(1, int),
                        count=1, trials=1, seed=0, choices={0: ()})  # fmt: skip
    ends = [Bounds(np.full((1, 2), end), np.full(2, end)) for end in (-1.0, 1.0, 0.0)]
    assert held_inside(envelope, *ends).margin < 0


# ------------------------------------------------------------------ forms of learning, inputs that are wanted


@declared
class Declared(Planned):
    """It declares the gain that it has."""

    @property
    def learning_gain(self):
        return LearningGain(0.3, 0.3)

    def learn(self, memory, trial):
        return Plan(memory.u + 0.3 * known(trial.reached, trial.e)[1:] + self.more(trial))

    def more(self, trial):
        return 0


@declared
class Drifting(Declared):
    """Its plan moves where the trial did not come."""

    def more(self, trial):
        return 0.01 * (1 - trial.reached[1:])


@declared
class Crossed(Declared):
    """Its last sample learns from the error of the second."""

    def learn(self, memory, trial):
        e = known(trial.reached, trial.e)[1:]
        return Plan(memory.u + 0.3 * ca.horzcat(e[:, : N - 1], e[:, 1]))


@declared
class Ahead(Declared):
    """How fast it learns at a sample depends on the error of the sample behind it."""

    @property
    def learning_gain(self):
        return LearningGain(0.0, 0.3)

    def learn(self, memory, trial):
        further = ca.horzcat(trial.e[2:], ca.DM.zeros(1, 1))
        return Plan(memory.u + known(trial.reached[1:], 0.3 * ca.exp(-(further**2)) * trial.e[1:]))


@declared
class Doubled(Declared):
    """It learns twice as fast as it says."""

    def more(self, trial):
        return 0.3 * known(trial.reached, trial.e)[1:]


def form_of(law, **more):
    one = study(law=law, **more)
    return learns_as_declared(law, one.task(law)).standing


def the_plan_is_kept_where_no_trial_came():
    varying = {"trial_length": TrialLength(minimum=3)}
    assert form_of(Declared(), **varying) is PROVED
    assert form_of(Drifting(), **varying) is not PROVED


def every_sample_learns_from_its_own():
    assert form_of(Crossed()) is not PROVED


def the_gain_is_the_declared_one():
    assert form_of(Doubled()) is not PROVED


def a_later_sample_may_be_missing():
    assert form_of(Ahead(), trial_length=TrialLength(minimum=3)) is not PROVED
    assert form_of(Ahead()) is PROVED


def a_polynomial_may_dip_between_its_ends():
    dips = [Fraction(1, 2), Fraction(-2), Fraction(1)]
    assert not positive(dips, Fraction(0), Fraction(2)) and not never_negative(dips, Fraction(0), Fraction(2))
    assert positive([Fraction(2), Fraction(-2), Fraction(1)], Fraction(0), Fraction(2))


def a_polynomial_may_cross_three_times_at_once():
    cubed = [Fraction(-1), Fraction(3), Fraction(-3), Fraction(1)]
    assert not never_negative(cubed, Fraction(0), Fraction(2))


def an_estimate_may_not_step_too_far():
    assert _parameters(SimpleNamespace(eta=1.5, mu=1.0, eps=1.0, rho=1.0, lam=1.0, force_unit=1.0))


def a_plan_that_moved_is_seen():
    r, y = np.ones(3), np.zeros((2, 3))
    u = np.array([[0.0, 0.0], [0.3, 0.3]])
    assert held_update(Declared(), r, u, y, np.array([1, 1])).margin < 0


def the_wall_is_nearer_by_what_is_not_exact():
    one = study(plant=Second(), law=increments())
    found = wanted_input(one)
    low, high = found.x.min(axis=1), found.x.max(axis=1)
    box = Box({"x": (low, high), "u": (found.u.min(), found.u.max()), "w": (np.zeros(0),) * 2, "k": (0.0, N - 1.0)},
              whole=("k",))  # fmt: skip
    assert follows(found, box).standing is not PROVED


def defects_are_no_smaller_than_they_are():
    found = wanted_input(study(plant=SUM, law=increments()))
    moved = dataclasses.replace(found, u=found.u + 0.1)
    assert (moved.defects[1] >= 0.0499).all()


# ------------------------------------------------------------------ premises and slopes


@declared
class Reacting(Planned):
    """It feeds the error back, without a memory of it."""

    def act(self, memory_k, state, r, r_next, y):
        return memory_k.u + 0.3 * (r - y), state


def a_law_that_moves_the_start_is_told():
    assert same_but_for_the_input(study(), Starting()) is not None


def feedback_is_told():
    assert plan_alone(Reacting(), study(law=Reacting())) is not None


def noise_is_told():
    assert no_noise(study(noise=UniformNoise(largest=0.1)), "ours").check().standing is REFUTED


def short_trials_are_told():
    assert whole_trials(study(trial_length=TrialLength(minimum=3)), "ours").check().standing is REFUTED


def later_steps_come_later():
    plant = small("Clock", lambda x, u, k: (x[1] * (1 + k), u), states=2)
    found = delayed_step(plant, 2)(x=[0.0, 2.0], u=3.0, k=4)
    assert float(found["y"]) == 3 * (1 + 5)


def the_last_step_lies_in_the_box():
    found = delayed_box(box_of(STEADY), 3)["k"][1]
    assert float(found[0, 0]) == N - 1 - 2


def a_kink_has_no_continuous_slope():
    plant = small("Kinked", lambda x, u, k: (0.5 * x[0] + ca.fabs(u),))
    assert continuous_slope(plant, Box({**box_of(plant), "u": (-1.0, 1.0)}, ("k",))).standing is not PROVED


def a_jump_of_the_late_output_is_found():
    plant = small("Stepping", lambda x, u, k: (0.5 * x[0] + x[1] + ca.sign(x[1] - 0.12), u), states=2)
    assert judged(dossier(plant=plant), "A1").standing is not PROVED


def the_asked_entry_is_taken():
    x = ca.SX.sym("x", 2)
    f = read(ca.Function("f", [x], [ca.vertcat(2 * x[0] + 3 * x[1], 5 * x[0] + 7 * x[1])], ["x"], ["y"]))
    found = [
        [float(call(slope(f, "y", "x", i, j), {"x": np.ones((2, 1))})["slope"][0, 0]) for j in (0, 1)] for i in (0, 1)
    ]
    assert found == [[2, 3], [5, 7]]


def a_falling_slope_counts():
    plant = small("Decay", lambda x, u, k: (x[0],), slope=lambda self, x, u, w, t: -3.0 * x)
    assert lipschitz(plant, [-1.0], [1.0], [-1.0, 1.0]).bound >= 3


def a_step_is_found():
    assert find_jump(lambda x: float(x > 0.3142), [0.0], [1.0]) is not None


def an_entry_that_is_zero_is_a_value():
    x = ca.SX.sym("x")
    sparse = ca.SX(2, 1)
    sparse[0] = x**2 + 1
    low, high = values_of(ca.Function("f", [x], [sparse]))
    assert low <= 0 <= high


def an_integrator_bears_a_gain_of_two():
    assert np.isclose(critical_gain(control.ss(control.TransferFunction([1], [1, -1], 1.0))), 2.0)


def initial_errors_follow_their_factor():
    assert held_against(np.array([1.0, 0.9]), np.ones(2), 0.4).margin < 0


def trials_leave_a_set_at_their_first_sample_outside():
    trials = attack._inside(box_of(SUM), np.array([[[0.5, 2.0, 0.5, 0.5]]]), np.array([[0.5, 0.5, 0.5]]))
    assert trials[0] == 1


def a_bound_that_is_too_small_is_contradicted():
    d = dossier(plant=SUM)
    assert attack.held_row_sums(1e-3, d.slopes, d.box, d.recorded, 1, False).margin < 0


# ------------------------------------------------------------------ identities, draws, tubes

A, B = ca.SX.sym("a"), ca.SX.sym("b")


def identity(left, right, **at):
    symbols = {"a": A, "b": B}
    return Identity(left=left, right=right, at={name: (symbols[name], value) for name, value in at.items()}, method="m")


def sides_that_meet_in_one_point_are_not_equal():
    assert identity(A**2, 3 * A - 2, a=1.0).finding().standing is not PROVED


def an_inverse_has_an_inverse_factor():
    assert identity(1 / (2 * A), 2 / A, a=1.5).finding().standing is not PROVED


def a_number_is_not_its_negative():
    assert identity(3 * A, -3 * A, a=1.5).finding().standing is not PROVED


def failures_have_their_share():
    for failed, tries in ((0, 10), (3, 40)):
        most = most_that_fail(failed, tries)
        assert np.isclose(stats.binom.cdf(failed, tries, most), 0.05)


def ten_draws_say_little_of_all():
    few = Finding(grounds=Grounds.TRIES, margin=1.0, tries=10, method="drawn")
    assert about_all(few).standing is not SUPPORTED


def with_parts(**parts):
    """A tube with parts replaced after it was checked: what a wrong design would be."""
    wrong = dataclasses.replace(integrator_tube())
    wrong.__dict__.update(parts)
    return wrong


def pushed():
    honest = integrator_tube()
    return with_parts(Sigma=Polytope(H=honest.Sigma.H, h=0.01 * honest.Sigma.h))


def a_set_that_is_left_is_not_invariant():
    assert tube.rpi(pushed()).standing is REFUTED


def a_tube_that_sticks_out_is_seen():
    assert tube.tube_inside(pushed()).standing is REFUTED


def a_delay_that_is_ignored_is_felt():
    honest = integrator_tube()
    ignorant = dataclasses.replace(honest, ignore_delay=True)
    assert tube.tightening_sound(honest, 3, sequences=2).standing is PROVED
    assert tube.tightening_sound(ignorant, 3, sequences=2).standing is REFUTED


def a_wrong_weight_misses_its_equation():
    assert tube.lyapunov(with_parts(P=1.1 * integrator_tube().P)).standing is REFUTED


def disturbances_pass_through_the_delay():
    plant = DelayedPlant(A=np.array([[0.5]]), b=np.array([1.0]), W=Zonotope.box([-1.0], [1.0]), delay=2)
    law = SimpleNamespace(move=lambda following, e: (SimpleNamespace(du=0.0, infeasible=""), following))
    w = np.arange(1.0, 7.0).reshape(-1, 1)
    run_ = feasibility.simulate(law, plant, Polytope.box([-9.0], [9.0]), np.zeros(1), disturb=w)
    x = [0.0]
    for one in w[:, 0]:
        x.append(0.5 * x[-1] + one)
    assert np.allclose(run_.x[:, 0], x[2 : 2 + len(run_.x)])


def a_lost_plan_is_a_failure():
    one = feasibility.Run(e=np.zeros((2, 1)), x=np.zeros((2, 1)), w=np.zeros((2, 1)), infeasible_at=1, lost=1,
                          reason="none", violation=-1.0)  # fmt: skip
    assert predictive._kept(one)[0] < 0


SLIPS = (
    Slip(
        where="verification.checks.learning_curve:peak",
        stands="max(3 - ratio",
        slipped="max(5 - ratio",
        causes="a peak that is four times the predicted one is SUPPORTED",
        check=peaks_that_differ_by_four,
    ),
    Slip(
        where="verification.checks.learning_curve:learning_curve",
        stands="max(3 - mean",
        slipped="max(5 - mean",
        causes="a learning curve four times the predicted one is SUPPORTED",
        check=curves_that_differ_by_four,
    ),
    Slip(
        where="verification.checks.convergence:_compared",
        stands="margin=law.lam - least",
        slipped="margin=least - law.lam",
        causes="a lambda that is too small is SUPPORTED, a large one REFUTED",
        check=a_small_lambda_is_refuted,
    ),
    Slip(
        where="verification.checks.convergence:lambda_min",
        stands="(4 if one_sided else 16)",
        slipped="(16 if one_sided else 4)",
        causes="a quarter of the lambda that is needed is PROVED to be enough",
        check=the_factor_lies_above_zero,
    ),
    Slip(
        where="verification.checks.convergence:adaptation",
        stands="law.rho * phi / (law.lam + phi**2) * evidence.ratio",
        slipped="law.rho * phi / (law.lam + phi) * evidence.ratio",
        causes="factors of the printed theorem in (-1, 1) that are not",
        check=resets_are_those_of_the_record,
    ),
    Slip(
        where="verification.checks.assumptions:trial_lengths",
        stands="margin=adjusted - SIGNIFICANCE",
        slipped="margin=adjusted",
        causes="A3 is SUPPORTED whatever lengths were drawn",
        check=one_length_alone_is_no_distribution,
    ),
    Slip(
        where="verification.checks.assumptions:sign_printed",
        stands="margin=-share",
        slipped="margin=share",
        causes="A4 as printed is SUPPORTED by ratios below zero",
        check=ratios_below_zero_are_refuted,
    ),
    Slip(
        where="verification.checks.assumptions:sign_partial",
        stands="margin=found.witness.upper",
        slipped="margin=-found.witness.upper",
        causes="A4 is PROVED for an input that acts the other way",
        check=a_slope_below_zero_is_no_proof,
    ),
    Slip(
        where="verification.checks.assumptions:lipschitz_lifted",
        stands="float(rows.max()) + max(abs(slopes.gain_low), abs(slopes.gain_high))",
        slipped="float(rows.max())",
        causes="A2 is PROVED with a p that leaves out what the input of the sample itself does",
        check=lifted_rows_bound_differences,
    ),
    Slip(
        where="verification.checks.assumptions:_unbounded",
        stands="- met.ratios[-1]",
        slipped="+ met.ratios[-1]",
        causes="A2 is SUPPORTED where two plans next to each other refute it",
        check=a_jump_refutes,
    ),
    Slip(
        where="verification.checks.assumption_replays:replay_across",
        stands="(along if np.isfinite(along) else 0.0) - ",
        slipped="-",
        causes="A2 is REFUTED by any two plans, though the row sums bound their ratio",
        check=two_plans_within_the_row_sums_refute_nothing,
    ),
    Slip(
        where="verification.checks.across_jump:_inside",
        stands="last = min([last, *(int(k) - 1 for k in left[:1]), *(int(k) for k in beyond[:1])])",
        slipped="last = min([last, *(int(k) for k in beyond[:1])])",
        causes="A2 is REFUTED by trials that left the scope on the way",
        check=what_left_the_scope_is_no_witness,
    ),
    Slip(
        where="verification.checks.across_jump:_between",
        stands="low = middle",
        slipped="high = middle",
        causes="A2 is left open where the output jumps: plans never come to two sides of it",
        check=a_jump_refutes,
    ),
    Slip(
        where="verification.checks.continuity:jump_reached",
        stands="for result in f.outputs for",
        slipped="for result in f.outputs[:1] for",
        causes="A2 is SUPPORTED by the row sums along one trial where a hidden state jumps",
        check=a_hidden_state_jumps,
    ),
    Slip(
        where="verification.checks.assumptions:data_model",
        stands="evidence.du == 0",
        slipped="evidence.du != evidence.du",
        causes="Lemma 1 holds where the output moved though its input did not",
        check=a_kept_input_moves_the_output,
    ),
    Slip(
        where="verification.checks.assumption_replays:_differences",
        stands="[sample + evidence.degree]",
        slipped="[sample]",
        causes="refutations of A4 and Lemma 1 that stand are thrown away, or others confirmed",
        check=a_ratio_is_that_of_the_record,
    ),
    Slip(
        where="verification.checks.domain:_wider",
        stands="margin * (upper - lower)",
        slipped="0 * (upper - lower)",
        causes="proofs are stated for a scope wider than the box that they were made for",
        check=the_scope_is_wider_than_the_run,
    ),
    Slip(
        where="verification.checks.error_map:monotone",
        stands="sum_of_both = value.value + value.residual",
        slipped="sum_of_both = value.value - value.residual",
        causes="a singular value of 0.9 that is known to 0.2 is below 1: SUPPORTED",
        check=a_residual_counts,
    ),
    Slip(
        where="verification.checks.error_map_replay:replay_monotone",
        stands="return 1 - float(",
        slipped="return 2 - float(",
        causes="2 - sigma for 1 - sigma: a norm that grows is not confirmed, UNDECIDED",
        check=its_replay_says_so_too,
    ),
    Slip(
        where="verification.checks.error_map:_against",
        stands="if last > max(first, least)",
        slipped="if last < 0",
        causes="a law whose error grew is SUPPORTED to converge",
        check=a_law_that_fell_does_not_converge,
    ),
    Slip(
        where="verification.checks.trial_map:_lower",
        stands="sparse.triu(matrix, 1)",
        slipped="sparse.triu(matrix, 2)",
        causes="the spectral radius of a map that looks ahead is read off its diagonal",
        check=what_looks_ahead_is_not_triangular,
    ),
    Slip(
        where="verification.checks.trial_map:Reached.apply",
        stands="product(self._of, self._linear.apply(dv))",
        slipped="-product(self._of, self._linear.apply(dv))",
        causes="I + G L for I - G L: a law that learns with the wrong sign converges",
        check=a_norm_that_grows_is_refuted,
    ),
    Slip(
        where="verification.checks.spectral_radius:spectral_radius",
        stands="log, k = 2 * log, 2 * k",
        slipped="log, k = 2 * log, 4 * k",
        causes="bounds of a spectral radius between which it does not lie",
        check=the_radius_is_bounded_from_both_sides,
    ),
    Slip(
        where="verification.checks.row_sums:off_diagonal",
        stands="_up(weight * _up(",
        slipped="_up(1.0 * _up(",
        causes="the weighted norm is that without a weight: nothing contracts",
        check=weights_are_applied_once,
    ),
    Slip(
        where="verification.checks.row_sums:state_reach",
        stands=" + by[:, k]",
        slipped="",
        causes="differences of states that nothing moves, whatever moved them",
        check=states_move_by_what_moves_them,
    ),
    Slip(
        where="verification.checks.row_sums:slope_bounds",
        stands="if not continuous.proved:",
        slipped="if continuous is None:",
        causes="slopes beside a jump bound differences across it: A2 PROVED",
        check=a_jump_has_no_row_sums,
    ),
    Slip(
        where="verification.checks.increment:monotone",
        stands="reach = gain * (slopes.gain_high + r)",
        slipped="reach = gain * slopes.gain_high",
        causes="monotone convergence PROVED where l_max (b + r) is above 2",
        check=row_sums_count_for_the_largest_gain,
    ),
    Slip(
        where="verification.checks.increment:weighted",
        stands="reach = gain * (slopes.gain_high + r)",
        slipped="reach = gain * (slopes.gain_high - r)",
        causes="weighted convergence PROVED where l_max (b + r) is above 2",
        check=weighted_rows_add_to_the_slope,
    ),
    Slip(
        where="verification.checks.increment:largest_weight",
        stands="< share * slopes.gain_low",
        slipped="< slopes.gain_low",
        causes="a weight that leaves no room",
        check=the_weight_leaves_its_share,
    ),
    Slip(
        where="verification.checks.increment:factor",
        stands="(slopes.gain_high + r) - 1",
        slipped="(slopes.gain_high - r) - 1",
        causes="a factor a trial below 1 for errors that grow",
        check=an_input_error_grows_by_its_factor,
    ),
    Slip(
        where="verification.checks.limit:contracting",
        stands="np.nextafter(2 - product",
        slipped="np.nextafter(4 - product",
        causes="the limit of learning PROVED for l B up to 4, where inputs swing ever farther",
        check=a_gain_of_two_and_a_half_does_not_contract,
    ),
    Slip(
        where="verification.checks.limit:transient",
        stands="np.argmax(mse[1:])",
        slipped="np.argmin(mse[1:])",
        causes="an error that rose never did",
        check=errors_that_rise_are_seen,
    ),
    Slip(
        where="verification.checks.limit:unreached",
        stands="np.argmin(reach)",
        slipped="np.argmax(reach)",
        causes="every sample is reached again and again, if one is",
        check=the_last_sample_is_reached_least,
    ),
    Slip(
        where="verification.checks.limit:held_at_first_sample",
        stands="np.minimum(after - ends.min(axis=0), ends.max(axis=0) - after)",
        slipped="after - ends.min(axis=0)",
        causes="an attack that lets errors shrink as slowly as they like",
        check=steps_of_the_proof_are_held,
    ),
    Slip(
        where="verification.checks.limit:slope_everywhere",
        stands="np.arange(horizon)",
        slipped="0",
        causes="the slope of the first sample is taken for that of all",
        check=the_slope_is_that_of_every_sample,
    ),
    Slip(
        where="verification.checks.funnel:Maker.question",
        stands="2 * float(scope.noise[0])",
        slipped="float(scope.noise[0])",
        causes="a funnel that trials with noise leave: increments are off by twice the noise",
        check=noise_counts_twice,
    ),
    Slip(
        where="verification.checks.funnel:around",
        stands="x=_hull([one.x for one in sets])",
        slipped="x=first.x",
        causes="the funnel of one part of a scope is given for the whole",
        check=the_hull_holds_every_part,
    ),
    Slip(
        where="verification.checks.funnel:parts_of",
        stands="float(cuts[name][i + 1])",
        slipped="float(cuts[name][i])",
        causes="a funnel for a few values of a quantity is given for a range",
        check=parts_cover_a_range,
    ),
    Slip(
        where="verification.checks.funnel:_leaves",
        stands="out |= ends[:, 1] > high",
        slipped="pass",
        causes="a funnel PROVED where inputs leave the domain in which the equations mean something",
        check=a_domain_has_two_sides,
    ),
    Slip(
        where="verification.checks.funnel_curve:_mean_square",
        stands="np.maximum(np.abs(reference - sets.y[:, 0])",
        slipped="np.minimum(np.abs(reference - sets.y[:, 0])",
        causes="a learning curve PROVED that trials lie above",
        check=the_curve_lies_above_the_run,
    ),
    Slip(
        where="verification.checks.funnel_curve:falls",
        stands="if not first > end:",
        slipped="if not first:",
        causes="a learning curve is REFUTED by a bound that does not fall, which refutes nothing",
        check=a_curve_that_does_not_fall_is_no_proof,
    ),
    Slip(
        where="verification.checks.envelope:held_inside",
        stands="most - ends.high + add",
        slipped="most - ends.low + add",
        causes="campaigns that leave a funnel above do not contradict it",
        check=everything_reached_lies_within,
    ),
    Slip(
        where="verification.checks.learned_gain:Shown._kept",
        stands="if not self.learned.varying_lengths:",
        slipped="if self.learned is not None:",
        causes="a law that moves plans where no trial came is PROVED to keep them",
        check=the_plan_is_kept_where_no_trial_came,
    ),
    Slip(
        where="verification.checks.learned_gain:Shown._within",
        stands="why = gain and found.within(",
        slipped="why = None and found.within(",
        causes="a law is PROVED to learn with the gain that it declares, whatever it has",
        check=the_gain_is_the_declared_one,
    ),
    Slip(
        where="verification.checks.learned_forms:Column._seen",
        stands="place.column - self.k if wide",
        slipped="0 if wide",
        causes="a sample that learns from another one's error is taken for one that learns from its own",
        check=every_sample_learns_from_its_own,
    ),
    Slip(
        where="verification.checks.learned_graph:_Missing._present",
        stands="one.column >= source.column",
        slipped="one.column >= source.column - 1",
        causes="a law is PROVED to learn in its form whose plan is no number after a short trial",
        check=a_later_sample_may_be_missing,
    ),
    Slip(
        where="verification.checks.univariate:positive",
        stands="changes(low, above=False) == changes(high, above=True)",
        slipped="changes(low, above=False) >= changes(high, above=True)",
        causes="a gain that leaves its ends in between is PROVED to lie between them",
        check=a_polynomial_may_dip_between_its_ends,
    ),
    Slip(
        where="verification.checks.univariate:_odd",
        stands="if power % 2:",
        slipped="if power % 2 and power < 3:",
        causes="a gain that crosses its end three times at once is PROVED never to",
        check=a_polynomial_may_cross_three_times_at_once,
    ),
    Slip(
        where="verification.checks.estimate_form:_parameters",
        stands="if not 0 < eta <= 1:",
        slipped="if not 0 < eta:",
        causes="an estimate that may run away is PROVED bounded",
        check=an_estimate_may_not_step_too_far,
    ),
    Slip(
        where="verification.checks.update:_room",
        stands="np.where(reached, np.minimum",
        slipped="np.where(True, np.minimum",
        causes="plans that moved after the end of a trial do not contradict the form",
        check=a_plan_that_moved_is_seen,
    ),
    Slip(
        where="verification.checks.wanted:_inside",
        stands="np.minimum(values - room - low, high - values - room)",
        slipped="np.minimum(values - low, high - values)",
        causes="an input that follows is PROVED to lie in the box, whose wall what is not exact may cross",
        check=the_wall_is_nearer_by_what_is_not_exact,
    ),
    Slip(
        where="verification.checks.wanted:Wanted.defects",
        stands="np.maximum(np.abs(high - wanted), np.abs(low - wanted))",
        slipped="0 * np.abs(high - wanted)",
        causes="an input that does not follow is PROVED to",
        check=defects_are_no_smaller_than_they_are,
    ),
    Slip(
        where="verification.checks.premises:same_but_for_the_input",
        stands="if law.places:",
        slipped="if law is None:",
        causes="theorems about differences of inputs PROVED for a law that moves the start",
        check=a_law_that_moves_the_start_is_told,
    ),
    Slip(
        where="verification.checks.premises:plan_alone",
        stands="return acts if ca.depends_on(",
        slipped="return acts if not ca.depends_on(",
        causes="a law that acts within the trial is taken for one that only plans",
        check=feedback_is_told,
    ),
    Slip(
        where="verification.checks.settled:settled",
        stands="holds=reason is None",
        slipped="holds=True",
        causes="every premise about the settings is met",
        check=noise_is_told,
    ),
    Slip(
        where="verification.checks.settled:whole_trials",
        stands="least(study.horizon) < study.horizon",
        slipped="least(study.horizon) > study.horizon",
        causes="trials that end early last to their end",
        check=short_trials_are_told,
    ),
    Slip(
        where="verification.checks.delayed:delayed_step",
        stands='at["k"] + step)',
        slipped='at["k"])',
        causes="A1 and A4 of a late plant are looked at with the coefficients of another sample",
        check=later_steps_come_later,
    ),
    Slip(
        where="verification.checks.delayed:delayed_box",
        stands="last - (degree - 1)",
        slipped="last",
        causes="A1 REFUTED at a step that no trial makes",
        check=the_last_step_lies_in_the_box,
    ),
    Slip(
        where="verification.checks.continuity:continuous_slope",
        stands='("df/du", slopes, None, continuous_on(slopes, inner))',
        slipped='("df/du", slopes, None, continuous_on(f, inner))',
        causes="A1 PROVED of |u|, whose slope jumps",
        check=a_kink_has_no_continuous_slope,
    ),
    Slip(
        where="verification.theorems.learning:_assumptions",
        stands="continuity.continuous_slope(d.plant, box, d.evidence.degree)",
        slipped="continuity.continuous_slope(d.plant, box, 1)",
        causes="A1 at the wrong degree: PROVED of an output that does not answer the input yet",
        check=a_jump_of_the_late_output_is_found,
    ),
    Slip(
        where="verification.checks.slope:slope",
        stands="(entry.row, entry.column) == (row, column)",
        slipped="(entry.column, entry.row) == (row, column)",
        causes="bounds of |dx_i/dx_j| for those of |dx_j/dx_i|",
        check=the_asked_entry_is_taken,
    ),
    Slip(
        where="verification.checks.lipschitz:lipschitz",
        stands="-found.lower, found.upper)",
        slipped="found.upper)",
        causes="a right-hand side that falls is PROVED to have the Lipschitz constant 0",
        check=a_falling_slope_counts,
    ),
    Slip(
        where="verification.checks.jump:_along",
        stands="abs(fm - fa) >= abs(fb - fm)",
        slipped="abs(fm - fa) < abs(fb - fm)",
        causes="a map that jumps does not",
        check=a_step_is_found,
    ),
    Slip(
        where="verification.checks.values:values_of",
        stands="if len(found) < result.shape[0] * result.shape[1]:",
        slipped="if not found:",
        causes="an entry that is always zero does not count for the least value",
        check=an_entry_that_is_zero_is_a_value,
    ),
    Slip(
        where="verification.checks.linear_loop:spectral_radius",
        stands="control.feedback(loop, 1)",
        slipped="control.feedback(0.5 * loop, 1)",
        causes="a critical gain that is twice what it is: gains are SUPPORTED to be safe that are not",
        check=an_integrator_bears_a_gain_of_two,
    ),
    Slip(
        where="verification.checks.initial_state:held_against",
        stands="errors[1:] - factor * errors[:-1]",
        slipped="errors[1:] * 0",
        causes="no initial error contradicts the proved factor",
        check=initial_errors_follow_their_factor,
    ),
    Slip(
        where="verification.checks.attack:_inside",
        stands="np.logical_and(x >= low, x <= high)",
        slipped="np.logical_and(x >= low, x >= low)",
        causes="attacks from outside of the scope: CONTRADICTION of what is true",
        check=trials_leave_a_set_at_their_first_sample_outside,
    ),
    Slip(
        where="verification.checks.attack:_held_differences",
        stands="spare[:both] - answer",
        slipped="spare[:both] + answer",
        causes="a p that is too small is not contradicted",
        check=a_bound_that_is_too_small_is_contradicted,
    ),
    Slip(
        where="verification.checks.polynomial:Identity._gap",
        stands="[self.left - self.right]",
        slipped="ca.substitute([self.left - self.right], symbols, [ca.SX(number) for _, number in self.at.values()])",
        causes="a Lyapunov identity is PROVED that holds in the one point that was looked at",
        check=sides_that_meet_in_one_point_are_not_equal,
    ),
    Slip(
        where="verification.checks.polynomial:Variables.inverse",
        stands="1 / coefficient",
        slipped="coefficient",
        causes="1/(2 a) = 2/a is PROVED",
        check=an_inverse_has_an_inverse_factor,
    ),
    Slip(
        where="verification.checks.polynomial:negative",
        stands="-one for",
        slipped="one for",
        causes="3 a = -3 a is PROVED",
        check=a_number_is_not_its_negative,
    ),
    Slip(
        where="verification.checks.shares:most_that_fail",
        stands="betaincinv(failed + 1, tries - failed",
        slipped="betaincinv(failed + 1, tries + 1",
        causes="less may fail than draws say",
        check=failures_have_their_share,
    ),
    Slip(
        where="verification.checks.shares:about_all",
        stands="finding.tries >= needed",
        slipped="finding.tries >= 1",
        causes="ten draws support a claim about all draws",
        check=ten_draws_say_little_of_all,
    ),
    Slip(
        where="verification.checks.tube:rpi",
        stands="tube.A_cl @ answer.x + w)",
        slipped="tube.A_cl @ answer.x)",
        causes="a set that the disturbance leaves is robustly invariant",
        check=a_set_that_is_left_is_not_invariant,
    ),
    Slip(
        where="verification.checks.tube:tube_inside",
        stands="tube.Sigma.h - minimal.support(tube.Sigma.H)",
        slipped="tube.Sigma.h + minimal.support(tube.Sigma.H)",
        causes="a tube lies in a set that it sticks out of",
        check=a_tube_that_sticks_out_is_seen,
    ),
    Slip(
        where="verification.checks.tube:_slack",
        stands=" - bounds.H @ _simulated(tube, w, stage, M)",
        slipped="",
        causes="tightened bounds are sound whatever the delay is",
        check=a_delay_that_is_ignored_is_felt,
    ),
    Slip(
        where="verification.checks.tube:lyapunov",
        stands="margin=ROUNDING - size",
        slipped="margin=ROUNDING + size",
        causes="(19) holds with any P",
        check=a_wrong_weight_misses_its_equation,
    ),
    Slip(
        where="verification.checks.feasibility:simulate",
        stands="for j in range(plant.delay):",
        slipped="for j in range(plant.delay - 1):",
        causes="bounds are kept by an error that lacks what disturbs it within the delay",
        check=disturbances_pass_through_the_delay,
    ),
    Slip(
        where="verification.checks.predictive:_kept",
        stands="if run.lost:",
        slipped="if run.lost > 1:",
        causes="a run that was once without a plan was always feasible",
        check=a_lost_plan_is_a_failure,
    ),
)
