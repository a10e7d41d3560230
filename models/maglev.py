"""The medium/low-speed maglev train of Zhang, Nan, Cao et al. (Beijing Jiaotong University), (1)-(7).

The line, the air resistance and several coefficients are ours: tables and formulas of the published text are lost.
"""

from __future__ import annotations

from typing import Any, ClassVar

import casadi as ca

from models.discretise import rk4
from models.line import Line
from models.plant import Plant, signals
from models.quantity import count, declared, part, quantity

TEST_LINE = Line(
    grade_starts_m=(800, 1100, 1250, 1400),
    grade_permille=(0, 30, 0, -20, 0),
    curve_starts_m=(300,),
    curve_ends_m=(600,),
    curve_radii_m=(100,),
    length=1580,
)


@declared
class Maglev(Plant):
    """M dv/dt = F - D(v) - d(x, v), dx/dt = v: air and eddy resistance, and that of grades and curves.

    F (and a disturbing force) is held over a sample; the equations are integrated by fourth-order Runge-Kutta.
    |v|^0.5 and sgn(v) have no derivative at rest, so |v| is sqrt(v^2 + 0.05^2) (ours). Position is that of the
    train's middle, over whose length grades and curvature are averaged.
    """

    source: ClassVar[str] = "Zhang, Nan, Cao et al., PALC of a maglev train, (1)-(7)"
    states = signals(position=("m", "position of the train's middle"), speed=("m/s", "speed"))
    inputs = signals(force=("N", "traction or braking force, positive away from the first station"))
    outputs = signals(position=("m", "position of the train's middle"), speed=("m/s", "speed"))
    disturbances = signals(gust=("N", "disturbing force"))

    integrator: ClassVar[str] = "fourth-order Runge-Kutta, one step a sample"

    line: Line = part(default=TEST_LINE, doc="the line's grades and curves")
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

    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        """Return position and speed one sample later."""
        return rk4(lambda at, t: self.rhs(at, u.force + w.gust), x.vector, 0, self.sampling_time)

    def slope(self, x: Any, u: Any, w: Any, t: Any) -> Any:
        """Return dx/dt, which the step integrates."""
        return self.rhs(x.vector, u.force + w.gust)

    def rhs(self, x: Any, force: Any) -> Any:
        """Return dx/dt, a column (2), of the column x = (x, v) under a force in N, (6)-(7)."""
        pull = force - self.running_resistance(x[1]) - self.line_resistance(x[0], x[1])
        return ca.vertcat(x[1], pull / self.mass)

    def output(self, x: Any) -> Any:
        """Return position and speed."""
        return x.position, x.speed

    def running_resistance(self, v: Any) -> Any:
        """Return D in N, air (2) and eddy currents (3), at the speed v in m/s."""
        size = self._size(v)
        air = (self.air_first + self.air_car * self.cars) * v * size  # (2), ours
        return air + self.cars * (self.eddy_root * size**0.5 + self.eddy_power * size**0.7) * v / size  # (3)

    def line_resistance(self, x: Any, v: Any) -> Any:
        """Return d in N, grades (4) and curves (5), with the train's middle at x metres and the speed v in m/s."""
        front = x + self.length / 2
        grade = self.line.mean_grade(front, self.length) / 1000
        curve = self.curve_constant * self.line.mean_curvature(front, self.length) * v / self._size(v)
        return self.mass * self.gravity * (grade + curve)  # (4), (5)

    def _size(self, v: Any) -> Any:
        return ca.sqrt(v**2 + self.smooth_speed**2)
