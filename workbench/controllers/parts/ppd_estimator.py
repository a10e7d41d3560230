"""What the CFDL laws share: the parameters of Table 1 and the estimator of the pseudo partial derivative.

Jiao & Hou (2025), (12), (13), (15).
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from models.quantity import InvalidValue, declared, quantity
from workbench.contracts.law import Estimator, Law


@declared
class Parameters(Law):
    """The parameters of a CFDL law, in units of the law's own ``force_unit`` (lam, mu and eps are absolute)."""

    eta: float = quantity(default=1.0, unit="1", doc="step of the estimator", above=0, most=1)
    rho: float = quantity(default=0.245, unit="1", doc="step of the input", above=0, most=1)
    lam: float = quantity(default=5e-5, unit="(output/force unit)^2", doc="weight on input changes", above=0)
    mu: float = quantity(default=0.1, unit="(force unit)^2", doc="weight on estimate changes", above=0)
    eps: float = quantity(default=1e-5, unit="force unit", doc="reset threshold of estimate and input change", above=0)
    phi0: float | None = quantity(
        default=None, unit="output/force unit", doc="phi(k,1); null takes sqrt(lam)", optional=True
    )
    initial_input: float = quantity(default=1500.0, unit="N", doc="input of the first trial")
    force_unit: float = quantity(default=100.0, unit="N", doc="the unit that the law computes forces in", above=0)

    @property
    def estimator(self) -> Estimator:
        """Its own parameters."""
        return self

    def check(self) -> None:
        """Raise InvalidValue where phi0 is zero: its sign is the assumed control direction."""
        if isinstance(self.phi0, float) and self.phi0 == 0:
            raise InvalidValue("phi0 must not be 0 (its sign is the control direction), got 0.0")

    def first_estimate(self) -> Any:
        """Return phi(k,1): phi0, or sqrt(lam), where the gain is largest."""
        return ca.sqrt(self.lam) if self.phi0 is None else self.phi0

    def update(self, phi: Any, du: Any, xi: Any) -> Any:
        """Return the next estimate, elementwise.

        phi (1, N) is the last estimate, du (1, N) the input difference of the last two trials and xi (1, N) the
        innovation dy(k+1) - phi du, or 0 where it is not known.
        """
        first = self.first_estimate()
        phi = phi + self.eta * du / (self.mu + du**2) * xi  # (12), (15)
        excited = ca.logic_and(ca.fabs(phi) > self.eps, ca.fabs(du) > self.eps)
        keep = ca.logic_and(excited, ca.sign(phi) == ca.sign(first))
        return ca.if_else(keep, phi, first)  # (13)
