"""Where a map jumps: found by halving until a difference is left that does not shrink."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from models.array import Array


class Jump(NamedTuple):
    """Two points next to each other between which a map jumps."""

    before: tuple[float, ...]
    after: tuple[float, ...]
    size: float


def find_jump(
    f: Callable[..., float], low: Sequence[float], high: Sequence[float], *, cells: int = 40, least: float = 1e-3
) -> Jump | None:
    """Return a jump of f between two points of a box, or None.

    Lines along every axis are cut into ``cells``; each cell is halved towards its larger difference until its ends
    are neighbouring floating-point numbers. A difference above ``least`` that is left there is a jump. The largest
    one found is returned.
    """
    lines = [np.linspace(a, b, cells + 1) for a, b in zip(low, high, strict=True)]
    found: Jump | None = None
    for axis in range(len(lines)):
        others = [line if at != axis else line[:1] for at, line in enumerate(lines)]
        for point in np.stack(np.meshgrid(*others, indexing="ij"), -1).reshape(-1, len(lines)):
            jump = _along(f, point, axis, lines[axis], least)
            if jump and (found is None or jump.size > found.size):
                found = jump
    return found


def _along(f: Callable[..., float], point: Array, axis: int, line: Array, least: float) -> Jump | None:
    def at(value: float) -> tuple[float, ...]:
        moved = [float(entry) for entry in point]
        moved[axis] = float(value)
        return tuple(moved)

    values = [f(*at(value)) for value in line]
    steps = np.abs(np.diff(values))
    cell = int(np.argmax(steps))
    if steps[cell] <= least:
        return None
    a, b, fa, fb = float(line[cell]), float(line[cell + 1]), values[cell], values[cell + 1]
    while a < (middle := (a + b) / 2) < b and abs(fb - fa) > least:
        fm = f(*at(middle))
        if abs(fm - fa) >= abs(fb - fm):
            b, fb = middle, fm
        else:
            a, fa = middle, fm
    return Jump(at(a), at(b), abs(fb - fa)) if abs(fb - fa) > least else None
