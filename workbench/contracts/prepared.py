"""A law before its first trial: what it answers to a task, held against what it was asked.

A slip in a law of one's own is one line that names class and method.
"""

from __future__ import annotations

import numpy as np

from models.array import Array
from models.quantity import InvalidValue
from models.users_code import asking
from workbench.contracts.law import AnyLaw, Law, Task


def chance_of(law: AnyLaw, seed: int) -> Array:
    """Return the random numbers that a law starts with, (any number,); raise InvalidValue for anything else."""
    kind = type(law)
    with asking(f"the law {kind.__name__}", kind.chance):
        given: object = law.chance(seed)
        try:
            numbers = np.asarray(given, dtype=float)
        except (TypeError, ValueError):
            numbers = np.empty((0, 0))
        if given is None or numbers.ndim != 1:
            raise InvalidValue(f"{kind.__name__}.chance must give numbers in a row, () for none; got {_shown(given)}")
        return numbers


def refusal_of(law: AnyLaw, task: Task) -> str | None:
    """Return why a law cannot be used for a task, or None; raise InvalidValue for anything else."""
    kind = type(law)
    with asking(f"the law {kind.__name__}", kind.refusal):
        given: object = law.refusal(task)
        if given is not None and not isinstance(given, str):
            raise InvalidValue(
                f"{kind.__name__}.refusal must give why it cannot be used, in words, or None; got {_shown(given)}"
            )
        return given


def prepared(law: AnyLaw, task: Task) -> AnyLaw:
    """Return a law made ready for a task; raise InvalidValue where what it gives is no law."""
    kind = type(law)
    with asking(f"the law {kind.__name__}", kind.ready_for):
        given: object = law.ready_for(task)
        if not isinstance(given, Law):
            raise InvalidValue(f"{kind.__name__}.ready_for must give the law, made ready; got {_shown(given)}")
        return given


def _shown(value: object) -> str:
    """Return what came, in one line that is not long."""
    said = " ".join(repr(value).split())
    return said if len(said) <= 60 else f"{said[:57]}..."
