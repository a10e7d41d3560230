"""Reachable and robust positively invariant (RPI) sets of x+ = A x + w, w in a zonotope W."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_discrete_lyapunov

from models.quantity import InvalidValue
from workbench.sets.array import Array, checked
from workbench.sets.polytope import Polytope, is_redundant
from workbench.sets.zonotope import TOLERANCE, Zonotope


def spectral_radius(A: ArrayLike) -> float:
    """The largest modulus of an eigenvalue of A, shape (n, n); below 1 means Schur (stable in discrete time)."""
    return float(np.max(np.abs(np.linalg.eigvals(checked("A", A, (None, None))))))


def require_schur(A: ArrayLike, *, name: str = "A") -> Array:
    """A as an array, or InvalidValue if an eigenvalue lies on or outside the unit circle."""
    A = checked(name, A, (None, None))
    radius = spectral_radius(A)
    if radius >= 1:
        raise InvalidValue(
            f"{name} must be Schur (spectral radius below 1), got {radius:.6g}; choose another gain K, "
            "for example one from `workbench.predictive.regulator.lqr`"
        )
    return A


def reachable(A: ArrayLike, W: Zonotope, steps: int) -> tuple[Zonotope, ...]:
    """The sets F_0 = {0}, F_i = W + A W + ... + A^(i-1) W for i up to `steps`, exactly.

    Source: doi 10.16383/j.aas.c200039, the sets below (14), whose printed upper index is one too high.
    """
    A = checked("A", A, (W.dimension, W.dimension))
    if steps < 0:
        raise InvalidValue(f"steps must be at least 0, got {steps}")
    sets, term = [Zonotope.point(np.zeros(W.dimension))], W
    for _ in range(steps):
        sets.append(sets[-1] + term)
        term = term.mapped(A)
    return tuple(sets)


@dataclass(frozen=True, kw_only=True, eq=False)
class MinimalRPI:
    """A robust positively invariant outer approximation of Z = W + A W + A^2 W + ...

    It is F + {x : x'S x <= r^2}: finitely many terms exactly, the rest inside an ellipsoid that A contracts by
    `rate` and that is r = (size of the first term left out) / (1 - rate). Hence A (F + tail) + W lies in F + tail.
    W may be a mere segment, where the scaling of Rakovic et al. (IEEE TAC 50(3), 2005) finds no factor.
    """

    partial: Zonotope
    """F: the sum of the first terms, with the whole sum of the centres."""
    shape: Array
    """S, shape (n, n), positive definite."""
    radius: float
    """r: how large the tail may be, in the norm of S."""
    rate: float
    """Contraction of A in the norm of S, below 1."""

    def support(self, directions: ArrayLike) -> Array:
        """An upper bound, tight to the tail, of the largest d'x over Z for each row d; (m, n) to (m,)."""
        directions = checked("directions", directions, (None, self.partial.dimension))
        tail = np.sqrt(np.einsum("ij,ij->i", directions, np.linalg.solve(self.shape, directions.T).T))
        bound: Array = self.partial.support(directions) + self.radius * tail
        return bound


def minimal_rpi(A: ArrayLike, W: Zonotope, *, tolerance: float = TOLERANCE, max_terms: int = 100_000) -> MinimalRPI:
    """Outer approximation of the minimal RPI set of x+ = A x + w.

    Parameters
    ----------
    A
        Schur, shape (n, n).
    W
        The disturbances.
    tolerance
        The tail left out may move no support along a unit direction by more than this.
    max_terms
        Where to give up.

    Raises
    ------
    InvalidValue
        If A is not Schur, or so slow that `max_terms` do not suffice.
    """
    A = require_schur(checked("A", A, (W.dimension, W.dimension)))
    rate = (1 + spectral_radius(A)) / 2
    # A'S A = rate^2 (S - I) < rate^2 S, so A contracts the norm of S by the rate
    shape = np.asarray(solve_discrete_lyapunov((A / rate).T, np.eye(len(A))), dtype=np.float64)
    stretch = 1 / np.sqrt(np.linalg.eigvalsh(shape)[0])
    center = np.asarray(np.linalg.solve(np.eye(len(A)) - A, W.center), dtype=np.float64)
    blocks: list[Array] = [np.zeros((len(A), 0))]
    term = W.generators
    for _ in range(max_terms):
        radius = float(np.sqrt(np.einsum("ij,ij->j", term, shape @ term)).sum() / (1 - rate))
        if radius * stretch <= tolerance:
            generators = np.hstack(blocks)
            return MinimalRPI(
                partial=Zonotope(center=center, generators=generators), shape=shape, radius=radius, rate=rate
            )
        blocks.append(term)
        term = A @ term
    raise InvalidValue(f"the tail must fall below {tolerance} within {max_terms} terms, got {radius * stretch:.3g}")


def maximal_rpi(
    A: ArrayLike, W: Zonotope, X: Polytope, *, tolerance: float = TOLERANCE, max_steps: int = 2000
) -> Polytope:
    """The largest set inside X from which x+ = A x + w never leaves X, with redundant rows removed.

    The rows of X are carried back step by step, row_i = H A^i x <= h - support of F_i along H, until a step adds
    nothing: a set that one step does not cut is invariant. `rpi_residual` checks the answer independently.

    Parameters
    ----------
    A
        Schur, shape (n, n).
    W
        The disturbances.
    X
        The bounds; may leave states free if A makes them visible in the others.
    tolerance
        What counts as cutting, a distance.
    max_steps
        Where to give up.

    Raises
    ------
    InvalidValue
        If A is not Schur, if no such set exists (it names the bound and by how much the disturbance exceeds it),
        or if it is not found within `max_steps`.

    Source: Kolmanovsky and Gilbert, Math. Probl. Eng. 4 (1998); the paper's reference [39] for Sigma_0 in (16).
    """
    A = require_schur(checked("A", A, (X.dimension, X.dimension)))
    unit = X.normalized()
    room = unit.h - minimal_rpi(A, W).support(unit.H)
    if np.any(room < -tolerance):
        worst = int(np.argmin(room))
        raise InvalidValue(
            f"no invariant set fits the bounds: the disturbance alone carries the closed loop beyond "
            f"'{unit.labels[worst]}' by {-room[worst]:.6g}; make W smaller, widen that bound or choose another gain K"
        )
    H, h, labels = unit.H, unit.h, list(unit.labels)
    back, offsets = unit.H, unit.h
    for step in range(1, max_steps + 1):
        offsets = offsets - W.support(back)  # h - support of F_step
        back = back @ A
        cut = False
        for row, offset, label in zip(back, offsets, unit.labels, strict=True):
            length = float(np.linalg.norm(row))
            if length <= np.finfo(float).tiny or is_redundant(row / length, offset / length, H, h, tolerance=tolerance):
                continue
            H, h = np.vstack([H, row / length]), np.r_[h, offset / length]
            labels.append(f"{label}, {step} steps on")
            cut = True
        if not cut:
            return Polytope(H=H, h=h, labels=tuple(labels)).reduced(tolerance=tolerance)
    raise InvalidValue(f"the invariant set must be found within {max_steps} steps, got none; raise max_steps")


def rpi_residual(A: ArrayLike, W: Zonotope, S: Polytope) -> float:
    """By how much A S + W can leave S, a distance: at most the tolerance used if S is RPI; -inf if S is empty.

    One LP a row: the largest d'A x over S, plus the support of W along d, less the row's offset.
    """
    A = checked("A", A, (S.dimension, S.dimension))
    unit = S.normalized()
    push = W.support(unit.H)
    reach = [unit.support(row @ A) for row in unit.H]
    return float(np.max(np.array(reach) + push - unit.h, initial=-np.inf))
