"""Half-space polytopes {x : H x <= h}, bounded or not, worked with linear programs only.

No vertices are ever enumerated: the sets of a controller have four states and a hundred rows, and everything it
needs (support, emptiness, redundancy, Pontryagin difference by a zonotope) is an LP or less.

Nothing depends on units: every tolerance is a share of the set's own width along the row in question, see
`Polytope.sizes`, and a set far smaller or larger than one, or long in one state and short in another, is worked as well
as any.

Libraries that were looked at before writing this:

- polytope 0.2.5 (TuLiP): well kept, but it has no zonotopes, no support function and no Pontryagin difference; its
  tolerance of 1e-7 is a module global and a set without interior counts as empty.
- pytope: has the difference and Rakovic's minimal invariant set, but its own page calls it experimental and largely
  untested, its last release is of 2019, and that bound needs a disturbance set with an interior.
- pycvxset: the closest and well kept, but it brings CVXPY and cddlib for what is one LP here, takes milliseconds of
  modelling for every support value, and is under the AGPL.
- pypolycontain: unmaintained since 2021.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from models.quantity import InvalidValue
from workbench.sets.array import Array, checked
from workbench.sets.balance import balanced
from workbench.sets.linear_program import LPAnswer, SolverFailed, minimise
from workbench.sets.zonotope import TOLERANCE, Zonotope

FAR_FROM_ORIGIN = 1e-5
"""A width counts as at least this share of the distance from the origin, where rounding of the offsets is felt."""

FAR = 1e6
"""How many times its own size a set without end is looked at."""


class Conflict(NamedTuple):
    """Why a polytope is empty: rows that cannot hold together, and by how much they miss."""

    rows: tuple[int, ...]
    labels: tuple[str, ...]
    shortfall: float
    """For two opposite unit rows: the least total by which their offsets would have to grow."""

    def __str__(self) -> str:
        names = " and ".join(f"'{label}'" for label in self.labels)
        return f"{names} cannot {'both ' if len(self.labels) == 2 else ''}hold: they miss by {self.shortfall:.6g}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Polytope:
    """The set {x : H x <= h}; unbounded and empty sets are allowed.

    Parameters
    ----------
    H
        Row normals, shape (m, n); no row may be zero.
    h
        Offsets, shape (m,).
    labels
        What each row says, for errors: ``"u <= 1"``. Numbered when left empty.
    scale
        What the tolerances of each row are shares of, shape (m,), positive, in the row's own units; the set's widths,
        see `sizes`, when left out. A set that is made smaller by another keeps the scale that it had before.

    Raises
    ------
    InvalidValue
        If the shapes do not fit, an entry is not finite, a row is zero or a scale is not positive.
    """

    H: Array
    h: Array
    labels: tuple[str, ...] = ()
    scale: Array | None = None

    def __post_init__(self) -> None:
        H = checked("H", self.H, (None, None))
        object.__setattr__(self, "H", H)
        object.__setattr__(self, "h", checked("h", self.h, (len(H),)))
        zero = np.flatnonzero(~np.any(H != 0, axis=1))
        if zero.size:
            raise InvalidValue(f"H must have no zero row, got one at {zero[0]}; leave it out: it says nothing about x")
        labels = self.labels or tuple(f"row {i}" for i in range(len(H)))
        if len(labels) != len(H):
            raise InvalidValue(f"labels must name each of the {len(H)} rows, got {len(labels)}")
        object.__setattr__(self, "labels", tuple(labels))
        if self.scale is not None:
            scale = checked("scale", self.scale, (len(H),))
            if np.any(scale <= 0):
                raise InvalidValue(f"scale must be positive, got {scale.min():.6g}; leave it out to have it measured")
            object.__setattr__(self, "scale", scale)

    @classmethod
    def box(cls, low: ArrayLike, high: ArrayLike, *, names: tuple[str, ...] = ()) -> Self:
        """The points with low <= x <= high; an infinite bound makes no row.

        Rows come in the order x0 <= high, x0 >= low, x1 <= high, ...

        Parameters
        ----------
        low, high
            Bounds, shape (n,); infinities allowed, NaN not.
        names
            Names of the entries of x, for the labels.
        """
        lower, upper = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
        if lower.ndim != 1 or lower.shape != upper.shape:
            raise InvalidValue(
                f"low and high must be vectors of one length, got shapes {lower.shape} and {upper.shape}"
            )
        if not np.all(lower <= upper):
            raise InvalidValue(f"low must be at most high and neither NaN, got low {lower} and high {upper}")
        names = names or tuple(f"x{i}" for i in range(lower.size))
        if len(names) != lower.size:
            raise InvalidValue(f"names must name each of the {lower.size} entries, got {len(names)}")
        rows: list[Array] = []
        offsets: list[float] = []
        labels: list[str] = []
        for unit, name, least, most in zip(np.eye(lower.size), names, lower, upper, strict=True):
            if np.isfinite(most):
                rows.append(unit)
                offsets.append(float(most))
                labels.append(f"{name} <= {most:.6g}")
            if np.isfinite(least):
                rows.append(-unit)
                offsets.append(float(-least))
                labels.append(f"{name} >= {least:.6g}")
        return cls(H=np.array(rows).reshape(-1, lower.size), h=np.array(offsets), labels=tuple(labels))

    @property
    def dimension(self) -> int:
        """Dimension n of the space."""
        return int(self.H.shape[1])

    @cached_property
    def sizes(self) -> Array:
        """How wide the set is along each row, shape (m,), in the row's own units: what tolerances are shares of.

        The offset less the least H_j x over the set, by one LP a row; the offset's own size where there is no least or
        no set. Where that is nothing too (a cone, a mere point), the size that the row has beside the others. `scale`
        where it was given.
        """
        if self.scale is not None:
            return self.scale
        beside = 1 / balanced(self.H, beside=self.h).rows
        room = float((np.abs(self.h) / beside).max(initial=0.0))
        sizes = np.where(self._widths > 0, self._widths, beside * (room or 1.0))
        sizes.setflags(write=False)
        return sizes

    @cached_property
    def _widths(self) -> Array:
        """`sizes`, zero where the set has none."""
        if self.scale is not None:
            return self.scale
        offset = np.abs(self.h)
        widths = offset.copy()
        for j, row in enumerate(self.H):
            answer = minimise(row, self.H, self.h)
            if answer.status == "infeasible":
                return offset
            if answer.status == "failed":
                raise SolverFailed(f"the width of the set along '{self.labels[j]}' could not be found")
            if answer.status == "optimal":
                reach = max(offset[j], float(np.abs(row) @ np.abs(answer.x)))
                width = max(self.h[j] - answer.value, FAR_FROM_ORIGIN * reach)
                widths[j] = width if reach > 0 else 0.0
        return widths

    def normalized(self) -> Polytope:
        """The same set with rows of unit length, so that offsets are distances."""
        length = np.linalg.norm(self.H, axis=1)
        scale = None if self.scale is None else self.scale / length
        return Polytope(H=self.H / length[:, None], h=self.h / length, labels=self.labels, scale=scale)

    def violation(self, point: ArrayLike) -> float:
        """By how much `point`, shape (n,), breaks a row at worst, a share of `sizes`; -inf for a set without rows."""
        point = checked("point", point, (self.dimension,))
        own = np.abs(self.H) @ np.abs(point)  # a set without a size is measured by the point
        sizes = np.where(self._widths > 0, self._widths, np.where(own > 0, own, self.sizes))
        return float(np.max((self.H @ point - self.h) / sizes, initial=-np.inf))

    def contains(self, point: ArrayLike, *, tolerance: float = TOLERANCE) -> bool:
        """Whether `point`, shape (n,), violates no row by more than `tolerance`, a share of the set's width."""
        return self.violation(point) <= tolerance

    def support(self, direction: ArrayLike) -> float:
        """The largest d'x over the set, by one LP: inf if unbounded, -inf if the set is empty.

        Raises
        ------
        SolverFailed
            If the linear program has no answer that can be believed.
        """
        direction = checked("direction", direction, (self.dimension,))
        if not np.any(direction):
            return -np.inf if self.is_empty() else 0.0
        answer = minimise(-direction, self.H, self.h)
        if answer.status == "failed":
            raise SolverFailed(f"the support of a set of {len(self.h)} rows could not be found")
        return -answer.value

    def intersect(self, other: Polytope) -> Polytope:
        """The points in both sets; rows of `other` come last."""
        return Polytope(H=np.vstack([self.H, other.H]), h=np.r_[self.h, other.h], labels=self.labels + other.labels)

    def preimage(self, matrix: ArrayLike, offset: ArrayLike | None = None) -> Polytope:
        """The points x with M x + offset in the set, M of shape (n, p).

        A row that M sends to zero, but for rounding, must hold by itself: it is then left out. If it does not,
        InvalidValue.
        """
        matrix = checked("matrix", matrix, (self.dimension, None))
        shift = np.zeros(self.dimension) if offset is None else checked("offset", offset, (self.dimension,))
        H, h = self.H @ matrix, self.h - self.H @ shift
        rounding = 4 * self.dimension * np.finfo(float).eps * (np.abs(self.H) @ np.abs(matrix))
        keep = np.any(np.abs(H) > rounding, axis=1)
        if not keep.all():
            broken = np.flatnonzero(~keep & (h < -TOLERANCE * self.sizes))
            if broken.size:
                raise InvalidValue(f"no x maps into the set: '{self.labels[broken[0]]}' fails by {-h[broken[0]]:.6g}")
        labels = tuple(np.array(self.labels, dtype=object)[keep])
        return Polytope(H=H[keep], h=h[keep], labels=labels, scale=None if self.scale is None else self.scale[keep])

    def minus(self, other: Zonotope) -> Polytope:
        """The Pontryagin difference {x : x + w in the set for every w of `other`}.

        Exact: {x : H x <= h - support of `other` along each row of H}. The result may be empty; `conflict` says why.
        Its tolerances stay those of this set: what is left over may be as small as the rounding of what it is left of.
        Source: Kolmanovsky and Gilbert, Math. Probl. Eng. 4 (1998), theorem 2.3.
        """
        return Polytope(H=self.H, h=self.h - other.support(self.H), labels=self.labels, scale=self.sizes)

    def conflict(self, *, tolerance: float = TOLERANCE) -> Conflict | None:
        """None if the set has a point, else the rows that exclude each other (a Farkas certificate of the LP).

        Rows exclude each other if they still do when each is relaxed by `tolerance`, a share of its `sizes`.
        """
        if np.all(self.h >= 0):  # the origin is in it
            return None
        depth, answer = self._deepest(self.sizes, cap=1.0)
        if depth >= -tolerance:
            return None
        price = answer.prices[: len(self.h)]
        rows = np.flatnonzero(price * self.sizes > 1e-7 * (price * self.sizes).max())
        length = np.linalg.norm(self.H[rows], axis=1)  # as prices of unit rows, whose offsets are distances
        shortfall = -float(price[rows] @ self.h[rows]) / float((price[rows] * length).max())
        names = tuple(self.labels[i] for i in rows)
        return Conflict(rows=tuple(int(i) for i in rows), labels=names, shortfall=shortfall)

    def is_empty(self, *, tolerance: float = TOLERANCE) -> bool:
        """Whether even with every row relaxed by `tolerance`, a share of its `sizes`, there is no point."""
        return self.conflict(tolerance=tolerance) is not None

    def deepest(self) -> tuple[Array, float]:
        """A point, shape (n,), with as much room in every row as can be had, and that room, a share of `sizes`.

        The room is at most 1, and negative for an empty set. Unlike `chebyshev`, it does not depend on units.
        """
        depth, answer = self._deepest(self.sizes, cap=1.0)
        return answer.x[:-1], depth

    def chebyshev(self, *, cap: float | None = None) -> tuple[Array, float]:
        """Centre, shape (n,), and radius of a largest ball inside: Euclidean, so the states must share a unit.

        The radius is negative for an empty set and at most `cap` for one that contains balls of any size: a million
        times the largest distance of a row from the origin if not given.
        """
        unit = self.normalized()
        largest = float(np.abs(unit.h).max(initial=0.0))
        radius, answer = unit._deepest(np.ones(len(unit.h)), cap=FAR * (largest or 1.0) if cap is None else cap)
        return answer.x[:-1], radius

    def reduced(self, *, tolerance: float = TOLERANCE) -> Polytope:
        """The same set, unit rows, without those that the others imply.

        Implied is what the others exceed by at most `tolerance`, a share of `sizes`. Of an empty set, rows are kept
        that exclude each other: it stays empty.
        """
        conflict = self.conflict(tolerance=tolerance)
        kept = list(range(len(self.h)) if conflict is None else conflict.rows)
        for row in list(kept) if conflict is None else []:
            others = [i for i in kept if i != row]
            if is_redundant(
                self.H[row],
                float(self.h[row]),
                self.H[others],
                self.h[others],
                size=float(self.sizes[row]),
                tolerance=tolerance,
            ):
                kept = others
        labels = tuple(self.labels[i] for i in kept)
        return Polytope(H=self.H[kept], h=self.h[kept], labels=labels, scale=self.sizes[kept]).normalized()

    def _deepest(self, sizes: Array, *, cap: float) -> tuple[float, LPAnswer]:
        """The largest t <= cap with H x + sizes t <= h, and the LP's answer with x and t; its last row is the cap."""
        lift = np.zeros(self.dimension + 1)
        lift[-1] = 1.0
        rows = np.vstack([np.hstack([self.H, sizes[:, None]]), lift])
        answer = minimise(-lift, rows, np.r_[self.h, cap])
        if answer.status != "optimal":
            raise SolverFailed(f"the linear solver failed on {len(self.h)} rows that must have an answer")
        return -answer.value, answer


def is_redundant(
    normal: Array, offset: float, H: Array, h: Array, *, size: float, tolerance: float = TOLERANCE
) -> bool:
    """Whether normal'x <= offset + tolerance * size wherever H x <= h: one LP.

    Parameters
    ----------
    normal, offset
        The row, shape (n,).
    H, h
        The others, shapes (m, n) and (m,). Where they have no point, every row is implied.
    size
        What the tolerance is a share of, in the row's units, positive: see `Polytope.sizes`. The LP is kept bounded by
        asking only whether the row can be exceeded by so much.

    Raises
    ------
    SolverFailed
        If the linear program has no answer that can be believed.
    """
    answer = minimise(-normal, np.vstack([H, normal]), np.r_[h, offset + size])
    if answer.status == "infeasible":  # beyond the row by more than was asked for, or nowhere
        answer = minimise(np.zeros_like(normal), H, h)
        if answer.status in ("optimal", "infeasible"):
            return answer.status == "infeasible"
    if answer.status != "optimal":
        raise SolverFailed(f"whether a row is implied by {len(h)} others could not be found: {answer.status}")
    return -answer.value <= offset + tolerance * size
