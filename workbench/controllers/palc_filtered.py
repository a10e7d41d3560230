"""PALC that stays stable behind lag and dead time: a lead, a zero-phase filter, and no learning while saturated."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import ClassVar, NamedTuple, Self

import casadi as ca

from models.expression import Expression, Number
from models.plant import Signal, signals
from models.quantity import InvalidValue, count, declared, given, quantity, rebuilt
from models.vehicle import Vehicle
from workbench.contracts.law import Channels, Law, LearnedSignal, Task, Trial
from workbench.controllers.parts import zero_phase
from workbench.controllers.parts.rows import zeros
from workbench.controllers.parts.shuttle_force import base_force, errors, late_by, overlong
from workbench.controllers.parts.vehicle_model import believed, lacking, needed

WRAP = 10
"""The filter runs in from the neighbouring periods over the N/WRAP nearest samples."""


class Memory(NamedTuple):
    """The line resistance that the law reads, that learned in the last period, (1, N), N, sampling time and limits."""

    d_hat: Expression
    before: Expression
    sampling_time: Expression
    lower: Number
    """The command in N that does no more when it is lowered; minus infinity where there is none."""
    upper: Number


@declared
class FilteredPALC(Law[Memory, tuple[()]]):
    """d_hat <- Q[d_hat - k S(t - P + lead)], the force otherwise as PALC's. Ours.

    Learning happens between periods, so the whole last period is at hand: Q is a zero-phase low-pass filter, and the
    lead makes up for lag and dead time between command and force. What would lie beyond the period's end is taken
    from its beginning. Nothing is learned where the force commanded reaches a limit of the plant's, however that was
    given, or ``limit`` either way, at the sample or a lead later.
    """

    source: ClassVar[str] = "ours, after Zhang, Nan, Cao et al., PALC of a maglev train, (12)-(13)"
    channels: ClassVar[Channels] = Channels(outputs=2, inputs=1)
    told: ClassVar[tuple[str, ...]] = ("reference", "limits", "model")
    learns_on: ClassVar[LearnedSignal | None] = "output"
    tells: ClassVar[tuple[Signal, ...]] = signals(line_resistance=("N", "learned line resistance"))

    model: Vehicle | None = given(default=None, doc="what the law knows of what it moves; None: as the task says")
    late: int = count(
        default=0, unit="samples", doc="by how much the assumed period is too long; below 0: too short", least=-math.inf
    )
    limit: float | None = quantity(
        default=None,
        unit="N",
        doc="largest force either way beside the plant's own limits; null: none",
        above=0,
        optional=True,
        structural=True,
    )
    alpha: float = quantity(default=0.4, unit="1/s", doc="gain on S", above=0)
    lam: float = quantity(default=0.22, unit="1/s", doc="weight of the position error in S", above=0)
    gamma: float = quantity(default=0.2, unit="1/s", doc="learning gain k over the mass", above=0)
    q_cutoff_hz: float | None = quantity(
        default=0.5,
        unit="Hz",
        doc="cutoff of the zero-phase low-pass filter Q; null: none",
        above=0,
        optional=True,
        structural=True,
    )
    lead_s: float = quantity(
        default=1.0, unit="s", doc="lead of S, taken to the nearest sample", least=0, structural=True
    )
    ahead: int | None = given(default=None, doc="the lead in samples of the task that it was made ready for")

    def ready_for(self, task: Task) -> Self:
        """Return the law with its lead in samples, and with the task's model, where it was given none of its own."""
        ahead = round(self.lead_s / float(task.sampling_time))
        return rebuilt(self, {"model": believed(self.model, task), "ahead": ahead})

    def refusal(self, task: Task) -> str | None:
        """Return the refusal of a task whose sampling time or period admit no such filter, or that gives no model."""
        step = float(task.sampling_time)
        nyquist = 0.5 / step
        if self.q_cutoff_hz is not None and self.q_cutoff_hz >= nyquist:
            return f"q_cutoff_hz must lie below half the sampling frequency, {nyquist:g} Hz, got {self.q_cutoff_hz:g}"
        if self.lead_s >= task.samples * step:
            return f"lead_s must lie below the period of {task.samples * step:g} s, got {self.lead_s:g}"
        return lacking(self, believed(self.model, task)) or overlong(self.late, task)

    def start(self, task: Task) -> Memory:
        """Return nothing learned."""
        nothing = zeros(1, task.samples)
        own = None if self.limit is None else -self.limit
        limits = task.limits.tightened(own, self.limit)
        return Memory(nothing, nothing, task.sampling_time, limits.lower, limits.upper)

    def act(
        self, memory_k: Memory, state: tuple[()], r: Expression, r_next: Expression, y: Expression
    ) -> tuple[tuple[Expression], tuple[()]]:
        """Return the force with the line resistance as learned up to the last period."""
        e = errors(r, y, self.lam)
        acceleration = (r_next[1] - r[1]) / memory_k.sampling_time
        return (
            base_force(needed(self, self.model), e, acceleration, y[1], self.alpha, self.lam) + memory_k.d_hat,
        ), state

    def learn(self, memory: Memory, trial: Trial[tuple[()]]) -> Memory:
        """Return what was learned, as the next period will read it."""
        model = needed(self, self.model)
        ahead = self._lead(model)
        s = _turned(errors(trial.r, trial.y, self.lam).s[:, :-1], ahead)
        free = ca.logic_and(trial.u > memory.lower, trial.u < memory.upper)
        s = ca.if_else(ca.logic_and(free, _turned(free, ahead)), s, 0)
        d_hat = memory.d_hat - self.gamma * model.mass * s
        if self.q_cutoff_hz is not None:
            wrap = d_hat.shape[1] // WRAP
            wide = ca.horzcat(d_hat[:, -wrap:], d_hat, d_hat[:, :wrap])
            d_hat = zero_phase.low_pass(wide, self.q_cutoff_hz, memory.sampling_time)[:, wrap:-wrap]
        return memory._replace(d_hat=late_by(self.late, memory.before, d_hat), before=d_hat)

    def tell(self, memory: Memory, trial: Trial[tuple[()]]) -> tuple[Expression]:
        """Return the learned line resistance that the period ran with."""
        return (memory.d_hat,)

    def ranges(self, task: Task) -> Mapping[str, tuple[float, float]]:
        """Return the gains to tune, which the mass and the time that the law knows make independent of the plant."""
        return {"alpha": (0.05, 20.0), "lam": (1e-3, 5.0), "gamma": (1e-3, 5.0)}

    def scaled_for(self, task: Task) -> Self:
        """Return the law with a lead of the plant's relative degree, and a cutoff that the sampling time admits."""
        step = float(task.sampling_time)
        cutoff = None if self.q_cutoff_hz is None else min(self.q_cutoff_hz, 0.1 / step)
        return dataclasses.replace(self, q_cutoff_hz=cutoff, lead_s=step * (task.relative_degree or 1))

    def _lead(self, model: Vehicle) -> int:
        """Return the lead in samples: of the task, for a law that was made ready, else of its model."""
        if self.ahead is not None:
            return self.ahead
        if not isinstance(model.sampling_time, float):
            raise InvalidValue("FilteredPALC must be made ready for its task first: law.ready_for(task)")
        return round(self.lead_s / model.sampling_time)


def _turned(row: Expression, ahead: int) -> Expression:
    """Return the row read ``ahead`` samples later, its beginning following its end."""
    return ca.horzcat(row[:, ahead:], row[:, :ahead]) if ahead else row
