"""What lies between a command and a plant: limits, dead time and lag, as wrappers round any plant.

Each wrapper is itself a plant with the inner plant's inputs, outputs and disturbances; its own states stand after
the inner plant's and begin at zero. They nest: ``Saturated(plant=Delayed(plant=Lagged(plant=motor, ...), ...))``
limits the command, then delays it, then lags it.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import ClassVar, Literal, Self, TypeAlias

import casadi as ca

from models.expression import Column, Expression, Number
from models.limits import Limits, check_inputs
from models.plant import Plant, Signal, Values
from models.quantity import InvalidValue, declared, given, part, quantity

PerInput: TypeAlias = float | tuple[float | None, ...] | None
"""A limit for every input, one an input, or none."""


class Wrapper(Plant):
    """What all wrappers share: inputs, outputs, disturbances and sampling time are those of the inner plant.

    The inner plant's states come first; a wrapper's own are not recorded by runs.
    """

    plant: Plant

    @property
    def sampling_time(self) -> float:
        """The inner plant's sampling time."""
        return self.plant.sampling_time

    @property
    def inputs(self) -> tuple[Signal, ...]:
        """Inputs of the inner plant."""
        return self.plant.inputs

    @property
    def outputs(self) -> tuple[Signal, ...]:
        """Outputs of the inner plant."""
        return self.plant.outputs

    @property
    def disturbances(self) -> tuple[Signal, ...]:  # type: ignore[override]  # those of the inner plant
        """Disturbances of the inner plant."""
        return self.plant.disturbances

    @property
    def clock(self) -> Literal["samples", "seconds"]:
        """What the inner plant's time counts."""
        return self.plant.clock

    @property
    def input_limits(self) -> Limits:
        """Limits of the inner plant: a command beyond them does no more, also behind a lag or a dead time."""
        return self.plant.input_limits

    @abstractmethod
    def step(self, x: Values, u: Values, w: Values, k: Expression) -> Column:
        """Return the inner plant's next state and the wrapper's own."""

    def output(self, x: Values) -> Column:
        """Return the outputs of the inner plant."""
        return self.plant.measured(x.vector[: len(self.plant.states)])

    def ended(self, x: Values) -> Expression | None:
        """Return whether the inner plant's trial is over."""
        return self.plant.ended(Values(self.plant.states, x.vector[: len(self.plant.states)]))


def _own(inputs: Sequence[Signal], suffix: str, doc: str) -> tuple[Signal, ...]:
    return tuple(Signal(f"{one.name}_{suffix}", one.unit, f"{doc} {one.doc or one.name}", False) for one in inputs)


def under_way(plant: Plant, samples: int) -> tuple[Signal, ...]:
    """Return the commands of the last samples as signals, the oldest first."""
    ages = range(samples, 0, -1)
    return tuple(own for age in ages for own in _own(plant.inputs, f"{age}_ago", f"command {age} sample(s) ago:"))


@declared
class Delayed(Wrapper):
    """A plant whose inputs arrive ``dead_time`` seconds late; before that they are zero.

    The states added are the commands under way, the oldest first. Raises InvalidValue unless the dead time is a
    multiple of the sampling time.
    """

    source: ClassVar[str] = "ours"

    plant: Plant = part(doc="the plant behind the dead time")
    dead_time: float = quantity(unit="s", doc="dead time, a multiple of the sampling time", above=0, structural=True)
    counted: tuple[float, int] | None = given(
        default=None, doc="the dead time and its samples, which stay while the sampling time is a symbol; found here"
    )

    def __new__(cls, **fields: object) -> Self:
        """Make an object, or raise InvalidValue where the dead time is given in samples, as it once was."""
        if "samples" in fields:
            raise InvalidValue(
                f"{cls.__name__} takes dead_time in seconds, got samples={fields['samples']!r}: "
                "give dead_time = samples * sampling_time"
            )
        return super().__new__(cls)

    def check(self) -> None:
        """Raise InvalidValue unless the dead time is a multiple of the sampling time."""
        if not isinstance(self.sampling_time, (ca.SX, ca.MX)):
            samples = whole_samples("dead_time", self.dead_time, float(self.sampling_time))
            object.__setattr__(self, "counted", (self.dead_time, samples))
        elif self.counted is None or self.counted[0] != self.dead_time:
            raise InvalidValue("dead_time shapes the equations: give the sampling time as a number, not as a symbol")

    @property
    def samples(self) -> int:
        """The dead time in samples."""
        return self.counted[1] if self.counted else 0

    @property
    def states(self) -> tuple[Signal, ...]:
        """States of the inner plant, then the commands under way, the oldest first."""
        return (*self.plant.states, *under_way(self.plant, self.samples))

    def step(self, x: Values, u: Values, w: Values, k: Expression) -> Column:
        """Return the next state: the oldest command reaches the inner plant, the new one joins the queue."""
        n, m = len(self.plant.states), len(self.plant.inputs)
        inner, queue = x.vector[:n], x.vector[n:]
        return ca.vertcat(self.plant.next_state(inner, queue[:m], w.vector, k), ca.vertcat(queue, u.vector)[m:])

    def applied(self, x: Values, u: Values, k: Expression) -> Column:
        """Return what acts inside for the oldest command."""
        n, m = len(self.plant.states), len(self.plant.inputs)
        return self.plant.applied_input(x.vector[:n], x.vector[n : n + m], k)


@declared
class Lagged(Wrapper):
    """A plant whose inputs follow the command through a first-order lag.

    The lag is exact for a command held over the sample; the inner plant is given the mean of the lagged input
    over the sample (an error of second order in the sampling time).
    """

    source: ClassVar[str] = "ours"

    plant: Plant = part(doc="the plant behind the lag")
    time_constant: float = quantity(unit="s", doc="time constant of the lag", above=0)

    @property
    def states(self) -> tuple[Signal, ...]:
        """States of the inner plant, then the lagged inputs."""
        return (*self.plant.states, *_own(self.plant.inputs, "lagged", "lagged"))

    def step(self, x: Values, u: Values, w: Values, k: Expression) -> Column:
        """Return the next state; the inner plant sees the lagged input's mean over the sample."""
        n = len(self.plant.states)
        inner, lagged = x.vector[:n], x.vector[n:]
        kept = ca.exp(-self.sampling_time / self.time_constant)
        follows = u.vector + (lagged - u.vector) * kept
        return ca.vertcat(self.plant.next_state(inner, self._mean(lagged, u.vector), w.vector, k), follows)

    def applied(self, x: Values, u: Values, k: Expression) -> Column:
        """Return what acts inside for the lagged input's mean over the sample."""
        n = len(self.plant.states)
        return self.plant.applied_input(x.vector[:n], self._mean(x.vector[n:], u.vector), k)

    def _mean(self, lagged: Expression, command: Expression) -> Expression:
        ratio = self.sampling_time / self.time_constant
        return command + (lagged - command) * (1 - ca.exp(-ratio)) / ratio


def _each(limit: PerInput, inputs: int) -> Sequence[float | None]:
    return limit if isinstance(limit, tuple) else (limit,) * inputs


def _cut(extreme: Callable[[Expression, Number], Expression], u: Expression, limit: PerInput) -> Expression:
    """Return inputs (rows) cut at a limit; an input without one stays as it is."""
    if limit is None:
        return u
    if not isinstance(limit, tuple):
        return extreme(u, limit)
    return ca.vertcat(*(u[i, :] if one is None else extreme(u[i, :], one) for i, one in enumerate(limit)))


@declared
class Saturated(Wrapper):
    """A plant whose inputs are cut at a lower and an upper limit: one for every input, or one an input.

    null is no limit, also for one of the inputs.
    """

    source: ClassVar[str] = "ours"

    plant: Plant = part(doc="the plant behind the limits")
    lower: PerInput = quantity(default=None, unit="input units", doc="least input", optional=True, rows=True)
    upper: PerInput = quantity(default=None, unit="input units", doc="largest input", optional=True, rows=True)

    def check(self) -> None:
        """Raise InvalidValue unless the lower limit lies below the upper one."""
        inputs = len(self.inputs)
        check_inputs("lower", self.lower, inputs)
        check_inputs("upper", self.upper, inputs)
        each = zip(_each(self.lower, inputs), _each(self.upper, inputs), strict=True)
        if any(isinstance(low, float) and isinstance(high, float) and low >= high for low, high in each):
            raise InvalidValue(f"lower must lie below upper, got {self.lower!r} and {self.upper!r}")

    @property
    def states(self) -> tuple[Signal, ...]:
        """States of the inner plant."""
        return self.plant.states

    @property
    def input_limits(self) -> Limits:
        """Limits of the inner plant and these."""
        return self.plant.input_limits.tightened(self.lower, self.upper)

    def step(self, x: Values, u: Values, w: Values, k: Expression) -> Column:
        """Return the inner plant's next state for the limited input."""
        return self.plant.next_state(x.vector, self.limited(u.vector), w.vector, k)

    def applied(self, x: Values, u: Values, k: Expression) -> Column:
        """Return what acts inside for the limited input."""
        return self.plant.applied_input(x.vector, self.limited(u.vector), k)

    def limited(self, u: Expression) -> Expression:
        """Return the inputs cut at the limits, same shape."""
        return _cut(ca.fmax, _cut(ca.fmin, u, self.upper), self.lower)


@declared
class RateLimited(Wrapper):
    """A plant whose inputs follow the command at a limited rate: one for every input, or one an input.

    The states added are the inputs of the last sample.
    """

    source: ClassVar[str] = "ours"

    plant: Plant = part(doc="the plant behind the rate limit")
    rate: PerInput = quantity(unit="input units/s", doc="largest rate of change", above=0, optional=True, rows=True)

    def check(self) -> None:
        """Raise InvalidValue where the rates are not one an input."""
        check_inputs("rate", self.rate, len(self.inputs))

    @property
    def states(self) -> tuple[Signal, ...]:
        """States of the inner plant, then the inputs of the last sample."""
        return (*self.plant.states, *_own(self.plant.inputs, "before", "last sample's"))

    @property
    def input_limits(self) -> Limits:
        """Limits of the inner plant and this rate."""
        return self.plant.input_limits.tightened(rate=self.rate)

    def step(self, x: Values, u: Values, w: Values, k: Expression) -> Column:
        """Return the next state for an input that moves towards the command."""
        n = len(self.plant.states)
        moved = self._moved(x.vector[n:], u.vector)
        return ca.vertcat(self.plant.next_state(x.vector[:n], moved, w.vector, k), moved)

    def applied(self, x: Values, u: Values, k: Expression) -> Column:
        """Return what acts inside for the input that moves towards the command."""
        n = len(self.plant.states)
        return self.plant.applied_input(x.vector[:n], self._moved(x.vector[n:], u.vector), k)

    def _moved(self, before: Expression, command: Expression) -> Expression:
        rate, step = self.rate, self.sampling_time
        if rate is None:
            return command
        if isinstance(rate, tuple):
            most: PerInput = tuple(None if one is None else one * step for one in rate)
            least: PerInput = tuple(None if one is None else -(one * step) for one in rate)
        else:
            most = rate * step
            least = -most
        return before + _cut(ca.fmin, _cut(ca.fmax, command - before, least), most)


def whole_samples(name: str, seconds: float, sampling_time: float) -> int:
    """Return a time in samples; raises InvalidValue, naming it, unless it is a multiple of the sampling time."""
    samples = round(seconds / sampling_time)
    if seconds < 0 or abs(samples * sampling_time - seconds) > 1e-9 * max(1.0, seconds):
        raise InvalidValue(
            f"{name} must be a multiple of the sampling time of {sampling_time:g} s, 0 or more, got {seconds!r}"
        )
    return samples


def delayed(plant: Plant, delay: float) -> Plant:
    """Return the plant behind a dead time in seconds; the plant itself for 0.

    Raises InvalidValue unless the delay is a multiple of the sampling time, 0 or more.
    """
    return Delayed(plant=plant, dead_time=delay) if whole_samples("delay", delay, plant.sampling_time) else plant


@declared
class Actuator:
    """Settings of an actuator: the command is limited, then delayed, then lagged; zero and null switch off.

    A limit is one number for every input, or a row with one an input.
    """

    lag: float = quantity(default=0.0, unit="s", doc="time constant of the lag", least=0, structural=True)
    delay: float = quantity(
        default=0.0, unit="s", doc="dead time, a multiple of the sampling time", least=0, structural=True
    )
    lower: PerInput = quantity(
        default=None, unit="input units", doc="least input", optional=True, structural=True, rows=True
    )
    upper: PerInput = quantity(
        default=None, unit="input units", doc="largest input", optional=True, structural=True, rows=True
    )
    rate: PerInput = quantity(
        default=None,
        unit="input units/s",
        doc="largest rate of change",
        above=0,
        optional=True,
        structural=True,
        rows=True,
    )

    def wrapped(self, plant: Plant) -> Plant:
        """Return the plant behind this actuator; the plant itself where everything is switched off."""
        if self.lag > 0:
            plant = Lagged(plant=plant, time_constant=self.lag)
        try:
            plant = delayed(plant, self.delay)
        except InvalidValue as error:
            raise InvalidValue(f"actuator.{error}") from None
        if self.rate is not None:
            plant = RateLimited(plant=plant, rate=self.rate)
        if self.lower is None and self.upper is None:
            return plant
        return Saturated(plant=plant, lower=self.lower, upper=self.upper)
