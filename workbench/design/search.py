"""Tuning as part of a study: every controller alike, on the plant as it is believed to be."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

import numpy as np
import xarray as xr

from models.array import Array
from models.quantity import InvalidValue, count, declared, nested, symbolised
from workbench.contracts.law import AnyLaw
from workbench.contracts.record import TrialInput
from workbench.contracts.settings import changed, rows
from workbench.contracts.study import Progress, Study, Tuned, Tuning
from workbench.design.one_error import one_error, weighed
from workbench.design.tuning import Found, tune
from workbench.trials.simulation import Runner, ready

TUNING_STREAM = 1
JUDGED = 5  # last trials whose mean MSE tuning minimises: one alone may be lucky with its noise


@declared
class Search(Tuning):
    """Every controller is tuned by one procedure with one budget (:data:`workbench.design.tuning.PROCEDURE`).

    What it minimises is the mean MSE of the last 5 of the study's trials (of 5 trials for a law that does not learn),
    weighed where there are several outputs. It tunes on the plant as it is believed to be, behind the same actuator,
    with noise of its own; which numbers of a law, and between what, the law says (``ranges``).
    """

    budget: int = count(default=60, doc="evaluations that tuning a law may take", least=1, most=100_000)

    def tuned(self, study: Study, progress: Progress) -> Tuned:
        """Return the tuned laws; raises InvalidValue where no law suits the study's plant."""
        refused = dict(study.refusals())
        nominal = believed(study)
        suited: dict[str, AnyLaw] = {}
        for name, law in study.controllers.items():
            if name in refused:
                continue
            try:
                Runner(nominal, name)
            except InvalidValue as error:
                refused[name] = str(error)
            else:
                suited[name] = law
        if not suited:
            raise InvalidValue("no law suits this plant: " + "; ".join(f"{n}: {why}" for n, why in refused.items()))
        runners, found = ready(nominal, suited), {}
        inputs = met(study)
        with progress(len(suited) * self.budget, f"tune {study.name}") as advance:
            for name, runner in runners.items():
                found[name] = self._found(nominal, name, runner, inputs, advance)
        laws = {
            name: _with(law, found[name].settings) if name in found else law for name, law in study.controllers.items()
        }
        return Tuned(laws, refused, self._record(study, refused, found))

    def laws(self, study: Study, data: xr.Dataset) -> Mapping[str, AnyLaw]:
        """Return the laws with the settings that tuning found, from the record; refused ones as they are declared."""
        told = {str(name): str(data["tuned"].sel(controller=name).values) for name in data["controller"].values}
        return {
            name: _with(law, json.loads(told[name])) if told.get(name) else law
            for name, law in study.controllers.items()
        }

    def _found(
        self, nominal: Study, name: str, runner: Runner, inputs: Sequence[TrialInput], advance: Callable[[int], object]
    ) -> Found:
        """Return what tuning one law of the believed study found."""
        law = nominal.controllers[name]
        ranges = law.ranges(runner.task)
        judged = inputs[:JUDGED] if law.learns_on is None else inputs
        moves = _Moves(nominal, name, runner, frozenset(ranges))

        def cost(settings: Mapping[str, float]) -> float:
            errors = []
            for mse in moves.mse(_with(law, settings), judged):
                errors.append(one_error(nominal, mse))
                if not np.isfinite(errors[-1]):
                    break
            advance(1)
            return float(np.mean(errors[-JUDGED:]))

        if not ranges:
            advance(self.budget - 1)  # one evaluation is as good as all
        return tune(cost, ranges, _numbers(law, ranges), self.budget, _tuning_seed(nominal.seed))

    def _record(self, study: Study, refused: Mapping[str, str], found: Mapping[str, Found]) -> xr.Dataset:
        names = list(study.controllers)
        nothing = [np.nan] * self.budget
        unit = weighed(study).unit
        return xr.Dataset(
            {
                "tuned": (
                    ("controller",),
                    np.array([json.dumps(found[name].settings) if name in found else "" for name in names], dtype=str),
                    {"units": "", "long_name": "settings found by tuning"},
                ),
                "tuning_mse": (
                    ("controller", "evaluation"),
                    np.array([found[name].costs if name in found else nothing for name in names]),
                    {
                        "units": unit,
                        "long_name": "mean MSE of the last trials of every evaluation on the nominal plant",
                    },
                ),
                "refused": (
                    ("refused_law",),
                    np.array(list(refused.values()), dtype=str),
                    {"units": "", "long_name": "why a law does not suit the plant"},
                ),
            },
            {
                "evaluation": (
                    "evaluation",
                    np.arange(1, self.budget + 1),
                    {"units": "1", "long_name": "evaluation"},
                ),
                "refused_law": (
                    "refused_law",
                    np.array(list(refused), dtype=str),
                    {"units": "", "long_name": "refused law"},
                ),
            },
        )


class _Moves:
    """A runner whose law's numbers change: as inputs of the compiled trial where they can, else it is made anew."""

    def __init__(self, nominal: Study, name: str, runner: Runner, ranges: frozenset[str]) -> None:
        self.nominal, self.name, self.runner = nominal, name, runner
        self.inputs_alone = not runner.law.stepped and ranges <= frozenset(symbolised(runner.law).names)

    def mse(self, law: AnyLaw, inputs: Sequence[TrialInput]) -> Iterator[Array]:
        """Yield the outputs' mean square errors of every trial with a law in place of the runner's own."""
        if self.inputs_alone:
            values = self.runner.fold.values_of(law.ready_for(self.runner.task))
            lefts = self.runner.trials(inputs, values=values)
        else:
            lefts = Runner(self.nominal, self.name, law).trials(inputs)
        for left in lefts:
            yield left.mse


def believed(study: Study) -> Study:
    """Return a study on the plant as it is believed to be, that is not tuned; its laws start as in the study."""
    return dataclasses.replace(study, compose=None, truth={}, tuning=None, draws=1, sweeps=())


def met(study: Study) -> list[TrialInput]:
    """Return what the trials of tuning are run with: as in a study on its believed plant, but drawn anew."""
    return believed(dataclasses.replace(study, seed=_tuning_seed(study.seed))).inputs()


def _tuning_seed(seed: int) -> int:
    """Return a seed for tuning that differs from the seed of the run."""
    return int(np.random.SeedSequence([seed, TUNING_STREAM]).generate_state(1)[0])


def _with(law: AnyLaw, settings: Mapping[str, float]) -> AnyLaw:
    """Return a law with other settings, given by path (``law.alpha`` for a law within a law)."""
    return changed(law, nested(settings))


def _numbers(law: AnyLaw, ranges: Iterable[str]) -> dict[str, float]:
    """Return the settings that tuning starts from, by path; InvalidValue for one that the law does not have."""
    numbers = {row.path: row.value for row in rows(law)}
    first = {}
    for name in ranges:
        value = numbers.get(name)
        if not isinstance(value, float):
            raise InvalidValue(f"{type(law).__name__} has no number {name!r} to tune: look at its ranges")
        first[name] = value
    return first
