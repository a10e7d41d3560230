"""Integrators: how a right-hand side becomes a step from one sample to the next.

Each is written out as expressions, so that what it gives is one graph with everything else: it can be differentiated,
compiled, bounded and typeset. CasADi's own integrators (``ca.integrator``) stand in a graph as one opaque call, of
which nothing but its value can be had; they are the oracle of these.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import TypeAlias

import casadi as ca

from models.expression import Expression, Number
from models.quantity import count, declared

Slope: TypeAlias = Callable[[Expression, Number], Expression]
"""dx/dt, a column, of a column x and the time in seconds; inputs are held over the step."""


class Integrator(ABC):
    """What turns dx/dt into the state one sampling time later."""

    @abstractmethod
    def advance(self, slope: Slope, x: Expression, t: Number, step: Number) -> Expression:
        """Return the column x at ``t + step`` from that at ``t``, both in seconds."""

    @property
    @abstractmethod
    def phrase(self) -> str:
        """What it is, in words for a report."""


def _method(name: str, substeps: int) -> str:
    number = ("no", "one", "two", "three", "four")[substeps] if substeps < 5 else f"{substeps}"
    return f"{name}, {number} step{'' if substeps == 1 else 's'} a sample"


@declared
class Euler(Integrator):
    """Explicit Euler with equal steps, of first order."""

    substeps: int = count(default=1, doc="steps a sample", least=1)

    def advance(self, slope: Slope, x: Expression, t: Number, step: Number) -> Expression:
        """Return the column x at ``t + step`` from that at ``t``."""
        h = step / self.substeps
        for index in range(self.substeps):
            x = x + h * slope(x, t + index * h)
        return x

    @property
    def phrase(self) -> str:
        """The method and its steps."""
        return _method("explicit Euler", self.substeps)


@declared
class RK4(Integrator):
    """Classical Runge-Kutta with equal steps, of fourth order."""

    substeps: int = count(default=1, doc="steps a sample", least=1)

    def advance(self, slope: Slope, x: Expression, t: Number, step: Number) -> Expression:
        """Return the column x at ``t + step`` from that at ``t``."""
        h = step / self.substeps
        for index in range(self.substeps):
            at = t + index * h
            k1 = slope(x, at)
            k2 = slope(x + h / 2 * k1, at + h / 2)
            k3 = slope(x + h / 2 * k2, at + h / 2)
            k4 = slope(x + h * k3, at + h)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return x

    @property
    def phrase(self) -> str:
        """The method and its steps."""
        return _method("fourth-order Runge-Kutta", self.substeps)


_ROOT3, _ROOT15 = 3**0.5, 15**0.5
_GAUSS = {
    1: (((1 / 2,),), (1.0,)),
    2: (((1 / 4, 1 / 4 - _ROOT3 / 6), (1 / 4 + _ROOT3 / 6, 1 / 4)), (1 / 2, 1 / 2)),
    3: (
        (
            (5 / 36, 2 / 9 - _ROOT15 / 15, 5 / 36 - _ROOT15 / 30),
            (5 / 36 + _ROOT15 / 24, 2 / 9, 5 / 36 - _ROOT15 / 24),
            (5 / 36 + _ROOT15 / 30, 2 / 9 + _ROOT15 / 15, 5 / 36),
        ),
        (5 / 18, 4 / 9, 5 / 18),
    ),
}
"""Matrix and weights of the Gauss-Legendre collocation methods by their number of points."""


@declared
class GaussLegendre(Integrator):
    """Collocation at the Gauss-Legendre points, for stiff plants: implicit, A-stable, of order 2 * points.

    The implicit equations are solved by a fixed number of Newton steps with exact Jacobians, from the slope at the
    beginning of the step on; one is enough where dx/dt is linear in x. Nothing tells at run time whether they have
    converged: compare with one Newton step more, or with more substeps.

    Source: E. Hairer and G. Wanner, Solving Ordinary Differential Equations II, 1996, section IV.5.
    """

    points: int = count(default=2, doc="collocation points a step", least=1, most=3)
    substeps: int = count(default=1, doc="steps a sample", least=1)
    newton: int = count(default=3, doc="Newton steps that solve the implicit equations", least=1)

    def advance(self, slope: Slope, x: Expression, t: Number, step: Number) -> Expression:
        """Return the column x at ``t + step`` from that at ``t``."""
        h = step / self.substeps
        for index in range(self.substeps):
            x = self._one(slope, x, t + index * h, h)
        return x

    def _one(self, slope: Slope, x: Expression, t: Number, h: Number) -> Expression:
        matrix, weights = _GAUSS[self.points]
        unit, none = ca.DM.eye(x.numel()), ca.DM(x.numel(), x.numel())
        instants = [t + sum(row) * h for row in matrix]
        slopes = [slope(x, t)] * self.points
        for _ in range(self.newton):
            at = [x + h * _summed(row, slopes) for row in matrix]
            found = [_with_jacobian(slope, here, now) for here, now in zip(at, instants, strict=True)]
            left = ca.vertcat(*(one - value for one, (value, _) in zip(slopes, found, strict=True)))
            rows = [
                [(unit if i == j else none) - h * share * jacobian for j, share in enumerate(row)]
                for i, (row, (_, jacobian)) in enumerate(zip(matrix, found, strict=True))
            ]
            change = ca.solve(ca.vertcat(*(ca.horzcat(*row) for row in rows)), left)
            slopes = [one - part for one, part in zip(slopes, ca.vertsplit(change, x.numel()), strict=True)]
        return x + h * _summed(weights, slopes)

    @property
    def phrase(self) -> str:
        """The method, its points, steps and Newton steps."""
        return _method(
            f"Gauss-Legendre collocation of order {2 * self.points} solved by {self.newton} Newton step(s)",
            self.substeps,
        )


def _summed(shares: tuple[float, ...], slopes: list[Expression]) -> Expression:
    total = shares[0] * slopes[0]
    for share, slope in zip(shares[1:], slopes[1:], strict=True):
        total = total + share * slope
    return total


def _with_jacobian(slope: Slope, x: Expression, t: Number) -> tuple[Expression, Expression]:
    """Return dx/dt and its exact derivative by x, of the kind (SX, MX or DM) that dx/dt has."""
    value = slope(x, t)
    kind = ca.MX if isinstance(value, ca.MX) else ca.SX
    z = kind.sym("z", x.numel())
    jacobian = ca.substitute(ca.jacobian(slope(z, t), z), z, kind(x))
    return value, ca.evalf(jacobian) if isinstance(value, ca.DM) else jacobian
