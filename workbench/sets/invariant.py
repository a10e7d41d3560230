"""Reachable and robust positively invariant (RPI) sets of x+ = A x + w, w in a zonotope W."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_discrete_lyapunov

from models.quantity import InvalidValue
from workbench.sets.array import Array, checked
from workbench.sets.balance import state_units
from workbench.sets.polytope import Polytope, is_redundant
from workbench.sets.zonotope import TOLERANCE, Zonotope


def spectral_radius(A: ArrayLike) -> float:
    """The largest modulus of an eigenvalue of A, shape (n, n); below 1 means Schur (stable in discrete time)."""
    A = checked("A", A, (None, None))
    units = state_units(A)
    return float(np.max(np.abs(np.linalg.eigvals(A * units / units[:, None]))))


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
        The tail left out may reach no farther than this share of the whole, states taken in units in which A and W
        are near one.
    max_terms
        Where to give up.

    Raises
    ------
    InvalidValue
        If A is not Schur, or so slow that `max_terms` do not suffice.
    """
    A = require_schur(checked("A", A, (W.dimension, W.dimension)))
    units = state_units(A, np.abs(W.generators).sum(axis=1))
    alike = A * units / units[:, None]  # A for the states x / units
    rate = (1 + spectral_radius(A)) / 2
    # A'S A = rate^2 (S - I) < rate^2 S, so A contracts the norm of S by the rate
    norm = np.asarray(solve_discrete_lyapunov((alike / rate).T, np.eye(len(A))), dtype=np.float64)
    stretch = 1 / np.sqrt(np.linalg.eigvalsh(norm)[0])
    center = np.asarray(np.linalg.solve(np.eye(len(A)) - alike, W.center / units), dtype=np.float64)
    blocks: list[Array] = [np.zeros((len(A), 0))]
    term = W.generators / units[:, None]
    reach = np.zeros(len(A))
    for _ in range(max_terms):
        radius = float(np.sqrt(np.einsum("ij,ij->j", term, norm @ term)).sum() / (1 - rate))
        if radius * stretch <= tolerance * float(reach.max(initial=0.0)):
            partial = Zonotope(center=center * units, generators=np.hstack(blocks) * units[:, None])
            return MinimalRPI(partial=partial, shape=norm / np.outer(units, units), radius=radius, rate=rate)
        blocks.append(term)
        reach = reach + np.abs(term).sum(axis=1)
        term = alike @ term
    share = radius * stretch / float(reach.max())
    raise InvalidValue(f"the tail must fall below {tolerance} of the set within {max_terms} terms, got {share:.3g}")


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
        What counts as cutting, a share of X's width along the bound that was carried back.
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
    sizes = unit.sizes
    room = unit.h - minimal_rpi(A, W).support(unit.H)
    if np.any(room < -tolerance * sizes):
        worst = int(np.argmin(room / sizes))
        raise InvalidValue(
            f"no invariant set fits the bounds: the disturbance alone carries the closed loop beyond "
            f"'{unit.labels[worst]}' by {-room[worst]:.6g}; make W smaller, widen that bound or choose another gain K"
        )
    H, h, scale, labels = unit.H, unit.h, sizes, list(unit.labels)
    back, offsets = unit.H, unit.h
    for step in range(1, max_steps + 1):
        offsets = offsets - W.support(back)  # h - support of F_step
        back = back @ A
        cut = False
        for row, offset, size, label in zip(back, offsets, sizes, unit.labels, strict=True):
            if not np.any(row) or is_redundant(row, float(offset), H, h, size=float(size), tolerance=tolerance):
                continue
            H, h, scale = np.vstack([H, row]), np.r_[h, offset], np.r_[scale, size]
            labels.append(f"{label}, {step} steps on")
            cut = True
        if not cut:
            return Polytope(H=H, h=h, labels=tuple(labels), scale=scale).reduced(tolerance=tolerance)
    raise InvalidValue(f"the invariant set must be found within {max_steps} steps, got none; raise max_steps")


def rpi_residual(A: ArrayLike, W: Zonotope, S: Polytope) -> float:
    """By how much A S + W can leave S, a share of S's width along the row: at most the tolerance used if S is RPI.

    One LP a row: the largest d'A x over S, plus the support of W along d, less the row's offset. -inf if S is empty.
    """
    A = checked("A", A, (S.dimension, S.dimension))
    push = W.support(S.H)
    reach = [S.support(row @ A) for row in S.H]
    return float(np.max((np.array(reach) + push - S.h) / S.sizes, initial=-np.inf))
