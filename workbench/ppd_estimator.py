"""The estimator of the pseudo partial derivative that the CFDL laws share, Jiao & Hou (2025), (12), (13), (15)."""

from __future__ import annotations

from typing import Any

import casadi as ca


def update(phi: Any, phi0: Any, du: Any, xi: Any, *, eta: Any, mu: Any, eps: Any) -> Any:
    """Return the next estimate, elementwise.

    phi (1, N) is the last estimate, phi0 its first value phi(k,1), du (1, N) the input difference of the last
    two trials and xi (1, N) the innovation dy(k+1) - phi du, or 0 where it is not known.
    """
    phi = phi + eta * du / (mu + du**2) * xi  # (12), (15)
    keep = ca.logic_and(ca.logic_and(ca.fabs(phi) > eps, ca.fabs(du) > eps), ca.sign(phi) == ca.sign(phi0))
    return ca.if_else(keep, phi, phi0)  # (13)
