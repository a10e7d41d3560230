"""Whether a plant's right-hand side is Lipschitz in its state on a box, by rigorous interval bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import casadi as ca
import numpy as np

from models.array import Array
from models.plant import Plant
from verification.certificates.bounds import Ask, bounds, looser
from verification.checks.slope import slope
from verification.enclosure.bounds import bound
from verification.enclosure.box import Box
from verification.enclosure.smoothness import continuous_on
from verification.enclosure.tables import told, with_tables
from workbench.contracts.certificate import Certificate
from workbench.contracts.claim import Held
from workbench.contracts.finding import Finding, Grounds, undecided
from workbench.graph import Unreadable, read

BUDGET = 300
"""Boxes spent on every entry of the Jacobian and band."""
TOLERANCE = 1e-2
"""Share to which a bound of an entry is sought, and by which it is certified wider."""
PAIRS = 2000
"""Pairs of states that a proved constant is held against."""
CONTINUOUS = 1e-9
"""Share of its size by which a continuous function may change between neighbouring numbers."""


def lipschitz(plant: Plant, lower: Sequence[float], upper: Sequence[float], bands: Sequence[float]) -> Finding:
    """Bound the Jacobian of a plant's right-hand side at no input on a box of states, cut into bands of the last state.

    A function that is continuous on the box and differentiable but for kinks is Lipschitz with the largest row sum
    of |df/dx| (maximum norm). A jump inside the box refutes it: the witness is a pair of states across the jump.
    """
    f = _right_hand_side(plant)
    try:
        graph = with_tables(read(f))
    except Unreadable as error:
        return undecided(str(error))
    smooth = continuous_on(graph, Box({"x": (list(lower), list(upper))}))
    for reach in smooth.reaches:
        if reach.operation.kind == "jump" and reach.reachable == "yes" and reach.point is not None:
            pair = _across(f, reach.point.midpoint()["x"].ravel(), [f"{one.unit}/s" for one in plant.states])
            if pair is not None:
                return pair
    if not smooth.proved:
        return undecided(f"continuity on the box could not be shown: {smooth.reason}")
    entries = np.zeros((len(lower), len(lower)), dtype=float)
    for i, j in np.ndindex(*entries.shape):
        entry = slope(graph, "f", "x", i, j)
        for low, high in pairwise(bands):
            box = Box({"x": ([*lower[:-1], low], [*upper[:-1], high])})
            found = bound(entry, box, budget=BUDGET, tolerance=TOLERANCE)
            entries[i, j] = max(float(entries[i, j]), -found.lower, found.upper)
    constant = float(entries.sum(axis=1).max())
    if not np.isfinite(constant):
        return undecided("an entry of the Jacobian could not be bounded on the box")
    return Finding(
        grounds=Grounds.ENCLOSURE,
        method="outward-rounded interval bounds of the Jacobian's entries by branch and bound, f being continuous"
        + told(graph),
        holds=bool(np.isfinite(constant)),
        bound=constant,
        bound_unit="of df over dx in the maximum norm",
        witness={"bounds_of_the_jacobian": entries, "lower": list(lower), "upper": list(upper)},
    )


def certified(plant: Plant, finding: Finding, premises: Mapping[str, Certificate]) -> Certificate:
    """Return the certificate of the bounds of all slopes of a plant's right-hand side, which f being Lipschitz means.

    Raises NotCertified where the checker's rules do not show them.
    """
    witness = finding.witness or {}
    entries = np.asarray(witness["bounds_of_the_jacobian"], dtype=float)
    low, high = (np.asarray(witness[end], dtype=float) for end in ("lower", "upper"))
    box = Box({"x": (low, high)})
    graph = read(_right_hand_side(plant))
    labels = graph.labels()
    asks = [
        Ask(("f", i, 0), labels[j], side, looser(sign * float(entries[i, j]), side, TOLERANCE))
        for i, j in np.ndindex(*entries.shape)
        for sign, side in ((-1, "at least"), (1, "at most"))
    ]
    return bounds(graph, box, dict(zip(labels, (one.unit for one in plant.states), strict=True)), asks)


def jump_at(plant: Plant, witness: Mapping[str, object]) -> float:
    """Return the margin at a witness: how far the right-hand side jumps between its two states, below zero.

    They are brought together until no number lies between them: what is left of the difference is a jump, or what one
    rounding of a state makes of a continuous function, which is allowed for.
    """
    f = _right_hand_side(plant)
    low, high = (np.asarray(witness[name], dtype=float) for name in ("x1", "x2"))
    below, above = (f(one).full().ravel() for one in (low, high))
    axis = int(np.argmax(np.abs(high - low)))
    while low[axis] < (middle := (low[axis] + high[axis]) / 2) < high[axis]:
        between = low.copy()
        between[axis] = middle
        value = f(between).full().ravel()
        if np.abs(value - below).max() >= np.abs(above - value).max():
            high, above = between, value
        else:
            low, below = between, value
    return CONTINUOUS * max(1.0, float(np.abs(above).max())) - float(np.abs(above - below).max())


def held_slopes(plant: Plant, lower: Sequence[float], upper: Sequence[float], finding: Finding) -> Held:
    """Hold a Lipschitz constant against pairs of states: near ones, where slopes show, and far ones."""
    f, rng = _right_hand_side(plant), np.random.default_rng(0)
    a, b = (rng.uniform(lower, upper, (PAIRS, len(lower))).T for _ in range(2))
    b = a + np.where(np.arange(PAIRS) % 2, 1e-3, 1.0) * (b - a)
    ratios = np.abs(f(a).full() - f(b).full()).max(axis=0) / np.abs(a - b).max(axis=0)
    worst = int(np.argmax(ratios))
    room = (finding.bound or 0.0) * (1 + CONTINUOUS) - float(ratios[worst])
    return Held(PAIRS, room, {"x1": a[:, worst], "x2": b[:, worst], "ratio": ratios[worst]})


def _right_hand_side(plant: Plant) -> ca.Function:
    """Return dx/dt of a state at no input and no disturbance."""
    x = ca.SX.sym("x", len(plant.states))
    u, w = ca.SX.zeros(len(plant.inputs)), ca.SX.zeros(len(plant.disturbances))
    return ca.Function("rhs", [x], [plant.slope(x, u, w, 0)], ["x"], ["f"])


def _across(f: ca.Function, point: Array, units: Sequence[str]) -> Finding | None:
    """Return the refutation at a jump of f in its first state, or None where f does not jump there."""
    far, step = (scale * max(1.0, abs(float(point[0]))) for scale in (1e-6, 1e-9))

    def pair(distance: float) -> tuple[list[Array], list[Array], float]:
        near = [point + np.array([sign * distance, *[0.0] * (point.size - 1)]) for sign in (-1, 1)]
        values = [f(one).full().ravel() for one in near]
        return near, values, float(np.abs(values[1] - values[0]).max())

    near, values, gap = pair(step)
    if gap <= 0.1 * pair(far)[2] or gap == 0:  # a continuous function's would have shrunk a thousandfold
        return None
    row = int(np.argmax(np.abs(values[1] - values[0])))
    return Finding(
        grounds=Grounds.ENCLOSURE,
        method="the right-hand side jumps inside the box: the ratio of the differences grows without bound as the two "
        "states come closer",
        margin=-gap,
        unit=units[row],
        witness={"x1": near[0], "x2": near[1], "f1": values[0], "f2": values[1], "ratio": gap / (2 * step)},
    )
