"""A braking train, Liu, Xun, Gao & Yin (2022), doi 10.16383/j.aas.c200039, in continuous time.

The brake answers a command after a dead time through a first-order lag; the running resistance depends on the speed
and on where the train is.
"""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import casadi as ca

from models.discretise import rk4
from models.line import Line, stepped
from models.plant import Plant, Signal, signals
from models.quantity import InvalidValue, declared, given, quantity, table

APPROACH = Line(grade_starts_m=(150.0, 300.0), grade_permille=(12.0, 28.0, -6.0))
"""The grades before the stop: g(s) of the paper."""

MOST_SUBSTEPS = 1000


class Motion(NamedTuple):
    """What moves, or how fast it changes: brake acceleration (m/s^2), speed (m/s), position (m)."""

    acceleration: Any
    speed: Any
    position: Any


@declared
class Brake(Plant):
    """da_c/dt = (c u(t - Td) - a_c) / tau, dv/dt = a_c - a_r(v, s), ds/dt = v.

    The step integrates these equations over ``substeps`` fine steps; the dead time is a line of past commands, so it
    must be a whole number of samples. The equations hold while the train runs: nothing here keeps it from reversing.

    Deviations: the coefficients of a_r are read as N/t (the paper prints no unit). ``blocks``, if given, are the
    resistance by position in place of that of the line.
    """

    source: ClassVar[str] = "Liu, Xun, Gao & Yin 2022, (1)-(8)"
    inputs = signals(command=("1", "brake command, 1 is full brake"))
    outputs = signals(speed=("m/s", "speed"))
    disturbances = signals(resistance=("m/s^2", "resistance per unit mass beyond that of the line"))

    integrator: ClassVar[str] = "fourth-order Runge-Kutta, fine steps; the commands shift by one at each sample"

    lag: float = quantity(default=0.4, unit="s", doc="time constant of the brake (tau)", above=0)
    dead_time: float = quantity(default=1.0, unit="s", doc="dead time of the brake (Td)", least=0, structural=True)
    full_brake: float = quantity(default=-1.07, unit="m/s^2", doc="acceleration at full brake (c)", below=0)
    sampling_time: float = quantity(default=0.2, unit="s", doc="sampling time (T)", above=0, structural=True)
    fine_step: float = quantity(default=0.01, unit="s", doc="step of the integration", above=0, structural=True)
    constant: float = quantity(default=5.4, unit="N/t", doc="resistance, constant part", least=0)
    linear: float = quantity(default=0.0098, unit="N/t/(km/h)", doc="resistance, part linear in speed", least=0)
    quadratic: float = quantity(
        default=0.00163, unit="N/t/(km/h)^2", doc="resistance, part quadratic in speed", least=0
    )
    gravity: float = quantity(default=9.81, unit="m/s^2", doc="acceleration of gravity", above=0)
    line: Line = given(default=APPROACH, doc="the grades")
    blocks: tuple[float, ...] | None = table(
        default=None, unit="m/s^2", doc="resistance by blocks of position in place of the line's", optional=True
    )
    block_length: float = quantity(default=10.0, unit="m", doc="length of a block", above=0, structural=True)

    def check(self) -> None:
        """Raise InvalidValue unless dead time and sampling time are whole numbers of their steps."""
        for name, value, step in (
            ("dead_time", self.dead_time, self.sampling_time),
            ("sampling_time", self.sampling_time, self.fine_step),
        ):
            if abs(value / step - round(value / step)) > 1e-9:
                of = "sampling_time" if name == "dead_time" else "fine_step"
                raise InvalidValue(f"{name} must be a whole number of {of} = {step:g} s, got {value:g} s")
        if self.substeps > MOST_SUBSTEPS:
            raise InvalidValue(
                f"fine_step must be at least {self.sampling_time / MOST_SUBSTEPS:g} s "
                f"(sampling_time / {MOST_SUBSTEPS}), got {self.fine_step:g} s"
            )
        if self.blocks is not None and not self.blocks:
            raise InvalidValue("blocks must hold at least one number, got none; give null for the line's resistance")

    @property
    def delay(self) -> int:
        """The dead time in samples (l)."""
        return round(self.dead_time / self.sampling_time)

    @property
    def substeps(self) -> int:
        """Fine steps a sample."""
        return round(self.sampling_time / self.fine_step)

    @property
    def states(self) -> Any:  # type: ignore[override]  # depends on the dead time
        """Brake acceleration, speed, position and the commands on their way, the newest first."""
        moving = signals(
            acceleration=("m/s^2", "acceleration by the brake"),
            speed=("m/s", "speed"),
            position=("m", "position of the train"),
        )
        line = (Signal(f"command_{i}", "1", f"command {i} sample(s) ago", False) for i in range(1, self.delay + 1))
        return (*moving, *line)

    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        """Return motion and line of commands one sample later."""
        acceleration, speed, position, *commands = x
        motion, line = Motion(acceleration, speed, position), [u.command, *commands]
        for _ in range(self.substeps):
            motion = self.fine(motion, line[self.delay], w.resistance)
        return (*motion, *line[: self.delay])

    def output(self, x: Any) -> Any:
        """Return the speed."""
        return (x.speed,)

    def resistance(self, speed: Any, position: Any) -> Any:
        """Return a_r in m/s^2 at a speed in m/s and a position in m, (3)-(5)."""
        if self.blocks is not None:
            return stepped(self._block_ends(self.blocks), self.blocks, position)
        v = 3.6 * speed
        running = (self.constant + self.linear * v + self.quadratic * v * v) / 1000
        return running + self.gravity * self.line.grade(position) / 1000

    def rates(self, motion: Motion, acting: Any, resistance: Any) -> Motion:
        """Return how motion changes under the command that acts now and a resistance, (1), (6)-(8)."""
        return Motion(
            (self.full_brake * acting - motion.acceleration) / self.lag,
            motion.acceleration - resistance,
            motion.speed,
        )

    def fine(self, motion: Motion, acting: Any, extra: Any) -> Motion:
        """Return the motion one fine step later, by the classical Runge-Kutta method.

        ``acting`` is the command that acts over the sample, ``extra`` the resistance beyond the plant's own.
        """

        def rhs(column: Any, t: Any) -> Any:
            now = Motion(column[0], column[1], column[2])
            return ca.vertcat(*self.rates(now, acting, self.resistance(now.speed, now.position) + extra))

        column = rk4(rhs, ca.vertcat(*motion), 0.0, self.fine_step)
        return Motion(column[0], column[1], column[2])

    def slope(self, x: Any, u: Any, w: Any, t: Any) -> Any:
        """Return dx/dt within a sample, where the commands stand still."""
        motion = Motion(x.acceleration, x.speed, x.position)
        acting = [u.command, *x][-1] if self.delay else u.command
        rates = self.rates(motion, acting, self.resistance(x.speed, x.position) + w.resistance)
        return (*rates, *(0.0 for _ in range(self.delay)))

    def _block_ends(self, blocks: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(self.block_length * i for i in range(1, len(blocks)))
