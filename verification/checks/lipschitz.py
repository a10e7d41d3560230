"""Whether a plant's right-hand side is Lipschitz in its state on a box, by rigorous interval bounds."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import casadi as ca
import numpy as np

from models.array import Array
from models.plant import Plant
from verification.enclosure.bounds import bound
from verification.enclosure.box import Box
from verification.enclosure.smoothness import continuous_on
from workbench.contracts.verdict import Finding, Standing, undecided

BUDGET = 300
"""Boxes spent on every entry of the Jacobian and band."""


def lipschitz(plant: Plant, lower: Sequence[float], upper: Sequence[float], bands: Sequence[float]) -> Finding:
    """Bound the Jacobian of a plant's right-hand side at no input on a box of states, cut into bands of the last state.

    A function that is continuous on the box and differentiable but for kinks is Lipschitz with the largest row sum
    of |df/dx| (maximum norm). A jump inside the box refutes it: the witness is a pair of states across the jump.
    """
    x = ca.SX.sym("x", len(plant.states))
    rhs = plant.slope(x, ca.SX.zeros(len(plant.inputs)), ca.SX.zeros(len(plant.disturbances)), 0)
    f = ca.Function("rhs", [x], [rhs], ["x"], ["f"])
    smooth = continuous_on(f, Box({"x": (list(lower), list(upper))}))
    for reach in smooth.reaches:
        if reach.operation.kind == "jump" and reach.reachable == "yes" and reach.point is not None:
            pair = _across(f, reach.point.midpoint()["x"].ravel())
            if pair is not None:
                return pair
    if not smooth.proved:
        return undecided(f"continuity on the box could not be shown: {smooth.reason}")
    rows, entries = ca.jacobian(rhs, x), np.zeros((x.numel(), x.numel()), dtype=float)
    for i, j in np.ndindex(*entries.shape):
        entry = ca.Function("entry", [x], [rows[i, j]], ["x"], ["entry"])
        for low, high in pairwise(bands):
            box = Box({"x": ([*lower[:-1], low], [*upper[:-1], high])})
            found = bound(entry, box, budget=BUDGET, tolerance=1e-2)
            entries[i, j] = max(float(entries[i, j]), -found.lower, found.upper)
    constant = float(entries.sum(axis=1).max())
    if not np.isfinite(constant):
        return undecided("an entry of the Jacobian could not be bounded on the box")
    return Finding(
        standing=Standing.PROVED,
        method="outward-rounded interval bounds of the Jacobian's entries by branch and bound, f being continuous",
        witness={"constant": constant, "bounds_of_the_jacobian": entries, "lower": list(lower), "upper": list(upper)},
    )


def _across(f: ca.Function, point: Array) -> Finding | None:
    """Return the refutation at a jump of f in its first state, or None where f does not jump there."""
    far, step = (scale * max(1.0, abs(float(point[0]))) for scale in (1e-6, 1e-9))

    def pair(distance: float) -> tuple[list[Array], list[Array], float]:
        near = [point + np.array([sign * distance, *[0.0] * (point.size - 1)]) for sign in (-1, 1)]
        values = [f(one).full().ravel() for one in near]
        return near, values, float(np.abs(values[1] - values[0]).max())

    near, values, gap = pair(step)
    if gap <= 0.1 * pair(far)[2] or gap == 0:  # a continuous function's would have shrunk a thousandfold
        return None
    return Finding(
        standing=Standing.REFUTED,
        method="the right-hand side jumps inside the box: the ratio of the differences grows without bound as the two "
        "states come closer",
        margin=-gap,
        unit="N/kg",
        witness={"x1": near[0], "x2": near[1], "f1": values[0], "f2": values[1], "ratio": gap / (2 * step)},
    )
