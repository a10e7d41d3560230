"""One stop: a law on the braking train in continuous time, sample by sample, until the train stands."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from models.brake import Brake, Motion
from models.braking_curve import BrakingCurve
from studies.stopping.brake_model import reference_state
from workbench.controllers.compensated_mpc import CompensatedMPC
from workbench.controllers.rmpc import RMPC
from workbench.controllers.rsmpc import RSMPC
from workbench.controllers.speed_pid import SpeedPID
from workbench.predictive.decision import Decision, start
from workbench.sets.array import Array


class Seen(NamedTuple):
    """What a law is told at sample k."""

    k: int
    x: Array
    """[a_c(k), u(k-l-1), v(k), s(k)]."""
    pending: Array
    """The increments on their way, du(k-l) ... du(k-1), shape (l,)."""
    command: float
    """u(k-1)."""


Step = Callable[[Any, Seen], tuple[Decision, Any]]
"""What a law decides at a sample, and its memory for the next, given its memory (None at first)."""


class Stop(NamedTuple):
    """What a run left: one row a sample, and how it ended."""

    rows: dict[str, Array]
    position: float
    """Where the train stood first, in metres; NaN if it never did."""
    time: float
    """When, in seconds."""
    reason: str
    """Why there was no plan at the first sample without one, or empty."""


class Truth:
    """The plant in continuous time, made for many samples: its path, resistance and reference."""

    def __init__(self, brake: Brake, curve: BrakingCurve) -> None:
        self.brake, self.curve = brake, curve
        motion, acting = ca.SX.sym("motion", 3), ca.SX.sym("acting")
        here = Motion(motion[0], motion[1], motion[2])
        after, jerk = ca.vertcat(*brake.fine(here, acting, 0.0)), brake.rates(here, acting, 0.0).acceleration
        step = ca.Function("fine", [motion, acting], [after, jerk], ["motion", "acting"], ["after", "jerk"])
        self._sample = step.mapaccum("sample", brake.substeps)
        self._repeated = np.ones((1, brake.substeps))
        v, s = ca.SX.sym("v"), ca.SX.sym("s")
        self._resistance = ca.Function("resistance", [v, s], [brake.resistance(v, s)])

    def sample(self, motion: Array, acting: float) -> tuple[Array, Array]:
        """Return the motion after each fine step, (3, substeps), and the brake's jerk during it, (substeps,)."""
        path, jerk = self._sample(motion, acting * self._repeated)
        return path.full(), jerk.full().ravel()

    def resistance(self, v: float, s: float) -> float:
        """Return a_r in m/s^2."""
        return float(self._resistance(v, s))

    def reference(self, k: int) -> Array:
        """Return x_s(k), shape (4,)."""
        return reference_state(self.brake, self.curve, k)


def stepping(law: Any, truth: Truth, forecast: bool = False) -> Step:
    """Return a law of the study as a step: ``forecast`` tells a compensating law the resistance of the line ahead."""
    if isinstance(law, SpeedPID):
        return _pid(law, truth)
    if isinstance(law, CompensatedMPC):
        return _ideal(law, truth) if forecast else _offset_free(law, truth)
    return _tube(law, truth)


def _pid(law: SpeedPID, truth: Truth) -> Step:
    def step(memory: Any, seen: Seen) -> tuple[Decision, Any]:
        error = float(seen.x[2] - truth.reference(seen.k)[2])
        u, after = law.act(law.start() if memory is None else memory, error)
        return Decision(du=u - seen.command, M=1, J=np.nan, qps=0, infeasible=""), after

    return step


def _tube(law: RMPC | RSMPC, truth: Truth) -> Step:
    plant = law.tube.plant

    def step(memory: Any, seen: Seen) -> tuple[Decision, Any]:
        e = plant.predict(seen.x, seen.pending) - truth.reference(seen.k + plant.delay)
        return law.act(start() if memory is None else memory, e)

    return step


def _ideal(law: CompensatedMPC, truth: Truth) -> Step:
    plant, E = law.tube.plant, law.model.E

    def step(memory: Any, seen: Seen) -> tuple[Decision, Any]:
        x, ahead = seen.x, []
        for j in range(plant.delay + 1):  # where the resistance ahead is met depends on the resistance before
            ahead.append(truth.resistance(x[2], x[3]))
            if j < plant.delay:
                x = plant.A @ x + plant.b * seen.pending[j] + E * ahead[-1]
        e = plant.predict(seen.x, seen.pending) - truth.reference(seen.k + plant.delay)
        return law.act(start() if memory is None else memory, e, np.array(ahead))

    return step


def _offset_free(law: CompensatedMPC, truth: Truth) -> Step:
    plant = law.tube.plant

    def step(memory: Any, seen: Seen) -> tuple[Decision, Any]:
        following, before = (start(), None) if memory is None else memory
        error = seen.x - truth.reference(seen.k)
        d = 0.0 if before is None else law.model.estimate(before[0], before[1], error)
        e = plant.predict(seen.x, seen.pending) - truth.reference(seen.k + plant.delay)
        decision, following = law.act(following, e, d)
        acted = float(seen.pending[0]) if plant.delay else decision.du
        return decision, (following, (error, acted))

    return step


def brake_to_stop(truth: Truth, step: Step, *, warm: bool, most: int) -> Stop:
    """Run a law until the train stands, at most ``most`` samples.

    ``warm``: the brake already holds the reference, in the train and in the line of commands; else all is zero. The
    stop is the first time that the speed is zero, interpolated between fine steps.
    """
    brake, T = truth.brake, truth.brake.sampling_time
    begin = truth.reference(0)
    held = float(begin[1]) if warm else 0.0
    motion = np.array([begin[0] if warm else 0.0, begin[2], begin[3]])
    line = [held] * (brake.delay + 1)  # u(k-l-1) ... u(k-1)
    rows: dict[str, list[float]] = {
        name: []
        for name in (
            *("acceleration", "speed", "position", "command", "increment"),
            *("hold", "cost", "qps", "infeasible", "peak_jerk"),
        )
    }
    memory, reason, stopped = None, "", None
    for k in range(most):
        x = np.array([motion[0], line[0], motion[1], motion[2]])
        decision, memory = step(memory, Seen(k, x, np.diff(line), line[-1]))
        reason = reason or (f"sample {k}: {decision.infeasible}" if decision.infeasible else "")
        u = line[-1] + decision.du
        line = [*line, u]
        path, jerk = truth.sample(motion, line[1])
        halted = np.flatnonzero(path[1] <= 0)
        if halted.size:
            i = int(halted[0])
            before = motion if i == 0 else path[:, i - 1]
            share = before[1] / (before[1] - path[1, i])
            place = before[2] + share * (path[2, i] - before[2])
            stopped = float(place), k * T + (i + share) * brake.fine_step
            jerk = jerk[: i + 1]
        values = (*motion, u, decision.du, decision.M, decision.J, decision.qps, bool(decision.infeasible))
        for name, value in zip(rows, (*values, np.abs(jerk).max()), strict=True):
            rows[name].append(float(value))
        if stopped is not None:
            break
        motion, line = path[:, -1], line[1:]
    place, when = stopped if stopped is not None else (np.nan, np.nan)
    return Stop({name: np.array(row) for name, row in rows.items()}, place, when, reason)
