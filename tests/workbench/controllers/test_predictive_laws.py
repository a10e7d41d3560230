"""The predictive laws: a second solver, a problem written with its states, dynamic programming, closed loops."""

from __future__ import annotations

import numpy as np
import piqp
import pytest
from brake_tubes import brake_matrices, brake_tube

from models.quantity import InvalidValue
from workbench.controllers.compensated_mpc import CompensatedMPC
from workbench.controllers.rmpc import RMPC
from workbench.controllers.rsmpc import RSMPC
from workbench.controllers.speed_pid import Integral, SpeedPID
from workbench.predictive.condensed import CondensedQP, Plan
from workbench.predictive.decision import start
from workbench.predictive.disturbance_model import DisturbanceModel
from workbench.predictive.quadratic_program import Infeasible, WarmQP, kkt_residual

AGREEMENT = 1e-6
START = Integral(total=0.0, before=None)


def exact_solver():
    """PIQP as tight as it goes: next to the edge of feasibility an error of 1e-10 in it moves the plan by 6e-5."""
    solver = piqp.DenseSolver()
    solver.settings.eps_abs = solver.settings.eps_rel = 1e-13
    return solver


def second_solver(problem: CondensedQP, e):
    solver = exact_solver()
    solver.setup(
        np.asfortranarray(problem.hessian),
        problem.gradient @ e,
        None,
        None,
        np.asfortranarray(problem.G),
        None,
        problem.g - problem.S @ e,
    )
    return solver.result.x if solver.solve() == piqp.PIQP_SOLVED else None


def with_states(tube, e, *, N, M=0, beta=1.0):
    """(11) or, with M > 0, (25) as a problem in all states and increments, equations and all."""
    n, T = tube.plant.order, N + M
    size = n * (T + 1) + T
    H, rows, rhs, G, g = np.zeros((size, size)), [], [], [], []

    def pick(i):
        block = np.zeros((n, size))
        block[:, n * i : n * i + n] = np.eye(n)
        return block

    for i in range(T):
        share = 1 / beta if i < M else 1.0
        H += 2 * share * pick(i).T @ tube.Q @ pick(i)
        H[n * (T + 1) + i, n * (T + 1) + i] = 2 * tube.R * share
        step = tube.plant.A @ pick(i) - pick(i + 1)
        step[:, n * (T + 1) + i] = tube.plant.b
        rows.append(step)
        rhs.append(np.zeros(n))
        bounds = tube.held_stage_bounds(M, i) if M else tube.stage_bounds(i)
        if i:
            G.append(bounds.H @ pick(i))
            g.append(bounds.h)
    H += 2 * pick(T).T @ tube.P @ pick(T)
    bounds = tube.held_terminal_bounds(M, N) if M else tube.terminal_bounds(N)
    G.append(bounds.H @ pick(T))
    g.append(bounds.h)
    rows.append(pick(0))
    rhs.append(e)
    for i in range(1, M):
        hold = np.zeros((1, size))
        hold[0, n * (T + 1) + i] = 1
        rows.append(hold)
        rhs.append(np.zeros(1))
    solver = exact_solver()
    equal, limit = np.asfortranarray(np.vstack(rows)), np.asfortranarray(np.vstack(G))
    solver.setup(np.asfortranarray(H), np.zeros(size), equal, np.concatenate(rhs), limit, None, np.concatenate(g))
    if solver.solve() != piqp.PIQP_SOLVED:
        return None
    return solver.result.x[n * (T + 1) :], solver.result.info.primal_obj


def starts(problem: CondensedQP, count: int, *, seed: int, center=None):
    """Errors inside the feasible set, some next to its edge and some beyond."""
    random, center = np.random.default_rng(seed), problem.inside() if center is None else center
    for number in range(count):
        direction = random.normal(size=center.size)
        distance = problem.edge(center, direction).distance
        yield center + [0.3, 0.9, 0.9999, 1.01][number % 4] * distance * direction, number % 4 < 3


@pytest.mark.parametrize("N", [3, 8, 15])
def test_plans_agree_with_a_second_solver(tube, N):
    problem = RMPC(tube=tube, N=N).problem
    for e, feasible in starts(problem, 16, seed=N):
        answer = problem.solve(e)
        assert isinstance(answer, Plan) == feasible
        if isinstance(answer, Plan):
            other = second_solver(problem, e)
            assert other is not None and np.abs(answer.du - other).max() <= AGREEMENT
            assert answer.residual <= 1e-11


@pytest.mark.parametrize(("N", "M"), [(4, 0), (4, 1), (5, 3), (8, 5)])
def test_plans_agree_with_the_problem_in_all_its_states(tube, N, M):
    law = RSMPC(tube=tube, N=N, contained=False) if M else None
    problem = law.problem(M) if law else RMPC(tube=tube, N=N).problem
    for e, feasible in starts(problem, 6, seed=M):
        answer = problem.solve(e)
        if feasible:
            du, J = with_states(tube, e, N=N, M=M, beta=1.5)
            assert isinstance(answer, Plan)
            assert np.abs(answer.du - du).max() <= AGREEMENT
            assert abs(answer.J - J) <= 1e-6 * max(1, abs(J))
            assert np.all(answer.du[1:M] == 0)


def test_a_hold_of_one_sample_at_beta_one_is_rmpc_with_one_sample_more(tube):
    short, long = RSMPC(tube=tube, N=4, beta=1.0), RMPC(tube=tube, N=5)
    for e, feasible in starts(long.problem, 8, seed=2):
        first, second = short.plan(e, 1), long.plan(e)
        assert isinstance(first, Plan) == isinstance(second, Plan) == feasible
        if isinstance(first, Plan) and isinstance(second, Plan):
            assert np.allclose(first.du, second.du, atol=1e-8) and np.isclose(first.J, second.J)


def test_without_active_bounds_the_plan_is_the_regulator():
    """With P and K both of the cost, dynamic programming says: the first move is K e and J is e'P e, for every N."""
    tube = brake_tube("B")
    e = np.array([0.01, 0.0, 0.02, -0.03])
    for N in (3, 8):
        plan = RMPC(tube=tube, N=N).plan(e)
        assert isinstance(plan, Plan)
        assert np.isclose(plan.du[0], tube.K @ e, atol=1e-9) and np.isclose(plan.J, e @ tube.P @ e)


def test_selection_is_the_largest_hold_that_costs_no_more(brake_a):
    law = RSMPC(tube=brake_a, N=6)
    chosen = set()
    for e, feasible in starts(law.problem(1), 24, seed=9, center=np.zeros(4)):
        if not feasible:
            assert isinstance(law.select(e), Infeasible)
            continue
        choice, plans = law.select(e), {M: law.plan(e, M) for M in law.offered}
        assert not isinstance(choice, Infeasible)
        J1 = plans[1].J
        allowed = [M for M, plan in plans.items() if isinstance(plan, Plan) and J1 + 1e-9 >= plan.J]
        assert choice.M == max(allowed)
        assert choice.qps == 1 + sum(1 for M in law.offered if M > 1 and choice.M <= M)
        chosen.add(choice.M)
    assert len(chosen) > 1


def test_an_m_with_an_empty_set_is_never_offered():
    law = RSMPC(tube=brake_tube("B"), N=15, contained=False)
    assert law.offered == tuple(range(1, 10))
    with pytest.raises(InvalidValue, match=r"M must be one of .*, got 12 \(X_z - R_14\^12 is empty"):
        law.problem(12)


@pytest.mark.parametrize("make", [lambda t: RMPC(tube=t, N=4), lambda t: RSMPC(tube=t, N=5)], ids=["rmpc", "rsmpc"])
def test_closed_loops_stay_feasible_and_within_bounds(tube, make):
    law, plant = make(tube), tube.plant
    problem = law.deciding
    for run, (e, _) in enumerate(list(starts(problem, 9, seed=5))[2::4]):
        random, memory = np.random.default_rng(run), start()
        for _ in range(40):
            decision, memory = law.move(memory, e)
            assert decision.infeasible == ""
            e = plant.A @ e + plant.b * decision.du + plant.W_z.extreme(random.normal(size=plant.order))
            assert tube.X_z.contains(e, tolerance=1e-7)


def test_rsmpc_holds_for_as_long_as_it_said(brake_a):
    law, memory, e = RSMPC(tube=brake_a, N=8), start(), np.array([0.0, 0.05, 0.3, 1.0])
    decision, memory = law.move(memory, e)
    assert decision.M > 1 and decision.qps > 0
    for left in range(decision.M - 1, 0, -1):
        held, memory = law.move(memory, np.full(4, np.nan))  # not looked at while holding
        assert (held.du, held.qps, held.M) == (0.0, 0, left)
    assert memory.wait == 0


@pytest.mark.parametrize("law", [RMPC, RSMPC])
def test_without_a_plan_the_last_one_is_followed_and_told(brake_a, law):
    controller = law(tube=brake_a, N=3)
    _, memory = controller.move(start(), np.array([0.0, 0.05, 0.3, 1.0]))
    while memory.wait:
        _, memory = controller.move(memory, np.zeros(4))
    expected = memory.plan.du[0]
    lost, memory = controller.move(memory, np.array([0.0, 0.0, 5.0, 0.0]))
    assert "'v <= 2 at i = 0' misses by" in lost.infeasible and lost.du == expected and lost.qps == 1
    for _ in range(60):  # past its end the plan goes on by feedback, toward the reference
        lost, memory = controller.move(memory, np.array([0.0, 0.0, 5.0, 0.0]))
    assert abs(lost.du) < 0.01


@pytest.mark.parametrize("law", [RMPC, RSMPC])
def test_without_any_plan_the_feedback_acts_and_it_is_told(brake_a, law):
    e = np.array([0.0, 0.0, 5.0, 0.0])
    decision, memory = law(tube=brake_a, N=3).move(start(), e)
    assert decision.du == brake_a.K @ e and memory == start()
    assert decision.infeasible.endswith("no input can change it; no earlier plan, feedback acts")
    assert "'v <= 2 at i = 0' misses by 3" in decision.infeasible


def test_infeasible_names_rows_and_amount(brake_a):
    answer = RMPC(tube=brake_a, N=3).plan([0.0, 0.5, -1.6, 0.0])
    assert isinstance(answer, Infeasible)
    assert "misses by" in answer.reason and answer.shortfall > 0


def test_compensation_reaches_the_reference_under_a_constant_disturbance(brake_a):
    E = brake_matrices().E
    model = DisturbanceModel(plant=brake_a.plant, E=E, Q=brake_a.Q)
    offsets = {}
    for compensated in (False, True):
        law, memory, plant = CompensatedMPC(tube=brake_a, model=model, N=8), start(), brake_a.plant
        x, pending, d, seen = np.zeros(4), np.zeros(plant.delay), 0.0, -0.05
        for _ in range(250):
            decision, memory = law.move(memory, plant.predict(x, pending), d if compensated else 0.0)
            after = plant.A @ x + plant.b * pending[0] + E * seen
            d = model.estimate(x, pending[0], after)
            x, pending = after, np.r_[pending[1:], decision.du]
        offsets[compensated] = abs(x[3])
    assert offsets[True] < 1e-6 < 0.1 < offsets[False]


def test_zero_disturbance_makes_the_tube_vanish():
    tube = brake_tube(low=0.0, high=0.0)
    assert np.array_equal(tube.terminal_bounds(5).h, tube.Sigma.h)


def test_the_solver_is_checked_by_the_residual_and_confirmed_by_a_linear_program():
    H, G = np.eye(2), np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0]])
    program = WarmQP(H, G, ("a", "b", "c"), sizes=np.ones(3))
    solved = program.solve(np.array([-2.0, -2.0]), np.array([1.0, 1.0, 5.0]))
    assert np.allclose(solved.u, [1, 2]) and np.allclose(solved.multipliers, [1, 0, 0])
    assert (
        kkt_residual(H, np.array([-2.0, -2.0]), G, np.array([1.0, 1.0, 5.0]), np.array([1.0, 1.9]), solved.multipliers)
        > 0.01
    )
    none = program.solve(np.zeros(2), np.array([-1.0, 0.5, 5.0]))
    assert none == Infeasible(reason="'a' against 'b' misses by 0.25", shortfall=0.25)
    again = program.solve(np.array([-2.0, -2.0]), np.array([1.0, 1.0, 5.0]))
    assert np.allclose(again.u, solved.u)
    with pytest.raises(InvalidValue, match="H must be positive definite, got the eigenvalue 0"):
        WarmQP(np.zeros((1, 1)), np.ones((1, 1)), ("a",), sizes=np.ones(1))


def test_pid_by_hand_with_its_integral_held_at_the_limit():
    pid = SpeedPID(kp=1.0, ki=0.5, kd=0.2, sample_time=0.1, low=0.0, high=1.0, feed=0.4)
    u, memory = pid.move(START, 0.2)
    assert np.isclose(u, 0.4 + 0.2 + 0.5 * 0.02)
    u, memory = pid.move(memory, 0.1)
    assert np.isclose(u, 0.4 + 0.1 + 0.5 * 0.03 - 0.2)
    limited, after = pid.move(memory, 5.0)
    assert limited == 1.0 and after.total == memory.total


FAILURES = {
    r"N must lie in \[2, ∞\), got 1": lambda t: RMPC(tube=t, N=1),
    r"N must be a whole number in \[2, ∞\), got 2.5": lambda t: RSMPC(tube=t, N=2.5),
    r"beta must lie in \[1, ∞\), got 0.9": lambda t: RSMPC(tube=t, N=3, beta=0.9),
    r"beta must be a finite number in \[1, ∞\), got nan": lambda t: RSMPC(tube=t, N=3, beta=float("nan")),
    r"M must be one of \(1, 2\), got 3": lambda t: RSMPC(tube=t, N=3).plan(np.zeros(4), 3),
    r"M must be one of \(1, 2\), got 0": lambda t: RSMPC(tube=t, N=3).plan(np.zeros(4), 0),
    "the state must be finite, got v = nan": lambda t: RMPC(tube=t, N=3).move(start(), [0, 0, np.nan, 0]),
    "the state must be finite, got s = inf": lambda t: RSMPC(tube=t, N=3).move(start(), [0, 0, 0, np.inf]),
    "d must be finite, got nan": lambda t: CompensatedMPC(
        tube=t, model=DisturbanceModel(plant=t.plant, E=brake_matrices().E, Q=t.Q), N=3
    ).move(start(), np.zeros(4), np.nan),
    "the error must be finite, got nan": lambda t: SpeedPID(kp=1, ki=0, kd=0, sample_time=0.1, low=0, high=1).move(
        START, np.nan
    ),
    "low must be below high": lambda t: SpeedPID(kp=1, ki=0, kd=0, sample_time=0.1, low=1, high=1),
    r"sample_time must lie in \(0, ∞\) s, got 0": lambda t: SpeedPID(kp=1, ki=0, kd=0, sample_time=0, low=0, high=1),
}


@pytest.mark.parametrize("message", sorted(FAILURES))
def test_bad_input_is_told(brake_a, message):
    with pytest.raises(InvalidValue, match=message):
        FAILURES[message](brake_a)
