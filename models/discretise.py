"""Named integrators that turn a right-hand side into a step.

Each takes ``rhs(x, t) -> dx/dt`` on CasADi columns (inputs held over the step) and returns the state one
sampling time later.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable


def euler(rhs: Callable[[Any, Any], Any], x: Any, t: Any, step: Any, substeps: int = 1) -> Any:
    """Explicit Euler with ``substeps`` equal steps."""
    h = step / substeps
    for index in range(substeps):
        x = x + h * rhs(x, t + index * h)
    return x


def rk4(rhs: Callable[[Any, Any], Any], x: Any, t: Any, step: Any, substeps: int = 1) -> Any:
    """Classical fourth-order Runge-Kutta with ``substeps`` equal steps."""
    h = step / substeps
    for index in range(substeps):
        at = t + index * h
        k1 = rhs(x, at)
        k2 = rhs(x + h / 2 * k1, at + h / 2)
        k3 = rhs(x + h / 2 * k2, at + h / 2)
        k4 = rhs(x + h * k3, at + h)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x


@runtime_checkable
class Integrated(Protocol):
    """A plant whose step integrates a right-hand side, which it can show: reports typeset this one."""

    integrator: str
    """The integrator in words, e.g. "fourth-order Runge-Kutta, one step a sample"."""

    def slope(self, x: Any, u: Any, w: Any, t: Any) -> Any:
        """Return dx/dt (in the order of the states) from state, input, disturbance and time in seconds."""
