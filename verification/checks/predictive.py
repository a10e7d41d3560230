"""What must hold of a predictive law in closed loop, by simulation: decrease, suboptimality, recursive feasibility."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from models.quantity import InvalidValue
from verification.checks.feasibility import VIOLATION_TOLERANCE, Deciding, Run, campaign, simulate
from verification.checks.shares import about_all, in_words
from verification.checks.tube import vector
from workbench.contracts.finding import Finding, Grounds, undecided
from workbench.controllers.rmpc import RMPC
from workbench.controllers.rsmpc import RSMPC
from workbench.predictive.condensed import Plan
from workbench.predictive.decision import start
from workbench.predictive.delayed_plant import DelayedPlant
from workbench.predictive.quadratic_program import Infeasible
from workbench.predictive.tube import Tube
from workbench.sets import Polytope
from workbench.sets.array import Array

SLACK = 1e-7
"""What rounding may add to a cost, relative to the cost at the start, but at least to the problem's `cost_size`."""

NONE = "without a disturbance"
"""Stands in a witness where nothing disturbed the run."""


class NoPlan(InvalidValue):
    """A law has no plan where a claim speaks of one."""


class Slack(NamedTuple):
    """By how much an inequality of costs held, as a share of the cost."""

    share: float
    values: Mapping[str, object]
    """The costs."""


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


def nominal_decrease(law: RMPC, *, runs: int = 300, steps: int = 5, seed: int = 0) -> Finding:
    """Without disturbance J falls by at least the stage cost at each sample; (18)."""
    tube, least, witness = law.sets, np.inf, {}
    failed = 0
    try:
        for e in starts(law, runs, seed=seed):
            before, fell = _planned(law.plan(e), e), False
            for _ in range(steps):
                slack, after_e, after = _decrease(law, e, before, np.zeros(tube.plant.order))
                fell |= slack.share < -SLACK
                if slack.share < least:
                    least, witness = slack.share, {"e": e, "w": NONE, **slack.values}
                e, before = after_e, after
            failed += fell
    except NoPlan as error:
        return undecided(str(error))
    return _of_draws(least, witness, failed, runs, f"undisturbed runs of {steps} samples, from the edge inward")


def disturbed_decrease(law: RMPC) -> Finding:
    """The same as printed, with the disturbance of the model acting: from rest any disturbance refutes it."""
    e, w = np.zeros(law.sets.plant.order), _worst_push(law.sets)
    try:
        slack, _, _ = _decrease(law, e, _planned(law.plan(e), e), w)
    except NoPlan as error:
        return undecided(str(error))
    method = "one sample from rest under a disturbance at a vertex of W"
    return about_all(_never_below(slack.share, {"e": e, "w": w, **slack.values}, 1, method))


def decrease_margin(law: RMPC, witness: Mapping[str, object]) -> float:
    """Return the margin of the decrease of J at a witness: its error e and disturbance w, one sample on."""
    e, w = vector(witness, "e"), _push(witness, law.sets.plant)
    return _decrease(law, e, _planned(law.plan(e), e), w)[0].share + SLACK


def suboptimality(law: RSMPC, *, runs: int = 300, steps: int = 120, seed: int = 0) -> Finding:
    """Without disturbance the cost of the whole run stays below beta times J^1 at its start; (32)."""
    least, witness, failed = np.inf, {}, 0
    try:
        for e in starts(law, runs, seed=seed):
            slack = _spent(law, e, np.zeros(law.sets.plant.order), steps, needs_plans=True)
            failed += slack.share < -SLACK
            if slack.share < least:
                least, witness = slack.share, {"e": e, "w": NONE, "samples": steps, **slack.values}
    except NoPlan as error:
        return undecided(str(error))
    what = f"undisturbed runs of {steps} samples, the cost after them left out"
    return _of_draws(least, witness, failed, runs, what)


def disturbed_suboptimality(law: RSMPC, *, steps: int = 100) -> Finding:
    """The same as printed, with the disturbance of the model acting: from rest, where J is 0, it cannot hold."""
    e, w = np.zeros(law.sets.plant.order), _worst_push(law.sets)
    try:
        slack = _spent(law, e, w, steps)
    except NoPlan as error:
        return undecided(str(error))
    witness = {"e": e, "w": w, "samples": steps, **slack.values}
    method = f"{steps} samples from rest under a constant disturbance at a vertex of W; the cost grows without end"
    return about_all(_never_below(slack.share, witness, 1, method))


def suboptimality_margin(law: RSMPC, witness: Mapping[str, object]) -> float:
    """Return the margin of the cost of a run at a witness: from its error e, under w at each of so many samples."""
    e, w = vector(witness, "e"), _push(witness, law.sets.plant)
    return _spent(law, e, w, int(str(witness["samples"]))).share + SLACK


def recursive_feasibility(
    law: Deciding,
    plant: DelayedPlant,
    bounds: Polytope,
    *,
    runs: int = 300,
    seed: int = 0,
    until_first: bool = False,
) -> Finding:
    """No run from the edge of the feasible set is ever without a plan or breaks a bound, whatever W does.

    ``plant`` and ``bounds`` are the true ones, which the law's tube may have been designed against or not.
    """
    found = campaign(law, law.deciding, plant, bounds, runs=runs, seed=seed, until_first=until_first)
    method = (
        f"{found.runs} runs of 60 samples from the edge of the feasible set, uniform, vertex and aimed disturbances: "
        f"{found.infeasible} without a plan somewhere, {found.violated} beyond a bound of the plant"
    )
    if until_first and found.failed:  # the share of failures says nothing where the first one ends the search
        method += ", with which the search ended"
    else:
        method += f"; {in_words(found.failed, found.runs, 'runs fail')}"
    if found.witness is None:
        return about_all(
            Finding(
                grounds=Grounds.TRIES,
                margin=VIOLATION_TOLERANCE - found.worst_violation,
                unit="of the bounds' width",
                weak=True,
                bound=found.worst_violation,
                bound_unit="of the bounds' width, the farthest beyond",
                tries=found.runs,
                method=method,
            )
        )
    w = found.witness
    margin, unit = _kept(simulate(law, plant, bounds, w.e, disturb=w.w))
    return Finding(
        grounds=Grounds.TRIES,
        margin=margin,
        unit=unit,
        weak=True,
        tries=found.runs,
        witness={
            "run": w.number,
            "kind": w.kind,
            "infeasible at sample": w.infeasible_at,
            "reason": w.reason,
            "beyond a bound by": w.violation,
            "e": w.e,
            "w": w.w,
        },
        method=method,
    )


def feasibility_margin(law: Deciding, plant: DelayedPlant, bounds: Polytope, witness: Mapping[str, object]) -> float:
    """Return the margin of :func:`recursive_feasibility` in the run of a witness: from its e, under its w.

    Raises InvalidValue for a disturbance outside W.
    """
    w = np.asarray(witness["w"], dtype=float).reshape(-1, plant.order)
    if not all(plant.W.contains(one, tolerance=1e-7) for one in w):
        raise InvalidValue("the witness must disturb within W, and does not")
    return _kept(simulate(law, plant, bounds, vector(witness, "e"), disturb=w))[0]


def _kept(run: Run) -> tuple[float, str]:
    """Return the margin of one run and its unit: samples without a plan come first."""
    if run.lost:
        return -float(run.lost), "samples without a plan"
    return VIOLATION_TOLERANCE - run.violation, "of the bounds' width"


def _decrease(law: RMPC, e: Array, before: Plan, w: Array) -> tuple[Slack, Array, Plan]:
    """Return by how much more than the stage cost J falls in one sample, with the next error and plan."""
    tube = law.sets
    after_e: Array = tube.plant.A @ e + tube.plant.b * before.du[0] + tube.plant.A_delay @ w
    after = _planned(law.plan(after_e), after_e)
    stage = float(e @ tube.Q @ e + tube.R * before.du[0] ** 2)
    share = (before.J - stage - after.J) / max(law.problem.program.cost_size, before.J)
    return Slack(share, {"J": before.J, "stage cost": stage, "J next": after.J}), after_e, after


def _spent(law: RSMPC, first: Array, w: Array, steps: int, *, needs_plans: bool = False) -> Slack:
    """Return by how much the cost of a run from an error under a constant w stays below beta J^1 at its start."""
    tube, e, following, spent = law.sets, first, start(), 0.0
    best = _planned(law.plan(e, 1), e)
    for k in range(steps):
        move, following = law.move(following, e)
        if needs_plans and move.infeasible:
            raise NoPlan(f"no plan at sample {k} from e = {first.tolist()}: {move.infeasible}")
        spent += float(e @ tube.Q @ e + tube.R * move.du**2)
        e = tube.plant.A @ e + tube.plant.b * move.du + tube.plant.A_delay @ w
    share = (law.beta * best.J - spent) / max(law.problem(1).program.cost_size, best.J)
    return Slack(share, {"beta J": law.beta * best.J, "spent": spent})


def _planned(answer: Plan | Infeasible, e: Array) -> Plan:
    if isinstance(answer, Infeasible):
        raise NoPlan(f"no plan at e = {e.tolist()}: {answer.reason}")
    return answer


def _worst_push(tube: Tube) -> Array:
    """Return the vertex of W that drives the error where J grows most."""
    return tube.plant.W.extreme(np.linalg.eigh(tube.P)[1][:, -1] @ tube.plant.A_delay)


def _push(witness: Mapping[str, object], plant: DelayedPlant) -> Array:
    """Return the disturbance of a witness. Raises InvalidValue for one outside W."""
    if witness["w"] == NONE:
        return np.zeros(plant.order)
    w = vector(witness, "w")
    if not plant.W.contains(w, tolerance=1e-7):
        raise InvalidValue("the witness must disturb within W, and does not")
    return w


def _of_draws(share: float, witness: Mapping[str, object], failed: int, runs: int, what: str) -> Finding:
    return about_all(_never_below(share, witness, runs, f"{runs} {what}: {in_words(failed, runs, 'runs fail')}"))


def _never_below(share: float, witness: Mapping[str, object], tries: int, method: str) -> Finding:
    """Return the finding of a search for the least slack of an inequality, which may be below 0 by rounding only."""
    return Finding(
        grounds=Grounds.TRIES,
        margin=share + SLACK,
        unit="of J",
        weak=True,
        bound=share,
        bound_unit="of J, the least slack",
        tries=tries,
        witness=witness,
        method=f"{method}; {SLACK:g} counts as rounding",
    )
