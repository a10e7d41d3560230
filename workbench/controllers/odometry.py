"""Laws that feed back position and speed, where only the speed is measured."""

from __future__ import annotations

from collections import namedtuple
from typing import Any, ClassVar

import casadi as ca

from models.quantity import declared, part, quantity
from workbench.contracts.law import Law, LearnedSignal, Task, Trial


@declared
class Odometry(Law):
    """A law whose outputs are position (m) and speed (m/s), given the speed alone: the position is integrated.

    Ours. Position and reference position are sums of speed times the sampling time, from 0 at the beginning of a
    trial; the law's input times ``input_unit`` is the plant's. Where the law would move the initial state, it is
    left alone. The law must keep ``sampling_time`` in its memory.
    """

    source: ClassVar[str] = "ours, 2026: an adapter, the law within has its own source"

    law: Law = part(doc="the law within")
    speed_unit: float = quantity(default=1.0, unit="output per m/s", doc="the plant's speed unit", above=0)
    input_unit: float = quantity(default=1.0, unit="plant's input/input", doc="the law's input unit", above=0)

    @property
    def learns_on(self) -> LearnedSignal | None:  # type: ignore[override]  # what the law within learns on
        """What the law within learns on."""
        return self.law.learns_on

    def refusal(self, study: Any) -> str | None:
        """Return the refusal of a plant that does not measure a speed, or the law's own."""
        if len(study.plant.outputs) != 1 or study.plant.outputs[0].name != "speed":
            return f"{type(self.law).__name__} on odometry needs a plant that measures a speed, nothing else"
        return self.law.refusal(study)

    def start(self, task: Task) -> Any:
        """Return the law's memory for the reference of position and speed."""
        v = task.reference[0, :] / self.speed_unit
        if isinstance(v, ca.DM):
            x = ca.horzcat(0, ca.cumsum(v[:, :-1]) * task.sampling_time)
        else:
            step = ca.Function("step", [at := ca.MX.sym("x"), dx := ca.MX.sym("dx")], [at + dx])
            x = ca.horzcat(0, step.mapaccum("integrate", task.samples)(0, v[:, :-1] * task.sampling_time))
        return self.law.start(Task(ca.vertcat(x, v), task.sampling_time, task.limits.scaled(self.input_unit)))

    def ready(self, memory: Any) -> Any:
        """Return the law's state, with position and reference position 0."""
        return self._state(self.law.ready(memory), 0, 0)

    def act(self, memory_k: Any, state: Any, r: Any, r_next: Any, y: Any) -> tuple[Any, Any]:
        """Return the law's input at position and speed, and the state after a sample."""
        v, v_r, v_next = y[0] / self.speed_unit, r[0] / self.speed_unit, r_next[0] / self.speed_unit
        ahead = state.reference_position + memory_k.sampling_time * v_r
        u, inner = self.law.act(
            memory_k,
            self._inner(memory_k, state),
            ca.vertcat(state.reference_position, v_r),
            ca.vertcat(ahead, v_next),
            ca.vertcat(state.position, v),
        )
        u = u[0] if isinstance(u, tuple) else u
        return u * self.input_unit, self._state(inner, state.position + memory_k.sampling_time * v, ahead)

    def learn(self, memory: Any, trial: Trial) -> Any:
        """Return what the law learns from positions and speeds."""
        if self.law.learns_on is None:
            return memory
        y = ca.vertcat(ca.horzcat(0, trial.state.position), trial.y / self.speed_unit)
        r = ca.vertcat(ca.horzcat(0, trial.state.reference_position), trial.r / self.speed_unit)
        inner = self._inner(memory, trial.state)
        return self.law.learn(memory, Trial(r, y, r - y, trial.u / self.input_unit, trial.reached, inner))

    def _state(self, inner: Any, position: Any, reference_position: Any) -> Any:
        names = [*getattr(inner, "_fields", ()), "position", "reference_position"]
        make: Any = namedtuple  # the fields depend on the law within
        return make("OdometryState", names)(*inner, position, reference_position)

    def _inner(self, memory: Any, state: Any) -> Any:
        """Return the law's own part of a state, in its own type."""
        if not self.law.keeps_state:
            return ()
        return type(self.law.ready(memory))(*state[:-2])
