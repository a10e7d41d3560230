"""What is random in a campaign, drawn from its seed: each kind has its own stream, so one changes no other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from models.actuator import Wrapper
from models.array import Array
from models.quantity import symbolised
from models.users_code import asking
from workbench.contracts.record import TrialInput

if TYPE_CHECKING:
    from workbench.contracts.study import Study

LENGTHS, NOISE, STARTS, DISTURBANCES, TRUTH = range(5)


def _streams(study: Study) -> list[np.random.Generator]:
    return [np.random.default_rng(one) for one in np.random.SeedSequence(study.seed).spawn(TRUTH + 1)]


def inputs(study: Study) -> list[TrialInput]:
    """Return what every trial of a study is run with."""
    scenario, plant, runs, n = study.scenario, study.plant, study.plant_that_runs, study.horizon
    streams, trials = _streams(study), study.trials
    with asking("what the study draws", *(type(one).draw for one in scenario[1:4])):
        lengths = scenario.trial_length.draw(n, trials, streams[LENGTHS])
        begins = starts(study)
        behind = np.zeros((trials, len(runs.states) - begins.shape[1]))  # what the actuator adds begins at zero
        calm = None if scenario.disturbance.bound(plant).any() else _zeros(len(plant.disturbances), n)
        quiet = None if scenario.noise.bound(plant).any() else _zeros(len(plant.outputs), n + 1)
        return [
            TrialInput(
                int(length),
                start,
                scenario.disturbance.draw(plant, n, streams[DISTURBANCES]) if calm is None else calm,
                scenario.noise.draw(plant, n + 1, streams[NOISE]) if quiet is None else quiet,
                truth,
            )
            for length, start, truth in zip(
                lengths, np.hstack([begins, behind]), _truths(study, streams[TRUTH]), strict=True
            )
        ]


def factors(study: Study) -> dict[str, Array]:
    """Return the factors of the quantities that are not the same in every trial, (trials,) by path."""
    return _factors(study, _streams(study)[TRUTH])


def disturbances_that_repeat(study: Study) -> Array:
    """Return the disturbances that every trial meets, (disturbances, N), of a study in which they repeat."""
    scenario, n = study.scenario, study.horizon
    with asking("what the study draws", type(scenario.disturbance).draw):
        return np.asarray(scenario.disturbance.draw(study.plant, n, _streams(study)[DISTURBANCES]), dtype=float)


def starts(study: Study) -> Array:
    """Return the states of the plant in which trials begin, (trials, states), without those of an actuator."""
    with asking("what the study draws", type(study.scenario.initial).draw):
        return np.asarray(study.scenario.initial.draw(study.plant, study.trials, _streams(study)[STARTS]), dtype=float)


def path_that_runs(study: Study, name: str) -> str:
    """Return where a quantity of the plant stands in the plant that runs, which an actuator may be wrapped round."""
    outer, prefix = study.plant_that_runs, ""
    while outer is not study.true_plant:
        assert isinstance(outer, Wrapper)
        outer, prefix = outer.plant, f"{prefix}plant."
    return f"{prefix}{name}"


def _factors(study: Study, stream: np.random.Generator) -> dict[str, Array]:
    moving = {name: one for name, one in study.scenario.truth.items() if not one.repeats}
    return {name: one.draw(study.trials, stream) for name, one in moving.items()}


def _truths(study: Study, stream: np.random.Generator) -> list[Array | None]:
    """Return the quantities of the plant that runs by trial, or None where all trials have the same."""
    drawn = _factors(study, stream)
    if not drawn:
        return [None] * study.trials
    names, values = symbolised(study.plant_that_runs)[1::2]
    made = np.tile(np.array(values), (study.trials, 1))
    for name, row in drawn.items():
        made[:, names.index(path_that_runs(study, name))] *= row
    return list(made)


def _zeros(rows: int, columns: int) -> Array:
    """Return zeros that all trials share, and nobody may write into."""
    zeros = np.zeros((rows, columns))
    zeros.flags.writeable = False
    return zeros
