"""Whether a learning law that uses dy/dt has a direct term: h_x B of a plant, exactly, and what follows from it."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from models.expression import Expression
from models.plant import Plant
from workbench.contracts.verdict import Finding, Standing, undecided


def input_matrix(plant: Plant) -> tuple[Expression, Expression]:
    """Return h_x (outputs by states) and B = d(dx/dt)/du (states by 1) of a plant as exact expressions (SX).

    The plant has one input, no disturbance and gives ``rhs``.
    """
    x, u = ca.SX.sym("x", len(plant.states)), ca.SX.sym("u")
    slope = plant.slope(x, u, ca.SX(len(plant.disturbances), 1), 0)
    return ca.jacobian(plant.measured(x), x), ca.simplify(ca.jacobian(slope, u))


def spectral_radius(plant: Plant, lam: float) -> Finding:
    """Find the spectral radius of I - h_x [0, B] lambda for two states and outputs, u = [0, F] as the patent has it."""
    h_x, b = (ca.evalf(matrix).full() for matrix in input_matrix(plant))
    direct = h_x @ np.column_stack([np.zeros(2), b])
    eigenvalues = np.sort(np.linalg.eigvals(np.eye(2) - lam * direct).real)
    radius = float(np.abs(eigenvalues).max())
    return Finding(
        standing=Standing.REFUTED if radius >= 1 else Standing.PROVED,
        method="exact algebra: h_x and B come from the plant's equations; the first row of h_x B is zero, so "
        "I - h_x B lambda has the eigenvalue 1 (position) for every lambda, beside 1 - b lambda (speed)",
        margin=1 - radius,
        unit="1",
        witness={"lambda": lam, "h_x_B": direct, "eigenvalues": eigenvalues},
    )


def contraction(plant: Plant, output: int, gains: Sequence[float]) -> Finding:
    """Bound |1 - b lambda| between the least and the largest gain, b = d(dy/dt)/du of one output."""
    h_x, column = input_matrix(plant)
    direct = ca.simplify(h_x[output, :] @ column)
    if ca.symvar(direct):
        return undecided("the input gain depends on the state: no exact bound")
    b = float(ca.evalf(direct))
    factors = {lam: abs(1 - b * lam) for lam in gains}
    worst = max(factors, key=lambda lam: factors[lam])
    return Finding(
        standing=Standing.PROVED if factors[worst] < 1 else Standing.REFUTED,
        method="exact algebra: dv/dt is affine in F with the constant factor b, and |1 - b lambda| is convex in "
        "lambda, so its largest value is at an end of the range of gains",
        margin=1 - factors[worst],
        unit="1",
        witness={"b": b, "lambda": worst, "factor": factors[worst]},
    )


def answers_at_once(plant: Plant, outputs: Sequence[str]) -> Finding:
    """Look for outputs whose first derivative by time does not depend on the input.

    That is the relative degree of ``rhs``; the plant's ``relative_degree`` is that of ``step``, where a force held
    over a sample moves the position too.
    """
    h_x, b = input_matrix(plant)
    values = ca.evalf(h_x @ b).full().ravel()
    direct = dict(zip([signal.name for signal in plant.outputs], values, strict=True))
    least = min(outputs, key=lambda output: abs(direct[output]))
    return Finding(
        standing=Standing.PROVED if direct[least] != 0 else Standing.REFUTED,
        method="exact algebra: d(dy/dt)/dF of every output from the plant's equations",
        margin=abs(float(direct[least])),
        unit="output/s per input unit",
        witness={"output": least, "d(dy/dt)/dF": float(direct[least])},
    )
