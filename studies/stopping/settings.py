"""The stopping study's own settings, and the plant, the tubes and the laws that they make."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import cached_property

import numpy as np

from models.array import Array
from models.brake import APPROACH, Brake
from models.braking_curve import BrakingCurve
from models.line import Line
from models.quantity import InvalidValue, choice, declared, part, quantity, table
from studies.stopping.brake_model import BrakeModel, Method, brake_model, reference_state
from studies.stopping.design import CONFIGS, Config, Control, Grade, Range, Resistance, direction, make_tube
from studies.stopping.view import BrakeView, line_ahead, speed_excess
from workbench.contracts.law import AnyLaw
from workbench.contracts.study import Study
from workbench.controllers.compensated_mpc import CompensatedMPC
from workbench.controllers.rmpc import RMPC
from workbench.controllers.rsmpc import RSMPC
from workbench.controllers.speed_pid import SpeedPID
from workbench.predictive import Tube

IDEAL_HORIZON = 10
MOST_HORIZON = 60
MOST_SAMPLES = 20_000
BLOCKS = 60
"""Blocks of a random resistance: beyond the last its value holds."""


@declared
class Stopping:
    """What shapes the stopping study: configuration, model, horizons, resistance, brake and curve."""

    config: Config = choice(default="A", options=CONFIGS, doc="range of the command, weights and tube gain")
    model: Method = choice(default="zoh", options=("zoh", "euler"), doc="model that the laws plan with")
    start: str = choice(
        default="warm", options=("warm", "cold"), doc="whether the brake already holds the reference at the start"
    )
    beta: float = quantity(
        default=1.5, unit="1", doc="how much of the decrease RSMPC may give up for holding", least=1, structural=True
    )
    horizons: tuple[float, ...] = table(default=(3, 5, 8, 10, 15), unit="samples", doc="horizons N")
    disturbance: Range = part(default=Range(), doc="resistances that the sets allow for")
    resistance: Resistance = part(default=Resistance(), doc="what resists")
    grade: Grade = part(default=Grade(), doc="the line")
    tube: Control = part(default=Control(), doc="negative controls")
    brake: Brake = part(default=Brake(), doc="brake and train")
    curve: BrakingCurve = part(default=BrakingCurve(), doc="the reference")

    def check(self) -> None:
        """Raise InvalidValue for horizons that are not whole, too short or given twice."""
        if not self.horizons:
            raise InvalidValue("horizons must name at least one horizon, got none")
        for N in self.horizons:
            if N != int(N) or not 2 <= N <= MOST_HORIZON:
                raise InvalidValue(f"horizons must be whole numbers from 2 to {MOST_HORIZON}, got {N:g}")
        if len(set(self.horizons)) != len(self.horizons):
            raise InvalidValue(f"horizons must differ, got {[int(N) for N in self.horizons]}")
        if self.brake.delay < 1:
            raise InvalidValue("brake.dead_time must be at least one sample, got 0 s")
        if self.most_samples > MOST_SAMPLES:
            raise InvalidValue(
                f"the reference must stop within {MOST_SAMPLES // 2} samples, got {self.most_samples // 2}: "
                "raise curve.deceleration or lower curve.speed"
            )

    @property
    def lengths(self) -> tuple[int, ...]:
        """The horizons as whole numbers."""
        return tuple(int(N) for N in self.horizons)

    @property
    def most_samples(self) -> int:
        """When a run is given up: twice the time of the reference."""
        return int(2 * self.curve.stop_time / self.brake.sampling_time)

    @property
    def held(self) -> float:
        """The command with which the brake acts before the run."""
        return float(reference_state(self.brake, self.curve, 0)[1]) if self.start == "warm" else 0.0

    @property
    def begin(self) -> tuple[float, ...]:
        """The state that a run begins in: the brake holds the reference, or nothing, and so does its line of commands.

        In the order of :attr:`models.brake.Halting.states`.
        """
        acceleration, _, speed, position = (float(one) for one in reference_state(self.brake, self.curve, 0))
        motion = (acceleration if self.start == "warm" else 0.0, speed, position)
        return (*motion, *(self.held,) * self.brake.delay, 0.0, 0.0)

    def reference(self) -> Array:
        """Return speed and position of the curve, also past its stop, until a run is given up, (2, samples + 1)."""
        t = np.arange(self.most_samples + 1, dtype=float) * self.brake.sampling_time
        return np.stack(self.curve.at(t))

    def braked(self, seed: int = 0) -> Brake:
        """Return the brake on its line, or with the random resistance of ``resistance.seed`` plus a seed."""
        if self.resistance.seed is not None:
            drawn = np.random.default_rng(self.resistance.seed + seed)
            values = drawn.uniform(self.disturbance.low, self.disturbance.high, BLOCKS)
            return dataclasses.replace(self.brake, blocks=tuple(values))
        grades = (*APPROACH.grade_permille[:-1], self.grade.last)
        return dataclasses.replace(self.brake, line=Line(grade_starts_m=APPROACH.grade_starts_m, grade_permille=grades))

    @cached_property
    def linear(self) -> BrakeModel:
        """The model that the laws plan with."""
        return brake_model(self.brake, self.model)

    def tube_for(self, disturbance: Range | None = None, control: Control | None = None) -> Tube:
        """Return the tube of this study, or of another disturbance or negative control.

        Raises InvalidValue where the disturbance leaves no room.
        """
        return make_tube(
            brake=self.brake,
            curve=self.curve,
            config=self.config,
            model=self.model,
            disturbance=disturbance or self.disturbance,
            control=control or self.tube,
        )

    @cached_property
    def design(self) -> Tube:
        """The tube of this study."""
        return self.tube_for()

    @property
    def view(self) -> BrakeView:
        """How the laws see the train."""
        return BrakeView(self.brake, self.curve, self.held)

    @property
    def pid(self) -> SpeedPID:
        """The PID with feed-forward."""
        return SpeedPID(
            sample_time=self.brake.sampling_time,
            low=self.config.low,
            high=self.config.high,
            feed=-self.curve.deceleration / self.brake.full_brake,
            error=speed_excess(self.curve, self.brake.sampling_time),
        )

    def ideal(self, brake: Brake) -> CompensatedMPC:
        """Return the ideal law, which knows the resistance of a brake's line and expects nothing else."""
        tube = self.tube_for(Range(low=0.0, high=0.0), Control())
        known = line_ahead(brake, self.linear)
        return CompensatedMPC(
            tube=tube, model=direction(tube, self.linear), N=IDEAL_HORIZON, view=self.view, forecast=known
        )

    def rmpc(self, N: int) -> RMPC:
        """Return the tube law of a horizon."""
        return RMPC(tube=self.design, N=N, view=self.view)

    def rsmpc(self, N: int, *, beta: float | None = None, contained: bool = True) -> RSMPC:
        """Return the self-triggered law of a horizon."""
        return RSMPC(tube=self.design, N=N, beta=beta or self.beta, contained=contained, view=self.view)

    @cached_property
    def _tubed(self) -> dict[str, AnyLaw]:
        laws: dict[str, AnyLaw] = {f"rmpc-n{N}": self.rmpc(N) for N in self.lengths}
        laws |= {f"rsmpc-n{N}": self.rsmpc(N) for N in self.lengths}
        known = direction(self.design, self.linear)
        return laws | {
            f"offset-free-n{N}": CompensatedMPC(tube=self.design, model=known, N=N, view=self.view)
            for N in self.lengths
        }

    def controllers(self, brake: Brake) -> Mapping[str, AnyLaw]:
        """Return the laws by name, the ideal one knowing a brake's line.

        Raises InvalidValue where the disturbance leaves no room.
        """
        return {"pid": self.pid, "ideal-mpc": self.ideal(brake), **self._tubed}


def own(study: Study) -> Stopping:
    """Return the settings of a stopping study."""
    assert isinstance(study.own, Stopping)
    return study.own
