"""Slips in the workbench: derivatives and tables, sets and tubes, laws, what is drawn, recorded and scored."""

from __future__ import annotations

import casadi as ca
import numpy as np
import xarray as xr
from brake_tubes import integrator_tube
from learning_laws import Planned, Second
from scipy import signal as filters
from small_plants import small

from models.expression import as_expression
from slips.planting import Slip
from workbench import Study, run
from workbench.contracts import scope
from workbench.contracts.law import Trial
from workbench.contracts.scenario import NormalNoise, UniformNoise
from workbench.contracts.trial_length import TrialLength
from workbench.controllers import ICFDL, Increment
from workbench.controllers.parts.zero_phase import low_pass
from workbench.controllers.rsmpc import RSMPC
from workbench.evidence.lifted import Lifted, largest_singular_value
from workbench.evidence.trajectory import Lineariser, partial, rollout
from workbench.graph import call, jacobian, read
from workbench.graph.table import Lookup, Table, value
from workbench.predictive.delayed_plant import DelayedPlant
from workbench.predictive.quadratic_program import Infeasible
from workbench.predictive.regulator import decrease, lmi, terminal_weight
from workbench.sets import Polytope, Zonotope
from workbench.sets.invariant import maximal_rpi, minimal_rpi, rpi_residual
from workbench.trials.draws import draw_of
from workbench.trials.metrics import trial_scores
from workbench.trials.simulation import diverged

N = 8
RAMP = np.linspace(0.0, 1.0, N + 1) ** 2
STEADY = small("Steady", lambda x, u, k: (0.9 * x[0] + 0.5 * u,))


def study(**more):
    return Study(**{"name": "small", "plant": STEADY, "reference": RAMP, "trials": 4, "controllers": {"law": Planned()}}
                 | more)  # fmt: skip


# ------------------------------------------------------------------ graphs


def slopes_are_those_of_school():
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    point = {"x": np.array([[0.7]]), "y": np.array([[1.9]])}
    for of, by_x, by_y in (
        (x / y, 1 / 1.9, -0.7 / 1.9**2),
        (x**y, 1.9 * 0.7**0.9, 0.7**1.9 * np.log(0.7)),
        (ca.atan2(x, y), 1.9 / (0.7**2 + 1.9**2), -0.7 / (0.7**2 + 1.9**2)),
    ):
        graph = read(ca.Function("f", [x, y], [of], ["x", "y"], ["f"]))
        found = [next(iter(call(jacobian(graph, "f", by), point).values()))[0, 0] for by in ("x", "y")]
        assert np.allclose(found, [by_x, by_y], rtol=1e-12)


def a_choice_has_the_slope_of_its_branch():
    x = ca.SX.sym("x")
    graph = read(ca.Function("f", [x], [ca.if_else(x > 0, 3 * x, -2 * x)], ["x"], ["f"]))
    for at, slope in ((1.0, 3.0), (-1.0, -2.0)):
        assert next(iter(call(jacobian(graph, "f", "x"), {"x": np.array([[at]])}).values()))[0, 0] == slope


TABLE = Table(name="t", kind="linear", grid=((0.0, 1.0, 2.0),), values=(0.0, 1.0, 4.0), outputs=1, degrees=(1,),
              search=(0,))  # fmt: skip


def a_table_goes_on_as_it_ends():
    for at, expected in ((3.0, 7.0), (-1.0, -1.0), (1.5, 2.5)):
        assert value(TABLE, Lookup(0, 0, (0,)), [at], float) == expected


def a_table_is_halved_to_the_right_piece():
    halved = Table(name="t", kind="linear", grid=((0.0, 1.0, 2.0, 3.0),), values=(0.0, 1.0, 4.0, 9.0), outputs=1,
                   degrees=(1,), search=(2,))  # fmt: skip
    for at, expected in ((0.5, 0.5), (1.5, 2.5), (2.5, 6.5), (4.0, 14.0)):
        assert value(halved, Lookup(0, 0, (0,)), [at], float) == expected


# ------------------------------------------------------------------ sets and tubes

TURN = np.array([[0.6, 0.5], [-0.3, 0.7]])
PUSH = Zonotope.box([-0.1, -0.05], [0.1, 0.2])
AROUND = np.array([[np.cos(a), np.sin(a)] for a in np.linspace(0, 2 * np.pi, 9)])


def a_support_is_attained():
    crossed = Zonotope(center=np.array([1.0, 0.0]), generators=np.array([[1.0, -1.0], [0.5, 2.0]]))
    corners = [crossed.center + crossed.generators @ z for z in np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])]
    assert np.allclose(crossed.support(AROUND), (np.array(corners) @ AROUND.T).max(axis=0))


def an_extreme_point_is_extreme():
    for row, reach in zip(AROUND, PUSH.support(AROUND), strict=True):
        assert np.isclose(row @ PUSH.extreme(row), reach)


def the_rest_of_a_sum_is_in_its_tail():
    found = minimal_rpi(TURN, PUSH, tolerance=0.5)
    whole, term = np.zeros(len(AROUND)), np.eye(2)
    for _ in range(300):
        whole += PUSH.mapped(term).support(AROUND)
        term = TURN @ term
    assert (found.support(AROUND) >= whole - 1e-12).all()


def a_set_is_left_by_a_push():
    assert rpi_residual(np.array([[0.5]]), Zonotope.box([-0.6], [0.6]), Polytope.box([-1.0], [1.0])) > 0


def an_invariant_set_is_not_left():
    found = maximal_rpi(TURN, PUSH, Polytope.box([-1.0, -1.0], [1.0, 1.0]))
    worst = max(
        found.support(row @ TURN) + PUSH.support(row[None])[0] - h for row, h in zip(found.H, found.h, strict=True)
    )
    assert worst <= 1e-7


def what_is_taken_away_fits():
    left = Polytope.box([-1.0], [1.0]).minus(Zonotope.box([-0.1], [0.4]))
    assert np.isclose(left.support(np.array([1.0])), 0.6) and np.isclose(left.support(np.array([-1.0])), 0.9)


def a_held_tube_runs_without_feedback_first():
    tube = integrator_tube()
    M, i = 2, 4
    A, A_cl, W = tube.plant.A, tube.A_cl, tube.W_z
    maps = []
    for j in range(i):  # what comes at sample j goes on under A while the input is held, then under A + b K
        held, after = max(M - 1 - j, 0), i - max(M, j + 1)
        maps.append(np.linalg.matrix_power(A_cl, after) @ np.linalg.matrix_power(A, held))
    assert np.allclose(tube.R_hold(M, i).support(AROUND), sum(W.mapped(one).support(AROUND) for one in maps))


def a_prediction_misses_what_the_delay_lets_in():
    plant = DelayedPlant(A=TURN, b=np.array([1.0, 0.5]), W=PUSH, delay=2)
    assert np.allclose(plant.prediction_error.support(AROUND), PUSH.support(AROUND) + PUSH.mapped(TURN).support(AROUND))


def both_inequalities_say_the_same():
    A_cl, K, Q = np.array([[0.9]]), np.array([0.3]), np.array([[1.0]])
    for share in (0.5, 2.0):
        P = share * terminal_weight(A_cl, K, Q, 1.0)
        falls = np.linalg.eigvalsh(decrease(A_cl, K, Q, 1.0, P))[-1] <= 1e-9
        assert falls == (np.linalg.eigvalsh(lmi(A_cl, K, Q, 1.0, P))[0] >= -1e-9)


def a_hold_costs_no_more_than_allowed():
    law = RSMPC(tube=integrator_tube(), N=4, beta=1.1)
    slack = law.tolerance * law.problem(1).program.cost_size
    rng, tried = np.random.default_rng(3), 0
    center = law.deciding.inside()
    for direction in rng.normal(size=(30, 2)) * law.deciding.spread(center):
        e = center + rng.uniform(0, 0.9) * min(law.deciding.edge(center, direction).distance, 1.0) * direction
        once, chosen = law.plan(e, 1), law.select(e)
        if isinstance(once, Infeasible) or isinstance(chosen, Infeasible):
            continue
        tried += 1
        assert chosen.plan.J <= once.J + slack
    assert tried > 5


# ------------------------------------------------------------------ laws


def a_filter_halves_its_cutoff():
    step, cutoff = 0.1, 1.0
    t = step * np.arange(400)
    row, out = np.sin(2 * np.pi * cutoff * t), ca.MX.sym("row", 1, t.size)
    found = ca.Function("f", [out], [low_pass(out, cutoff, step)])(row).full()[0]
    assert np.isclose(np.linalg.norm(found[100:300]) / np.linalg.norm(row[100:300]), 0.5, rtol=0.02)


def trial_of(reached, y):
    row = [as_expression(ca.DM(np.atleast_2d(np.asarray(one, dtype=float)))) for one in (y, reached)]
    r = as_expression(ca.DM.ones(1, len(reached)))
    return Trial(r, row[0], r - row[0], as_expression(ca.DM.zeros(1, len(reached) - 1)), row[1], ())


def number(expression):
    return ca.DM(ca.evalf(ca.densify(expression)) if not isinstance(expression, ca.DM) else expression).full()[0]


def an_estimate_needs_two_trials():
    law = ICFDL(force_unit=1.0, rho=0.5, lam=1.0, mu=1.0, initial_input=0.3)
    row = [
        as_expression(ca.DM(one)) for one in ([[0.5, 0.5]], [[1.0, 1.0]], [[0.1, 0.1]], [[0.0, 0.2, 0.3]], [[1, 1, 0]])
    ]
    memory = law.start(study().task(law))._replace(
        u=row[0], phi=row[1], u_before=row[2], y_before=row[3], reached_before=row[4]
    )
    found = law.learn(memory, trial_of([1, 1, 1], [0.0, 0.4, 0.6]))
    assert number(found.phi)[0] != 1 and number(found.phi)[1] == 1


def an_estimate_keeps_its_sign():
    law = ICFDL(force_unit=1.0, lam=1.0, mu=1.0)
    one = [as_expression(ca.DM(v)) for v in (1.0, 1.0, -9.0)]
    assert number(law.update(*one)) == law.first_estimate()


def an_estimate_stays_between_its_ends():
    law = Increment(force_unit=1.0, rho=0.5, lam=1.0, mu=0.01, initial_input=0.3, phi_range=(0.8, 2.0))
    data = run(study(controllers={"law": law}, trials=6, plant=Second()), show_progress=False).data
    estimate = data["ppd_estimate"].values[0, :, :-1]
    assert estimate.min() == 0.8 and estimate.max() <= 2.0


# ------------------------------------------------------------------ evidence


def rows_are_those_of_the_matrix():
    x, _ = rollout(Second(), np.zeros(2), np.zeros(N))
    line = Lineariser(Second(), N).at(x, np.zeros(N), np.zeros((0, N)))
    lifted = Lifted(line, 1, increment=True)
    matrix = np.array([lifted.apply(one) for one in np.eye(N)]).T
    off, own = lifted.row_sums()
    assert np.allclose(own, np.abs(np.diag(matrix))) and np.allclose(off + own, np.abs(matrix).sum(axis=1))
    assert np.allclose(lifted.adjoint(np.arange(N) + 1.0), matrix.T @ (np.arange(N) + 1.0))


def a_singular_value_lies_within_its_residual():
    matrix = np.random.default_rng(0).standard_normal((9, 9))
    found = largest_singular_value(lambda v: matrix @ v, lambda v: matrix.T @ v, 9, np.inf)
    true = np.linalg.svd(matrix, compute_uv=False)
    assert np.isclose(found.value, true[0], rtol=1e-4) and found.residual < 1e-3


def a_late_slope_is_that_of_its_sample():
    plant = small("Clock", lambda x, u, k: ((1 + 0.5 * ca.sin(k)) * x[1], u), states=2)
    line = Lineariser(plant, N).at(np.zeros((2, N + 1)), np.zeros(N), np.zeros((0, N)))
    assert np.allclose(partial(line, 2), 1 + 0.5 * np.sin(np.arange(1, N)))


# ------------------------------------------------------------------ scenarios, records, scores


def a_seed_decides_what_is_drawn():
    first, second = (study(seed=seed, noise=UniformNoise(largest=1.0)).inputs()[0].noise for seed in (1, 2))
    assert not np.array_equal(first, second)


def noise_comes_from_its_stream():
    first, second = (NormalNoise(sigma=1.0).draw(STEADY, N, np.random.default_rng(seed)) for seed in (1, 2))
    assert not np.array_equal(first, second)


def draws_have_seeds_of_their_own():
    one = study(seed=5, draws=3)
    assert [draw_of(one, draw).seed for draw in range(3)] == [5, 6, 7]


def every_trial_reaches_its_first_sample():
    law = TrialLength(minimum=3)
    lengths, mass = law.distribution(N)
    assert np.allclose(law.reach_probability(N), [mass[lengths >= k].sum() for k in range(N + 1)])


def a_scope_has_two_ends():
    told = []
    scope._held("plant mass", "kg", (0.0, 1.0), scope._Ends(0.5, 2.0), told)
    assert told


def scopes_hold_what_noise_may_be():
    found = scope.scope_of(study(noise=UniformNoise(largest=0.25)))
    assert found.noise[0] == 0.25 and not found.open


def a_mean_is_over_the_samples_that_were_reached():
    data = run(study(trial_length=TrialLength(minimum=2), trials=6), show_progress=False).data
    lengths = data["trial_length"].values.reshape(-1)
    for error, mse, length in zip(data["error"].values[0], data["mse"].values[0], lengths, strict=True):
        assert np.isclose(mse, np.mean(error[1 : int(length) + 1] ** 2), rtol=1e-12)


def scores_leave_the_start_out():
    one = study(trial_length=TrialLength(minimum=3))
    error = np.zeros((1, 4, N + 1))
    error[0, -1, 0], error[0, -1, 2] = 9.0, 3.0
    data = xr.Dataset(
        {"error": (("controller", "trial", "sample"), error), "mse": (("controller", "trial"), np.ones((1, 4))),
         "diverged_at_trial": (("controller",), [np.nan])},
        {"controller": ["law"]},
    )  # fmt: skip
    least = one.scenario.trial_length.least(N)
    assert np.isclose(trial_scores(one, data)["law"]["mse_always_reached_last"], 9.0 / least)


def a_law_diverges_by_its_error_not_the_square():
    assert diverged({"y": 1.0}, 10.0, np.array([81.0])) is None
    assert diverged({"y": 1.0}, 10.0, np.array([121.0])) is not None


def a_filter_has_the_gain_of_scipy():
    b, a = filters.butter(2, 0.2)
    row = np.random.default_rng(0).standard_normal(60)
    out = ca.MX.sym("row", 1, 60)
    found = ca.Function("f", [out], [low_pass(out, 0.1, 1.0)])(row).full()[0]
    zi = filters.lfilter_zi(b, a)
    once = filters.lfilter(b, a, row, zi=zi * row[0])[0][::-1]
    assert np.allclose(found, filters.lfilter(b, a, once, zi=zi * once[0])[0][::-1], atol=1e-9)


SLIPS = (
    Slip(
        where="workbench.graph.derivative:_quotient",
        stands='b.operation("neg", b.operation("div", f, y))',
        slipped='b.operation("div", f, y)',
        causes="slopes by a divisor with their sign turned: A4 PROVED or REFUTED wrongly",
        check=slopes_are_those_of_school,
    ),
    Slip(
        where="workbench.graph.derivative:gradient",
        stands='build.operation("if_else_zero", node.args[0], so_far)',
        slipped="so_far",
        causes="both branches of a choice add to its slope",
        check=a_choice_has_the_slope_of_its_branch,
    ),
    Slip(
        where="workbench.graph.table:_linear",
        stands="share = (x - grid[at]) / width",
        slipped="share = min(max((x - grid[at]) / width, number(0.0)), number(1.0))",
        causes="a table that stands still beyond its grid, where the compiled one goes on",
        check=a_table_goes_on_as_it_ends,
    ),
    Slip(
        where="workbench.graph.table:_interval",
        stands="if x < grid[pivot]:",
        slipped="if x < grid[pivot - 1]:",
        causes="values of a neighbouring piece of a table",
        check=a_table_is_halved_to_the_right_piece,
    ),
    Slip(
        where="workbench.sets.zonotope:Zonotope.support",
        stands="np.abs(directions @ self.generators)",
        slipped="(directions @ self.generators)",
        causes="tubes and tightened bounds that are too small: feasibility SUPPORTED by too little",
        check=a_support_is_attained,
    ),
    Slip(
        where="workbench.sets.zonotope:Zonotope.extreme",
        stands="direction @ self.generators < 0, -1.0, 1.0",
        slipped="direction @ self.generators < 0, 1.0, -1.0",
        causes="the worst disturbance is the mildest: nothing is ever violated",
        check=an_extreme_point_is_extreme,
    ),
    Slip(
        where="workbench.sets.invariant:minimal_rpi",
        stands=".sum() / (1 - rate))",
        slipped=".sum())",
        causes="a tube without most of its tail is inside",
        check=the_rest_of_a_sum_is_in_its_tail,
    ),
    Slip(
        where="workbench.sets.invariant:rpi_residual",
        stands="np.array(reach) + push - S.h",
        slipped="np.array(reach) - S.h",
        causes="a set that the disturbance leaves is invariant",
        check=a_set_is_left_by_a_push,
    ),
    Slip(
        where="workbench.sets.invariant:maximal_rpi",
        stands="offsets = offsets - W.support(back)",
        slipped="offsets = offsets",
        causes="an invariant set for a plant without disturbance",
        check=an_invariant_set_is_not_left,
    ),
    Slip(
        where="workbench.sets.polytope:Polytope.minus",
        stands="other.support(self.H)",
        slipped="other.support(-self.H)",
        causes="bounds tightened at the wrong side",
        check=what_is_taken_away_fits,
    ),
    Slip(
        where="workbench.predictive.tube:Tube.R_hold",
        stands="np.linalg.matrix_power(self.A_cl, i - M)",
        slipped="np.linalg.matrix_power(self.plant.A, i - M)",
        causes="(27) decided for a tube without feedback after the hold",
        check=a_held_tube_runs_without_feedback_first,
    ),
    Slip(
        where="workbench.predictive.delayed_plant:DelayedPlant.prediction_error",
        stands="[self.delay]",
        slipped="[max(self.delay - 1, 0)]",
        causes="bounds that the true error breaks within the delay",
        check=a_prediction_misses_what_the_delay_lets_in,
    ),
    Slip(
        where="workbench.predictive.regulator:lmi",
        stands="[P - A_cl.T @ P @ A_cl, root.T, row.T]",
        slipped="[P, root.T, row.T]",
        causes="(20) holds with a P that violates (19)",
        check=both_inequalities_say_the_same,
    ),
    Slip(
        where="workbench.controllers.rsmpc:RSMPC.select",
        stands="held.J <= once.J + slack",
        slipped="held.J <= 1.05 * once.J + slack",
        causes="a trigger that is 5 % loose: suboptimality SUPPORTED for another law",
        check=a_hold_costs_no_more_than_allowed,
    ),
    Slip(
        where="workbench.controllers.parts.zero_phase:low_pass",
        stands="math.pi * cutoff_hz",
        slipped="math.pi * 2 * cutoff_hz",
        causes="a filter at twice its cutoff: contraction by period for another law",
        check=a_filter_halves_its_cutoff,
    ),
    Slip(
        where="workbench.controllers.parts.zero_phase:_forward",
        stands="ca.vertcat((1 - b0) * first, (b0 - a2) * first)",
        slipped="ca.vertcat(0 * first, 0 * first)",
        causes="plans that begin with a transient of the filter",
        check=a_filter_has_the_gain_of_scipy,
    ),
    Slip(
        where="workbench.controllers.icfdl:ICFDL.learn",
        stands="ca.logic_and(reached, memory.reached_before[1:])",
        slipped="reached",
        causes="estimates from outputs that no trial reached",
        check=an_estimate_needs_two_trials,
    ),
    Slip(
        where="workbench.controllers.parts.ppd_estimator:Parameters.update",
        stands="ca.sign(phi) == ca.sign(first)",
        slipped="ca.sign(phi) != 0",
        causes="an estimate with the wrong sign, which the limit of learning leaves out",
        check=an_estimate_keeps_its_sign,
    ),
    Slip(
        where="workbench.controllers.increment:Increment.learn",
        stands="ca.fmin(ca.fmax(phi, least), most)",
        slipped="phi",
        causes="gains beyond those that the learning curve is proved for",
        check=an_estimate_stays_between_its_ends,
    ),
    Slip(
        where="workbench.evidence.lifted:Lifted.row_sums",
        stands="np.abs(entries[: own + 1]).sum()",
        slipped="np.abs(entries[: own + 1].sum())",
        causes="row sums in which entries cancel: A2 and increment_monotone with too small an r",
        check=rows_are_those_of_the_matrix,
    ),
    Slip(
        where="workbench.evidence.lifted:largest_singular_value",
        stands="adjoint(image) - value**2 * vector",
        slipped="adjoint(image) - value * vector",
        causes="a residual of something else: monotone UNDECIDED where it is true",
        check=a_singular_value_lies_within_its_residual,
    ),
    Slip(
        where="workbench.evidence.trajectory:partial",
        stands="line.a[step : step + last]",
        slipped="line.a[step - 1 : step - 1 + last]",
        causes="A4 looks at the slope of another sample",
        check=a_late_slope_is_that_of_its_sample,
    ),
    Slip(
        where="workbench.contracts.drawn:_streams",
        stands="np.random.SeedSequence(study.seed)",
        slipped="np.random.SeedSequence(0)",
        causes="draws that are all the same support a claim about all",
        check=a_seed_decides_what_is_drawn,
    ),
    Slip(
        where="workbench.contracts.scenario:NormalNoise.draw",
        stands="noise[row] = rng.normal(",
        slipped="noise[row] = np.random.default_rng(0).normal(",
        causes="noise that ignores its seed: every trial meets the same",
        check=noise_comes_from_its_stream,
    ),
    Slip(
        where="workbench.trials.draws:draw_of",
        stands="seed=study.seed + draw",
        slipped="seed=study.seed",
        causes="twenty draws that are one",
        check=draws_have_seeds_of_their_own,
    ),
    Slip(
        where="workbench.contracts.trial_length:TrialLength.reach_probability",
        stands="np.cumsum(mass[::-1])[::-1]",
        slipped="np.cumsum(mass)",
        causes="late samples are reached for sure, early ones never",
        check=every_trial_reaches_its_first_sample,
    ),
    Slip(
        where="workbench.contracts.scope:_held",
        stands="low <= met.low <= met.high <= high",
        slipped="low <= met.low",
        causes="a proof for a scope that the study leaves above is PROVED for the study",
        check=a_scope_has_two_ends,
    ),
    Slip(
        where="workbench.contracts.scenario:UniformNoise.bound",
        stands="= self.largest",
        slipped="= self.largest / 2",
        causes="a funnel for half the noise that trials meet",
        check=scopes_hold_what_noise_may_be,
    ),
    Slip(
        where="workbench.fold.fold:_functions",
        stands="ca.sum2(squared) / length",
        slipped="ca.sum2(squared) / samples",
        causes="short trials have a small error: monotone and outcomes SUPPORTED by their lengths",
        check=a_mean_is_over_the_samples_that_were_reached,
    ),
    Slip(
        where="workbench.trials.metrics:_of_output",
        stands="error[-1, 1 : least + 1]",
        slipped="error[-1, : least + 1]",
        causes="a score that counts the sample that no input reaches",
        check=scores_leave_the_start_out,
    ),
    Slip(
        where="workbench.trials.simulation:diverged",
        stands="math.sqrt(error) > limit",
        slipped="error > limit",
        causes="a law is stopped as diverged that is not",
        check=a_law_diverges_by_its_error_not_the_square,
    ),
)
