"""Zonotopes: a centre plus a sum of segments, closed under linear maps and Minkowski sums."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from models.quantity import InvalidValue
from workbench.sets.array import Array, checked
from workbench.sets.linear_program import SolverFailed, minimise

TOLERANCE = 1e-9
"""How far a comparison between sets may miss by rounding, relative to the set: a share of a polytope's width along the
row that is asked about, of a zonotope's gauge.

The one default of every `tolerance` argument in `workbench.sets`.
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Zonotope:
    """The set {c + G z : |z_i| <= 1}.

    Parameters
    ----------
    center
        c, shape (n,).
    generators
        G, shape (n, g); g may be 0 (a point), and G need not have full rank (a segment in the plane).

    Raises
    ------
    InvalidValue
        If the shapes do not fit or an entry is not finite.
    """

    center: Array
    generators: Array

    def __post_init__(self) -> None:
        center = checked("center", self.center, (None,))
        object.__setattr__(self, "center", center)
        object.__setattr__(self, "generators", checked("generators", self.generators, (center.size, None)))

    @classmethod
    def point(cls, center: ArrayLike) -> Self:
        """The set of one point, `center` of shape (n,)."""
        center = checked("center", center, (None,))
        return cls(center=center, generators=np.zeros((center.size, 0)))

    @classmethod
    def segment(cls, direction: ArrayLike, low: float, high: float) -> Self:
        """The points t * direction with low <= t <= high; `direction` has shape (n,)."""
        if not low <= high:
            raise InvalidValue(f"low must be at most high, got low {low} and high {high}")
        direction = checked("direction", direction, (None,))
        return cls(center=direction * (low + high) / 2, generators=direction[:, None] * (high - low) / 2)

    @classmethod
    def box(cls, low: ArrayLike, high: ArrayLike) -> Self:
        """The points with low <= x <= high, entry by entry; both of shape (n,)."""
        low = checked("low", low, (None,))
        high = checked("high", high, (low.size,))
        if np.any(low > high):
            raise InvalidValue(f"low must be at most high, got low {low} and high {high}")
        return cls(center=(low + high) / 2, generators=np.diag((high - low) / 2))

    @property
    def dimension(self) -> int:
        """Dimension n of the space."""
        return self.center.size

    def support(self, directions: ArrayLike) -> Array:
        """The largest d'x over the set for each row d of `directions`, shape (m, n); exact, shape (m,)."""
        directions = checked("directions", directions, (None, self.dimension))
        reach: Array = directions @ self.center + np.abs(directions @ self.generators).sum(axis=1)
        return reach

    def extreme(self, direction: ArrayLike) -> Array:
        """A point of the set that attains the support in `direction`, shape (n,)."""
        direction = checked("direction", direction, (self.dimension,))
        return self.center + self.generators @ np.where(direction @ self.generators < 0, -1.0, 1.0)

    def mapped(self, matrix: ArrayLike) -> Zonotope:
        """The image {M x}, with M of shape (p, n)."""
        matrix = checked("matrix", matrix, (None, self.dimension))
        return Zonotope(center=matrix @ self.center, generators=matrix @ self.generators)

    def __add__(self, other: Zonotope) -> Zonotope:
        """The Minkowski sum; generators that are zero are left out."""
        if other.dimension != self.dimension:
            raise InvalidValue(f"both sets must have one dimension, got {self.dimension} and {other.dimension}")
        generators = np.hstack([self.generators, other.generators])
        return Zonotope(center=self.center + other.center, generators=generators[:, np.any(generators != 0, axis=0)])

    def sample(self, count: int, *, seed: int) -> Array:
        """Points c + G z with z uniform on the cube, shape (count, n)."""
        weights = np.random.default_rng(seed).uniform(-1, 1, (count, self.generators.shape[1]))
        points: Array = self.center + weights @ self.generators.T
        return points

    def gauge(self, point: ArrayLike) -> float:
        """The least t for which c + G z reaches `point` with |z_i| <= t; infinite off the span of G.

        A difference from the centre that is no more than the rounding of its two terms counts as none.

        Raises
        ------
        SolverFailed
            If the linear program has no answer that can be believed.
        """
        point = checked("point", point, (self.dimension,))
        count = self.generators.shape[1]
        gap = point - self.center
        gap[np.abs(gap) <= 2 * np.finfo(float).eps * (np.abs(point) + np.abs(self.center))] = 0.0
        if not np.any(gap):
            return 0.0
        if count == 0:
            return np.inf
        # Variables (z, t): minimise t subject to G z = point - c and -t <= z_i <= t.
        bound = np.block([[np.eye(count), -np.ones((count, 1))], [-np.eye(count), -np.ones((count, 1))]])
        reach = np.hstack([self.generators, np.zeros((self.dimension, 1))])
        cost = np.r_[np.zeros(count), 1.0]
        answer = minimise(cost, bound, np.zeros(2 * count), equal=(reach, gap))
        if answer.status == "failed":
            raise SolverFailed(f"the gauge of a zonotope of {count} generators could not be found")
        return answer.value

    def contains(self, point: ArrayLike, *, tolerance: float = TOLERANCE) -> bool:
        """Whether `point`, shape (n,), lies in the set, its gauge being at most 1 + tolerance."""
        return self.gauge(point) <= 1 + tolerance

    def outline(self) -> Array:
        """Corners of a plane zonotope, counter-clockwise, shape (2 g, 2); for drawing."""
        if self.dimension != 2:
            raise InvalidValue(f"outline needs a set in the plane, got dimension {self.dimension}; map it down first")
        upward = np.where(
            (self.generators[1] < 0) | ((self.generators[1] == 0) & (self.generators[0] < 0)),
            -self.generators,
            self.generators,
        )
        steps = 2 * upward[:, np.argsort(np.arctan2(upward[1], upward[0]))].T
        bottom = self.center - upward.sum(axis=1)
        right = bottom + np.cumsum(np.vstack([np.zeros((1, 2)), steps]), axis=0)
        corners: Array = np.vstack([right, 2 * self.center - right[1:-1]]) if len(steps) > 1 else right
        return corners
