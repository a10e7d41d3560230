"""The line that a vehicle runs on: grades, curves and tunnels by position, averaged over the vehicle's length."""

from __future__ import annotations

from itertools import pairwise

import casadi as ca

from models.expression import Expression, Number
from models.quantity import InvalidValue, declared, quantity, table


def averaged_steps(
    positions: tuple[float, ...], values: tuple[float, ...], front: Expression, length: Number
) -> Number:
    """Return a piecewise constant profile, averaged over ``[front - length, front]``.

    ``values`` has one entry more than ``positions``: the first holds before positions[0]. The mean is exact: the
    difference of the profile's piecewise linear antiderivative at the two ends, over the length.
    """

    def antiderivative(s: Expression) -> Number:
        changes = (after - before for before, after in pairwise(values))
        return sum(change * ca.fmax(0, s - at) for at, change in zip(positions, changes, strict=True))

    return values[0] + (antiderivative(front) - antiderivative(front - length)) / length


def stepped(positions: tuple[float, ...], values: tuple[float, ...], front: Expression) -> Number:
    """Return a piecewise constant profile at a point: values[0] before positions[0], and so on."""
    level: Number = values[0]
    for at, before, after in zip(positions, values, values[1:], strict=False):
        level = level + ca.if_else(front >= at, after - before, 0)
    return level


def pieces(
    starts: tuple[float, ...], ends: tuple[float, ...], values: tuple[float, ...]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return positions and values of a profile that is zero but for pieces in rising order, for the two above."""
    positions: list[float] = []
    levels: list[float] = [0.0]
    for start, end, value in zip(starts, ends, values, strict=True):
        if positions and positions[-1] == start:
            positions, levels = positions[:-1], levels[:-1]
        positions += [start, end]
        levels += [value, 0.0]
    return tuple(positions), tuple(levels)


@declared
class Line:
    """Grades, curves and tunnels of a line.

    The grade is ``grade_permille[0]`` before ``grade_starts_m[0]``, then one value from each start on. A curve
    (and a tunnel) reaches from its start to its end; the line is straight (and open) elsewhere.
    """

    grade_starts_m: tuple[float, ...] = table(default=(), unit="m", doc="positions at which the grade changes")
    grade_permille: tuple[float, ...] = table(
        default=(0.0,), unit="per mille", doc="grades, one more than the positions"
    )

    curve_starts_m: tuple[float, ...] = table(default=(), unit="m", doc="positions at which curves begin")
    curve_ends_m: tuple[float, ...] = table(default=(), unit="m", doc="positions at which curves end")
    curve_radii_m: tuple[float, ...] = table(default=(), unit="m", doc="radii of the curves")
    tunnel_starts_m: tuple[float, ...] = table(default=(), unit="m", doc="positions at which tunnels begin")
    tunnel_ends_m: tuple[float, ...] = table(default=(), unit="m", doc="positions at which tunnels end")
    length: float | None = quantity(
        default=None, unit="m", doc="length of the line; null: without end", above=0, optional=True, structural=True
    )

    def check(self) -> None:
        """Raise InvalidValue unless positions rise, pieces do not overlap, radii are positive and sizes agree."""
        if len(self.grade_permille) != len(self.grade_starts_m) + 1:
            raise InvalidValue(
                f"grade_permille must have one entry more than grade_starts_m ({len(self.grade_starts_m) + 1}), "
                f"got {len(self.grade_permille)}"
            )
        if any(b <= a for a, b in pairwise(self.grade_starts_m)):
            raise InvalidValue(f"grade_starts_m must rise, got {self.grade_starts_m}")
        _apart("curve", self.curve_starts_m, self.curve_ends_m)
        _apart("tunnel", self.tunnel_starts_m, self.tunnel_ends_m)
        if len(self.curve_radii_m) != len(self.curve_starts_m):
            raise InvalidValue(
                f"curve_radii_m must have one entry a curve ({len(self.curve_starts_m)}), got {len(self.curve_radii_m)}"
            )
        if any(radius <= 0 for radius in self.curve_radii_m):
            raise InvalidValue(f"curve_radii_m must be above 0 m, got {min(self.curve_radii_m):g}")

    def holds(self, length: Number) -> None:
        """Raise InvalidValue where a vehicle of this length (m) is longer than the line."""
        if self.length is not None and isinstance(length, float) and length > self.length:
            raise InvalidValue(f"length must be at most that of the line, {self.length:g} m, got {length:g}")

    def mean_grade(self, front: Expression, length: Number) -> Number:
        """Return the grade in per mille averaged over a vehicle of ``length`` metres whose front is at ``front``."""
        return averaged_steps(self.grade_starts_m, self.grade_permille, front, length)

    def mean_curvature(self, front: Expression, length: Number) -> Number:
        """Return 1/R in 1/m averaged over a vehicle of ``length`` metres with its front at ``front``; 0 if straight."""
        return averaged_steps(*self._curvature(), front, length)

    def curvature(self, position: Expression) -> Number:
        """Return 1/R in 1/m at a point; 0 where the line is straight."""
        return stepped(*self._curvature(), position)

    def tunnel(self, position: Expression) -> Number:
        """Return 1 in a tunnel and 0 elsewhere."""
        return stepped(*pieces(self.tunnel_starts_m, self.tunnel_ends_m, (1.0,) * len(self.tunnel_starts_m)), position)

    def _curvature(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        return pieces(self.curve_starts_m, self.curve_ends_m, tuple(1 / radius for radius in self.curve_radii_m))

    def grade(self, position: Expression) -> Number:
        """Return the grade in per mille at a point."""
        return stepped(self.grade_starts_m, self.grade_permille, position)


def _apart(kind: str, starts: tuple[float, ...], ends: tuple[float, ...]) -> None:
    if len(starts) != len(ends):
        raise InvalidValue(f"{kind}_ends_m must have one entry a {kind} ({len(starts)}), got {len(ends)}")
    if any(end <= start for start, end in zip(starts, ends, strict=True)):
        raise InvalidValue(f"{kind}_ends_m must lie beyond {kind}_starts_m, got {ends} for {starts}")
    if any(later < end for end, later in zip(ends, starts[1:], strict=False)):
        raise InvalidValue(f"{kind}s must follow one another without overlap, got {starts} to {ends}")


FLAT = Line()
HILLY = Line(grade_starts_m=(600, 1100, 1700, 2300, 3000), grade_permille=(0, 6, -4, 3, -8, 0))
LINES = {"hilly": HILLY, "flat": FLAT}
