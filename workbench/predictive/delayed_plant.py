"""A linear plant with an input delay and bounded disturbances, as the tube controllers see it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from models.quantity import InvalidValue
from workbench.predictive.regulator import require_stabilizable
from workbench.sets import Zonotope, reachable
from workbench.sets.array import Array, checked


@dataclass(frozen=True, kw_only=True, eq=False)
class DelayedPlant:
    """x(k+1) = A x(k) + b du(k-l) + w(k), with w(k) in W; du is the increment of the input.

    Parameters
    ----------
    A, b
        Shapes (n, n) and (n,). Eigenvalues on or outside the unit circle are allowed if the input reaches them.
    W
        The disturbances, in the units of x a sample; a segment will do.
    delay
        l, in whole samples, at least 0.
    names
        What each state is called in errors; numbered when left empty.

    Raises
    ------
    InvalidValue
        If shapes do not fit, an entry is not finite, the delay is not a whole number of samples, or the plant is
        not stabilisable.

    Source: doi 10.16383/j.aas.c200039, (9). The delayed input in the state is u(k-l-1); the printed
    u(k-l) contradicts the printed b.
    """

    A: Array
    b: Array
    W: Zonotope
    delay: int = 0
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        b = checked("b", self.b, (None,))
        A = checked("A", self.A, (b.size, b.size))
        object.__setattr__(self, "A", A)
        object.__setattr__(self, "b", b)
        if self.W.dimension != b.size:
            raise InvalidValue(f"W must lie in the space of the {b.size} states, got dimension {self.W.dimension}")
        if isinstance(self.delay, bool) or not isinstance(self.delay, int | np.integer) or self.delay < 0:
            raise InvalidValue(f"delay must be a whole number of samples, at least 0, got {self.delay}")
        names = tuple(self.names) or tuple(f"x{i}" for i in range(b.size))
        if len(names) != b.size:
            raise InvalidValue(f"names must name each of the {b.size} states, got {len(names)}")
        object.__setattr__(self, "names", names)
        require_stabilizable(A, b)

    @property
    def order(self) -> int:
        """Number n of states."""
        return self.b.size

    @cached_property
    def A_delay(self) -> Array:
        """A^l, shape (n, n): how a state or a disturbance of now shows once the input of now acts."""
        return checked("A^l", np.linalg.matrix_power(self.A, self.delay), (self.order, self.order))

    @cached_property
    def W_z(self) -> Zonotope:
        """A^l W: what disturbs the prediction z from one sample to the next."""
        return self.W.mapped(self.A_delay)

    @cached_property
    def prediction_error(self) -> Zonotope:
        """W + A W + ... + A^(l-1) W: where the true x(k+l) may lie round its prediction z(k)."""
        return reachable(self.A, self.W, self.delay)[self.delay]

    def predict(self, x: ArrayLike, pending: ArrayLike) -> Array:
        """z(k), the prediction of x(k+l) without disturbance.

        Parameters
        ----------
        x
            The state x(k), shape (n,), absolute or as an error: the map is linear.
        pending
            The increments that are on their way, du(k-l) ... du(k-1), oldest first, shape (l,).

        Raises
        ------
        InvalidValue
            If an entry is not finite or the shapes do not fit.
        """
        z = self.require_state(x)
        for du in checked("pending", pending, (self.delay,)):
            z = self.A @ z + self.b * du
        return z

    def require_state(self, x: ArrayLike) -> Array:
        """`x` as a finite vector, shape (n,), or a InvalidValue that names the state at fault."""
        values = np.asarray(x, dtype=np.float64)
        if values.shape != (self.order,):
            raise InvalidValue(f"the state must have shape ({self.order},), got {values.shape}")
        if not np.isfinite(values).all():
            worst = int(np.flatnonzero(~np.isfinite(values))[0])
            raise InvalidValue(
                f"the state must be finite, got {self.names[worst]} = {values[worst]}; no input is computed from it"
            )
        return values
