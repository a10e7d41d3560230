"""Small dense quadratic programs that are set up once and solved often, each answer checked."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import daqp
import numpy as np

from models.quantity import InvalidValue
from workbench.sets.array import Array
from workbench.sets.linear_program import minimise

KKT_TOLERANCE = 1e-11
"""Largest residual of the optimality conditions that counts as solved, relative to the size of the gradient.

DAQP reaches 1e-15. Next to the edge of feasibility the last moves of a plan answer to a residual with 1e5 times its
size, so that a looser limit would not vouch for 1e-6 in the input.
"""

FEASIBILITY_TOLERANCE = 1e-8
"""By how much constraints may miss each other before a problem is called infeasible, in the units of the rows."""

SOLVER_SETTINGS = {"primal_tol": 1e-10, "dual_tol": 1e-12, "iter_limit": 10_000}


class Solved(NamedTuple):
    """A minimiser u, shape (p,), its multipliers, shape (m,), and the residual of the optimality conditions."""

    u: Array
    multipliers: Array
    residual: float


class Infeasible(NamedTuple):
    """Why there is no answer, in words, and by how much the constraints miss each other (NaN if they do not)."""

    reason: str
    shortfall: float


def kkt_residual(H: Array, f: Array, G: Array, g: Array, u: Array, multipliers: Array) -> float:
    """The worst of stationarity, feasibility, sign and complementarity for min u'H u / 2 + f'u, G u <= g.

    Stationarity and complementarity are relative to the size of the terms that cancel, feasibility is absolute.
    Written with dot products: it runs after every solve and must not cost more than the solve.
    """
    return _residual(H.dot(u), f, G, g - G.dot(u), multipliers)


def _residual(curve: Array, f: Array, G: Array, slack: Array, multipliers: Array) -> float:
    gradient = curve + f
    scale = 1.0 + math.sqrt(max(f.dot(f), curve.dot(curve)))
    sign = product = broken = 0.0
    active = multipliers.nonzero()[0]
    if active.size:  # most problems have none or a few: the others have no part in what follows
        prices = multipliers[active]
        gradient += prices.dot(G[active])
        sign, product = -float(prices[prices.argmin()]), float(prices.dot(np.abs(slack[active])))
    if slack.size:
        broken = -float(slack[slack.argmin()])  # argmin and an index take half the time of a minimum
    stationary = math.sqrt(gradient.dot(gradient)) / scale
    # max() may pass over what is not a number
    return max(stationary, broken, sign / scale, product / scale) if stationary + broken < math.inf else math.inf


class WarmQP:
    """min u'H u / 2 + f'u subject to G u <= g, with H and G fixed: f and g change from one solve to the next.

    DAQP keeps the last active set and starts from it. Its answer is believed only if the optimality conditions,
    computed here, hold; otherwise the problem is solved again from nothing. "Infeasible" is believed only if a linear
    program confirms it. Answers therefore depend on the calls before by rounding alone. Tolerances are absolute: choose
    units in which the entries of H are not far from one.

    Parameters
    ----------
    H
        Shape (p, p), positive definite.
    G
        Shape (m, p).
    labels
        What each row of G says, for reasons.

    Raises
    ------
    InvalidValue
        If H is not positive definite.
    """

    def __init__(self, H: Array, G: Array, labels: tuple[str, ...]) -> None:
        least = float(np.linalg.eigvalsh(H)[0])
        if least <= 0:
            raise InvalidValue(f"H must be positive definite, got the eigenvalue {least:.6g}; give R a positive weight")
        self.H = np.ascontiguousarray(H, dtype=np.float64)
        self.G = np.ascontiguousarray(G, dtype=np.float64)
        self.labels = labels
        self._both = np.vstack([self.H, self.G])
        self._below = np.full(len(G), -1e30)
        self._model: Any = None

    def solve(self, f: Array, g: Array) -> Solved | Infeasible:
        """The minimiser for this f, shape (p,), and g, shape (m,), or why there is none."""
        if not len(self.G):
            u = np.asarray(np.linalg.solve(self.H, -f), dtype=np.float64)
            return Solved(u=u, multipliers=np.zeros(0), residual=kkt_residual(self.H, f, self.G, g, u, np.zeros(0)))
        if self._model is None:
            answer = self._cold(f, g)
        else:
            self._model.update(f=f, bupper=g)
            answer = self._check(f, g)
            if answer is None:
                answer = self._cold(f, g)
        return self._doubted(f, g) if answer is None else answer

    def _cold(self, f: Array, g: Array) -> Solved | None:
        self._model = daqp.Model()
        self._model.settings = SOLVER_SETTINGS
        self._model.setup(self.H, f, self.G, g, self._below, np.zeros(len(g), dtype=np.int32))
        answer = self._check(f, g)
        if answer is None:
            self._model = None  # no active set worth starting from
        return answer

    def _check(self, f: Array, g: Array) -> Solved | None:
        u, _, flag, info = self._model.solve()
        if flag != 1:
            return None
        multipliers, image = info["lam"], self._both.dot(u)
        residual = _residual(image[: len(f)], f, self.G, g - image[len(f) :], multipliers)
        return Solved(u=u, multipliers=multipliers, residual=residual) if residual <= KKT_TOLERANCE else None

    def _doubted(self, f: Array, g: Array) -> Solved | Infeasible:
        """Ask a linear program whether the rows can hold at all; if they just do, solve with that much slack."""
        cost, rows = np.r_[np.zeros(len(f)), 1.0], np.hstack([self.G, -np.ones((len(g), 1))])
        answer = minimise(cost, rows, g)  # the least t with G u <= g + t
        if answer.status == "optimal" and answer.value > FEASIBILITY_TOLERANCE:
            weightiest = np.argsort(-answer.prices, kind="stable")[:2]
            names = [f"'{self.labels[row]}'" for row in weightiest if answer.prices[row] > 0]
            return Infeasible(reason=f"{' against '.join(names)} misses by {answer.value:.6g}", shortfall=answer.value)
        relaxed = self._cold(f, g + FEASIBILITY_TOLERANCE)
        self._model = None
        if relaxed is not None:
            return relaxed
        return Infeasible(reason="the solver's answer fails the optimality conditions", shortfall=np.nan)
