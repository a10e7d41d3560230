"""How many digits of a campaign's scores are true: what is left of them when settings or arithmetic change a little.

A score is printed with sixteen digits whatever it is worth. Here every setting is changed by a part in 1e12, then in
1e6, and at last the trials are run in single precision; the digits on which both runs agree survive.
"""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Mapping
from functools import cached_property
from typing import NamedTuple

import numpy as np
import xarray as xr

from models.array import Array
from models.quantity import InvalidValue, nested
from workbench.contracts.law import AnyLaw
from workbench.contracts.nudge import Nudged, nudged, varied
from workbench.contracts.settings import changed, numbers
from workbench.contracts.study import Progress, Study, Tuned, Tuning
from workbench.contracts.survival import Survival, Survivals
from workbench.trials import progress
from workbench.trials.campaign import Campaign
from workbench.trials.metrics import scores_of
from workbench.trials.simulation import ready, ready_in_single, runner_in_single, simulate

SMALL, LARGE = 1e-12, 1e-6
"""Relative changes of every setting."""
DRAWS = 3
"""Draws of the changes' signs; one where a law decides sample by sample, which takes long."""


class Change(NamedTuple):
    """By how much a law's last mean square error changed in the worst of some draws."""

    change: float
    """Relative to the error; infinite where it is no number any more."""
    draw: int
    moved: int
    """How many settings were changed."""
    kept: tuple[str, ...]
    """Paths of those that could not be."""


class _Run(NamedTuple):
    """What is kept of a run: its scores, and the mean square errors, (trials, outputs) by controller."""

    scores: Mapping[str, Mapping[str, float | None]]
    mse: Mapping[str, Array]


def relative_change(one: float | None, other: float | None) -> float:
    """Return how far another number is from one, relative to it; infinite where one of them is no number, or 0."""
    if one is None or other is None or not (math.isfinite(one) and math.isfinite(other)):
        return 0.0 if one is other else math.inf
    if one == other:
        return 0.0
    return abs(other - one) / abs(one) if one else math.inf


class Digits:
    """The digits of a campaign's scores, computed when they are first asked for."""

    def __init__(self, campaign: Campaign) -> None:
        self.campaign = campaign

    @cached_property
    def study(self) -> Study:
        """The study that is run again: its first draw, nothing swept besides, its laws as tuning left them."""
        return self._held(0.0, 0)

    def _held(self, relative: float, draw: int) -> Study:
        """Return that study, what tuning found a little off."""
        study = dataclasses.replace(self.campaign.study, draws=1, sweeps=())
        if study.tuning is None:
            return study
        held, compose = _Held(self.campaign.data, study.tuning, relative, draw), study.compose
        if compose is None:
            return dataclasses.replace(study, tuning=held)
        return dataclasses.replace(study, compose=lambda own, seed: {**compose(own, seed), "tuning": held})

    @property
    def varied(self) -> int:
        """The number of settings that there are to change."""
        return len(varied(self.study))

    def _nudged(self, relative: float, draw: int, kept: tuple[str, ...]) -> Nudged:
        return nudged(self._held(relative, draw), relative, draw, aside=kept)

    @cached_property
    def draws(self) -> int:
        """How many draws of the changes are looked at."""
        return 1 if any(law.stepped for law in self.study.controllers.values()) else DRAWS

    @cached_property
    def table(self) -> Survivals:
        """What survives of every score that exists, by controller and metric."""
        before = self._before
        found: dict[str, dict[str, Survival]] = {}
        for name, row in before.scores.items():
            found[name] = {
                metric: Survival(
                    max(relative_change(value, _score(run, name, metric)) for _, run in self._small),
                    max(relative_change(value, _score(run, name, metric)) for _, run in self._large),
                    relative_change(value, _score(self._single, name, metric)) if name in self._single.mse else None,
                )
                for metric, value in row.items()
                if value is not None
            }
        return found

    def last(self, controller: str, relative: float) -> Change:
        """Return the worst change of a law's last mean square error, of several outputs the worst."""
        runs = self._small if relative == SMALL else self._large
        worst = max(range(len(runs)), key=lambda draw: self._change(controller, runs[draw][1]))
        made, run = runs[worst]
        return Change(self._change(controller, run), worst, len(made.moved), made.kept)

    def in_single(self, controller: str) -> tuple[float | None, str]:
        """Return the change of a law's last mean square error in single precision; where there is none, why."""
        if controller in self._single.mse:
            return self._change(controller, self._single), ""
        law: AnyLaw = self.study.controllers[controller]
        if law.stepped:
            return None, "the law decides in numbers, sample by sample"
        try:
            runner_in_single(self.study, controller)
        except InvalidValue as error:
            return None, str(error)
        return None, "the law does not run"

    def again(self, controller: str, relative: float, draw: int, kept: tuple[str, ...]) -> float:
        """Return the change of a law's last mean square error in one draw, computed anew for that law alone."""
        made = self._nudged(relative, draw, kept)
        data = simulate(
            made.study,
            progress.silent,
            made=lambda study, laws: ready(study, {controller: laws[controller]} if controller in laws else {}),
        )
        return self._change(controller, _Run({}, {controller: _errors(data, controller)}))

    def last_trial(self, controller: str) -> int | None:
        """Return the last trial, from 0, of which a law has a mean square error; None where there is none."""
        whole = np.flatnonzero(np.isfinite(self._before.mse[controller]).all(axis=1))
        return int(whole[-1]) if whole.size else None

    def _change(self, controller: str, run: _Run) -> float:
        trial = self.last_trial(controller)
        assert trial is not None
        pairs = zip(self._before.mse[controller][trial], run.mse[controller][trial], strict=True)
        return max(relative_change(float(one), float(other)) for one, other in pairs)

    @cached_property
    def _before(self) -> _Run:
        return self._kept(self.study, self.campaign.data)

    @cached_property
    def _small(self) -> list[tuple[Nudged, _Run]]:
        return self._runs(SMALL)

    @cached_property
    def _large(self) -> list[tuple[Nudged, _Run]]:
        return self._runs(LARGE)

    @cached_property
    def _single(self) -> _Run:
        """What a run in single precision left, of the laws that can be had in it."""
        if all(law.stepped for law in self.study.controllers.values()):
            return _Run({}, {})
        data = simulate(self.study, progress.silent, made=ready_in_single)
        run = self._kept(self.study, data)
        ran = {name: mse for name, mse in run.mse.items() if np.isfinite(mse[0]).all()}
        return run._replace(mse=ran)

    def _runs(self, relative: float) -> list[tuple[Nudged, _Run]]:
        """Run every draw; what one could not change is left alone by those after it."""
        found: list[tuple[Nudged, _Run]] = []
        kept: tuple[str, ...] = ()
        for draw in range(self.draws):
            made = self._nudged(relative, draw, kept)
            kept = (*kept, *made.kept)
            found.append((made._replace(kept=kept), self._kept(made.study, simulate(made.study, progress.silent))))
        return found

    def _kept(self, study: Study, data: xr.Dataset) -> _Run:
        """Return what is kept of a run; what tuning recorded is added to it."""
        before = self.campaign.data
        data = data.merge(before[[name for name in before.variables if name not in data.variables]])
        names = [str(name) for name in data["controller"].values]
        return _Run(scores_of(study, data), {name: _errors(data, name) for name in names})


@dataclasses.dataclass(frozen=True)
class _Held(Tuning):
    """Laws that were tuned before, and are not again: what was found is taken from a record, a little off."""

    record: xr.Dataset
    tuning: Tuning
    """What made the record."""
    relative: float
    draw: int

    def tuned(self, study: Study, progress: Progress) -> Tuned:
        """Return the laws as they were tuned; those that did not run do not now."""
        names = [str(name) for name in self.record["controller"].values]
        idle = [name for name in names if not np.isfinite(_errors(self.record, name)[0]).all()]
        return Tuned(self.laws(study, self.record), dict.fromkeys(idle, "it did not run before"), xr.Dataset())

    def laws(self, study: Study, data: xr.Dataset) -> Mapping[str, AnyLaw]:
        """Return the laws as they were tuned."""
        found, drawn = self.tuning.laws(study, self.record), np.random.default_rng([self.draw, 1])
        return {name: self._off(law, study.controllers[name], drawn) for name, law in found.items()}

    def _off(self, law: AnyLaw, declared: AnyLaw, drawn: np.random.Generator) -> AnyLaw:
        """Return a law with the numbers that tuning found a little off, where it takes them."""
        before = numbers(declared)
        for path, value in numbers(law).items():
            if isinstance(value, float) and before.get(path) != value:
                off = value * (1.0 + self.relative * float(drawn.choice([-1.0, 1.0])))
                with contextlib.suppress(InvalidValue):
                    law = changed(law, nested({path: off}))
        return law


def _score(run: _Run, controller: str, metric: str) -> float | None:
    return run.scores.get(controller, {}).get(metric)


def _errors(data: xr.Dataset, controller: str) -> Array:
    """Return the mean square errors of a law, (trials, outputs)."""
    mse: Array = data["mse"].sel(controller=controller).values
    return mse.reshape(data.sizes["trial"], -1)
