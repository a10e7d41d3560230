"""The linear regulator behind a tube: stabilisability, gain, terminal weight and what they must satisfy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov

from models.quantity import InvalidValue
from workbench.sets import require_schur
from workbench.sets.array import Array, checked

EIGENVALUE_TOLERANCE = 1e-9
"""How far rounding may move an eigenvalue or a singular value, relative to the size of the matrix."""


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
    scale = max(1.0, float(np.linalg.norm(A, 2)), float(np.linalg.norm(b)))
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
    scale = max(1.0, float(np.abs(weight).max(initial=0.0)))
    if not np.allclose(weight, weight.T, rtol=0, atol=1e-9 * scale):
        raise InvalidValue(f"{name} must be symmetric, got a difference of {np.abs(weight - weight.T).max():.3g}")
    least = float(np.linalg.eigvalsh(weight)[0])
    if least < -1e-9 * scale:
        raise InvalidValue(f"{name} must be positive semidefinite, got the eigenvalue {least:.6g}")
    return weight


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
    try:
        P = np.asarray(solve_discrete_are(A, b[:, None], Q, np.array([[R]])), dtype=np.float64)
    except np.linalg.LinAlgError as failure:
        raise InvalidValue(f"no stabilising gain for these weights ({failure}); let Q weigh every slow mode") from None
    K: Array = -(b @ P @ A) / (R + b @ P @ b)
    require_schur(A + np.outer(b, K), name="A + b K")
    return Regulator(K=K, P=(P + P.T) / 2)


def terminal_weight(A_cl: ArrayLike, K: ArrayLike, Q: ArrayLike, R: float) -> Array:
    """P, shape (n, n), with equality in (19): P = A_cl' P A_cl + Q + R K'K. A_cl must be Schur."""
    A_cl = require_schur(A_cl, name="A + b K")
    K = checked("K", K, (len(A_cl),))
    P = np.asarray(solve_discrete_lyapunov(A_cl.T, np.asarray(Q) + R * np.outer(K, K)), dtype=np.float64)
    return (P + P.T) / 2


def decrease(A_cl: ArrayLike, K: ArrayLike, Q: ArrayLike, R: float, P: ArrayLike) -> Array:
    """The matrix that (19) wants negative semidefinite: Q + R K'K + A_cl' P A_cl - P, shape (n, n)."""
    A_cl, K, P = checked("A_cl", A_cl, (None, None)), checked("K", K, (None,)), checked("P", P, (None, None))
    change: Array = np.asarray(Q) + R * np.outer(K, K) + A_cl.T @ P @ A_cl - P
    return change


def lmi(A_cl: ArrayLike, K: ArrayLike, Q: ArrayLike, R: float, P: ArrayLike) -> Array:
    """The matrix of (20), shape (2 n + 1, 2 n + 1): positive semidefinite exactly when (19) holds."""
    A_cl, P = checked("A_cl", A_cl, (None, None)), checked("P", P, (None, None))
    size = len(A_cl)
    K = checked("K", K, (size,))
    value, vector = np.linalg.eigh(symmetric_weight("Q", Q, size))
    root = vector @ np.diag(np.sqrt(np.clip(value, 0, None))) @ vector.T
    row = np.sqrt(R) * K[None, :]
    return np.block(
        [
            [P - A_cl.T @ P @ A_cl, root, row.T],
            [root, np.eye(size), np.zeros((size, 1))],
            [row, np.zeros((1, size)), np.ones((1, 1))],
        ]
    )
