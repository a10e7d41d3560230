"""Robust self-triggered MPC of a train that stops at a mark.

Predictive laws against a PID with feed-forward; Liu, Xun, Gao & Yin (2022).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr

from models.brake import APPROACH, Brake
from models.braking_curve import BrakingCurve
from models.line import Line
from models.quantity import InvalidValue, choice, count, declared, given, part, quantity, table
from studies.stopping.brake_model import BrakeModel, brake_model
from studies.stopping.design import (
    CONFIGS,
    Config,
    Control,
    Grade,
    Range,
    Resistance,
    design_document,
    direction,
    make_tube,
)
from workbench.contracts.study import Progress, Scores, Study
from workbench.predictive import Tube

IDEAL_HORIZON = 10
MOST_HORIZON = 60
MOST_SAMPLES = 20_000
BLOCKS = 60
"""Blocks of a random resistance: beyond the last its value holds."""


@declared
class Stopping(Study):
    """A train brakes to a stop at a mark, under a PID with feed-forward, an ideal MPC and tube MPCs of several
    horizons.
    """

    name: str = given(default="stopping", doc="name, used for folders and reports")
    title: str = given(default="Robust self-triggered MPC of a train that stops at a mark", doc="title")
    source: str = given(
        default="Liu, Xun, Gao & Yin, Acta Automatica Sinica 48(1), 2022, doi 10.16383/j.aas.c200039", doc="source"
    )
    config: Config = choice(default="A", options=CONFIGS, doc="range of the command, weights and tube gain")
    model: str = choice(default="zoh", options=("zoh", "euler"), doc="model that the laws plan with")
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
    seed: int = count(default=0, doc="seed of the checks' random runs", most=2**53)

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

    @cached_property
    def plant(self) -> Brake:
        """The plant in continuous time, with the line or the random resistance of this study."""
        if self.resistance.seed is not None:
            drawn = np.random.default_rng(self.resistance.seed)
            values = drawn.uniform(self.disturbance.low, self.disturbance.high, BLOCKS)
            return dataclasses.replace(self.brake, blocks=tuple(values))
        grades = (*APPROACH.grade_permille[:-1], self.grade.last)
        return dataclasses.replace(self.brake, line=Line(grade_starts_m=APPROACH.grade_starts_m, grade_permille=grades))

    @cached_property
    def linear(self) -> BrakeModel:
        """The model that the laws plan with."""
        return brake_model(self.brake, self.model)  # type: ignore[arg-type]  # a choice of the two

    def tube_for(self, disturbance: Range | None = None, control: Control | None = None) -> Tube:
        """Return the tube of this study, or of another disturbance or negative control.

        Raises InvalidValue where the disturbance leaves no room.
        """
        return make_tube(
            brake=self.brake,
            curve=self.curve,
            config=self.config,
            model=self.model,  # type: ignore[arg-type]  # a choice of the two
            disturbance=disturbance or self.disturbance,
            control=control or self.tube,
        )

    @cached_property
    def design(self) -> Tube:
        """The tube of this study."""
        return self.tube_for()

    @cached_property
    def controllers(self) -> Mapping[str, Any]:
        """The laws by name. Raises InvalidValue where the disturbance leaves no room."""
        from workbench.controllers.compensated_mpc import CompensatedMPC
        from workbench.controllers.rmpc import RMPC
        from workbench.controllers.rsmpc import RSMPC
        from workbench.controllers.speed_pid import SpeedPID

        tube = self.design
        undisturbed = self.tube_for(Range(low=0.0, high=0.0), Control())
        laws: dict[str, Any] = {
            "pid": SpeedPID(
                sample_time=self.brake.sampling_time,
                low=self.config.low,
                high=self.config.high,
                feed=-self.curve.deceleration / self.brake.full_brake,
            ),
            "ideal-mpc": CompensatedMPC(tube=undisturbed, model=direction(undisturbed, self.linear), N=IDEAL_HORIZON),
        }
        laws |= {f"rmpc-n{N}": RMPC(tube=tube, N=N) for N in self.lengths}
        laws |= {f"rsmpc-n{N}": RSMPC(tube=tube, N=N, beta=self.beta) for N in self.lengths}
        known = direction(tube, self.linear)
        laws |= {f"offset-free-n{N}": CompensatedMPC(tube=tube, model=known, N=N) for N in self.lengths}
        return laws

    @property
    def most_samples(self) -> int:
        """When a run is given up: twice the time of the reference."""
        return int(2 * self.curve.stop_time / self.brake.sampling_time)

    def simulate(self, progress: Progress) -> xr.Dataset:
        """Run every law; see :class:`workbench.contracts.study.Study`."""
        from studies.stopping.record import dataset
        from studies.stopping.run import Truth, brake_to_stop, stepping

        truth, stops = Truth(self.plant, self.curve), {}
        with progress(len(self.controllers), self.name) as advance:
            for name, law in self.controllers.items():
                step = stepping(law, truth, forecast=name == "ideal-mpc")
                stops[name] = brake_to_stop(truth, step, warm=self.start == "warm", most=self.most_samples)
                advance(1)
        return dataset(self, stops)

    def scores(self, data: xr.Dataset) -> Scores:
        """Return the metrics of every law."""
        from studies.stopping.scores import scores

        return scores(self, data)

    def documents(self, data: xr.Dataset) -> Mapping[str, Any]:
        """Return what is written beside run.nc: the design."""
        return {"design.json": design_document(self.design, self.linear, max(self.lengths))}

    def figures(self, data: xr.Dataset) -> Mapping[str, Callable[[], Any]]:
        """Return the figures by name, each a function that draws."""
        from studies.stopping.figures import stopping_figures

        return stopping_figures(self, data)


STUDY = Stopping()
