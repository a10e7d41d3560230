"""What the CFDL laws share: the parameters of Table 1 and the estimator of the pseudo partial derivative.

Jiao & Hou (2025), (12), (13), (15).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Generic, Self, TypeVar

import casadi as ca

from models.expression import Expression, Number
from models.quantity import InvalidValue, declared, quantity, rebuilt
from workbench.contracts.law import Estimator, Law, LearningGain, Task
from workbench.controllers.parts.scales import scales

ROUNDED = 2.0**-48
"""More than what the few operations of a gain round, as a share of it."""
M = TypeVar("M", bound=tuple[object, ...])
T = TypeVar("T")


@declared
class Parameters(Law[M, tuple[()]], Generic[M]):
    """The parameters of a CFDL law, in units of the law's own ``force_unit`` (lam, mu and eps are absolute)."""

    eta: float = quantity(default=1.0, unit="1", doc="step of the estimator", above=0, most=1)
    rho: float = quantity(default=0.245, unit="1", doc="step of the input", above=0, most=1)
    lam: float = quantity(default=5e-5, unit="(output/force unit)^2", doc="weight on input changes", above=0)
    mu: float = quantity(default=0.1, unit="(force unit)^2", doc="weight on estimate changes", above=0)
    eps: float = quantity(default=1e-5, unit="force unit", doc="reset threshold of estimate and input change", above=0)
    phi0: float | None = quantity(
        default=None, unit="output/force unit", doc="phi(k,1); null takes sqrt(lam)", optional=True
    )
    initial_input: float = quantity(
        default=1500.0, unit="N", doc="input of the first trial, where the task gives no first plan"
    )
    force_unit: float = quantity(default=100.0, unit="N", doc="the unit that the law computes forces in", above=0)

    @property
    def estimator(self) -> Estimator:
        """Its own parameters."""
        return self

    def check(self) -> None:
        """Raise InvalidValue where phi0 is zero: its sign is the assumed control direction."""
        if isinstance(self.phi0, float) and self.phi0 == 0:
            raise InvalidValue("phi0 must not be 0 (its sign is the control direction), got 0.0")

    def first_estimate(self) -> float:
        """Return phi(k,1): phi0, or sqrt(lam), where the gain is largest."""
        return ca.sqrt(self.lam) if self.phi0 is None else self.phi0

    @property
    def learning_gain(self) -> LearningGain | None:
        """Ends of rho phi/(lam + phi^2), in the plant's inputs per output, for the estimates that may come.

        A negative first estimate turns the sign of l; the estimate keeps the sign, by the reset (13).
        """
        least, most = self.estimates()
        sign, sizes = (1.0, (least, most)) if most > 0 else (-1.0, (-most, -least))
        return _gains(self.rho, self.lam, *sizes, sign * self.force_unit)

    def estimates(self) -> tuple[float, float]:
        """Return the ends of what phi may become, infinite where nothing bounds it; it has the sign of phi(k,1)."""
        first = self.first_estimate()
        return (min(self.eps, first), math.inf) if first > 0 else (-math.inf, max(-self.eps, first))

    def update(self, phi: Expression, du: Expression, xi: Expression) -> Expression:
        """Return the next estimate, elementwise.

        phi (1, N) is the last estimate, du (1, N) the input difference of the last two trials and xi (1, N) the
        innovation dy(k+1) - phi du, or 0 where it is not known.
        """
        first: Number = self.first_estimate()
        phi = phi + self.eta * du / (self.mu + du**2) * xi  # (12), (15)
        excited = ca.logic_and(ca.fabs(phi) > self.eps, ca.fabs(du) > self.eps)
        keep = ca.logic_and(excited, ca.sign(phi) == ca.sign(first))
        return ca.if_else(keep, phi, first)  # (13)

    def ranges(self, task: Task) -> Mapping[str, tuple[float, float]]:
        """Return rho, lam and mu to tune: lam about the square of the plant's slope, in the law's unit."""
        scale = scales(task)
        slope, unit = self.force_unit / abs(scale.step), abs(scale.rate) / self.force_unit
        return {
            "rho": (0.01, 1.0),
            "lam": (0.01 * slope**2, 1e4 * slope**2),
            "mu": (1e-4 * unit**2, 10.0 * unit**2),
        }

    def scaled_for(self, task: Task) -> Self:
        """Return the law in the plant's own scale, see :func:`scaled`."""
        return scaled(self, task)


def _gains(rho: float, lam: float, least: float, most: float, unit: float) -> LearningGain:
    """Return the ends of unit rho phi/(lam + phi^2) for 0 < least <= phi <= most, rounded outwards.

    It rises up to phi = sqrt(lam) and falls from there on.
    """

    def gain(phi: float) -> float:
        return rho * phi / (lam + phi * phi) if math.isfinite(phi) else 0.0

    inside = least * least <= lam <= most * most
    low, high = min(gain(least), gain(most)), rho / (2 * math.sqrt(lam)) if inside else max(gain(least), gain(most))
    low, high = low * abs(unit) * (1 - ROUNDED), high * abs(unit) * (1 + ROUNDED)
    return LearningGain(low, high) if unit > 0 else LearningGain(-high, -low)


def scaled(law: T, task: Task) -> T:
    """Return a law with an estimate in the unit of input that changes the output by one unit a second.

    It has no first input, and its first estimate has the sign of the plant's slope.
    """
    scale = scales(task)
    unit = abs(scale.rate)
    slope = unit / scale.step
    first = None if slope > 0 else slope
    return rebuilt(law, {"force_unit": unit, "lam": slope**2, "phi0": first, "initial_input": 0.0})
