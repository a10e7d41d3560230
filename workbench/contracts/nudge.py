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


def nudged(study: Study, relative: float, draw: int, *, aside: Sequence[str] = ()) -> Nudged:
    """Return a study with every number among its settings times ``1 + relative`` or ``1 - relative``, all at once.

    Which of the two is drawn for each number from ``draw`` alone. Zeros, counts, switches, choices, seeds and what else
    shapes the equations stay, and so do the settings named in ``aside`` and what a campaign draws at random. A change
    that the study refuses is not made, nor one with which it has other samples or other laws that suit it.
    """
    found = {path: value for path, value in settings.numbers(study).items() if not path.startswith(ASIDE)}
    found = {path: value for path, value in found.items() if path not in aside}
    drawn = np.random.default_rng(draw)
    changes: dict[str, Value] = {}
    for path, value in found.items():
        signs = drawn.choice([-1.0, 1.0], np.size(value))
        off = np.ravel(value) * (1.0 + relative * signs)
        changes[path] = tuple(off.tolist()) if isinstance(value, tuple) else float(off[0])
    made, moved = _with(study, study, {}, list(changes), changes)
    return Nudged(made, tuple(moved), tuple(path for path in changes if path not in moved))


def _with(
    study: Study, so_far: Study, taken: Mapping[str, Value], paths: list[str], changes: Mapping[str, Value]
) -> tuple[Study, dict[str, Value]]:
    """Make the changes of some paths besides those that were taken, halving them where they are refused."""
    asked = {**taken, **{path: changes[path] for path in paths}}
    if (made := _changed(study, asked)) is not None:
        return made, asked
    if len(paths) == 1:
        return so_far, dict(taken)
    middle = len(paths) // 2
    first, within = _with(study, so_far, taken, paths[:middle], changes)
    return _with(study, first, within, paths[middle:], changes)


def _changed(study: Study, changes: Mapping[str, Value]) -> Study | None:
    """Return the study with changes made, or None where they are refused or give a run of another shape."""
    try:
        made = settings.changed(study, nested(changes))
        same = made.horizon == study.horizon and made.refusals().keys() == study.refusals().keys()
    except InvalidValue:
        return None
    return made if same else None
