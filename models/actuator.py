"""What lies between a command and a plant: limits, dead time and lag, as wrappers round any plant.

Each wrapper is itself a plant with the inner plant's inputs, outputs and disturbances; its own states stand after
the inner plant's and begin at zero. They nest: ``Saturated(plant=Delayed(plant=Lagged(plant=motor, ...), ...))``
limits the command, then delays it, then lags it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import casadi as ca

from models.limits import Limits
from models.plant import Plant, Signal
from models.quantity import InvalidValue, count, declared, part, quantity


class Wrapper(Plant):
    """What all wrappers share: inputs, outputs, disturbances and sampling time are those of the inner plant.

    The inner plant's states come first; a wrapper's own are not recorded by runs.
    """

    plant: Plant

    @property
    def sampling_time(self) -> Any:  # type: ignore[override]  # that of the inner plant
        """The inner plant's sampling time."""
        return self.plant.sampling_time

    @property
    def inputs(self) -> Any:  # type: ignore[override]  # those of the inner plant
        """Inputs of the inner plant."""
        return self.plant.inputs

    @property
    def outputs(self) -> Any:  # type: ignore[override]  # those of the inner plant
        """Outputs of the inner plant."""
        return self.plant.outputs

    @property
    def disturbances(self) -> Any:  # type: ignore[override]  # those of the inner plant
        """Disturbances of the inner plant."""
        return self.plant.disturbances

    @property
    def input_limits(self) -> Limits:
        """Limits of the inner plant: a command beyond them does no more, also behind a lag or a dead time."""
        return self.plant.input_limits

    def output(self, x: Any) -> Any:
        """Return the outputs of the inner plant."""
        return self.plant.measured(x.vector[: len(self.plant.states)])


def _own(inputs: Sequence[Signal], suffix: str, doc: str) -> tuple[Signal, ...]:
    return tuple(Signal(f"{one.name}_{suffix}", one.unit, f"{doc} {one.doc or one.name}", False) for one in inputs)


@declared
class Delayed(Wrapper):
    """A plant whose inputs arrive ``samples`` sampling times late; before that they are zero.

    The states added are the commands under way, the oldest first. :func:`delayed` takes the delay in seconds.
    """

    source: ClassVar[str] = "ours"

    plant: Plant = part(doc="the plant behind the dead time")
    samples: int = count(unit="samples", doc="dead time", least=1)

    @property
    def states(self) -> Any:  # type: ignore[override]  # those of the inner plant and its own
        """States of the inner plant, then the commands under way, the oldest first."""
        waiting = range(self.samples, 0, -1)
        return (
            *self.plant.states,
            *(own for age in waiting for own in _own(self.plant.inputs, f"{age}_ago", f"command {age} sample(s) ago:")),
        )

    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        """Return the next state: the oldest command reaches the inner plant, the new one joins the queue."""
        n, m = len(self.plant.states), len(self.plant.inputs)
        inner, queue = x.vector[:n], x.vector[n:]
        return ca.vertcat(self.plant.next_state(inner, queue[:m], w.vector, k), ca.vertcat(queue, u.vector)[m:])

    def applied(self, x: Any, u: Any, k: Any) -> Any:
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
    def states(self) -> Any:  # type: ignore[override]  # those of the inner plant and its own
        """States of the inner plant, then the lagged inputs."""
        return (*self.plant.states, *_own(self.plant.inputs, "lagged", "lagged"))

    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        """Return the next state; the inner plant sees the lagged input's mean over the sample."""
        n = len(self.plant.states)
        inner, lagged = x.vector[:n], x.vector[n:]
        kept = ca.exp(-self.sampling_time / self.time_constant)
        follows = u.vector + (lagged - u.vector) * kept
        return ca.vertcat(self.plant.next_state(inner, self._mean(lagged, u.vector), w.vector, k), follows)

    def applied(self, x: Any, u: Any, k: Any) -> Any:
        """Return what acts inside for the lagged input's mean over the sample."""
        n = len(self.plant.states)
        return self.plant.applied_input(x.vector[:n], self._mean(x.vector[n:], u.vector), k)

    def _mean(self, lagged: Any, command: Any) -> Any:
        ratio = self.sampling_time / self.time_constant
        return command + (lagged - command) * (1 - ca.exp(-ratio)) / ratio


@declared
class Saturated(Wrapper):
    """A plant whose inputs are cut at a lower and an upper limit, the same for every input; null is no limit."""

    source: ClassVar[str] = "ours"

    plant: Plant = part(doc="the plant behind the limits")
    lower: float | None = quantity(default=None, unit="input units", doc="least input", optional=True)
    upper: float | None = quantity(default=None, unit="input units", doc="largest input", optional=True)

    def check(self) -> None:
        """Raise InvalidValue unless the lower limit lies below the upper one."""
        if isinstance(self.lower, float) and isinstance(self.upper, float) and self.lower >= self.upper:
            raise InvalidValue(f"lower must lie below upper, got {self.lower!r} and {self.upper!r}")

    @property
    def states(self) -> Any:  # type: ignore[override]  # those of the inner plant
        """States of the inner plant."""
        return self.plant.states

    @property
    def input_limits(self) -> Limits:
        """Limits of the inner plant and these."""
        return self.plant.input_limits.tightened(self.lower, self.upper)

    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        """Return the inner plant's next state for the limited input."""
        return self.plant.next_state(x.vector, self.limited(u.vector), w.vector, k)

    def applied(self, x: Any, u: Any, k: Any) -> Any:
        """Return what acts inside for the limited input."""
        return self.plant.applied_input(x.vector, self.limited(u.vector), k)

    def limited(self, u: Any) -> Any:
        """Return the inputs cut at the limits, same shape."""
        u = u if self.upper is None else ca.fmin(u, self.upper)
        return u if self.lower is None else ca.fmax(u, self.lower)


@declared
class RateLimited(Wrapper):
    """A plant whose inputs follow the command at a limited rate, the same for every input.

    The states added are the inputs of the last sample.
    """

    source: ClassVar[str] = "ours"

    plant: Plant = part(doc="the plant behind the rate limit")
    rate: float = quantity(unit="input units/s", doc="largest rate of change", above=0)

    @property
    def states(self) -> Any:  # type: ignore[override]  # those of the inner plant and its own
        """States of the inner plant, then the inputs of the last sample."""
        return (*self.plant.states, *_own(self.plant.inputs, "before", "last sample's"))

    @property
    def input_limits(self) -> Limits:
        """Limits of the inner plant and this rate."""
        return self.plant.input_limits.tightened(rate=self.rate)

    def step(self, x: Any, u: Any, w: Any, k: Any) -> Any:
        """Return the next state for an input that moves towards the command."""
        n = len(self.plant.states)
        moved = self._moved(x.vector[n:], u.vector)
        return ca.vertcat(self.plant.next_state(x.vector[:n], moved, w.vector, k), moved)

    def applied(self, x: Any, u: Any, k: Any) -> Any:
        """Return what acts inside for the input that moves towards the command."""
        n = len(self.plant.states)
        return self.plant.applied_input(x.vector[:n], self._moved(x.vector[n:], u.vector), k)

    def _moved(self, before: Any, command: Any) -> Any:
        most = self.rate * self.sampling_time
        return before + ca.fmin(ca.fmax(command - before, -most), most)


def delayed(plant: Plant, delay: float) -> Plant:
    """Return the plant behind a dead time in seconds; the plant itself for 0.

    Raises InvalidValue unless the delay is a multiple of the sampling time, 0 or more.
    """
    samples = round(delay / plant.sampling_time)
    if delay < 0 or abs(samples * plant.sampling_time - delay) > 1e-9 * max(1.0, delay):
        raise InvalidValue(
            f"delay must be a multiple of the sampling time of {plant.sampling_time:g} s, 0 or more, got {delay!r}"
        )
    return Delayed(plant=plant, samples=samples) if samples else plant


@declared
class Actuator:
    """Settings of an actuator: the command is limited, then delayed, then lagged; zero and null switch off."""

    lag: float = quantity(default=0.0, unit="s", doc="time constant of the lag", least=0, structural=True)
    delay: float = quantity(
        default=0.0, unit="s", doc="dead time, a multiple of the sampling time", least=0, structural=True
    )
    lower: float | None = quantity(default=None, unit="input units", doc="least input", optional=True, structural=True)
    upper: float | None = quantity(
        default=None, unit="input units", doc="largest input", optional=True, structural=True
    )
    rate: float | None = quantity(
        default=None, unit="input units/s", doc="largest rate of change", above=0, optional=True, structural=True
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
