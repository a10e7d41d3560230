"""The point-mass metro train of Jiao & Hou (2025), doi 10.7641/CTA.2024.30465, equations (1)-(3) and (17).

Ours: position is a second state, s(k+1) = s(k) + Ts v(k), because the slope force depends on it, and the
slopes come from a line, averaged over the train's length.
"""

from __future__ import annotations

from typing import ClassVar, Literal

import casadi as ca

from models.expression import Column, Expression, Number
from models.line import LINES, Line
from models.plant import Signal, Values, signal, signals
from models.quantity import choice, declared, quantity
from models.vehicle import Vehicle

READINGS = {
    "metro": "speed in km/h, forces in N, resistance coefficients not divided by the mass, k the sample index",
    "seconds": "as metro, with the resistance coefficients and the reference as functions of seconds",
    "printed": "the literal equations: resistance divided by the mass twice, no unit conversion",
}


@declared
class PointMass(Vehicle):
    """One mass moved by a force against rolling, air and slope resistance.

    Readings of the paper (it does not pin its units down):

    - ``metro``: v in km/h, v(k+1) = v(k) + 3.6 (Ts/M) (u - fa - fb), s in metres, fa = M g mean(i)/1000;
    - ``seconds``: the same, b0, b1, b2 varying with seconds instead of with the sample index;
    - ``printed``: v(k+1) = v(k) + (Ts/M) (u - fa - fb/M), fa = chi sin(theta), chi = g per unit mass.
    """

    source: ClassVar[str] = "Jiao & Hou 2025, (1)-(3), (17)"
    inputs = signals(force=signal("N", "traction (+) or braking (-) force", role="force"))

    reading: str = choice(default="metro", options=tuple(READINGS), doc="how the paper's units are read")
    line: Line = choice(default="hilly", options=LINES, doc="the line's grades")
    mass: float = quantity(default=350_000.0, unit="kg", doc="mass of the train", above=0)
    sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)
    length: float = quantity(
        default=140.0, unit="m", doc="length of the train, over which grades are averaged", above=0
    )
    gravity: float = quantity(default=9.81, unit="m/s^2", doc="acceleration of gravity", above=0)
    b0_mean: float = quantity(default=2977.0, unit="N", doc="constant resistance, mean", least=0)
    b0_swing: float = quantity(default=275.0, unit="N", doc="constant resistance, amplitude of its variation")
    b1_mean: float = quantity(default=25.17, unit="N/(km/h)", doc="resistance linear in speed, mean", least=0)
    b1_swing: float = quantity(default=2.5, unit="N/(km/h)", doc="resistance linear in speed, amplitude")
    b2_mean: float = quantity(default=0.2864, unit="N/(km/h)^2", doc="resistance quadratic in speed, mean", least=0)
    b2_swing: float = quantity(default=0.04, unit="N/(km/h)^2", doc="resistance quadratic in speed, amplitude")
    pulsation: float = quantity(
        default=0.0037, unit="rad per sample or second", doc="pulsation of the coefficients", least=0
    )

    @property
    def speed_factor(self) -> float:
        """Speed units per m/s: 3.6 where speed is in km/h, 1 in the printed reading."""
        return 1.0 if self.reading == "printed" else 3.6

    @property
    def speed_unit(self) -> str:
        """The unit of speed in this reading."""
        return "m/s" if self.reading == "printed" else "km/h"

    @property
    def clock(self) -> Literal["samples", "seconds"]:
        """What k counts in the coefficients and in the reference of this reading."""
        return "seconds" if self.reading == "seconds" else "samples"

    @property
    def states(self) -> tuple[Signal, ...]:
        """Speed and position of the train's front."""
        speed = signal(self.speed_unit, "speed", role="speed")
        return signals(speed=speed, position=signal("m", "position of the train's front", role="position"))

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """The speed."""
        return signals(speed=signal(self.speed_unit, "speed", role="speed"))

    def step(self, x: Values, u: Values, w: Values, k: Expression) -> Column:
        """Return speed and position one sample later, (1) with the position added."""
        v, s = x
        force = u.force - self.slope_force(s) - self.running_resistance(v, k)
        v_next = v + self.speed_factor * self.sampling_time / self.mass * force  # (1)
        return v_next, s + self.sampling_time * v / self.speed_factor

    def output(self, x: Values) -> Column:
        """Return the speed."""
        return (x.speed,)

    def slope_force(self, s: Expression) -> Number:
        """Return fa in newtons with the train's front at s metres, (2)."""
        slope = self.line.mean_grade(s, self.length) / 1000
        if self.reading == "printed":
            return self.gravity * ca.sin(ca.atan(slope))  # (2), chi = g
        return self.mass * self.gravity * slope

    def running_resistance(self, v: Expression, k: Number) -> Expression:
        """Return fb in newtons at speed v and sample k, (3) with (17)."""
        time = k * self.sampling_time if self.clock == "seconds" else k
        swing = ca.sin(self.pulsation * time)
        b0 = self.b0_mean + self.b0_swing * swing  # (17)
        b1 = self.b1_mean + self.b1_swing * swing
        b2 = self.b2_mean + self.b2_swing * swing
        resistance = b0 + b1 * v + b2 * v * v  # (3)
        return resistance / self.mass if self.reading == "printed" else resistance

    def resistance_at(self, speed: Expression) -> Expression:
        """Return fb at a speed in m/s and the first sample: in newtons, as :meth:`running_resistance` has it."""
        return self.running_resistance(speed * self.speed_factor, 0)
