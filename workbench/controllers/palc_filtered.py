"""PALC that stays stable behind lag and dead time: a lead, a zero-phase filter, and no learning while saturated."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import casadi as ca

from models.plant import Signal, signals
from models.quantity import declared, given, quantity
from workbench.contracts.law import Law, LearnedSignal, Task, Trial
from workbench.controllers.parts import zero_phase
from workbench.controllers.parts.nominal_model import NominalModel, lacking, needed
from workbench.controllers.parts.shuttle_force import base_force, errors, late_by

WRAP = 10
"""The filter runs in from the neighbouring periods over the N/WRAP nearest samples."""


class Memory(NamedTuple):
    """The line resistance that the law reads, that learned in the last period, (1, N), N, sampling time and limits."""

    d_hat: Any
    before: Any
    sampling_time: Any
    lower: Any
    """The command in N that does no more when it is lowered; minus infinity where there is none."""
    upper: Any


@declared
class FilteredPALC(Law):
    """d_hat <- Q[d_hat - k S(t - P + lead)], the force otherwise as PALC's. Ours.

    Learning happens between periods, so the whole last period is at hand: Q is a zero-phase low-pass filter, and the
    lead makes up for lag and dead time between command and force. What would lie beyond the period's end is taken
    from its beginning. Nothing is learned where the force commanded reaches a limit of the plant's, however that was
    given, or ``limit`` either way, at the sample or a lead later.
    """

    source: ClassVar[str] = "ours, after Zhang, Nan, Cao et al., PALC of a maglev train, (12)-(13)"
    learns_on: ClassVar[LearnedSignal | None] = "output"
    tells: ClassVar[tuple[Signal, ...]] = signals(line_resistance=("N", "learned line resistance"))

    model: NominalModel | None = given(default=None, doc="what the law knows of what it moves; the study gives it")
    late: int = given(default=0, doc="samples by which the assumed period is too long; the study gives its own")
    limit: float | None = given(default=None, doc="largest force in N beside the plant's own limits")
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

    def refusal(self, study: Any) -> str | None:
        """Return the refusal of a study that gives no model, or whose sampling time or period admit no such filter."""
        step = float(study.plant.sampling_time)
        nyquist = 0.5 / step
        if self.q_cutoff_hz is not None and self.q_cutoff_hz >= nyquist:
            return f"q_cutoff_hz must lie below half the sampling frequency, {nyquist:g} Hz, got {self.q_cutoff_hz:g}"
        if self.lead_s >= study.horizon * step:
            return f"lead_s must lie below the period of {study.horizon * step:g} s, got {self.lead_s:g}"
        return lacking(self, self.model)

    def start(self, task: Task) -> Memory:
        """Return nothing learned."""
        nothing = ca.DM.zeros(1, task.samples)
        own = None if self.limit is None else -self.limit
        limits = task.limits.tightened(own, self.limit)
        return Memory(nothing, nothing, task.sampling_time, limits.lower, limits.upper)

    def act(self, memory_k: Memory, state: Any, r: Any, r_next: Any, y: Any) -> tuple[Any, Any]:
        """Return the force with the line resistance as learned up to the last period."""
        e = errors(r, y, self.lam)
        acceleration = (r_next[1] - r[1]) / memory_k.sampling_time
        return (
            base_force(needed(self, self.model), e, acceleration, y[1], self.alpha, self.lam) + memory_k.d_hat,
        ), state

    def learn(self, memory: Memory, trial: Trial) -> Memory:
        """Return what was learned, as the next period will read it."""
        model = needed(self, self.model)
        ahead = round(self.lead_s / model.sampling_time)
        s = _turned(errors(trial.r, trial.y, self.lam).s[:, :-1], ahead)
        free = ca.logic_and(trial.u > memory.lower, trial.u < memory.upper)
        s = ca.if_else(ca.logic_and(free, _turned(free, ahead)), s, 0)
        d_hat = memory.d_hat - self.gamma * model.mass * s
        if self.q_cutoff_hz is not None:
            wrap = d_hat.shape[1] // WRAP
            wide = ca.horzcat(d_hat[:, -wrap:], d_hat, d_hat[:, :wrap])
            d_hat = zero_phase.low_pass(wide, self.q_cutoff_hz, memory.sampling_time)[:, wrap:-wrap]
        return memory._replace(d_hat=late_by(self.late, memory.before, d_hat), before=d_hat)

    def tell(self, memory: Memory, trial: Trial) -> Any:
        """Return the learned line resistance that the period ran with."""
        return (memory.d_hat,)


def _turned(row: Any, ahead: int) -> Any:
    """Return the row read ``ahead`` samples later, its beginning following its end."""
    return ca.horzcat(row[:, ahead:], row[:, :ahead]) if ahead else row
