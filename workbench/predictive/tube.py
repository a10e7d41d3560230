"""The design of a tube controller: gain, weights, invariant set and tightened bounds for a plant with delay."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from models.quantity import InvalidValue
from workbench.predictive.delayed_plant import DelayedPlant
from workbench.predictive.regulator import decrease, lqr, relative, symmetric_weight, terminal_weight
from workbench.sets import TOLERANCE, Polytope, Zonotope, maximal_rpi, reachable, require_schur
from workbench.sets.array import Array, checked

DECREASE_TOLERANCE = 1e-8
"""How far (19) may miss, relative to P, state by state: rounding of a Lyapunov solver."""


class Excess(NamedTuple):
    """By how much a tube leaves Sigma at worst, and the bound it leaves through; inside if not positive."""

    share: float
    """Of Sigma's width along that bound: this decides."""
    distance: float
    label: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Tube:
    """Bounds tightened so that a plan made without disturbance stays feasible under every disturbance of W.

    The error is e(k) = z(k) - x_s(k+l), z the prediction of x(k+l) and x_s a reference with x_s(k+1) = A x_s(k), so
    e+ = A e + b du + A^l w. The tube gain K is what the plan assumes after its end and between the lines: du = K e.

    Parameters
    ----------
    plant
        A, b, W and the delay l.
    bounds
        X: where the error x - x_s may be, in the plant's states.
    Q, R
        Weights of the cost: shape (n, n), positive semidefinite, and positive.
    K
        Gain, shape (n,), with A + b K Schur.
    P
        Terminal weight, shape (n, n), that satisfies (19).
    index_off_by_one
        Negative control: sum the tube to the upper index that the paper prints, one term too many.
    ignore_delay
        Negative control: use W and X where A^l W and X_z belong.

    Raises
    ------
    InvalidValue
        If K is not stabilising, P violates (19), or the disturbance is so large that a set is empty: it says which
        bound and by how much.

    Source: doi 10.16383/j.aas.c200039, (14)-(20), (25)-(27). Deviations: powers A_cl^j inside the
    sums (printed A_cl^i), the sum to i-1 (printed i), terminal index M+N (printed N), a robust invariant Sigma (Z in
    Sigma in Sigma_0 is not enough), and the delay, which the paper leaves out of its sets.
    """

    plant: DelayedPlant
    bounds: Polytope
    Q: Array
    R: float
    K: Array
    P: Array
    index_off_by_one: bool = False
    ignore_delay: bool = False

    def __post_init__(self) -> None:
        n = self.plant.order
        if self.bounds.dimension != n:
            raise InvalidValue(f"bounds must be on the plant's {n} states, got dimension {self.bounds.dimension}")
        if not (np.isfinite(self.R) and self.R > 0):
            raise InvalidValue(f"R must be positive, got {self.R}")
        object.__setattr__(self, "Q", symmetric_weight("Q", self.Q, n))
        object.__setattr__(self, "K", checked("K", self.K, (n,)))
        object.__setattr__(self, "P", symmetric_weight("P", self.P, n))
        require_schur(self.A_cl, name="A + b K")
        missing = decrease(self.A_cl, self.K, self.Q, self.R, self.P)
        if float(np.linalg.eigvalsh(relative(missing, self.P, self.Q))[-1]) > DECREASE_TOLERANCE:
            excess = float(np.linalg.eigvalsh(missing)[-1])
            raise InvalidValue(
                f"P must satisfy (19), Q + R K'K + A_cl'P A_cl - P <= 0, got the eigenvalue {excess:.6g}; "
                "take it from `workbench.predictive.regulator.terminal_weight`"
            )
        conflict = self.X_z.conflict()
        if conflict is not None:
            raise InvalidValue(
                f"the bounds less the prediction error over {self.plant.delay} samples of delay are empty: {conflict}; "
                "make W smaller or widen a bound"
            )
        _ = self.Sigma  # raises if no invariant set fits

    @classmethod
    def from_lqr(
        cls,
        *,
        plant: DelayedPlant,
        bounds: Polytope,
        Q: ArrayLike,
        R: float,
        gain_Q: ArrayLike | None = None,
        gain_R: float | None = None,
        index_off_by_one: bool = False,
        ignore_delay: bool = False,
    ) -> Tube:
        """The tube whose K is the LQR gain of the cost, or of (gain_Q, gain_R), and whose P has equality in (19)."""
        Q = symmetric_weight("Q", Q, plant.order)
        K = lqr(plant.A, plant.b, Q if gain_Q is None else gain_Q, R if gain_R is None else gain_R).K
        return cls(
            plant=plant,
            bounds=bounds,
            Q=Q,
            R=R,
            K=K,
            P=terminal_weight(plant.A + np.outer(plant.b, K), K, Q, R),
            index_off_by_one=index_off_by_one,
            ignore_delay=ignore_delay,
        )

    @cached_property
    def A_cl(self) -> Array:
        """A + b K, shape (n, n)."""
        return checked("A + b K", self.plant.A + np.outer(self.plant.b, self.K), (self.plant.order, self.plant.order))

    @cached_property
    def W_z(self) -> Zonotope:
        """What disturbs e from one sample to the next: A^l W."""
        return self.plant.W if self.ignore_delay else self.plant.W_z

    @cached_property
    def X_z(self) -> Polytope:
        """The bounds less the prediction error: z in X_z keeps the true x(k+l) in X."""
        return self.bounds if self.ignore_delay else self.bounds.minus(self.plant.prediction_error)

    @cached_property
    def Sigma(self) -> Polytope:
        """The maximal robust positively invariant set of e+ = A_cl e + w within X_z."""
        return maximal_rpi(self.A_cl, self.W_z, self.X_z)

    def F(self, i: int) -> Zonotope:
        """The tube after i samples of feedback, the sum of A_cl^j W_z over j < i; below (14)."""
        return self._reach(True, i + self.index_off_by_one)

    def R_hold(self, M: int, i: int) -> Zonotope:
        """R_i^M: the tube after i samples of which the first M run without feedback; below (25)."""
        if M < 1:
            raise InvalidValue(f"M must be at least 1, got {M}")
        slip = int(self.index_off_by_one)
        if i <= M:
            return self._reach(False, i + slip)
        held = self._reach(False, M + slip)
        return held.mapped(np.linalg.matrix_power(self.A_cl, i - M)) + self.F(i - M)

    def stage_bounds(self, i: int) -> Polytope:
        """X_z - F_i, where the planned e_i must lie under `workbench.controllers.rmpc`; (14)."""
        return self.X_z.minus(self.F(i))

    def terminal_bounds(self, N: int) -> Polytope:
        """Sigma - F_N, where the planned e_N must lie; (14)."""
        return self.Sigma.minus(self.F(N))

    def held_stage_bounds(self, M: int, i: int) -> Polytope:
        """X_z - R_i^M, where the planned e_i must lie if the input is held for M samples; (26)."""
        return self.X_z.minus(self.R_hold(M, i))

    def held_terminal_bounds(self, M: int, N: int) -> Polytope:
        """Sigma - R_{M+N}^M, where the planned e_{M+N} must lie; (26). Not empty if (27) holds."""
        return self.Sigma.minus(self.R_hold(M, M + N))

    def held_excess(self, M: int, N: int) -> Excess:
        """By how much R_{M+N}^M leaves Sigma; (27) holds if not at all."""
        excess = self.R_hold(M, M + N).support(self.Sigma.H) - self.Sigma.h
        worst = int(np.argmax(excess / self.Sigma.sizes))
        return Excess(
            share=float(excess[worst] / self.Sigma.sizes[worst]),
            distance=float(excess[worst]),
            label=self.Sigma.labels[worst],
        )

    def held_conflicts(self, N: int, *, contained: bool = True) -> Mapping[int, str]:
        """Why an M of 1 ... N-1 is not offered, in words, by M.

        Parameters
        ----------
        N
            Horizon, at least 2.
        contained
            Whether (27) is asked for as printed: R_{M+N}^M inside Sigma. Otherwise only its consequence is, that no
            tightened set is empty, and longer holds are offered.
        """
        require_horizon(N)
        reasons: dict[int, str] = {}
        for M in range(1, N):
            excess = self.held_excess(M, N)
            if contained and excess.share > TOLERANCE:
                reasons[M] = f"(27) fails: R_{M + N}^{M} leaves Sigma through '{excess.label}' by {excess.distance:.6g}"
                continue
            sets = {f"X_z - R_{i}^{M}": self.held_stage_bounds(M, i) for i in range(M + N)}
            sets[f"Sigma - R_{M + N}^{M}"] = self.held_terminal_bounds(M, N)
            for name, bounds in sets.items():
                conflict = bounds.conflict()
                if conflict is not None:
                    reasons[M] = f"{name} is empty: {conflict}"
                    break
        return MappingProxyType(reasons)

    def _reach(self, feedback: bool, steps: int) -> Zonotope:
        """Reachable sets with and without feedback, each computed once for the longest horizon asked for."""
        stored: tuple[Zonotope, ...] = self._sets.get(feedback, ())
        if len(stored) <= steps:
            stored = reachable(self.A_cl if feedback else self.plant.A, self.W_z, max(steps, 32))
            self._sets[feedback] = stored
        return stored[steps]

    @cached_property
    def _sets(self) -> dict[bool, tuple[Zonotope, ...]]:
        return {}


def require_horizon(N: int) -> int:
    """N if it is a whole number of at least 2, else InvalidValue."""
    if isinstance(N, bool) or not isinstance(N, int | np.integer) or N < 2:
        raise InvalidValue(f"horizon N must be a whole number of at least 2, got {N}")
    return int(N)
