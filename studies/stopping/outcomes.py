"""Stops beyond those of a stopping campaign: other resistances inside W, models, gains and trade-offs."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from models.brake import Brake
from studies.stopping.record import UPDATE
from studies.stopping.run import Truth, brake_to_stop, stepping
from studies.stopping.study import Stopping
from workbench.contracts.verdict import Finding, Standing
from workbench.controllers.rsmpc import RSMPC
from workbench.controllers.speed_pid import SpeedPID

LIMIT_CM = 50.0
"""The stopping window, plus and minus."""


class Outcome(NamedTuple):
    """How one stop went."""

    error_cm: float
    """NaN where the train never stopped."""
    updates: int


def stop(study: Stopping, law: Any, *, plant: Brake | None = None, forecast: bool = False) -> Outcome:
    """Run one law of a stopping study, on the study's plant or another."""
    truth = Truth(plant or study.plant, study.curve)
    step = stepping(law, truth, forecast=forecast)
    left = brake_to_stop(truth, step, warm=study.start == "warm", most=study.most_samples)
    return Outcome(
        100 * (left.position - study.curve.stop_position),
        int((np.abs(left.rows["increment"]) > UPDATE).sum()),
    )


def within_window(error_cm: float) -> bool:
    """Tell whether a stop lies in the window; a train that never stopped does not."""
    return bool(abs(error_cm) <= LIMIT_CM)


def random_plant(study: Stopping, seed: int) -> Brake:
    """Return the plant with the random resistance inside W that ``resistance.seed`` stands for."""
    resistance = dataclasses.replace(study.resistance, seed=seed)
    return dataclasses.replace(study, resistance=resistance).plant


def robustly_within(study: Stopping, name: str, seeds: Iterable[int]) -> Finding:
    """The law stops within the window whatever the resistance in W: its two ends held, then random ones."""
    law, forecast = study.controllers[name], name == "ideal-mpc"
    tried, worst, witness = 0, -1.0, {}
    for value in (study.disturbance.high, study.disturbance.low):
        plant = dataclasses.replace(study.brake, blocks=(value,))
        error = stop(study, law, plant=plant, forecast=forecast).error_cm
        tried += 1
        if abs(error) > worst or np.isnan(error):
            worst, witness = abs(error), {"setting": f"brake.blocks=[{value!r}]", "stop_error_cm": error}
        if not within_window(error):
            return _beyond(error, tried, witness)
    for seed in seeds:
        error = stop(study, law, plant=random_plant(study, seed), forecast=forecast).error_cm
        tried += 1
        if abs(error) > worst or np.isnan(error):
            worst, witness = abs(error), {"setting": f"resistance.seed={seed}", "stop_error_cm": error}
        if not within_window(error):
            return _beyond(error, tried, witness)
    return Finding(
        standing=Standing.SUPPORTED,
        margin=LIMIT_CM - worst,
        unit="cm",
        witness=witness,
        method=f"{tried} resistances inside W: both ends held, then random by blocks of position",
    )


def _beyond(error: float, tried: int, witness: dict[str, Any]) -> Finding:
    return Finding(
        standing=Standing.REFUTED,
        margin=LIMIT_CM - abs(error),
        unit="cm",
        witness=witness,
        method=f"stop number {tried} of resistances inside W; run the study with the witness's setting to see it again",
    )


class Share(NamedTuple):
    """With which share of some resistances a law stops in the window, and its worst stop."""

    share: float
    worst_cm: float


def share_within(study: Stopping, name: str, plants: Iterable[Brake]) -> Share:
    """Run a law on several plants."""
    law = study.controllers[name]
    errors = [stop(study, law, plant=plant).error_cm for plant in plants]
    return Share(float(np.mean([within_window(error) for error in errors])), float(np.nanmax(np.abs(errors))))


def held_plants(study: Stopping, number: int) -> list[Brake]:
    """Return plants whose resistance is the same everywhere, spread evenly over W."""
    low, high = study.disturbance.low, study.disturbance.high
    values = low + (high - low) * (np.arange(number) + 0.5) / number
    return [dataclasses.replace(study.brake, blocks=(float(value),)) for value in values]


def ideal_with(study: Stopping, model: str) -> Outcome:
    """Return how the ideal MPC stops when it plans with another model."""
    other = dataclasses.replace(study, model=model)
    return stop(other, other.controllers["ideal-mpc"], forecast=True)


def rsmpc_with(study: Stopping, N: int, *, beta: float | None = None, contained: bool = True) -> Outcome:
    """Return how RSMPC stops with another trade-off, or when (27) does not decide which holds are offered."""
    return stop(study, RSMPC(tube=study.design, N=N, beta=beta or study.beta, contained=contained))


def pid_with(study: Stopping, kp: float, ki: float, kd: float) -> Outcome:
    """Return how the PID law stops with other gains."""
    law: SpeedPID = study.controllers["pid"]
    return stop(study, dataclasses.replace(law, kp=kp, ki=ki, kd=kd))
