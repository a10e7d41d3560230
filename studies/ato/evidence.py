"""The draws of an ato campaign: their metrics side by side, and the signals of the one that a claim points at."""

from __future__ import annotations

from functools import cache, cached_property
from typing import NamedTuple, Protocol

import numpy as np
import xarray as xr

from models.array import Array
from workbench.contracts.law import AnyLaw
from workbench.trials.campaign import Campaign, run
from workbench.trials.draws import draw_of, of_draws


class Immune(Protocol):
    """What a law has whose gain is p1 - p2 f."""

    @property
    def f(self) -> str:
        """The kind of the stimulus."""

    @property
    def ki(self) -> float:
        """Integral coefficient, 1."""

    @property
    def kd(self) -> float:
        """Derivative coefficient, 1."""

    @property
    def input_unit(self) -> float:
        """The unit that the law gives u in, in the plant's."""


def is_immune(law: AnyLaw) -> bool:
    """Tell whether a law's gain is p1 - p2 f: then it tells what it is made of."""
    return {"p1", "p2", "f"} <= {signal.name for signal in law.tells}


class Drawn(NamedTuple):
    """A draw that a claim points at."""

    at: int
    """Counted from 0."""
    witness: dict[str, object]
    """Its number, counted from 1 as in draws.nc, and the seed that runs it alone."""


class Evidence:
    """A campaign and its draws."""

    def __init__(self, campaign: Campaign) -> None:
        self.campaign, self.study = campaign, campaign.study
        self.signals = cache(self._signals)
        """signals(draw): the record of one draw, counted from 0."""

    @cached_property
    def drawn(self) -> xr.Dataset:
        """Metrics of every draw."""
        return self.campaign.by_draw

    def metric(self, controller: str, name: str) -> Array:
        """Return a metric of a controller by draw, (draws,)."""
        return of_draws(self.drawn, controller, name)

    def draw(self, index: int) -> Drawn:
        """Return a draw by its index, counted from 0."""
        numbers = {name: int(self.drawn[name].values[index]) for name in ("draw", "seed")}
        return Drawn(index, dict(numbers))

    def worst(self, values: Array) -> Drawn:
        """Return the draw with the largest of some values by draw."""
        return self.draw(int(np.nanargmax(values)))

    def _signals(self, index: int) -> xr.Dataset:
        if index == 0:
            return self.campaign.data
        return run(draw_of(self.study, index), show_progress=False).data
