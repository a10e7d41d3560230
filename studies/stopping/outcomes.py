"""Stops beyond those of a stopping campaign: other resistances inside W, models, gains and trade-offs."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from models.brake import Brake, Halting
from models.quantity import InvalidValue
from studies.stopping.brake_model import Method
from studies.stopping.scores import UPDATE
from studies.stopping.settings import Stopping, own
from verification.checks.shares import about_all
from workbench.contracts.finding import Finding, Grounds
from workbench.contracts.law import AnyLaw
from workbench.contracts.study import Study
from workbench.fold.stepping import Stepped

LIMIT_CM = 50.0
"""The stopping window, plus and minus."""
LATE = (10.0, 5.0, 20.0)
"""How far before the mark the resistance takes a late step, in m: too late for a law that must first see it."""


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
    return room_cm(error_cm) >= 0


def room_cm(error_cm: float | None) -> float:
    """Return how far a stop is from the window's end, in cm; -inf for a train that never stopped."""
    return -np.inf if error_cm is None or np.isnan(error_cm) else LIMIT_CM - abs(error_cm)


def random_brake(settings: Stopping, seed: int) -> Brake:
    """Return the brake with the random resistance inside W that ``resistance.seed`` stands for in a run of seed 0."""
    return dataclasses.replace(settings, resistance=dataclasses.replace(settings.resistance, seed=seed)).braked()


def late_steps(settings: Stopping) -> list[Brake]:
    """Return brakes whose resistance goes once from one end of W to the other, shortly before the mark."""
    low, high, mark = settings.disturbance.low, settings.disturbance.high, settings.curve.stop_position
    return [
        dataclasses.replace(settings.brake, blocks=ends, block_length=mark - before)
        for before in LATE
        if before < mark
        for ends in ((low, high), (high, low))
    ]


def robustly_within(study: Study, name: str, seeds: int) -> Finding:
    """The law stops within the window whatever the resistance in W.

    Tried are both ends of W held, then a late step from one end to the other, then random resistances, those of
    ``resistance.seed`` 0 ... seeds - 1. The first stop outside the window ends the search.
    """
    settings = own(study)
    brakes = [
        dataclasses.replace(settings.brake, blocks=(value,))
        for value in (settings.disturbance.high, settings.disturbance.low)
    ]
    brakes += late_steps(settings)
    brakes += [random_brake(settings, study.seed + one) for one in range(seeds)]
    worst, worst_cm, witness, tried = np.inf, np.nan, {}, 0
    for brake in brakes:
        error = stop(study, settings.controllers(brake)[name], brake=brake).error_cm
        tried += 1
        if room_cm(error) < worst:
            worst, worst_cm, witness = room_cm(error), error, _witness(brake, error)
        if worst < 0:
            break
    named = "both ends of W held, late steps between them, then random by blocks of position"
    return about_all(
        Finding(
            grounds=Grounds.SEARCH,
            margin=worst,
            unit="cm",
            weak=True,
            tries=tried,
            bound=None if np.isnan(worst_cm) else worst_cm,
            bound_unit="cm, the worst stop",
            witness=witness,
            method=f"{'outside the window at' if worst < 0 else 'inside the window in all of'} {tried} resistance(s) "
            f"inside W: {named}",
        )
    )


def _witness(brake: Brake, error: float) -> dict[str, object]:
    assert brake.blocks is not None
    blocks, length = list(brake.blocks), brake.block_length
    return {
        "stop_error_cm": None if np.isnan(error) else error,
        "brake.blocks": blocks,
        "brake.block_length": length,
        "settings": ["resistance.seed=null", f"brake.blocks={blocks}", f"brake.block_length={length!r}"],
    }


def robust_margin(study: Study, name: str, witness: Mapping[str, object]) -> float:
    """Return the margin of :func:`robustly_within` at the resistance of a witness, in cm; -inf if it never stops.

    Raises InvalidValue for a resistance that leaves W.
    """
    settings = own(study)
    blocks = tuple(np.asarray(witness["brake.blocks"], dtype=float).tolist())
    if not settings.disturbance.low <= min(blocks) <= max(blocks) <= settings.disturbance.high:
        raise InvalidValue("the witness must resist within W, and does not")
    length = float(str(witness["brake.block_length"]))
    brake = dataclasses.replace(settings.brake, blocks=blocks, block_length=length)
    return room_cm(stop(study, settings.controllers(brake)[name], brake=brake).error_cm)


class Share(NamedTuple):
    """With which share of some resistances a law stops in the window, and its worst stop."""

    share: float
    worst_cm: float
    """NaN where the train never stopped under one of them."""


def share_within(study: Study, name: str, brakes: Iterable[Brake]) -> Share:
    """Run a law on several brakes and lines."""
    law = study.controllers[name]
    errors = [stop(study, law, brake=brake).error_cm for brake in brakes]
    return Share(float(np.mean([within_window(error) for error in errors])), float(np.max(np.abs(errors))))


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
