"""Premises of theorems about differences between trials, looked at in the study's own settings.

Each returns why a premise is not met, in one sentence, or None.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from models.plant import Plant
from verification.enclosure.box import Box

STEPS = 60  # of Newton's method, a sample
CLOSE = 1e-9  # of the wanted increment's size


def one_channel(plant: Plant) -> str | None:
    """Return why a theorem for one input and one output does not speak of a plant."""
    if len(plant.inputs) == len(plant.outputs) == 1:
        return None
    return f"the theorem is for one input and one output, the plant has {len(plant.inputs)} and {len(plant.outputs)}"


def same_but_for_the_input(study: Any) -> str | None:
    """Return how trials differ besides their inputs: where they begin, or what disturbs them."""
    if study.continues:
        return "a trial begins where the last one ended, so trials differ by more than their inputs"
    first, *others = study.inputs()
    if any(not np.array_equal(one.x0, first.x0) for one in others):
        return "trials begin in different states, so they differ by more than their inputs"
    if any(not np.array_equal(one.w, first.w) for one in others):
        return "the disturbance differs between trials, so they differ by more than their inputs"
    return None


def no_noise(study: Any) -> str | None:
    """Return that the study adds measurement noise, which the theorem leaves out."""
    noisy = any(np.any(one.noise) for one in study.inputs())
    return "the theorem leaves measurement noise out, and this study adds it" if noisy else None


def reference_within(study: Any, box: Box) -> str | None:
    """Return where the input that gives the reference's increments, or its trajectory, leaves a box.

    It is found by Newton's method sample after sample, so this looks and does not prove.
    """
    plant: Plant = study.plant
    begun = study.inputs()[0]
    at = plant.symbols()
    x_next = plant.next_state(**at)
    gained = plant.measured(x_next)[0] - plant.measured(at["x"])[0]
    outputs = [x_next, gained, ca.jacobian(gained, at["u"][0])]
    step = ca.Function("step", list(at.values()), outputs)
    wanted = np.diff(study.reference_samples[0])
    x, u = np.asarray(begun.x0, dtype=float), 0.0
    low, high = ({name: box[name][side].ravel() for name in ("x", "u")} for side in (0, 1))
    for k, target in enumerate(wanted):
        for _ in range(STEPS):
            following, got, slope = (value.full().ravel() for value in step(x, u, begun.w[:, k], k))
            miss = float(target - got[0])
            if not np.isfinite(miss) or slope[0] == 0 or abs(miss) <= CLOSE * max(1.0, abs(float(target))):
                break
            u += miss / float(slope[0])
        if not abs(miss) <= CLOSE * max(1.0, abs(float(target))):
            return f"no input was found that follows the reference at sample {k}"
        for name, values, named in (("x", x, plant.states), ("u", np.array([u]), plant.inputs)):
            for i, value in enumerate(values):
                if not low[name][i] <= value <= high[name][i]:
                    return (
                        f"the trajectory that follows the reference leaves the box at sample {k}: {named[i].name} is "
                        f"{value:.4g} {named[i].unit}, the box holds {low[name][i]:.4g} to {high[name][i]:.4g}"
                    )
        x = following
    return None
