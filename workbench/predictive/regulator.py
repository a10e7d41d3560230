"""The linear regulator behind a tube: stabilisability, gain, terminal weight and what they must satisfy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov

from models.quantity import InvalidValue
from workbench.sets import require_schur
from workbench.sets.array import Array, checked
from workbench.sets.balance import powers_of_two, state_units

EIGENVALUE_TOLERANCE = 1e-9
"""How far rounding may move an eigenvalue or a singular value, relative to the size of the matrix, its states taken in
units in which its entries are near one."""

WEIGHT_TOLERANCE = 1e-9
"""How far rounding may move a weight from symmetric and positive semidefinite, relative to its diagonal."""


class Regulator(NamedTuple):
    """A gain K, shape (n,), for du = K e, and the weight P, shape (n, n), of the cost to go e'P e."""

    K: Array
    P: Array


def unstabilizable(A: ArrayLike, b: ArrayLike, *, tolerance: float = EIGENVALUE_TOLERANCE) -> NDArray[np.complex128]:
    """The eigenvalues of A on or outside the unit circle that the input cannot move: none if (A, b) is stabilisable.

    Source: Popov-Belevitch-Hautus test, rank [lambda I - A, b] = n.
    """
    A = checked("A", A, (None, None))
    b = checked("b", b, (len(A),))
    units = state_units(A, b)
    A, b = A * units / units[:, None], b / units
    b = b / (np.linalg.norm(b) or 1.0)
    scale = max(1.0, float(np.linalg.norm(A, 2)))
    stuck = [
        value
        for value in np.linalg.eigvals(A)
        if abs(value) >= 1 - 1e-6  # repeated eigenvalues at 1 come out a little inside
        and np.linalg.svd(np.column_stack([value * np.eye(len(A)) - A, b]), compute_uv=False)[-1] <= tolerance * scale
    ]
    return np.array(stuck, dtype=np.complex128)


def require_stabilizable(A: ArrayLike, b: ArrayLike) -> None:
    """Raise InvalidValue where the input does not reach an eigenvalue of A on or outside the unit circle."""
    stuck = unstabilizable(A, b)
    if stuck.size:
        raise InvalidValue(
            f"(A, b) must be stabilisable, got the eigenvalue {stuck[0]:.6g} that b does not reach; "
            "leave that state out or add an input"
        )


def symmetric_weight(name: str, value: ArrayLike, size: int) -> Array:
    """`value` as a symmetric positive semidefinite matrix, shape (size, size), or InvalidValue."""
    weight = checked(name, value, (size, size))
    alike = relative(weight, weight)
    if np.abs(alike - alike.T).max(initial=0.0) > WEIGHT_TOLERANCE:
        raise InvalidValue(f"{name} must be symmetric, got a difference of {np.abs(weight - weight.T).max():.3g}")
    if float(np.linalg.eigvalsh(alike)[0]) < -WEIGHT_TOLERANCE:
        least = float(np.linalg.eigvalsh(weight)[0])
        raise InvalidValue(f"{name} must be positive semidefinite, got the eigenvalue {least:.6g}")
    return weight


def relative(matrix: Array, *weights: Array) -> Array:
    """A matrix of a cost, shape (n, n), each state in the unit that makes it count one in the largest of the weights.

    A congruence, so signs of eigenvalues stay, and their sizes do not depend on the units of the states. A state
    without weight of its own is taken in the unit in which its entries beside the others' are one.
    """
    size = np.sqrt(np.max([np.abs(np.diag(weight)) for weight in weights], axis=0))
    beside = np.max([np.abs(weight) for weight in (matrix, *weights)], axis=0)
    bare = size == 0
    against = np.divide(beside, size, out=np.zeros_like(beside), where=np.broadcast_to(~bare, beside.shape))
    alone = np.sqrt(beside[:, bare].max(axis=1, initial=0.0))
    size[bare] = np.maximum(against.max(axis=1, initial=0.0), alone)[bare]
    size[size == 0] = 1.0
    scaled: Array = matrix / size / size[:, None]
    return scaled


def lqr(A: ArrayLike, b: ArrayLike, Q: ArrayLike, R: float) -> Regulator:
    """The gain that minimises the infinite sum of e'Q e + R du^2 for e+ = A e + b du.

    Parameters
    ----------
    A, b
        Shapes (n, n) and (n,).
    Q, R
        Weight of the state, shape (n, n), positive semidefinite, and of the input increment, positive.

    Raises
    ------
    InvalidValue
        If the plant is not stabilisable, the weights are not admissible, or Q leaves a mode on the unit circle unseen.
    """
    A = checked("A", A, (None, None))
    b = checked("b", b, (len(A),))
    Q = symmetric_weight("Q", Q, len(A))
    if not (np.isfinite(R) and R > 0):
        raise InvalidValue(f"R must be positive, got {R}")
    require_stabilizable(A, b)
    units = state_units(A, b)
    push = 1 / float(powers_of_two(np.log2([np.abs(b / units).max(initial=0.0) or 1.0]))[0])  # du in units of this
    weight = Q * np.outer(units, units)
    worth = float(powers_of_two(np.log2([max(R * push**2, float(np.abs(weight).max(initial=0.0)))]))[0])
    F, e = A * units / units[:, None], b / units * push
    r = R * push**2 / worth
    try:
        P = np.asarray(solve_discrete_are(F, e[:, None], weight / worth, np.array([[r]])), dtype=np.float64)
    except np.linalg.LinAlgError:
        raise InvalidValue("no stabilising gain for these weights; let Q weigh every slow mode") from None
    K: Array = -(e @ P @ F) / (r + e @ P @ e) * push / units
    require_schur(A + np.outer(b, K), name="A + b K")
    return Regulator(K=K, P=worth * (P + P.T) / 2 / np.outer(units, units))


def terminal_weight(A_cl: ArrayLike, K: ArrayLike, Q: ArrayLike, R: float) -> Array:
    """P, shape (n, n), with equality in (19): P = A_cl' P A_cl + Q + R K'K. A_cl must be Schur."""
    A_cl = require_schur(A_cl, name="A + b K")
    K = checked("K", K, (len(A_cl),))
    units = state_units(A_cl, np.divide(1.0, K, out=np.zeros_like(K), where=K != 0))
    stage = (np.asarray(Q) + R * np.outer(K, K)) * np.outer(units, units)
    worth = float(powers_of_two(np.log2([np.abs(stage).max(initial=0.0) or 1.0]))[0])
    P = np.asarray(solve_discrete_lyapunov((A_cl * units / units[:, None]).T, stage / worth), dtype=np.float64)
    return worth * (P + P.T) / 2 / np.outer(units, units)


def decrease(A_cl: ArrayLike, K: ArrayLike, Q: ArrayLike, R: float, P: ArrayLike) -> Array:
    """The matrix that (19) wants negative semidefinite: Q + R K'K + A_cl' P A_cl - P, shape (n, n)."""
    A_cl, K, P = checked("A_cl", A_cl, (None, None)), checked("K", K, (None,)), checked("P", P, (None, None))
    change: Array = np.asarray(Q) + R * np.outer(K, K) + A_cl.T @ P @ A_cl - P
    return change


def lmi(A_cl: ArrayLike, K: ArrayLike, Q: ArrayLike, R: float, P: ArrayLike) -> Array:
    """The matrix of (20), shape (2 n + 1, 2 n + 1): positive semidefinite exactly when (19) holds.

    The printed Q^(1/2) is one F with F'F = Q; here F is taken from Q with ones on its diagonal, which is more exact
    where the states have different units. For a diagonal Q it is the same.
    """
    A_cl, P = checked("A_cl", A_cl, (None, None)), checked("P", P, (None, None))
    size = len(A_cl)
    K = checked("K", K, (size,))
    Q = symmetric_weight("Q", Q, size)
    own = np.sqrt(np.abs(np.diag(Q)))
    own[own == 0] = 1.0
    value, vector = np.linalg.eigh(Q / np.outer(own, own))
    root = vector @ np.diag(np.sqrt(np.clip(value, 0, None))) @ vector.T * own
    row = np.sqrt(R) * K[None, :]
    return np.block(
        [
            [P - A_cl.T @ P @ A_cl, root.T, row.T],
            [root, np.eye(size), np.zeros((size, 1))],
            [row, np.zeros((1, size)), np.ones((1, 1))],
        ]
    )
