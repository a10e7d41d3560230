"""The medium/low-speed maglev train of Zhang, Nan, Cao et al. (Beijing Jiaotong University), (1)-(7).

The line, the air resistance and several coefficients are ours: tables and formulas of the published text are lost.
"""

from __future__ import annotations

from typing import ClassVar

import casadi as ca

from models.discretise import RK4
from models.expression import Column, Expression, Number
from models.line import FLAT, Line
from models.plant import Values, signal, signals
from models.quantity import choice, count, declared, quantity
from models.vehicle import Vehicle

TEST_LINE = Line(
    grade_starts_m=(800, 1100, 1250, 1400),
    grade_permille=(0, 30, 0, -20, 0),
    curve_starts_m=(300,),
    curve_ends_m=(600,),
    curve_radii_m=(100,),
    length=1580,
)
LINES = {"paper": TEST_LINE, "flat": FLAT}


@declared
class Maglev(Vehicle):
    """M dv/dt = F - D(v) - d(x, v), dx/dt = v: air and eddy resistance, and that of grades and curves.

    F (and a disturbing force) is held over a sample; the equations are integrated by fourth-order Runge-Kutta.
    |v|^0.5 and sgn(v) have no derivative at rest, so |v| is sqrt(v^2 + 0.05^2) (ours). Position is that of the
    train's middle, over whose length grades and curvature are averaged.
    """

    source: ClassVar[str] = "Zhang, Nan, Cao et al., PALC of a maglev train, (1)-(7)"
    states = outputs = signals(
        position=signal("m", "position of the train's middle", role="position"),
        speed=signal("m/s", "speed", role="speed"),
    )
    inputs = signals(force=signal("N", "traction or braking force, positive away from the first station", role="force"))
    disturbances = signals(gust=signal("N", "disturbing force", role="force"))

    integrator = RK4()

    line: Line = choice(default="paper", options=LINES, doc="the line's grades and curves, by name or in tables")
    sampling_time: float = quantity(default=0.01, unit="s", doc="sampling time", above=0, structural=True)
    cars: int = count(default=3, doc="number of cars N", least=1)
    mass: float = quantity(default=90_000.0, unit="kg", doc="mass of the train M", above=0)
    length: float = quantity(default=45.0, unit="m", doc="length of the train", above=0)
    gravity: float = quantity(default=9.81, unit="m/s^2", doc="acceleration of gravity", above=0)
    air_first: float = quantity(default=1.652, unit="N/(m/s)^2", doc="air resistance of the train's ends", least=0)
    air_car: float = quantity(default=0.572, unit="N/(m/s)^2", doc="air resistance of a car", least=0)
    eddy_root: float = quantity(default=100.0, unit="N/(m/s)^0.5", doc="eddy resistance of a car, v^0.5", least=0)
    eddy_power: float = quantity(default=20.0, unit="N/(m/s)^0.7", doc="eddy resistance of a car, v^0.7", least=0)
    curve_constant: float = quantity(default=0.6, unit="m", doc="curve resistance per weight, times radius", least=0)
    smooth_speed: float = quantity(default=0.05, unit="m/s", doc="speed over which |v| is smoothed", above=0)

    def check(self) -> None:
        """Raise InvalidValue where the train is longer than the line."""
        self.line.holds(self.length)

    def rhs(self, x: Values, u: Values, w: Values, t: Number) -> Column:
        """Return speed and acceleration, (6)-(7)."""
        force = u.force + w.gust
        pull = force - self.running_resistance(x.speed) - self.line_resistance(x.position, x.speed)
        return x.speed, pull / self.mass

    def output(self, x: Values) -> Column:
        """Return position and speed."""
        return x.position, x.speed

    def running_resistance(self, v: Expression) -> Expression:
        """Return D in N, air (2) and eddy currents (3), at the speed v in m/s."""
        size = self._size(v)
        air = (self.air_first + self.air_car * self.cars) * v * size  # (2), ours
        return air + self.cars * (self.eddy_root * size**0.5 + self.eddy_power * size**0.7) * v / size  # (3)

    def resistance_at(self, speed: Expression) -> Expression:
        """Return D in N at a speed in m/s, at any sample."""
        return self.running_resistance(speed)

    def line_resistance(self, x: Expression, v: Expression) -> Expression:
        """Return d in N, grades (4) and curves (5), with the train's middle at x metres and the speed v in m/s."""
        front = x + self.length / 2
        grade = self.line.mean_grade(front, self.length) / 1000
        curve = self.curve_constant * self.line.mean_curvature(front, self.length) * v / self._size(v)
        return self.mass * self.gravity * (grade + curve)  # (4), (5)

    def _size(self, v: Expression) -> Expression:
        return ca.sqrt(v**2 + self.smooth_speed**2)
