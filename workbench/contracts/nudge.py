"""A study with every setting a little off: what a score's digits are held against."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from models.quantity import InvalidValue, nested
from workbench.contracts import settings
from workbench.contracts.study import Study

Value = float | tuple[float, ...]
ASIDE = ("verify.", "tuning.")
"""Parts of a study that no run reads: what proofs are stated for, and how laws were tuned before."""


class Nudged(NamedTuple):
    """A study whose settings were changed, and which."""

    study: Study
    moved: tuple[str, ...]
    """Paths of the settings that were changed."""
    kept: tuple[str, ...]
    """Paths of those that could not be: the end of a range, or what another value would make of the run's shape."""


def varied(study: Study) -> dict[str, Value]:
    """Return the settings that can be a little off, by path: numbers that shape no equation, zeros left out."""
    return {path: value for path, value in settings.numbers(study).items() if not path.startswith(ASIDE)}


def nudged(study: Study, relative: float, draw: int, *, aside: Sequence[str] = ()) -> Nudged:
    """Return a study with every number among its settings times ``1 + relative`` or ``1 - relative``, all at once.

    Which of the two is drawn for each number from ``draw`` alone. Zeros, counts, switches, choices, seeds and what else
    shapes the equations stay, and so do the settings named in ``aside`` and what a campaign draws at random. A change
    that the study refuses is not made, nor one with which it has other samples or other laws that suit it.
    """
    found = {path: value for path, value in varied(study).items() if path not in aside}
    drawn = np.random.default_rng(draw)
    changes: dict[str, Value] = {}
    for path, value in found.items():
        signs = drawn.choice([-1.0, 1.0], np.size(value))
        off = np.ravel(value) * (1.0 + relative * signs)
        changes[path] = tuple(off.tolist()) if isinstance(value, tuple) else float(off[0])
    made, moved = _Nudging(study, changes).made(study, {}, list(changes))
    return Nudged(made, tuple(moved), tuple(path for path in changes if path not in moved))


class _Nudging:
    """Makes changes of a study together, and finds those that it refuses by halves."""

    def __init__(self, study: Study, changes: Mapping[str, Value]) -> None:
        self.study, self.changes, self.unsuited = study, changes, study.refusals().keys()

    def made(
        self, so_far: Study, taken: Mapping[str, Value], paths: list[str], *, refused: bool = False
    ) -> tuple[Study, dict[str, Value]]:
        """Make the changes of some paths besides those that were taken; ``refused`` are some that are not all made."""
        asked = {**taken, **{path: self.changes[path] for path in paths}}
        if not refused and (whole := self._changed(asked)) is not None:
            return whole, asked
        if len(paths) <= 1:
            return so_far, dict(taken)
        middle = len(paths) // 2
        first, within = self.made(so_far, taken, paths[:middle])
        return self.made(first, within, paths[middle:], refused=within.keys() >= set(paths[:middle]))

    def _changed(self, changes: Mapping[str, Value]) -> Study | None:
        """Return the study with changes made, or None where they are refused or give a run of another shape."""
        try:
            made = settings.changed(self.study, nested(changes))
            same = made.horizon == self.study.horizon and made.refusals().keys() == self.unsuited
        except InvalidValue:
            return None
        return made if same else None
