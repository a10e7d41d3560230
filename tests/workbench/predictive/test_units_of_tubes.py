"""Tubes, plans, closed loops and their checks give the same answer in every unit of states, inputs and cost."""

from __future__ import annotations

import functools
import itertools

import numpy as np
import pytest
from brake_tubes import TUBES, brake_matrices, brake_tube, integrator_tube
from units import STATES, TUBE_UNITS, Units

from models.quantity import InvalidValue
from verification.checks import predictive as predictive_checks
from verification.checks import tube as tube_checks
from verification.checks.feasibility import campaign
from workbench.contracts.finding import Standing
from workbench.controllers.compensated_mpc import CompensatedMPC
from workbench.controllers.rmpc import RMPC
from workbench.controllers.rsmpc import RSMPC
from workbench.predictive.condensed import Plan
from workbench.predictive.decision import start
from workbench.predictive.delayed_plant import DelayedPlant
from workbench.predictive.disturbance_model import DisturbanceModel
from workbench.predictive.quadratic_program import Infeasible, WarmQP
from workbench.predictive.regulator import lqr, symmetric_weight, terminal_weight, unstabilizable
from workbench.predictive.tube import Tube
from workbench.sets import Polytope, SolverFailed, Zonotope, linear_program, rpi_residual

OTHER = sorted(set(TUBE_UNITS) - {"as it is"})
FEW = ("all 1e-9", "all 1e9, input 1e-9", "apart")
CASES = [("integrator", units) for units in OTHER] + [(name, units) for name in ("brake A", "brake B") for units in FEW]


@functools.cache
def plain(name):
    return TUBES[name]()


@functools.cache
def pair(name, units):
    tube = plain(name)
    u = TUBE_UNITS[units](tube.plant.order)
    return tube, u, u.tube(tube)


def starts(problem, count, *, seed):
    """Errors from near the centre of the feasible set to beyond its edge, in the problem's own units."""
    random, center = np.random.default_rng(seed), problem.inside()
    spread = problem.spread(center)
    for number in range(count):
        direction = random.normal(size=center.size) * spread
        share = [0.3, 0.9, 0.9999, 1.01][number % 4]
        yield center + share * problem.edge(center, direction).distance * direction


@pytest.mark.parametrize(("name", "units"), CASES)
def test_gains_and_weights(name, units):
    tube, u, other = pair(name, units)
    K, P = lqr(tube.plant.A, tube.plant.b, tube.Q, tube.R)
    gain, weight = lqr(other.plant.A, other.plant.b, other.Q, other.R)
    assert np.allclose(gain, u.push * K / u.c, rtol=1e-8, atol=0)
    assert np.allclose(weight / u.weight(np.ones_like(P)), P, rtol=1e-8, atol=1e-9 * np.abs(P).max())
    again = terminal_weight(other.A_cl, other.K, other.Q, other.R)
    assert np.allclose(again / u.weight(np.ones_like(P)), tube.P, rtol=1e-8, atol=1e-9 * np.abs(tube.P).max())


@pytest.mark.parametrize(("name", "units"), CASES)
def test_sets_of_a_tube(name, units):
    tube, u, other = pair(name, units)
    assert other.Sigma.labels == tube.Sigma.labels
    assert rpi_residual(other.A_cl, other.W_z, other.Sigma) <= 1e-9
    assert other.held_conflicts(6, contained=False).keys() == tube.held_conflicts(6, contained=False).keys()
    assert other.held_conflicts(15).keys() == tube.held_conflicts(15).keys()
    for M, i in itertools.product((1, 3), (0, 4)):
        first, second = tube.held_stage_bounds(M, i), other.held_stage_bounds(M, i)
        assert np.allclose(second.h * np.linalg.norm(first.H / u.c, axis=1), first.h, rtol=1e-9, atol=1e-12)
    for d in np.random.default_rng(0).normal(size=(6, tube.plant.order)):
        assert other.terminal_bounds(3).support(d / u.c) == pytest.approx(tube.terminal_bounds(3).support(d), rel=1e-8)
    assert other.held_excess(12, 15).share == pytest.approx(tube.held_excess(12, 15).share, rel=1e-7, abs=1e-12)


@pytest.mark.parametrize(("name", "units"), CASES)
@pytest.mark.parametrize("kind", ["rmpc", "rsmpc"])
def test_plans(kind, name, units):
    tube, u, other = pair(name, units)

    def problem(tube):
        return RMPC(tube=tube, N=6).problem if kind == "rmpc" else RSMPC(tube=tube, N=6, contained=False).problem(3)

    first, second = problem(tube), problem(other)
    assert (second.labels, second.fixed.labels) == (first.labels, first.fixed.labels)
    feasible = 0
    for e in starts(first, 12, seed=3):
        plan, same = first.solve(e), second.solve(e * u.c)
        assert type(same) is type(plan)
        if isinstance(plan, Plan) and isinstance(same, Plan):
            feasible += 1
            assert np.allclose(same.du / u.push, plan.du, rtol=0, atol=1e-6 * max(1, np.abs(plan.du).max()))
            assert same.J == pytest.approx(u.worth * plan.J, rel=1e-6)
            assert same.residual <= 1e-11
            for i, e_i in enumerate(same.e):  # independent of the solver: the sets themselves
                if kind == "rmpc":
                    bounds = other.stage_bounds(i) if i < 6 else other.terminal_bounds(6)
                    assert bounds.contains(e_i, tolerance=1e-7)
        elif isinstance(plan, Infeasible) and isinstance(same, Infeasible):
            assert same.reason.split("'")[1] == plan.reason.split("'")[1]
    assert feasible == 9
    for e in starts(second, 4, seed=5):  # the other way about: what is asked in the other units
        assert type(second.solve(e)) is type(first.solve(e / u.c))


@pytest.mark.parametrize(("name", "units"), [case for case in CASES if case[0] != "brake B"])
@pytest.mark.parametrize("kind", [RMPC, RSMPC])
def test_closed_loops(kind, name, units):
    """The same decisions at every sample under disturbances at vertices of W, and no bound broken."""
    tube, u, other = pair(name, units)
    law, same = kind(tube=tube, N=5), kind(tube=other, N=5)
    problem = law.problem if kind is RMPC else law.problem(1)
    e0 = next(itertools.islice(starts(problem, 4, seed=7), 1, 2))
    random, e, other_e, memory, other_memory = np.random.default_rng(1), e0, e0 * u.c, start(), start()
    for _ in range(30):
        decision, memory = law.move(memory, e)
        told, other_memory = same.move(other_memory, other_e)
        assert (told.M, told.qps, told.infeasible) == (decision.M, decision.qps, "")
        assert told.du / u.push == pytest.approx(decision.du, abs=1e-6)
        w = tube.W_z.extreme(random.normal(size=len(e)))
        e = tube.plant.A @ e + tube.plant.b * decision.du + w
        other_e = other.plant.A @ other_e + other.plant.b * told.du + w * u.c
        assert other.X_z.contains(other_e, tolerance=1e-9)


@pytest.mark.parametrize("units", FEW)
def test_compensation(units):
    tube, u, other = pair("brake A", units)
    E = brake_matrices().E
    model = DisturbanceModel(plant=tube.plant, E=E, Q=tube.Q)
    same = DisturbanceModel(plant=other.plant, E=E * u.c, Q=other.Q)
    assert np.allclose(same.shift / u.c, model.shift, atol=1e-7)
    laws = CompensatedMPC(tube=tube, model=model, N=5), CompensatedMPC(tube=other, model=same, N=5)
    x, d, memory = np.zeros(4), 0.0, [start(), start()]
    pending = np.zeros(tube.plant.delay)
    for _ in range(40):
        first, memory[0] = laws[0].move(memory[0], tube.plant.predict(x, pending), d)
        second, memory[1] = laws[1].move(memory[1], other.plant.predict(x * u.c, pending * u.push), d)
        assert second.du / u.push == pytest.approx(first.du, abs=1e-7)
        after = tube.plant.A @ x + tube.plant.b * pending[0] - 0.05 * E
        d = model.estimate(x, pending[0], after)
        assert same.estimate(x * u.c, pending[0] * u.push, after * u.c) == pytest.approx(d, abs=1e-6)
        x, pending = after, np.r_[pending[1:], first.du]


@pytest.mark.parametrize(("name", "units"), [case for case in CASES if case[0] != "brake B"])
def test_checks_stand_where_they_stood(name, units):
    _, _, other = pair(name, units)
    for check in ("schur", "lyapunov", "lmi20", "tube_inside", "rpi"):
        finding = getattr(tube_checks, check)(other)
        assert finding.standing is Standing.PROVED, finding
    assert tube_checks.tightening_sound(other, 2, sequences=3).standing is Standing.PROVED
    law = RMPC(tube=other, N=4)
    assert predictive_checks.nominal_decrease(law, runs=4, steps=8).margin >= 0
    assert predictive_checks.disturbed_decrease(law).standing is Standing.REFUTED
    held = RSMPC(tube=other, N=4)
    assert predictive_checks.suboptimality(held, runs=2, steps=60).margin >= 0
    assert predictive_checks.disturbed_suboptimality(held).standing is Standing.REFUTED
    found = campaign(law, law.problem, other.plant, other.bounds, runs=6, seed=1)
    assert (found.infeasible, found.violated) == (0, 0)


def twisted(tube, **values):
    """A tube with parts replaced after it was checked: what a wrong design would be."""
    wrong = TUBE_UNITS["as it is"](tube.plant.order).tube(tube)
    wrong.__dict__.update(values)
    return wrong


@pytest.mark.parametrize("units", FEW)
def test_checks_refute_in_every_unit(units):
    _, u, other = pair("brake A", units)
    small = Polytope(H=other.Sigma.H, h=0.3 * other.Sigma.h)
    wrong = {
        "schur": twisted(other, A_cl=1.1 * other.A_cl),
        "lyapunov": twisted(other, P=(1 - 1e-6) * other.P),
        "lmi20": twisted(other, P=(1 - 1e-6) * other.P),
        "tube_inside": twisted(other, Sigma=small),
        "rpi": twisted(other, Sigma=other.X_z),
        "tightening_sound": u.tube(plain("brake A"), ignore_delay=True),
    }
    for check, tube in wrong.items():
        finding = getattr(tube_checks, check)(tube, *([2] if check == "tightening_sound" else []))
        assert finding.standing is Standing.REFUTED and finding.margin < 0, check
    late = RMPC(tube=u.tube(plain("brake A"), ignore_delay=True), N=5)
    found = campaign(late, late.problem, other.plant, other.bounds, runs=30, until_first=True)
    assert found.witness is not None


@pytest.mark.parametrize("worth", [1e-12, 1.0, 1e12])
def test_a_decrease_that_fails_is_seen_whatever_a_cost_is_worth(worth):
    tube = Units(np.ones(4), 1.0, worth).tube(plain("brake A"))
    law = RMPC(tube=twisted(tube, P=0.2 * tube.P), N=3)  # violates (19)
    assert predictive_checks.nominal_decrease(law, runs=8).standing is Standing.REFUTED


@pytest.mark.parametrize(("name", "units"), CASES)
def test_directions_look_at_every_state_alike(name, units):
    tube, u, other = pair(name, units)
    first, second = RMPC(tube=tube, N=4).problem, RMPC(tube=other, N=4).problem
    center = first.inside()
    assert np.allclose(second.spread(center * u.c), first.spread(center) * u.c, rtol=1e-7, atol=0)
    assert first.solve(center).du.size == second.solve(second.inside()).du.size == 4


@pytest.mark.parametrize("units", OTHER)
def test_a_disturbance_that_is_too_large_is_told_in_every_unit(units):
    def made(reach):
        tube = plain("integrator")
        u = TUBE_UNITS[units](2)
        W = Zonotope.box([-reach, -reach], [reach, reach])
        plant = DelayedPlant(A=tube.plant.A, b=tube.plant.b, W=W, delay=1, names=("s", "v"))
        return Tube.from_lqr(
            plant=u.plant(plant), bounds=u.polytope(tube.bounds), Q=u.weight(np.eye(2)), R=u.worth / u.push**2
        )

    assert isinstance(made(0.02), Tube)
    with pytest.raises(InvalidValue, match="beyond 'v <= 1' by"):
        made(0.3)
    with pytest.raises(InvalidValue, match="over 1 samples of delay are empty: 'v <= 1' and 'v >= -1' cannot both"):
        made(3.0)


@pytest.mark.parametrize("units", sorted(STATES))
@pytest.mark.parametrize("push", [1.0, 1e-9, 1e9])
def test_stabilisable_or_not_in_every_unit(units, push):
    u = Units(STATES[units](2), push)
    reached = np.array([[1.0, 0.3], [0.0, 1.0]]), np.array([0.045, 0.3])
    stuck = np.array([[1.2, 0.0], [0.3, 0.5]]), np.array([0.0, 1.0])
    assert not unstabilizable(u.loop(reached[0]), reached[1] * u.c / push).size
    assert np.allclose(unstabilizable(u.loop(stuck[0]), stuck[1] * u.c / push), [1.2])


WEIGHTS = {
    "fine": ([[2.0, 1.0], [1.0, 1.0]], None),
    "semidefinite": ([[1.0, 1.0], [1.0, 1.0]], None),
    "nothing on the first": ([[0.0, 0.0], [0.0, 1.0]], None),
    "not symmetric": ([[1.0, 0.5], [0.5 + 1e-6, 1.0]], "symmetric"),
    "negative": ([[-1.0, 0.0], [0.0, 1.0]], "semidefinite"),
    "a little indefinite": ([[1.0, 1.0 + 1e-6], [1.0 + 1e-6, 1.0]], "semidefinite"),
    "beside nothing": ([[0.0, 1e-3], [1e-3, 1.0]], "semidefinite"),
}


@pytest.mark.parametrize("units", sorted(STATES))
@pytest.mark.parametrize("worth", [1.0, 1e-18, 1e18])
@pytest.mark.parametrize("name", sorted(WEIGHTS))
def test_weights_in_every_unit(name, worth, units):
    weight, reason = WEIGHTS[name]
    Q = Units(STATES[units](2), 1.0, worth).weight(weight)
    if reason is None:
        assert np.array_equal(symmetric_weight("Q", Q, 2), Q)
    else:
        with pytest.raises(InvalidValue, match=reason):
            symmetric_weight("Q", Q, 2)


@pytest.mark.parametrize("units", OTHER)
def test_a_weight_that_misses_19_is_refused_in_every_unit(units):
    tube, u, other = pair("integrator", units)
    fields = {name: getattr(other, name) for name in ("plant", "bounds", "Q", "R", "K")}
    with pytest.raises(InvalidValue, match=r"P must satisfy \(19\)"):
        Tube(**fields, P=(1 - 1e-6) * other.P)
    with pytest.raises(InvalidValue, match="must leave the plant a rest"):
        unreachable = DelayedPlant(A=np.diag([1.0, 0.5]), b=np.ones(2), W=Zonotope.point([0.0, 0.0]))
        DisturbanceModel(plant=u.plant(unreachable), E=np.array([1e-6, 1.0]) * u.c, Q=u.weight(np.eye(2)))
    assert tube.plant.order == 2


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
@pytest.mark.parametrize("worth", [1e-9, 1.0, 1e9])
@pytest.mark.parametrize("size", [1e-9, 1.0, 1e9])
def test_a_quadratic_program_by_its_conditions(scale, worth, size):
    """Minimise worth (u/scale - t)^2 in two inputs, rows told in units of `size`: the answer is the nearest point."""
    H, G = 2 * worth / scale**2 * np.eye(2), size / scale * np.array([[1.0, 0.0], [-1.0, 0.0], [1.0, 1.0]])
    program = WarmQP(H, G, ("a", "b", "c"), sizes=size * np.array([2.0, 2.0, 2.0]))
    for target, nearest in (
        ((2, 0), (1, 0)),
        ((0.2, 0.3), (0.2, 0.3)),
        ((-3, 1), (-1, 1)),
        ((0.5, 3.5), (-0.75, 2.25)),
    ):
        room = size * np.array([1.0, 1.0, 1.5])
        answer = program.solve(-2 * worth / scale * np.array(target, dtype=float), room)
        assert np.allclose(answer.u / scale, nearest, atol=1e-12)
        pull = H @ answer.u - 2 * worth / scale * np.array(target) + answer.multipliers @ G
        assert np.abs(pull).max() <= 1e-10 * worth / scale and np.all(answer.multipliers >= 0)
    none = program.solve(np.zeros(2), size * np.array([-1.0, 0.5, 5.0]))
    assert none.reason.startswith("'a' against 'b' misses by") and none.shortfall == pytest.approx(0.25 * size)
    barely = program.solve(np.zeros(2), size * np.array([-1.0, 1.0 - 1e-12, 5.0]))
    assert np.allclose(barely.u / scale, [-1, 0], atol=1e-7)
    assert isinstance(program.solve(np.zeros(2), size * np.array([-1.0, 1.0 - 1e-6, 5.0])), Infeasible)


def test_an_edge_is_where_the_plan_ends_and_says_when_there_is_none(monkeypatch):
    problem = RMPC(tube=integrator_tube(), N=4).problem
    center = problem.inside()
    for factor in (1e-9, 1.0, 1e9):
        far = problem.edge(center, factor * np.array([1.0, 0.2]))
        assert isinstance(problem.solve(center + 0.999999 * far.distance * factor * np.array([1.0, 0.2])), Plan)
        assert isinstance(problem.solve(center + 1.00001 * far.distance * factor * np.array([1.0, 0.2])), Infeasible)
    assert problem.edge(center + 1e3, [1.0, 0.0]).distance == -np.inf
    assert problem.edge(center, [0.0, 0.0]).distance == np.inf
    monkeypatch.setattr(linear_program, "linprog", lambda *_, **__: type("", (), {"status": 4}))
    with pytest.raises(SolverFailed, match="how far a problem of"):
        problem.edge(center, [1.0, 0.0])
    with pytest.raises(SolverFailed):
        problem.spread(center)


def test_without_any_believable_answer_there_is_no_plan(monkeypatch):
    program = WarmQP(np.eye(1), np.array([[1.0], [-1.0]]), ("a", "b"), sizes=np.ones(2))
    monkeypatch.setattr(linear_program, "linprog", lambda *_, **__: type("", (), {"status": 4}))
    answer = program.solve(np.zeros(1), np.array([-1.0, 0.5]))
    assert isinstance(answer, Infeasible) and "neither" in answer.reason and np.isnan(answer.shortfall)


def test_a_horizon_shorter_than_the_brake_keeps_its_rows():
    """Which rows no input moves is a property of the plant, not of its units."""
    counts = {len(RMPC(tube=pair("brake B", units)[2], N=3).problem.fixed.h) for units in FEW}
    assert counts == {len(RMPC(tube=brake_tube("B"), N=3).problem.fixed.h)}
