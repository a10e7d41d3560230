"""The line that a train runs on: grades by position, averaged over the train's length."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import casadi as ca

from models.quantity import InvalidValue, declared, table


def averaged_steps(positions: tuple[float, ...], values: tuple[float, ...], front: Any, length: Any) -> Any:
    """Return a piecewise constant profile, averaged over ``[front - length, front]``.

    ``values`` has one entry more than ``positions``: the first holds before positions[0]. The mean is exact: the
    difference of the profile's piecewise linear antiderivative at the two ends, over the length.
    """

    def antiderivative(s: Any) -> Any:
        changes = (after - before for before, after in pairwise(values))
        return sum(change * ca.fmax(0, s - at) for at, change in zip(positions, changes, strict=True))

    return values[0] + (antiderivative(front) - antiderivative(front - length)) / length


def stepped(positions: tuple[float, ...], values: tuple[float, ...], front: Any) -> Any:
    """Return a piecewise constant profile at a point: values[0] before positions[0], and so on."""
    level: Any = values[0]
    for at, before, after in zip(positions, values, values[1:], strict=False):
        level = level + ca.if_else(front >= at, after - before, 0)
    return level


@declared
class Line:
    """Grades of a line: ``grade_permille[0]`` before ``grade_starts_m[0]``, then one value from each start on."""

    grade_starts_m: tuple[float, ...] = table(default=(), unit="m", doc="positions at which the grade changes")
    grade_permille: tuple[float, ...] = table(
        default=(0.0,), unit="per mille", doc="grades, one more than the positions"
    )

    def check(self) -> None:
        """Raise InvalidValue unless positions rise and there is one grade more than positions."""
        if len(self.grade_permille) != len(self.grade_starts_m) + 1:
            raise InvalidValue(
                f"grade_permille must have one entry more than grade_starts_m ({len(self.grade_starts_m) + 1}), "
                f"got {len(self.grade_permille)}"
            )
        if any(b <= a for a, b in pairwise(self.grade_starts_m)):
            raise InvalidValue(f"grade_starts_m must rise, got {self.grade_starts_m}")

    def mean_grade(self, front: Any, length: Any) -> Any:
        """Return the grade in per mille averaged over a train of ``length`` metres whose front is at ``front``."""
        return averaged_steps(self.grade_starts_m, self.grade_permille, front, length)

    def grade(self, position: Any) -> Any:
        """Return the grade in per mille at a point."""
        return stepped(self.grade_starts_m, self.grade_permille, position)


FLAT = Line()
HILLY = Line(grade_starts_m=(600, 1100, 1700, 2300, 3000), grade_permille=(0, 6, -4, 3, -8, 0))
LINES = {"hilly": HILLY, "flat": FLAT}
