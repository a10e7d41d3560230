"""When an input first reaches an output: the relative degree, from the symbolic plant."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

from models.plant import Plant


class RelativeDegree(NamedTuple):
    """The first sample that an input reaches, and the derivative there."""

    degree: int
    """y(k + degree) is the first output that depends on u(k)."""
    slope: float
    """dy(k + degree)/du(k) at the point that was asked for."""


def relative_degree(plant: Plant, k: int = 0, most: int = 100) -> RelativeDegree | None:
    """Return the relative degree of the first input and output from sample k on, None beyond ``most``.

    The outputs before it do not contain the input as an expression, so the zero is exact at every state. The
    slope is taken at the origin (no input before and after).
    """
    x = ca.SX.sym("x", len(plant.states))
    u = ca.SX.sym("u", len(plant.inputs))
    w = ca.SX.zeros(len(plant.disturbances))
    state = plant.next_state(x, u, w, ca.SX(k))
    for degree in range(1, most + 1):
        output = plant.measured(state)[0]
        if ca.depends_on(output, u[0]):
            slope = ca.Function("slope", [x, u], [ca.jacobian(output, u[0])])
            value = slope(ca.DM.zeros(*x.shape), ca.DM.zeros(*u.shape))
            return RelativeDegree(degree, float(value))
        state = plant.next_state(state, ca.SX.zeros(*u.shape), w, ca.SX(k + degree))
    return None
