"""What a study is: a frozen declaration whose fields are its settings, and what it can do."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import xarray as xr

from models.plant import Plant
from workbench.contracts.law import Law

Scores = dict[str, dict[str, float | None]]
Progress = Callable[[int, str], Any]
"""progress(total, label) gives a context manager whose value is called with the steps done."""


class Measures(NamedTuple):
    """What a study measures beyond the common metrics."""

    headings: Mapping[str, str]
    """What a table calls every metric, its unit included, by the metric's name."""
    scores: Callable[[Any, xr.Dataset], Scores]
    """Gives these metrics by controller, from the study and its record; None stands for one that does not exist."""


class Folded(NamedTuple):
    """What one controller of a study is folded from."""

    plant: Plant
    law: Law
    samples: int
    """N of the trial: samples are 0..N."""


class Study(ABC):
    """A declaration that can be run: its declared fields are what ``--set`` takes.

    Studies made of trials are :class:`workbench.trials.study.TrialStudy` objects; a study of another kind is a
    declared subclass with these members.
    """

    name: str
    title: str
    source: str
    seed: int

    @abstractmethod
    def simulate(self, progress: Progress) -> xr.Dataset:
        """Run everything that the study compares and return it with units, as design of ``run.nc`` says."""

    @abstractmethod
    def scores(self, data: xr.Dataset) -> Scores:
        """Return every controller's metrics; None stands for a metric that does not exist in this run."""

    @abstractmethod
    def figures(self, data: xr.Dataset) -> Mapping[str, Callable[[], Any]]:
        """Return the figures by name, each a function that draws and returns a Matplotlib figure."""

    def documents(self, data: xr.Dataset) -> Mapping[str, Any]:
        """Return what the study writes besides, JSON by file name; nothing by default."""
        return {}

    def folded(self) -> Mapping[str, Folded]:
        """Return what every controller is folded from, by name; nothing where controllers are no equations."""
        return {}
