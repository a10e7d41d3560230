"""A plant given as a transfer function: built with python-control, discretised exactly, symbolic from there on."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, ClassVar, Self

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from models.array import Array
from models.expression import Column, Expression
from models.plant import Plant, Signal, Values
from models.quantity import InvalidValue, declared, given, quantity, table

if TYPE_CHECKING:
    from models.control_systems import TransferFunction

FASTEST = 1e6
"""Largest size of a pole times the sampling time."""
GROWTH = 700.0
"""Largest real part of a pole times the sampling time: beyond it the exponential is no number."""


@declared
class Transfer(Plant):
    """y = gain numerator(s)/denominator(s) u, sampled with a zero-order hold on u.

    Coefficients are in falling powers of s. The transfer function must be strictly proper, because a plant's
    output depends on its state alone. A dead time is put round it by :mod:`models.actuator`.

    Poles may be at most ``FASTEST`` times as fast as the sampling: what is rounded in the sampled matrices grows with
    that ratio, to about 1e-7 of the output at this limit and to all of it at 1e16. What such a pole does is over long
    before the next sample, so its coefficient can be left out.
    """

    source: ClassVar[str] = "control.c2d of a control.TransferFunction, zero-order hold"

    numerator: tuple[float, ...] = table(default=(1.0,), unit="falling powers of s", doc="numerator")
    denominator: tuple[float, ...] = table(default=(1.0, 1.0), unit="falling powers of s", doc="denominator")
    gain: float = quantity(default=1.0, unit="1", doc="factor on the numerator")
    sampling_time: float = quantity(default=0.2, unit="s", doc="sampling time", above=0, structural=True)
    input_signal: Signal = given(default=Signal("command", "1", "command"), doc="the input's name and unit")
    output_signal: Signal = given(default=Signal("output", "1", "output"), doc="the output's name and unit")

    def check(self) -> None:
        """Raise InvalidValue unless the transfer function is strictly proper."""
        numerator, denominator = (np.trim_zeros(np.array(row), "f") for row in (self.numerator, self.denominator))
        if denominator.size == 0:
            raise InvalidValue("denominator must have a coefficient that is not 0")
        if numerator.size >= denominator.size:
            raise InvalidValue(
                f"numerator must be of lower degree than denominator, got {self.numerator} over {self.denominator}"
            )
        poles = _poles(tuple(denominator.tolist()))
        fastest, growing = (float(part.max()) * float(self.sampling_time) for part in (np.abs(poles), poles.real))
        if not fastest <= FASTEST:
            raise InvalidValue(
                f"denominator must have poles at most {FASTEST:g} times as fast as the sampling, got one {fastest:.3g} "
                f"times as fast: leave the leading coefficient {denominator[0]:g} out"
            )
        if growing > GROWTH:
            raise InvalidValue(
                f"denominator must have poles that grow by finite factors a sample, got one by exp({growing:.3g})"
            )

    @classmethod
    def of(cls, system: TransferFunction, **fields: object) -> Self:
        """Return the plant of a python-control ``TransferFunction`` with one input and one output."""
        if system.ninputs != 1 or system.noutputs != 1 or system.isdtime(strict=True):
            raise InvalidValue("a transfer function must be continuous, with one input and one output")
        numerator, denominator = tuple(system.num[0][0]), tuple(system.den[0][0])
        return cls(numerator=numerator, denominator=denominator, **fields)  # type: ignore[arg-type]  # they are checked

    @property
    def states(self) -> tuple[Signal, ...]:
        """The states of python-control's realisation."""
        return tuple(
            Signal(f"x{i}", "1", f"state {i} of the realisation") for i in range(1, len(self._matrices[0]) + 1)
        )

    @property
    def inputs(self) -> tuple[Signal, ...]:
        """The input."""
        return (self.input_signal,)

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """The output."""
        return (self.output_signal,)

    def step(self, x: Values, u: Values, w: Values, k: Expression) -> Column:
        """Return the state one sample later: exact for an input that is held."""
        a, b, _ = self._matrices
        return ca.DM(a) @ x.vector + ca.DM(b) @ u.vector

    def output(self, x: Values) -> Column:
        """Return the output."""
        return self.gain * (ca.DM(self._matrices[2]) @ x.vector)

    @property
    def _matrices(self) -> tuple[Array, Array, Array]:
        return _sampled(self.numerator, self.denominator, float(self.sampling_time))


@functools.lru_cache(maxsize=64)
def _poles(coefficients: tuple[float, ...]) -> NDArray[np.complex128]:
    """Return the poles in rad/s; infinity for one that is beyond numbers, 0 where there is none."""
    denominator = np.array(coefficients)
    with np.errstate(over="ignore", divide="ignore"):
        if not np.isfinite(denominator / denominator[0]).all():
            return np.array([np.inf])
    return np.append(np.roots(denominator), 0)


@functools.cache
def _sampled(
    numerator: tuple[float, ...], denominator: tuple[float, ...], sampling_time: float
) -> tuple[Array, Array, Array]:
    from models.control_systems import zero_order_hold

    system = zero_order_hold(numerator, denominator, sampling_time)
    return system.A, system.B, system.C
