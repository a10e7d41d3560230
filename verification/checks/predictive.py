"""What must hold of a predictive law in closed loop, by simulation: decrease, suboptimality, recursive feasibility."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from verification.checks.feasibility import VIOLATION_TOLERANCE, Deciding, campaign
from workbench.contracts.verdict import Finding, Standing, undecided
from workbench.controllers.rmpc import RMPC
from workbench.controllers.rsmpc import RSMPC
from workbench.predictive.condensed import Plan
from workbench.predictive.decision import start
from workbench.predictive.delayed_plant import DelayedPlant
from workbench.sets import Polytope
from workbench.sets.array import Array

SLACK = 1e-7
"""What rounding may add to a cost, relative to the cost at the start, but at least to the problem's `cost_size`."""


def starts(law: Deciding, number: int, *, seed: int) -> Iterator[Array]:
    """Yield errors inside the feasible set, from near its centre to its edge."""
    random, problem = np.random.default_rng(seed), law.deciding
    center = problem.inside()
    spread = problem.spread(center)
    for index in range(number):
        direction = random.normal(size=center.size) * spread
        reach = problem.edge(center, direction).distance
        reach = reach if np.isfinite(reach) else 1.0
        yield center + (0.999, 0.7, 0.4, 0.1)[index % 4] * reach * direction


def nominal_decrease(law: RMPC, *, runs: int = 12, steps: int = 25, seed: int = 0) -> Finding:
    """Without disturbance J falls by at least the stage cost at each sample; (18)."""
    tube = law.sets
    worst, looked = np.inf, 0
    witness: dict[str, object] = {}
    for e in starts(law, runs, seed=seed):
        before = law.plan(e)
        for _ in range(steps):
            if not isinstance(before, Plan):
                return undecided(f"no plan at e = {e.tolist()}: {before.reason}")
            after_e = tube.plant.A @ e + tube.plant.b * before.du[0]
            after = law.plan(after_e)
            if not isinstance(after, Plan):
                return undecided(f"no plan at e = {after_e.tolist()}: {after.reason}")
            stage = float(e @ tube.Q @ e + tube.R * before.du[0] ** 2)
            slack = (before.J - stage - after.J) / max(law.problem.program.cost_size, before.J)
            looked += 1
            if slack < worst:
                worst, witness = slack, {"e": e, "J": before.J, "stage cost": stage, "J next": after.J}
            e, before = after_e, after
    return _never_below(
        worst, "of J", witness, f"{looked} samples of {runs} undisturbed runs from the edge of the feasible set inward"
    )


def disturbed_decrease(law: RMPC) -> Finding:
    """The same as printed, with the disturbance of the model acting: from rest any disturbance refutes it."""
    tube = law.sets
    e = np.zeros(tube.plant.order)
    w = tube.plant.W.extreme(np.linalg.eigh(tube.P)[1][:, -1] @ tube.plant.A_delay)
    before = law.plan(e)
    if not isinstance(before, Plan):
        return undecided(before.reason)
    after_e = tube.plant.A @ e + tube.plant.b * before.du[0] + tube.plant.A_delay @ w
    after = law.plan(after_e)
    if not isinstance(after, Plan):
        return undecided(after.reason)
    stage = float(e @ tube.Q @ e + tube.R * before.du[0] ** 2)
    slack = (before.J - stage - after.J) / law.problem.program.cost_size
    return _never_below(
        slack,
        "of the size of J",
        {"e": e, "w": w, "J": before.J, "stage cost": stage, "J next": after.J},
        "one sample from rest under a disturbance at a vertex of W",
    )


def suboptimality(law: RSMPC, *, runs: int = 8, steps: int = 500, seed: int = 0) -> Finding:
    """Without disturbance the cost of the whole run stays below beta times J^1 at its start; (32)."""
    tube, worst = law.sets, np.inf
    witness: dict[str, object] = {}
    for first in starts(law, runs, seed=seed):
        e, following, spent = first, start(), 0.0
        best = law.plan(e, 1)
        if not isinstance(best, Plan):
            return undecided(f"no plan at e = {e.tolist()}: {best.reason}")
        for k in range(steps):
            move, following = law.move(following, e)
            if move.infeasible:
                return undecided(f"no plan at sample {k} from e = {first.tolist()}: {move.infeasible}")
            spent += float(e @ tube.Q @ e + tube.R * move.du**2)
            e = tube.plant.A @ e + tube.plant.b * move.du
        slack = (law.beta * best.J - spent) / max(law.problem(1).program.cost_size, best.J)
        if slack < worst:
            worst, witness = slack, {"e": first, "beta J": law.beta * best.J, "spent": spent, "e at the end": e}
    return _never_below(
        worst, "of J", witness, f"{runs} undisturbed runs of {steps} samples, the cost after them left out"
    )


def disturbed_suboptimality(law: RSMPC, *, steps: int = 100) -> Finding:
    """The same as printed, with the disturbance of the model acting: from rest, where J is 0, it cannot hold."""
    tube = law.sets
    w = tube.plant.W.extreme(np.linalg.eigh(tube.P)[1][:, -1] @ tube.plant.A_delay)
    e, following, spent = np.zeros(tube.plant.order), start(), 0.0
    best = law.plan(e, 1)
    if not isinstance(best, Plan):
        return undecided(best.reason)
    for _ in range(steps):
        move, following = law.move(following, e)
        spent += float(e @ tube.Q @ e + tube.R * move.du**2)
        e = tube.plant.A @ e + tube.plant.b * move.du + tube.plant.A_delay @ w
    slack = (law.beta * best.J - spent) / law.problem(1).program.cost_size
    return _never_below(
        slack,
        "of the size of J",
        {"e": np.zeros(tube.plant.order), "w at each sample": w, "beta J": law.beta * best.J, "spent": spent},
        f"{steps} samples from rest under a constant disturbance at a vertex of W; it grows without end",
    )


def _never_below(slack: float, unit: str, witness: Mapping[str, object], method: str) -> Finding:
    """Return the finding of a search for the least slack of an inequality, which may be below 0 by rounding only."""
    return Finding(
        standing=Standing.SUPPORTED if slack >= -SLACK else Standing.REFUTED,
        margin=slack,
        unit=unit,
        witness=witness,
        method=method,
    )


def recursive_feasibility(
    law: Deciding, plant: DelayedPlant, bounds: Polytope, *, runs: int = 200, seed: int = 0
) -> Finding:
    """No run from the edge of the feasible set is ever without a plan or breaks a bound, whatever W does.

    ``plant`` and ``bounds`` are the true ones, which the law's tube may have been designed against or not.
    """
    found = campaign(law, law.deciding, plant, bounds, runs=runs, seed=seed)
    method = (
        f"{found.runs} runs of 60 samples from the edge of the feasible set, uniform, vertex and aimed disturbances: "
        f"{found.infeasible} infeasible, {found.violated} beyond a bound of the plant"
    )
    if found.witness is None:
        margin = VIOLATION_TOLERANCE - found.worst_violation
        return Finding(standing=Standing.SUPPORTED, margin=margin, unit="of the bounds' width", method=method)
    w = found.witness
    return Finding(
        standing=Standing.REFUTED,
        margin=-max(found.infeasible, found.violated) / found.runs,
        unit="of the runs",
        witness={
            "run": w.number,
            "kind": w.kind,
            "infeasible at sample": w.infeasible_at,
            "reason": w.reason,
            "beyond a bound by": w.violation,
            "e": w.e,
            "w": w.w,
            "replay": "verification.checks.feasibility.simulate(law, plant, bounds, e, disturb=w)",
        },
        method=method,
    )
