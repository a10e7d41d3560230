"""Stops beyond those of a stopping campaign: other resistances inside W, models, gains and trade-offs."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from models.brake import Brake, Halting
from studies.stopping.brake_model import Method
from studies.stopping.scores import UPDATE
from studies.stopping.settings import Stopping, own
from workbench.contracts.law import AnyLaw
from workbench.contracts.study import Study
from workbench.contracts.verdict import Finding, Standing
from workbench.fold.stepping import Stepped

LIMIT_CM = 50.0
"""The stopping window, plus and minus."""


class Outcome(NamedTuple):
    """How one stop went."""

    error_cm: float
    """NaN where the train never stopped."""
    updates: int


def stop(study: Study, law: AnyLaw, *, brake: Brake | None = None) -> Outcome:
    """Run one law of a stopping study, on the study's plant or another brake and line."""
    task, plant = study.task(law), study.plant_that_runs if brake is None else Halting(plant=brake)
    steps = Stepped(plant, law.ready_for(task), study.horizon, task)
    (left,) = steps.trials([study.inputs()[0]])
    speed, place = left.x[1, left.length], left.x[2, left.length]
    moves = np.diff(left.u[0, : left.length], prepend=own(study).held)
    mark = own(study).curve.stop_position
    return Outcome(100 * (place - mark) if speed <= 0 else np.nan, int((np.abs(moves) > UPDATE).sum()))


def within_window(error_cm: float) -> bool:
    """Tell whether a stop lies in the window; a train that never stopped does not."""
    return bool(abs(error_cm) <= LIMIT_CM)


def random_brake(settings: Stopping, seed: int) -> Brake:
    """Return the brake with the random resistance inside W that ``resistance.seed`` stands for in a run of seed 0."""
    return dataclasses.replace(settings, resistance=dataclasses.replace(settings.resistance, seed=seed)).braked()


def robustly_within(study: Study, name: str, seeds: int) -> Finding:
    """The law stops within the window whatever the resistance in W: its two ends held, then random ones.

    The random ones are those of ``resistance.seed`` 0 ... seeds - 1.
    """
    settings = own(study)
    brakes = {
        f"brake.blocks=[{value!r}]": dataclasses.replace(settings.brake, blocks=(value,))
        for value in (settings.disturbance.high, settings.disturbance.low)
    }
    brakes |= {f"resistance.seed={one}": random_brake(settings, study.seed + one) for one in range(seeds)}
    tried, worst = 0, -1.0
    witness: dict[str, object] = {}
    for setting, brake in brakes.items():
        error = stop(study, settings.controllers(brake)[name], brake=brake).error_cm
        tried += 1
        if abs(error) > worst or np.isnan(error):
            worst, witness = abs(error), {"setting": setting, "stop_error_cm": error}
        if not within_window(error):
            return _beyond(error, tried, witness)
    return Finding(
        standing=Standing.SUPPORTED,
        margin=LIMIT_CM - worst,
        unit="cm",
        witness=witness,
        method=f"{tried} resistances inside W: both ends held, then random by blocks of position",
    )


def _beyond(error: float, tried: int, witness: Mapping[str, object]) -> Finding:
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


def share_within(study: Study, name: str, brakes: Iterable[Brake]) -> Share:
    """Run a law on several brakes and lines."""
    law = study.controllers[name]
    errors = [stop(study, law, brake=brake).error_cm for brake in brakes]
    return Share(float(np.mean([within_window(error) for error in errors])), float(np.nanmax(np.abs(errors))))


def held_brakes(settings: Stopping, number: int) -> list[Brake]:
    """Return brakes whose resistance is the same everywhere, spread evenly over W."""
    low, high = settings.disturbance.low, settings.disturbance.high
    values = low + (high - low) * (np.arange(number) + 0.5) / number
    return [dataclasses.replace(settings.brake, blocks=(float(value),)) for value in values]


def ideal_with(study: Study, model: Method) -> Outcome:
    """Return how the ideal MPC stops when it plans with another model."""
    other = dataclasses.replace(own(study), model=model)
    return stop(study, other.ideal(other.braked(study.seed)))


def rsmpc_with(study: Study, N: int, *, beta: float | None = None, contained: bool = True) -> Outcome:
    """Return how RSMPC stops with another trade-off, or when (27) does not decide which holds are offered."""
    return stop(study, own(study).rsmpc(N, beta=beta, contained=contained))


def pid_with(study: Study, kp: float, ki: float, kd: float) -> Outcome:
    """Return how the PID law stops with other gains."""
    return stop(study, dataclasses.replace(own(study).pid, kp=kp, ki=ki, kd=kd))
