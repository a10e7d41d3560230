"""Laws that feed back position and speed, where only the speed is measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, Generic, NamedTuple, Self, TypeVar

import casadi as ca

from models.expression import Expression
from models.plant import Signal
from models.quantity import InvalidValue, declared, part, quantity, rebuilt
from workbench.contracts.law import Law, LearnedSignal, SlopeLearning, Task, Trial
from workbench.controllers.parts.rows import joined, zeros
from workbench.controllers.parts.scales import scales
from workbench.graph.dimensions import how_many

M = TypeVar("M", bound=tuple[object, ...])
S = TypeVar("S", bound=tuple[object, ...])


class Memory(NamedTuple, Generic[M]):
    """The memory of the law within, and the sampling time in s."""

    inner: M
    sampling_time: Expression


class State(NamedTuple, Generic[S]):
    """The acting state of the law within, and the positions so far, in m."""

    inner: S
    position: Expression
    reference_position: Expression


@declared
class Odometry(Law[Memory[M], State[S]], Generic[M, S]):
    """A law whose outputs are position (m) and speed (m/s), given the speed alone: the position is integrated.

    Ours. Position and reference position are sums of speed times the sampling time, from 0 at the beginning of a
    trial; the law's input times ``input_unit`` is the plant's. The plant's output is known as a speed by its role, and
    its unit is looked up. Where the law would move the initial state, it is left alone.
    """

    source: ClassVar[str] = "ours, 2026: an adapter, the law within has its own source"

    law: Law[M, S] = part(doc="the law within")
    speed_unit: float | None = quantity(
        default=None,
        unit="output per m/s",
        doc="the plant's speed unit; null: that of its output",
        above=0,
        optional=True,
    )
    input_unit: float = quantity(default=1.0, unit="plant's input/input", doc="the law's input unit", above=0)

    @property
    def learns_on(self) -> LearnedSignal | None:  # type: ignore[override]  # what the law within learns on
        """What the law within learns on."""
        return self.law.learns_on

    @property
    def told(self) -> tuple[str, ...]:  # type: ignore[override]  # what the law within uses
        """What the law within uses."""
        return self.law.told

    @property
    def tells(self) -> tuple[Signal, ...]:  # type: ignore[override]  # what the law within tells
        """What the law within tells."""
        return self.law.tells

    @property
    def solves_per_sample(self) -> int:  # type: ignore[override]  # what the law within solves
        """How many optimisation problems the law within solves at a sample."""
        return self.law.solves_per_sample

    def ready_for(self, task: Task) -> Self:
        """Return the law with the plant's speed unit, and the law within made ready for position and speed."""
        ready = self._knowing(task)
        return rebuilt(ready, {"law": self.law.ready_for(ready.within(task))})

    def ranges(self, task: Task) -> Mapping[str, tuple[float, float]]:
        """Return the ranges of the law within, and of the input unit where that law knows no model."""
        knowing = self._knowing(task)
        found = {f"law.{name}": ends for name, ends in self.law.ranges(knowing.within(task)).items()}
        if "model" in self.law.told:
            return found
        unit = abs(scales(task).rate) * knowing._known_unit
        return {**found, "input_unit": (0.05 * unit, 2 * unit)}

    def scaled_for(self, task: Task) -> Self:
        """Return the law with settings from which tuning can begin, its unit a force per mass where it knows none."""
        knowing = self._knowing(task)
        unit = self.input_unit if "model" in self.law.told else abs(scales(task).rate) * knowing._known_unit
        return rebuilt(self, {"law": self.law.scaled_for(knowing.within(task)), "input_unit": unit})

    @property
    def origin(self) -> str:
        """The source of the law within."""
        return self.law.source

    @property
    def slope_learning(self) -> SlopeLearning | None:
        """That of the law within, in the plant's units; made ready for the task first."""
        within = self.law.slope_learning
        return None if within is None else within._replace(unit=within.unit * self.input_unit / self._known_unit)

    def refusal(self, task: Task) -> str | None:
        """Return the refusal of a plant that does not measure a speed, or the law's own."""
        name = type(self.law).__name__
        measured = [] if task.model is None else [signal.role for signal in task.model.outputs]
        if measured != ["speed"]:
            return f"{name} on odometry needs a plant that measures a speed, nothing else"
        if self.law.stepped:
            return f"{name} decides in numbers, sample by sample: on odometry a law must act in expressions"
        if not self.law.channels.admits(2, 1):
            return f"{name} must be a law of one input for two outputs, position and speed, to be used on odometry"
        try:
            ready = self._knowing(task)
        except InvalidValue as error:
            return str(error)
        return self.law.refusal(ready.within(task))

    def chance(self, seed: int) -> Sequence[float]:
        """Return the random numbers of the law within."""
        return self.law.chance(seed)

    def within(self, task: Task) -> Task:
        """Return what the law within is told: position and speed as its reference, limits and plan in its unit."""
        v = task.reference[0, :] / self._known_unit
        if isinstance(v, ca.DM):
            x = ca.horzcat(0, ca.cumsum(v[:, :-1]) * task.sampling_time)
        else:
            step = ca.Function("step", [at := ca.MX.sym("x"), dx := ca.MX.sym("dx")], [at + dx])
            x = ca.horzcat(0, step.mapaccum("integrate", task.samples)(0, v[:, :-1] * task.sampling_time))
        return task._replace(
            reference=ca.vertcat(x, v),
            limits=task.limits.scaled(self.input_unit),
            first_plan=None if task.first_plan is None else task.first_plan / self.input_unit,
        )

    def start(self, task: Task) -> Memory[M]:
        """Return the law's memory for the reference of position and speed."""
        return Memory(self.law.start(self.within(task)), task.sampling_time)

    def ready(self, memory: Memory[M]) -> State[S]:
        """Return the law's state, with position and reference position 0."""
        return State(self.law.ready(memory.inner), zeros(), zeros())

    def act(
        self, memory_k: Memory[M], state: State[S], r: Expression, r_next: Expression, y: Expression
    ) -> tuple[Expression, State[S]]:
        """Return the law's input at position and speed, and the state after a sample."""
        unit, step = self._known_unit, memory_k.sampling_time
        v, v_r, v_next = y[0] / unit, r[0] / unit, r_next[0] / unit
        ahead = state.reference_position + step * v_r
        u, inner = self.law.act(
            memory_k.inner,
            state.inner,
            ca.vertcat(state.reference_position, v_r),
            ca.vertcat(ahead, v_next),
            ca.vertcat(state.position, v),
        )
        return joined(u) * self.input_unit, State(inner, state.position + step * v, ahead)

    def learn(self, memory: Memory[M], trial: Trial[State[S]]) -> Memory[M]:
        """Return what the law learns from positions and speeds."""
        return Memory(self.law.learn(memory.inner, self._seen(trial)), memory.sampling_time)

    def tell(self, memory: Memory[M], trial: Trial[State[S]]) -> Sequence[Expression]:
        """Return what the law within tells."""
        return self.law.tell(memory.inner, self._seen(trial))

    def _seen(self, trial: Trial[State[S]]) -> Trial[S]:
        """Return what a trial left in positions and speeds, the input in the law's unit."""
        unit = self._known_unit
        y = ca.vertcat(ca.horzcat(0, trial.state.position), trial.y / unit)
        r = ca.vertcat(ca.horzcat(0, trial.state.reference_position), trial.r / unit)
        return Trial(r, y, r - y, trial.u / self.input_unit, trial.reached, trial.state.inner)

    def _knowing(self, task: Task) -> Self:
        """Return the law with the plant's speed unit; raise InvalidValue where it is told by nobody."""
        if self.speed_unit is not None:
            return self
        unit = "" if task.model is None else task.model.outputs[0].unit
        per_metre = how_many(unit, "m/s")
        if per_metre is None:
            raise InvalidValue(
                f"speed_unit must be given, how many of the plant's speed unit are one m/s: "
                f"its unit {unit!r} is unknown"
            )
        return rebuilt(self, {"speed_unit": per_metre})

    @property
    def _known_unit(self) -> float:
        if self.speed_unit is None:
            raise InvalidValue("Odometry must be given speed_unit, or be made ready for its task first")
        return self.speed_unit
