"""Does a tube controller stay feasible, and its plant within bounds, whatever the disturbance does? By simulation.

Runs start at the edge of the set from which the controller has a plan, and the disturbance is drawn at random, thrown
between its extremes, or aimed at each sample at the facet of that set which the error is nearest to leave through, of
those facets that the starts lie on.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple, Protocol, get_args

import numpy as np

from models.quantity import InvalidValue
from workbench.predictive.condensed import CondensedQP
from workbench.predictive.decision import Following, Move, start
from workbench.predictive.delayed_plant import DelayedPlant
from workbench.sets import Polytope
from workbench.sets.array import Array

Disturbance = Literal["uniform", "vertex", "worst"]
"""How a run is disturbed."""

VIOLATION_TOLERANCE = 1e-7
"""By how much a bound may be exceeded by rounding and by the solver's tolerance, a share of the bounds' width."""

EDGE_MARGIN = 1e-9
"""Runs start this fraction inside the edge, so that rounding does not decide about the first plan."""


class Moving(Protocol):
    """A law on the predicted error: `workbench.controllers.rmpc` and its kin."""

    def move(self, following: Following, e: Array, /) -> tuple[Move, Following]:
        """The increment of the input at the error e, shape (n,), and the plan to follow on."""
        ...


class Deciding(Moving, Protocol):
    """Such a law, with the problem that it must be able to solve."""

    @property
    def deciding(self) -> CondensedQP:
        """The problem that must be feasible whenever the law decides."""


class Run(NamedTuple):
    """One run: what was done to the plant and what came of it."""

    e: Array
    """Predicted errors, shape (steps+1, n)."""
    x: Array
    """True errors l samples later, shape (steps+1, n)."""
    w: Array
    """Disturbances, shape (steps+l, n)."""
    infeasible_at: int | None
    """The first sample without a plan."""
    lost: int
    """Samples without a plan."""
    reason: str
    violation: float
    """By how much the true error exceeded a bound at worst, a share of the bounds' width; negative if it kept clear."""


class Witness(NamedTuple):
    """A run that failed, complete enough to be replayed: `simulate(law, plant, bounds, e, disturb=w)`."""

    number: int
    kind: Disturbance
    e: Array
    w: Array
    infeasible_at: int | None
    violation: float
    reason: str


class Campaign(NamedTuple):
    """How many runs were infeasible at some sample, how many broke a bound, and the first that did either."""

    runs: int
    infeasible: int
    violated: int
    failed: int
    """Runs that were infeasible, broke a bound, or both."""
    worst_violation: float
    witness: Witness | None


def simulate(
    law: Moving, plant: DelayedPlant, bounds: Polytope, e: Array, *, disturb: Array | Callable[[int, Array], Array]
) -> Run:
    """Run a law on e+ = A e + b du + A^l w and see where the true error x(k+l) goes.

    Parameters
    ----------
    law
        The controller; it may have been designed for another tube than the plant deserves.
    plant
        The plant and its true delay.
    bounds
        X, where the true error must stay.
    e
        The first predicted error, shape (n,).
    disturb
        The disturbances, shape (steps+l, n), or a function of the sample and the error; then 60 steps are run.
    """
    steps = 60 if callable(disturb) else len(disturb) - plant.delay
    errors, pushes = [e], []
    following, failed, lost, reason = start(), None, 0, ""
    for k in range(steps + plant.delay):
        pushes.append(disturb(k, errors[-1]) if callable(disturb) else disturb[k])
        if k >= steps:
            continue
        move, following = law.move(following, errors[-1])
        lost += bool(move.infeasible)
        if move.infeasible and failed is None:
            failed, reason = k, move.infeasible
        errors.append(plant.A @ errors[-1] + plant.b * move.du + plant.A_delay @ pushes[-1])
    w = np.array(pushes).reshape(-1, plant.order)
    x = np.array(errors)
    for j in range(plant.delay):  # x(k+l) - z(k) is the sum of A^(l-1-j) w(k+j)
        x = x + w[j : j + steps + 1] @ np.linalg.matrix_power(plant.A, plant.delay - 1 - j).T
    broken = float(((x @ bounds.H.T - bounds.h) / bounds.sizes).max())
    return Run(e=np.array(errors), x=x, w=w, infeasible_at=failed, lost=lost, reason=reason, violation=broken)


def campaign(
    law: Moving,
    problem: CondensedQP,
    plant: DelayedPlant,
    bounds: Polytope,
    *,
    runs: int = 200,
    seed: int = 0,
    until_first: bool = False,
) -> Campaign:
    """Many runs from the edge of the feasible set, a third with each kind of disturbance.

    Parameters
    ----------
    law, plant, bounds
        As for `simulate`.
    problem
        The problem that must be feasible at every decision: its edge is where the runs start.
    runs
        How many.
    seed
        Of directions and disturbances.
    until_first
        Stop at the first run that fails: enough for a negative control, which needs one witness. `runs` then counts
        the runs made.
    """
    if runs < 1:
        raise InvalidValue(f"runs must be at least 1, got {runs}")
    random = np.random.default_rng(seed)
    begin = _edge_of(problem, plant.order, runs, random)
    kinds: tuple[Disturbance, ...] = get_args(Disturbance)
    infeasible = violated = either = number = 0
    worst, witness = -np.inf, None
    for number in range(runs):
        kind = kinds[number % len(kinds)]
        e = begin.center + (1 - EDGE_MARGIN) * begin.rays[number]
        run = simulate(law, plant, bounds, e, disturb=_source(kind, plant, begin, random))
        failed, broke = run.infeasible_at is not None, run.violation > VIOLATION_TOLERANCE
        infeasible, violated, worst = infeasible + failed, violated + broke, max(worst, run.violation)
        either += failed or broke
        if (failed or broke) and witness is None:
            witness = Witness(number, kind, e, run.w, run.infeasible_at, run.violation, run.reason)
        if until_first and witness is not None:
            break
    return Campaign(number + 1, infeasible, violated, either, worst, witness)


class _Edge(NamedTuple):
    """Points on the edge of a feasible set and the facets that were met there."""

    center: Array
    rays: Array
    """From the centre to the edge, shape (runs, n); where there is none, as far as it is in other directions."""
    normals: Array
    """Outer normals n of the facets, scaled so that n (e - center) <= 1 on the set, shape (facets, n)."""


def _edge_of(problem: CondensedQP, order: int, runs: int, random: np.random.Generator) -> _Edge:
    center = problem.inside()
    rays, normals = [], []
    for direction in random.normal(size=(runs, order)) * problem.spread(center):
        edge = problem.edge(center, direction)
        rays.append((edge.distance if np.isfinite(edge.distance) else 1.0) * direction)
        reach = edge.normal @ rays[-1]
        if np.isfinite(reach) and reach > 0:
            normals.append(edge.normal / reach)
    return _Edge(center, np.array(rays), np.array(normals).reshape(-1, order))


def _source(
    kind: Disturbance, plant: DelayedPlant, edge: _Edge, random: np.random.Generator
) -> Callable[[int, Array], Array]:
    W, count = plant.W, plant.W.generators.shape[1]
    if kind == "uniform":
        return lambda k, e: W.center + W.generators @ random.uniform(-1, 1, count)
    if kind == "vertex":
        return lambda k, e: W.center + W.generators @ random.choice([-1.0, 1.0], count)
    onward = edge.normals @ plant.A_delay

    def aimed(k: int, e: Array) -> Array:
        if not len(onward):
            return W.extreme(random.normal(size=plant.order))
        return W.extreme(onward[int(np.argmax(edge.normals @ (e - edge.center)))])

    return aimed
