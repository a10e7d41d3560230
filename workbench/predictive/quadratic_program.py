"""Small dense quadratic programs that are set up once and solved often, each answer checked."""

from __future__ import annotations

import math
from typing import NamedTuple

import daqp
import numpy as np

from models.quantity import InvalidValue
from workbench.sets.array import Array
from workbench.sets.balance import powers_of_two
from workbench.sets.linear_program import minimise

KKT_TOLERANCE = 1e-11
"""Largest residual of the optimality conditions of the scaled problem that counts as solved; see `kkt_residual`.

DAQP reaches 1e-15. Next to the edge of feasibility the last moves of a plan answer to a residual with 1e5 times its
size, so that a looser limit would not vouch for 1e-6 in the input.
"""

FEASIBILITY_TOLERANCE = 1e-8
"""By how much constraints may miss each other before a problem is called infeasible, a share of the rows' sizes."""

SOLVER_SETTINGS = {"primal_tol": 1e-10, "dual_tol": 1e-12, "iter_limit": 10_000}
"""Tolerances of DAQP on the scaled problem."""


class Solved(NamedTuple):
    """A minimiser u, shape (p,), its multipliers, shape (m,), and the residual of the optimality conditions."""

    u: Array
    residual: float
    scaled_multipliers: Array
    """Those of the scaled problem."""
    prices: Array
    """What one of each is worth in the problem as it was told, shape (m,)."""

    @property
    def multipliers(self) -> Array:
        """The multipliers of the rows, shape (m,): seldom asked for, so not computed with every answer."""
        return self.prices * self.scaled_multipliers


class Infeasible(NamedTuple):
    """Why there is no answer, in words, and by how much the row named first is missed (NaN if none is)."""

    reason: str
    shortfall: float


def kkt_residual(H: Array, f: Array, G: Array, g: Array, u: Array, multipliers: Array) -> float:
    """The worst of stationarity, feasibility, sign and complementarity for min u'H u / 2 + f'u, G u <= g.

    Stationarity, sign and complementarity are relative to the size of the terms that cancel, but at least to 1, and
    feasibility is relative to 1: what that means depends on the units of the problem. `WarmQP` asks for the residual
    of a problem scaled so that 1 is the size of a row, and of the gradient that takes a plan from bound to bound.
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


def sensitivity(H: Array, G: Array) -> Array:
    """How far each row of G u moves, shape (m,), for the u of cost u'H u = 1 that moves it most.

    Raises
    ------
    InvalidValue
        If H is not positive definite.
    """
    units = 1 / np.sqrt(np.abs(np.diag(H)) + (np.diag(H) == 0))
    least = float(np.linalg.eigvalsh(H * np.outer(units, units))[0])
    if least <= len(H) * np.finfo(float).eps:
        least = float(np.linalg.eigvalsh(H)[0])
        raise InvalidValue(f"H must be positive definite, got the eigenvalue {least:.6g}; give R a positive weight")
    root = np.linalg.cholesky(H * np.outer(units, units))
    moved: Array = np.linalg.norm(np.linalg.solve(root, (G * units).T), axis=0)
    return moved


class WarmQP:
    """min u'H u / 2 + f'u subject to G u <= g, with H and G fixed: f and g change from one solve to the next.

    DAQP keeps the last active set and starts from it. Its answer is believed only if the optimality conditions,
    computed here, hold; otherwise the problem is solved again from nothing. "Infeasible" is believed only if a linear
    program confirms it. Answers therefore depend on the calls before by rounding alone.

    The units of u, of the rows and of the cost do not matter: the problem is scaled by powers of two, such that H has
    ones on its diagonal, rows have the size of one, and a cost of one moves the row that moves most by its size.
    All tolerances are those of the scaled problem.

    Parameters
    ----------
    H
        Shape (p, p), positive definite.
    G
        Shape (m, p).
    labels
        What each row of G says, for reasons.
    sizes
        What the rows' tolerances are shares of, shape (m,), positive: how far apart bounds of that kind lie, see
        `workbench.sets.Polytope.sizes`.

    Raises
    ------
    InvalidValue
        If H is not positive definite.
    """

    def __init__(self, H: Array, G: Array, labels: tuple[str, ...], *, sizes: Array) -> None:
        moved = float((sensitivity(H, G) / sizes).max(initial=0.0))
        self._gain = float(powers_of_two(np.log2([moved]))[0]) if moved > 0 else 1.0
        self._inputs = powers_of_two(-0.5 * np.log2(np.diag(H))) / self._gain
        self._rows = powers_of_two(-np.log2(sizes))
        self.labels = labels
        self.sizes = sizes
        self.H, self.G = H, G
        self._H = np.ascontiguousarray(self._gain**2 * self._inputs[:, None] * H * self._inputs)
        self._G = np.ascontiguousarray(self._rows[:, None] * G * self._inputs)
        self._forces, self._prices = self._gain**2 * self._inputs, self._rows / self._gain**2
        self._slack = FEASIBILITY_TOLERANCE * self._rows * sizes
        self._both = np.vstack([self._H, self._G])
        self._below = np.full(len(G), -1e30)
        self._model: daqp.Model | None = None

    @property
    def cost_size(self) -> float:
        """The cost that a plan may have just by moving the row that moves most by its size: what is large in J."""
        return 1 / self._gain**2

    def solve(self, f: Array, g: Array) -> Solved | Infeasible:
        """The minimiser for this f, shape (p,), and g, shape (m,), or why there is none."""
        f, g = self._forces * f, self._rows * g
        if not len(self._G):
            u = np.asarray(np.linalg.solve(self._H, -f), dtype=np.float64)
            residual = kkt_residual(self._H, f, self._G, g, u, np.zeros(0))
            return Solved(self._inputs * u, residual, np.zeros(0), self._prices)
        if self._model is None:
            answer = self._cold(f, g)
        else:
            self._model.update(f=f, bupper=g)
            answer = self._check(self._model, f, g)
            if answer is None:
                answer = self._cold(f, g)
        return self._doubted(f, g) if answer is None else answer

    def _cold(self, f: Array, g: Array) -> Solved | None:
        model = daqp.Model()
        model.settings = SOLVER_SETTINGS
        model.setup(self._H, f, self._G, g, self._below, np.zeros(len(g), dtype=np.int32))
        answer = self._check(model, f, g)
        self._model = None if answer is None else model  # without one there is no active set worth starting from
        return answer

    def _check(self, model: daqp.Model, f: Array, g: Array) -> Solved | None:
        u, _, flag, info = model.solve()
        if flag != 1:
            return None
        multipliers, image = info["lam"], self._both.dot(u)
        residual = _residual(image[: len(f)], f, self._G, g - image[len(f) :], multipliers)
        if residual > KKT_TOLERANCE:
            return None
        return Solved(self._inputs * u, residual, multipliers, self._prices)

    def _doubted(self, f: Array, g: Array) -> Solved | Infeasible:
        """Ask a linear program whether the rows can hold at all; if they just do, solve with that much slack."""
        cost, rows = np.r_[np.zeros(len(f)), 1.0], np.hstack([self._G, -(self._rows * self.sizes)[:, None]])
        answer = minimise(cost, rows, g)  # the least t with G u <= g + t sizes
        if answer.status == "optimal" and answer.value > FEASIBILITY_TOLERANCE:
            shares = answer.prices * self._rows * self.sizes
            weightiest = np.argsort(-shares, kind="stable")[:2]
            names = [f"'{self.labels[row]}'" for row in weightiest if shares[row] > 0]
            missing = float(answer.value * self.sizes[weightiest[0]])
            return Infeasible(reason=f"{' against '.join(names)} misses by {missing:.6g}", shortfall=missing)
        relaxed = self._cold(f, g + self._slack)
        self._model = None
        if relaxed is not None:
            return relaxed
        if answer.status != "optimal":
            reason = "neither the solver's answer nor a linear program's can be believed"
            return Infeasible(reason=reason, shortfall=np.nan)
        return Infeasible(reason="the solver's answer fails the optimality conditions", shortfall=np.nan)
