"""The stopping controllers: a program against DAQP called directly, a closed loop against CasADi and do-mpc."""

from __future__ import annotations

import contextlib
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import casadi as ca
import daqp
import numpy as np

from benchmarks.measure import least_times
from studies.stopping.record import predicted_errors
from studies.stopping.settings import own
from studies.stopping.study import STUDY
from workbench.controllers.rmpc import RMPC
from workbench.predictive.condensed import Plan
from workbench.predictive.decision import start
from workbench.trials.campaign import run

TIGHT = {"primal_tol": 1e-10, "dual_tol": 1e-12}
SAMPLES = 200
SETTINGS = own(STUDY)
AGREEMENT = 1e-6


def errors_met(N: int) -> list[Any]:
    """Return the predicted errors of one stop."""
    one = run(STUDY, show_progress=False).data.sel(controller=f"rmpc-n{N}")
    errors = predicted_errors(STUDY, one)
    return list(errors[~np.isnan(errors).any(axis=1)])


def one_program(N: int) -> Iterator[tuple[str, str, str]]:
    law = RMPC(tube=SETTINGS.design, N=N)
    problem, errors = law.problem, errors_met(N)
    H, G = problem.program.H, problem.program.G
    f, g = [problem.gradient @ e for e in errors], [problem.g - problem.S @ e for e in errors]
    low, sense = np.full(len(problem.g), -1e30), np.zeros(len(problem.g), dtype=np.int32)

    def direct() -> None:
        for fi, gi in zip(f, g, strict=True):
            daqp.solve(H, fi, G, gi, low, sense, **TIGHT)

    def ours() -> None:
        for fi, gi in zip(f, g, strict=True):
            problem.program.solve(fi, gi)

    def direct_from_error() -> None:
        for e in errors:
            daqp.solve(H, problem.gradient @ e, G, problem.g - problem.S @ e, low, sense, **TIGHT)

    def plans() -> None:
        for e in errors:
            problem.solve(e)

    for e, fi, gi in zip(errors, f, g, strict=True):
        plan, expected = problem.solve(e), daqp.solve(H, fi, G, gi, low, sense, **TIGHT)[0]
        assert isinstance(plan, Plan) and np.abs(plan.du - expected).max() <= AGREEMENT
    took = least_times({"direct": direct, "ours": ours, "from e": direct_from_error, "plans": plans}, 25)
    us = {name: 1e6 * seconds / len(errors) for name, seconds in took.items()}
    size = f"N = {N}, {len(problem.g)} rows"
    yield f"DAQP called directly, {size}", f"{us['direct']:.1f} us", ""
    yield f"a program, its optimality conditions checked, {size}", f"{us['ours']:.1f} us", ""
    yield "  ratio", f"{us['ours'] / us['direct']:.2f} x", "< 2 x"
    yield f"a plan from the error, planned states and cost, {size}", f"{us['plans']:.1f} us", ""
    yield "  against forming f and g and calling DAQP", f"{us['plans'] / us['from e']:.2f} x", ""


def closed_loop(decide: Callable[[Any], float], e: Any) -> Any:
    """Run a law on the error under the resistance of 0.1 m/s^2 and return its increments."""
    plant = SETTINGS.design.plant
    push, moves = plant.A_delay @ (SETTINGS.linear.E * 0.1), []
    for _ in range(SAMPLES):
        moves.append(decide(e))
        e = plant.A @ e + plant.b * moves[-1] + push
    return np.array(moves)


def ours_decides(law: RMPC) -> Callable[[Any], float]:
    following = [start()]

    def decide(e: Any) -> float:
        move, following[0] = law.move(following[0], e)
        return move.du

    return decide


def casadi_decides(law: RMPC) -> Callable[[Any], float]:
    """Return the same problem with its states as variables, solved by ``qpsol``: what one would write in CasADi."""
    tube, N = law.sets, law.N
    e0, e, du = ca.SX.sym("e0", 4), ca.SX.sym("e", 4, N + 1), ca.SX.sym("du", N)
    cost: Any = ca.bilin(ca.DM(tube.P), e[:, N], e[:, N])
    rows, low, high = [e[:, 0] - e0], [np.zeros(4)], [np.zeros(4)]
    for i in range(N):
        cost += ca.bilin(ca.DM(tube.Q), e[:, i], e[:, i]) + tube.R * du[i] ** 2
        rows.append(ca.DM(tube.plant.A) @ e[:, i] + ca.DM(tube.plant.b) * du[i] - e[:, i + 1])
        low.append(np.zeros(4))
        high.append(np.zeros(4))
    for i in range(1, N + 1):
        bounds = tube.stage_bounds(i) if i < N else tube.terminal_bounds(N)
        rows.append(ca.DM(bounds.H) @ e[:, i])
        low.append(np.full(len(bounds.h), -np.inf))
        high.append(bounds.h)
    problem = {"x": ca.vertcat(ca.vec(e), du), "f": cost, "g": ca.vertcat(*rows), "p": e0}
    quiet = {"print_time": False, "error_on_fail": True, "printLevel": "none", "sparse": True}
    program = ca.qpsol("program", "qpoases", problem, quiet)
    limits = {"lbg": np.concatenate(low), "ubg": np.concatenate(high)}
    last: list[Any] = [0.0]

    def decide(now: Any) -> float:
        left = program(x0=last[0], p=now, **limits)
        last[0] = left["x"]
        return float(left["x"][4 * (N + 1)])

    return decide


def dompc_decides(law: RMPC, e: Any) -> Callable[[Any], float] | None:
    """Return do-mpc's controller of the same plant, cost and horizon, with the bounds of the first stage throughout."""
    try:
        import do_mpc
    except ImportError:
        return None
    tube = law.sets
    model = do_mpc.model.Model("discrete")
    x = model.set_variable("_x", "e", shape=(4, 1))
    u = model.set_variable("_u", "du")
    model.set_rhs("e", ca.DM(tube.plant.A) @ x + ca.DM(tube.plant.b) @ u)
    model.setup()
    mpc = do_mpc.controller.MPC(model)
    mpc.settings.n_horizon, mpc.settings.t_step, mpc.settings.store_full_solution = law.N, 0.2, False
    mpc.settings.nlpsol_opts = {"ipopt.tol": 1e-10}
    mpc.settings.supress_ipopt_output()
    mpc.set_objective(mterm=ca.bilin(ca.DM(tube.P), x, x), lterm=ca.bilin(ca.DM(tube.Q), x, x) + tube.R * u**2)
    mpc.set_rterm(du=0.0)
    h = tube.X_z.h
    mpc.bounds["lower", "_x", "e"] = np.array([[-np.inf], [-h[1]], [-h[3]], [-h[5]]])
    mpc.bounds["upper", "_x", "e"] = np.array([[np.inf], [h[0]], [h[2]], [h[4]]])
    mpc.setup()
    mpc.x0 = e[:, None]
    mpc.set_initial_guess()
    return lambda now: float(mpc.make_step(now[:, None])[0, 0])


@contextlib.contextmanager
def silent() -> Iterator[None]:
    """Keep what solvers print out of the table, at the level of the process: it is not printed by Python."""
    sys.stdout.flush()
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        sys.stdout.flush()
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


def loops(N: int) -> Iterator[tuple[str, str, str]]:
    law, e = RMPC(tube=SETTINGS.design, N=N), np.array([0.0, 0.0, 0.4, -0.5])
    works: dict[str, Callable[[], object]] = {"ours": lambda: closed_loop(ours_decides(law), e)}
    with silent():
        casadi = casadi_decides(law)
        expected = closed_loop(ours_decides(law), e)
        assert np.abs(expected - closed_loop(casadi, e)).max() <= AGREEMENT
        works["CasADi"] = lambda: closed_loop(casadi, e)
        took = least_times(works, 5)
        dompc = dompc_decides(law, e)
        if dompc is not None:
            took["do-mpc"] = least_times({"do-mpc": lambda: closed_loop(dompc, e)}, 1)["do-mpc"]
    yield f"closed loop of {SAMPLES} samples, RMPC, N = {N}", f"{1e3 * took['ours']:.1f} ms", ""
    yield "  the same problem, states as variables, CasADi's qpsol with qpOASES", f"{1e3 * took['CasADi']:.0f} ms", ""
    yield "  ratio", f"{took['CasADi'] / took['ours']:.0f} x", ""
    if "do-mpc" in took:
        yield "  do-mpc with IPOPT, bounds not tightened over the horizon", f"{1e3 * took['do-mpc']:.0f} ms", ""
        yield "  ratio", f"{took['do-mpc'] / took['ours']:.0f} x", ""
    else:
        yield "  do-mpc", "not installed", ""


def rows() -> Iterator[tuple[str, str, str]]:
    for N in (3, 15):
        yield from one_program(N)
    yield from loops(10)
