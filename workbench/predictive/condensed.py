"""Finite-horizon problems of a linear plant, condensed to the inputs and built once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.quantity import InvalidValue
from workbench.predictive.quadratic_program import FEASIBILITY_TOLERANCE, Infeasible, WarmQP, sensitivity
from workbench.predictive.tube import Tube
from workbench.sets import Polytope
from workbench.sets.array import Array, checked
from workbench.sets.balance import state_units
from workbench.sets.linear_program import SolverFailed, minimise

IMMOVABLE = 1e-12
"""A row moves with the inputs if the cost that moves the most sensitive row by its size moves this one by such a share
of its own; the others are checked and not handed to the solver."""


class Plan(NamedTuple):
    """What a finite-horizon problem answers.

    `du` has shape (T,), `e` the planned errors, shape (T+1, n) without disturbance, J the cost.
    """

    du: Array
    e: Array
    J: float
    residual: float

    def advanced(self, K: Array, A_cl: Array) -> Plan:
        """The plan from its second sample on, continued at its end by the feedback it assumes there."""
        last = self.e[-1]
        return Plan(
            du=np.r_[self.du[1:], float(K @ last)], e=np.vstack([self.e[1:], A_cl @ last]), J=self.J, residual=np.nan
        )


class Edge(NamedTuple):
    """Where a line leaves the set of errors from which a problem is feasible.

    `distance` is the largest feasible t of origin + t * direction (-inf if there is none, inf if there is no end);
    `normal`, shape (n,), points out of the set there and is NaN unless the distance is finite.
    """

    distance: float
    normal: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class CondensedQP:
    """min over du of the sum of e_i'Q_i e_i + R_i du_i^2 plus e_T'P e_T, with e_i in given sets.

    The planned errors are e_i = Phi_i e_0 + Gamma_i U, U the increments that are free; see `condense`.
    The cost may start from another error than the bounds do: an estimate of the disturbance then shapes the plan and
    leaves the guarantees of the bounds alone.
    """

    Phi: Array
    """Shape (T+1, n, n)."""
    Gamma: Array
    """Shape (T+1, n, p)."""
    free: tuple[int, ...]
    """The samples whose increment is free, p of them; at the others it is zero."""
    hessian: Array
    """Shape (p, p)."""
    gradient: Array
    """Shape (p, n): the linear term is gradient @ e_0."""
    constant: Array
    """Shape (n, n): what the cost has besides."""
    G: Array
    """Rows that the inputs move, shape (m, p): G U <= g - S e_0."""
    g: Array
    """Shape (m,)."""
    S: Array
    """Shape (m, n)."""
    sizes: Array
    """What tolerances of the rows are shares of, shape (m,): the widths of the sets that they are from."""
    fixed: Polytope
    """The rows that no input moves, as a set of e_0."""
    labels: tuple[str, ...]
    """What each row of G says."""

    @property
    def steps(self) -> int:
        """T, the samples planned for."""
        return len(self.Phi) - 1

    def solve(self, e: ArrayLike, *, cost_error: ArrayLike | None = None) -> Plan | Infeasible:
        """The plan from the error e, shape (n,), or why there is none.

        Parameters
        ----------
        e
            Where the bounds see the plant.
        cost_error
            Where the cost sees it, shape (n,); e if not given. The planned errors returned are those of the bounds.
        """
        e = self._error("e", e)
        start = e if cost_error is None else self._error("cost_error", cost_error)
        inputs, moving, last = len(self.free), len(self.g), len(self.g) + len(self.fixed.h)
        image = self._maps.dot(e)  # one product for everything linear in e: this runs as often as the solver
        room = image[:last] + self._offsets
        if last > moving and np.minimum.reduce(room[moving:]) < -FEASIBILITY_TOLERANCE:
            worst = int(np.argmin(room[moving:]))
            missing = -float(room[moving + worst] * self.fixed.sizes[worst])
            reason = f"'{self.fixed.labels[worst]}' misses by {missing:.6g} and no input can change it"
            return Infeasible(reason=reason, shortfall=missing)
        pull = self._costs.dot(start)
        f = pull[:inputs]
        answer = self.program.solve(f, room[:moving])
        if isinstance(answer, Infeasible):
            return answer
        u = answer.u
        du = np.zeros(self.steps)
        du[self._free] = u
        planned = (image[last:] + self._gamma.dot(u)).reshape(self.steps + 1, -1)
        J = float(u.dot(0.5 * self.hessian.dot(u) + f) + start.dot(pull[inputs:]))
        return Plan(du=du, e=planned, J=J, residual=answer.residual)

    def _error(self, name: str, value: ArrayLike) -> Array:
        error = np.asarray(value, dtype=np.float64)
        if error.shape != (self.Phi.shape[1],) or not math.isfinite(error.dot(error)):
            return checked(name, value, (self.Phi.shape[1],))  # says what is wrong
        return error

    @cached_property
    def _maps(self) -> Array:
        shares = self.fixed.H / self.fixed.sizes[:, None]
        maps: Array = np.vstack([-self.S, -shares, self.Phi.reshape(-1, self.Phi.shape[2])])
        return maps

    @cached_property
    def _offsets(self) -> Array:
        return np.concatenate([self.g, self.fixed.h / self.fixed.sizes])

    @cached_property
    def _costs(self) -> Array:
        return np.vstack([self.gradient, self.constant])

    @cached_property
    def _gamma(self) -> Array:
        return np.ascontiguousarray(self.Gamma.reshape(-1, len(self.free)))

    @cached_property
    def _free(self) -> NDArray[np.intp]:
        return np.array(self.free, dtype=np.intp)

    @cached_property
    def program(self) -> WarmQP:
        """The solver, set up at first use; it remembers its last active set and nothing else."""
        return WarmQP(self.hessian, self.G, self.labels, sizes=self.sizes)

    def inside(self) -> Array:
        """An error, shape (n,), from which the problem is feasible with as much room in every row as can be had.

        Room is a share of the size of the set that the row is from, so that units do not matter.

        Raises
        ------
        InvalidValue
            If the problem is feasible from nowhere.
        """
        inputs, n = len(self.free), self.Phi.shape[1]
        joint = np.block([[self.G, self.S], [np.zeros((len(self.fixed.h), inputs)), self.fixed.H]])
        rows = Polytope(
            H=joint,
            h=np.r_[self.g, self.fixed.h],
            labels=self.labels + self.fixed.labels,
            scale=np.r_[self.sizes, self.fixed.sizes],
        )
        conflict = rows.conflict()
        if conflict is not None:
            raise InvalidValue(f"the problem is feasible from nowhere: {conflict}; make the disturbance smaller")
        return rows.deepest()[0][-n:]

    def edge(self, origin: ArrayLike, direction: ArrayLike) -> Edge:
        """How far the problem stays feasible from `origin` along `direction`, both of shape (n,), by one LP.

        Raises
        ------
        SolverFailed
            If the linear program has no answer that can be believed.
        """
        n = self.Phi.shape[1]
        origin, direction = checked("origin", origin, (n,)), checked("direction", direction, (n,))
        inputs = len(self.free)
        states = np.vstack([self.S, self.fixed.H])
        moves = np.vstack([self.G, np.zeros((len(self.fixed.h), inputs))])
        rows = np.hstack([moves, (states @ direction)[:, None]])
        room = np.r_[self.g, self.fixed.h] - states @ origin
        answer = minimise(np.r_[np.zeros(inputs), -1.0], rows, room)
        if answer.status == "failed":
            raise SolverFailed(f"how far a problem of {len(room)} rows stays feasible could not be found")
        return Edge(distance=-answer.value, normal=answer.prices @ states)

    def spread(self, origin: ArrayLike) -> Array:
        """How far from `origin`, shape (n,), the problem stays feasible along each state, the farther of both ways.

        Directions of this size, shape (n,), look at every state alike, whatever its unit. A state without end gets
        what the others have, in units in which the plant's entries are near one.
        """
        n = self.Phi.shape[1]
        reach = np.array([max(self.edge(origin, sign * unit).distance for sign in (1, -1)) for unit in np.eye(n)])
        ended = np.isfinite(reach) & (reach > 0)
        units = state_units(self.Phi[1])
        reach[~ended] = (units * (reach[ended] / units[ended]).max(initial=0.0))[~ended]
        return np.where(reach > 0, reach, units)


def condense(
    *,
    A: ArrayLike,
    b: ArrayLike,
    state_weights: Sequence[Array],
    input_weights: Sequence[float],
    P: Array,
    bounds: Sequence[Polytope],
    free: Sequence[int] | None = None,
) -> CondensedQP:
    """Eliminate the states of e_{i+1} = A e_i + b du_i from a horizon of T samples.

    Parameters
    ----------
    A, b
        Shapes (n, n) and (n,).
    state_weights, input_weights
        Q_i, shape (n, n), and R_i for i = 0 ... T-1.
    P
        Weight of e_T, shape (n, n).
    bounds
        Where e_0 ... e_T must lie: T + 1 sets.
    free
        The samples whose increment is a variable; all T of them if not given. The others keep du_i = 0.
    """
    b = checked("b", b, (None,))
    A = checked("A", A, (b.size, b.size))
    T = len(state_weights)
    if len(input_weights) != T or len(bounds) != T + 1:
        raise InvalidValue(
            f"a horizon of {T} samples needs {T} input weights and {T + 1} sets, "
            f"got {len(input_weights)} and {len(bounds)}"
        )
    samples = tuple(range(T)) if free is None else tuple(free)
    Phi = np.stack([np.linalg.matrix_power(A, i) for i in range(T + 1)])
    Gamma = np.zeros((T + 1, b.size, len(samples)))
    for column, j in enumerate(samples):
        for i in range(j + 1, T + 1):
            Gamma[i, :, column] = Phi[i - 1 - j] @ b
    weights = np.stack([*state_weights, P])
    R = np.diag([input_weights[j] for j in samples])
    rows = [bound.H @ Gamma[i] for i, bound in enumerate(bounds)]
    states = [bound.H @ Phi[i] for i, bound in enumerate(bounds)]
    labels = [f"{label} at i = {i}" for i, bound in enumerate(bounds) for label in bound.labels]
    G, S, g = np.vstack(rows), np.vstack(states), np.concatenate([bound.h for bound in bounds])
    sizes = np.concatenate([bound.sizes for bound in bounds])
    hessian = 2 * (np.einsum("iap,iab,ibq->pq", Gamma, weights, Gamma) + R)
    hessian = (hessian + hessian.T) / 2
    moved = sensitivity(hessian, G) / sizes
    moves = moved > IMMOVABLE * moved.max(initial=0.0)
    names = np.array(labels, dtype=object)
    return CondensedQP(
        Phi=Phi,
        Gamma=Gamma,
        free=samples,
        hessian=hessian,
        gradient=2 * np.einsum("iap,iab,ibn->pn", Gamma, weights, Phi),
        constant=np.einsum("iam,iab,ibn->mn", Phi, weights, Phi),
        G=G[moves],
        g=g[moves],
        S=S[moves],
        sizes=sizes[moves],
        fixed=Polytope(H=S[~moves], h=g[~moves], labels=tuple(names[~moves]), scale=sizes[~moves]),
        labels=tuple(names[moves]),
    )


def tube_problem(tube: Tube, N: int) -> CondensedQP:
    """Return the problem (11) of tube MPC over N samples under the tightened bounds (14), condensed."""
    return condense(
        A=tube.plant.A,
        b=tube.plant.b,
        state_weights=[tube.Q] * N,
        input_weights=[tube.R] * N,
        P=tube.P,
        bounds=[*(tube.stage_bounds(i) for i in range(N)), tube.terminal_bounds(N)],
    )
