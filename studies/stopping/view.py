"""How the predictive laws see the braking train, and what the ideal one knows of the line ahead."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from models.array import Array
from models.brake import Brake
from models.braking_curve import BrakingCurve
from studies.stopping.brake_model import BrakeModel, reference_state
from workbench.contracts.law import Seen
from workbench.predictive.view import Sight, View

ACCELERATION, SPEED, POSITION = range(3)
"""Where the motion stands in the plant's state."""


class BrakeView(View):
    """x = [a_c(k), u(k-l-1), v(k), s(k)], to be on the braking curve.

    ``held`` is the command with which the brake acts before the run, in the train and in the line of commands.
    """

    def __init__(self, brake: Brake, curve: BrakingCurve, held: float) -> None:
        self.brake, self.curve, self.held = brake, curve, held

    def state(self, seen: Seen, acted: float) -> Array:
        """Return the model's state at the sample, shape (4,)."""
        return np.array([seen.x[ACCELERATION], acted, seen.x[SPEED], seen.x[POSITION]])

    def reference(self, k: int) -> Array:
        """Return x_s(k), shape (4,)."""
        return reference_state(self.brake, self.curve, k)

    @property
    def before(self) -> float:
        """The command before the run."""
        return self.held


def line_ahead(brake: Brake, linear: BrakeModel) -> Callable[[Seen, Sight], Array]:
    """Return what tells the resistances d(k) ... d(k+l) of a line that is known, shape (l+1,)."""
    v, s = ca.SX.sym("v"), ca.SX.sym("s")
    resistance = ca.Function("resistance", [v, s], [brake.resistance(v, s)])

    def ahead(seen: Seen, sight: Sight) -> Array:
        x, found = sight.x, []
        for du in (*sight.pending, None):  # where the resistance ahead is met depends on the resistance before
            found.append(float(resistance(x[2], x[3])))
            if du is not None:
                x = linear.A @ x + linear.b * du + linear.E * found[-1]
        return np.array(found)

    return ahead


def speed_excess(curve: BrakingCurve, sampling_time: float) -> Callable[[Seen], float]:
    """Return what tells by how much the train is faster than the curve, in m/s: braking more lowers it."""

    def excess(seen: Seen) -> float:
        return float(seen.x[SPEED] - curve.at(seen.k * sampling_time)[0])

    return excess
