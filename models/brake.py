"""A braking train, Liu, Xun, Gao & Yin (2022), doi 10.16383/j.aas.c200039, in continuous time.

The brake answers a command after a dead time through a first-order lag; the running resistance depends on the speed
and on where the train is.
"""

from __future__ import annotations

from typing import ClassVar, NamedTuple

import casadi as ca

from models.actuator import Wrapper
from models.discretise import RK4
from models.expression import Column, Expression, Number
from models.line import Line, stepped
from models.plant import Plant, Signal, Values, signal, signals
from models.quantity import InvalidValue, declared, given, part, quantity, table
from models.repeated import repeated

APPROACH = Line(grade_starts_m=(150.0, 300.0), grade_permille=(12.0, 28.0, -6.0))
"""The grades before the stop: g(s) of the paper."""

MOST_SUBSTEPS = 1000


class Motion(NamedTuple):
    """What moves, or how fast it changes: brake acceleration (m/s^2), speed (m/s), position (m)."""

    acceleration: Expression
    speed: Expression
    position: Expression


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
    outputs = signals(speed=signal("m/s", "speed", role="speed"))
    disturbances = signals(
        resistance=signal("m/s^2", "resistance per unit mass beyond that of the line", role="force per mass")
    )

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
    def integrator(self) -> RK4:  # type: ignore[override]  # depends on the fine step
        """Classical Runge-Kutta with the fine steps."""
        return RK4(substeps=self.substeps)

    @property
    def states(self) -> tuple[Signal, ...]:
        """Brake acceleration, speed, position and the commands on their way, the newest first."""
        moving = signals(
            acceleration=signal("m/s^2", "acceleration by the brake", role="acceleration"),
            speed=signal("m/s", "speed", role="speed"),
            position=signal("m", "position of the train", role="position"),
        )
        line = (Signal(f"command_{i}", "1", f"command {i} sample(s) ago", False) for i in range(1, self.delay + 1))
        return (*moving, *line)

    def rhs(self, x: Values, u: Values, w: Values, t: Number) -> Column:
        """Return how the motion changes; the commands stand still within a sample."""
        acceleration, speed, position, *commands = x
        acting = [u.command, *commands][self.delay]
        extra = self.resistance(speed, position) + w.resistance
        return (*self.rates(Motion(acceleration, speed, position), acting, extra), *(0.0 for _ in commands))

    def at_sample(self, after: Values, x: Values, u: Values) -> Column:
        """Return the motion as it is and the line of commands shifted by one."""
        line = [u.command, *[*x][3:]]
        return (*[*after][:3], *line[: self.delay])

    def output(self, x: Values) -> Column:
        """Return the speed."""
        return (x.speed,)

    def resistance(self, speed: Expression, position: Expression) -> Number:
        """Return a_r in m/s^2 at a speed in m/s and a position in m, (3)-(5)."""
        if self.blocks is not None:
            return stepped(self._block_ends(self.blocks), self.blocks, position)
        v = 3.6 * speed
        running = (self.constant + self.linear * v + self.quadratic * v * v) / 1000
        return running + self.gravity * self.line.grade(position) / 1000

    def rates(self, motion: Motion, acting: Number, resistance: Number) -> Motion:
        """Return how motion changes under the command that acts now and a resistance, (1), (6)-(8)."""
        return Motion(
            (self.full_brake * acting - motion.acceleration) / self.lag,
            motion.acceleration - resistance,
            motion.speed,
        )

    def fine(self, motion: Motion, acting: Number, extra: Number) -> Motion:
        """Return the motion one fine step later, by the classical Runge-Kutta method.

        ``acting`` is the command that acts over the sample, ``extra`` the resistance beyond the plant's own.
        """

        def slope(column: Expression, t: Number) -> Expression:
            now = Motion(column[0], column[1], column[2])
            return ca.vertcat(*self.rates(now, acting, self.resistance(now.speed, now.position) + extra))

        column = RK4().advance(slope, ca.vertcat(*motion), 0.0, self.fine_step)
        return Motion(column[0], column[1], column[2])

    def _block_ends(self, blocks: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(self.block_length * i for i in range(1, len(blocks)))


@declared
class Halting(Wrapper):
    """A braking train until it stands: a trial ends there.

    Within the fine step in which the speed reaches zero the motion is interpolated, and there the train stays: its
    speed is 0, its position where it stands, and nothing moves any more. The state ``running_time`` says how long it
    ran, ``peak_jerk`` what the largest jerk of the brake was during the sample that led to the state.
    """

    source: ClassVar[str] = "Liu, Xun, Gao & Yin 2022, (1)-(8)"
    outputs = signals(
        speed=signal("m/s", "speed", role="speed"),
        position=signal("m", "position of the train", role="position"),
    )

    plant: Brake = part(default=Brake(), doc="brake and train")

    @property
    def states(self) -> tuple[Signal, ...]:
        """States of the braking train, then its running time and the largest jerk since the last sample."""
        return (
            *self.plant.states,
            *signals(
                running_time=("s", "time for which the train has run"),
                peak_jerk=("m/s^3", "largest jerk of the brake since the last sample"),
            ),
        )

    def step(self, x: Values, u: Values, w: Values, k: Expression) -> Column:
        """Return the motion after the fine steps, the line of commands shifted by one, running time and jerk."""
        brake = self.plant
        acceleration, speed, position, *commands, running_time, _ = x
        line = [u.command, *commands]
        acting = line[brake.delay]

        def advance(column: Expression) -> Expression:
            motion, time, peak = Motion(column[0], column[1], column[2]), column[3], column[4]
            jerk = ca.fabs(brake.rates(motion, acting, 0.0).acceleration)
            peak = ca.if_else(motion.speed > 0, ca.fmax(peak, jerk), peak)
            share, motion = self._fine(motion, acting, w.resistance)
            return ca.vertcat(*motion, time + share * brake.fine_step, peak)

        began = ca.vertcat(acceleration, speed, position, running_time, 0.0 * running_time)
        after = repeated(advance, began, brake.substeps)
        return (after[0], after[1], after[2], *line[: brake.delay], after[3], after[4])

    def output(self, x: Values) -> Column:
        """Return speed and position."""
        return (x.speed, x.position)

    def ended(self, x: Values) -> Expression | None:
        """Return whether the train stands."""
        return x.speed <= 0

    def _fine(self, motion: Motion, acting: Number, extra: Number) -> tuple[Expression, Motion]:
        """Return the share of a fine step for which the train runs, and the motion after it."""
        after = self.plant.fine(motion, acting, extra)
        halts = after.speed <= 0
        drop = ca.if_else(halts, motion.speed - after.speed, 1.0)
        share = ca.if_else(motion.speed <= 0, 0.0, ca.if_else(halts, motion.speed / drop, 1.0))
        stands = ca.logic_or(motion.speed <= 0, halts)
        here = Motion(
            *(ca.if_else(stands, old + share * (new - old), new) for old, new in zip(motion, after, strict=True))
        )
        return share, here._replace(speed=ca.if_else(stands, 0.0, here.speed))
