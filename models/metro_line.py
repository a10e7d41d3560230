"""The metro train of the patent of Nanjing Institute of Technology (2017), per unit mass, (1)-(2).

Its coefficients, line and reference are ours: the patent publishes none.
"""

from __future__ import annotations

from typing import ClassVar

import casadi as ca

from models.discretise import RK4
from models.expression import Column, Expression, Number
from models.line import Line
from models.plant import Plant, Values, signal, signals
from models.quantity import declared, part, quantity

PATENT_LINE = Line(
    grade_starts_m=(200, 500, 900, 1200),
    grade_permille=(0, 8, -12, 5, 0),
    curve_starts_m=(300, 950),
    curve_ends_m=(600, 1150),
    curve_radii_m=(450, 600),
    tunnel_starts_m=(600,),
    tunnel_ends_m=(1000,),
    length=1500,
)


@declared
class MetroLine(Plant):
    """ds/dt = v, dv/dt = b F - f0 - fi - fr - fs: basic, slope, curve and tunnel resistance in N/kg.

    F is held over a sample and the equations are integrated by fourth-order Runge-Kutta steps of half a sample.
    sgn(v) is smoothed to v/sqrt(v^2 + 0.05^2), so derivatives exist at rest. ``input_gain`` b is 1 in the patent.
    """

    source: ClassVar[str] = "Nanjing Institute of Technology, patent application 2017, (1)-(2)"
    states = outputs = signals(
        position=signal("m", "position of the train's front", role="position"),
        speed=signal("m/s", "speed", role="speed"),
    )
    inputs = signals(force=signal("N/kg", "traction (+) or braking (-) force per unit mass", role="force per mass"))

    integrator = RK4(substeps=2)

    line: Line = part(default=PATENT_LINE, doc="the line's grades, curves and tunnels")
    sampling_time: float = quantity(default=0.1, unit="s", doc="sampling time", above=0)
    length: float = quantity(default=100.0, unit="m", doc="length of the train", above=0)
    input_gain: float = quantity(default=1.0, unit="1", doc="b, force that acts over force commanded", above=0)
    gravity: float = quantity(default=9.81, unit="m/s^2", doc="acceleration of gravity", above=0)
    basic_0: float = quantity(default=2.031, unit="N/kN", doc="basic resistance, constant", least=0)
    basic_1: float = quantity(default=0.0622, unit="N/kN/(km/h)", doc="basic resistance, linear in speed", least=0)
    basic_2: float = quantity(
        default=0.001807, unit="N/kN/(km/h)^2", doc="basic resistance, quadratic in speed", least=0
    )
    curve_constant: float = quantity(default=600.0, unit="N m/kN", doc="curve resistance times radius", least=0)
    tunnel_resistance: float = quantity(default=0.00013 * 400, unit="N/kN", doc="resistance in a tunnel", least=0)
    smooth_speed: float = quantity(default=0.05, unit="m/s", doc="speed over which sgn(v) is smoothed", above=0)

    def check(self) -> None:
        """Raise InvalidValue where the train is longer than the line."""
        self.line.holds(self.length)

    def rhs(self, x: Values, u: Values, w: Values, t: Number) -> Column:
        """Return speed and acceleration, (2)."""
        return x.speed, self.input_gain * u.force - self.resistance(x.position, x.speed)

    def output(self, x: Values) -> Column:
        """Return position and speed."""
        return x.position, x.speed

    def resistance(self, s: Expression, v: Expression) -> Expression:
        """Return f0 + fi + fr + fs in N/kg with the train's front at s metres and the speed v in m/s."""
        kmh = 3.6 * ca.fabs(v)
        sign = v / ca.sqrt(v**2 + self.smooth_speed**2)
        f0 = (self.basic_0 + self.basic_1 * kmh + self.basic_2 * kmh**2) * sign
        fi = self.line.mean_grade(s, self.length)
        fr = self.curve_constant * self.line.mean_curvature(s, self.length) * sign
        fs = self.tunnel_resistance * self.line.tunnel(s) * sign
        return self.gravity / 1000 * (f0 + fi + fr + fs)
