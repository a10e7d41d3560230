"""What is done before a run: laws are tuned on the plant as it is believed to be."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, NamedTuple

import xarray as xr

from workbench.contracts.law import AnyLaw

if TYPE_CHECKING:
    from workbench.contracts.study import Study

Progress = Callable[[int, str], AbstractContextManager[Callable[[int], object]]]
"""progress(total, label) gives a context manager whose value is called with the steps done."""


class Tuned(NamedTuple):
    """What tuning before the run gave."""

    laws: Mapping[str, AnyLaw]
    """The laws that run, by controller: those that were not tuned as they were."""
    refused: Mapping[str, str]
    """Why a controller cannot be tuned, by name."""
    record: xr.Dataset
    """What the run's record says of it, with units."""


class Tuning(ABC):
    """How laws are tuned before the run: on the plant as it is believed to be, never on what the run will meet."""

    @abstractmethod
    def tuned(self, study: Study, progress: Progress) -> Tuned:
        """Return the tuned laws."""

    @abstractmethod
    def laws(self, study: Study, data: xr.Dataset) -> Mapping[str, AnyLaw]:
        """Return the laws that a recorded run had, by controller."""
