"""Tuning by a grid: one field of a law tried at some values, on the study itself, before the run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeAlias

import numpy as np
import xarray as xr

from models.array import Array
from models.quantity import InvalidValue, declared, given, quantities, rebuilt, table
from workbench.contracts.law import AnyLaw
from workbench.contracts.record import TrialRecord
from workbench.contracts.study import Progress, Study, Tuned, Tuning
from workbench.trials.simulation import ready, runner_of

Metric: TypeAlias = Callable[[Study, TrialRecord], float]
"""What is to be small, given a study and the last trial of a campaign."""
TUNED, GRID = "tuned", "grid"
"""Axes of what is recorded: the controllers that were tuned, and the values that were tried."""


@declared
class Grid(Tuning):
    """Every value of a row is tried for one field of some controllers; the one with the least metric runs.

    A campaign is run with each value, on the study as it is. A value with which the law diverges, or whose metric is
    no number, is never chosen; the first of several that are equally good is. The record tells the metric by value.
    """

    controllers: tuple[str, ...] = given(doc="names of the controllers that are tuned")
    field: str = given(doc="the field of theirs that is tuned")
    values: tuple[float, ...] = table(unit="of the field", doc="the values that are tried")
    metric: Metric = given(doc="metric(study, last trial) is to be small")
    name: str = given(default="metric", doc="the metric's name in the record, where it is grid_NAME")
    unit: str = given(default="1", doc="unit of the metric")
    field_doc: str = given(default="", doc="what the record says of the field")

    def check(self) -> None:
        """Raise InvalidValue where there is nothing to try."""
        if not self.values:
            raise InvalidValue("grid must hold at least one value, got none")

    def tuned(self, study: Study, progress: Progress) -> Tuned:
        """Return the laws with the best values, and the metric of every value."""
        chosen = [name for name in self.controllers if name in study.controllers]
        refused = study.refusals()
        chosen = [name for name in chosen if name not in refused]
        tried = np.full((len(chosen), len(self.values)), np.nan)
        with progress(tried.size, f"{study.name}: grid of {self.field}") as advance:
            for row, name in enumerate(chosen):
                for column, metric in enumerate(self._tried(study, name)):
                    tried[row, column] = metric
                    advance(1)
        record = self._record(study, chosen, tried)
        laws = self.laws(study, record)
        hopeless = {
            name: f"no value of {self.field} in the grid gives a finite {self.name}"
            for name, row in zip(chosen, tried, strict=True)
            if not np.isfinite(row).any()
        }
        return Tuned(laws, hopeless, record)

    def laws(self, study: Study, data: xr.Dataset) -> Mapping[str, AnyLaw]:
        """Return the laws of the study, those tuned with the best values of a record."""
        laws = dict(study.controllers)
        if f"grid_{self.name}" not in data:
            return laws
        for name in map(str, data[TUNED].values):
            row: Array = data[f"grid_{self.name}"].sel({TUNED: name}).values
            if np.isfinite(row).any():
                best = float(data[GRID].values[int(np.nanargmin(np.where(np.isfinite(row), row, np.inf)))])
                laws[name] = rebuilt(laws[name], {self.field: best})
        return laws

    def _tried(self, study: Study, name: str) -> list[float]:
        """Return the metric of every value, NaN where the law diverges with it."""
        law, inputs = study.controllers[name], study.inputs()
        specs = {field: spec for field, spec, _ in quantities(law)}
        if self.field not in specs:
            raise InvalidValue(f"the grid's field must be one of controllers.{name}, got {self.field!r}")
        shapes = law.stepped or specs[self.field].kind != "number" or specs[self.field].structural
        runner, found = runner_of(study, name), []
        for value in self.values:
            one = rebuilt(law, {self.field: value})
            if shapes:
                lefts = ready(study, {name: one})[name].trials(inputs)
            else:
                lefts = runner.trials(inputs, values=runner.fold.values_of(one.ready_for(runner.task)))
            *_, (left, reason) = runner.judged(lefts)
            found.append(float("nan") if reason else self.metric(study, left))
        return found

    def _record(self, study: Study, chosen: list[str], tried: Array) -> xr.Dataset:
        if not chosen:
            return xr.Dataset()
        units = {field: spec.unit for field, spec, _ in quantities(study.controllers[chosen[0]])}
        field = {"units": units[self.field], "long_name": self.field_doc or self.field}
        about = {"units": self.unit, "long_name": f"{self.name.upper()} by the value tried"}
        return xr.Dataset(
            {f"grid_{self.name}": ((TUNED, GRID), tried, about)},
            {
                TUNED: (TUNED, chosen, {"units": "", "long_name": "tuned controller"}),
                GRID: (GRID, list(self.values), field),
            },
        )
