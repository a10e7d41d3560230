"""Half-space polytopes {x : H x <= h}, bounded or not, worked with linear programs only.

No vertices are ever enumerated: the sets of a controller have four states and a hundred rows, and everything it
needs (support, emptiness, redundancy, Pontryagin difference by a zonotope) is an LP or less.

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
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from models.quantity import InvalidValue
from workbench.sets.array import Array, checked
from workbench.sets.linear_program import LPAnswer, minimise
from workbench.sets.zonotope import TOLERANCE, Zonotope


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

    Raises
    ------
    InvalidValue
        If the shapes do not fit, an entry is not finite or a row is zero.
    """

    H: Array
    h: Array
    labels: tuple[str, ...] = ()

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

    def normalized(self) -> Polytope:
        """The same set with rows of unit length, so that offsets and tolerances are distances."""
        length = np.linalg.norm(self.H, axis=1)
        return Polytope(H=self.H / length[:, None], h=self.h / length, labels=self.labels)

    def violation(self, point: ArrayLike) -> float:
        """The largest entry of H x - h at `point`, shape (n,): at most 0 inside, -inf without rows."""
        point = checked("point", point, (self.dimension,))
        return float(np.max(self.H @ point - self.h, initial=-np.inf))

    def contains(self, point: ArrayLike, *, tolerance: float = TOLERANCE) -> bool:
        """Whether `point`, shape (n,), violates no row by more than `tolerance`."""
        return self.violation(point) <= tolerance

    def support(self, direction: ArrayLike) -> float:
        """The largest d'x over the set, by one LP: inf if unbounded, -inf if the set is empty."""
        direction = checked("direction", direction, (self.dimension,))
        if not np.any(direction):
            return -np.inf if self.is_empty() else 0.0
        answer = minimise(-direction, self.H, self.h)
        if answer.status == "failed":  # HiGHS may leave open whether it was unbounded or infeasible
            return -np.inf if self.is_empty() else np.inf
        return -answer.value

    def intersect(self, other: Polytope) -> Polytope:
        """The points in both sets; rows of `other` come last."""
        return Polytope(H=np.vstack([self.H, other.H]), h=np.r_[self.h, other.h], labels=self.labels + other.labels)

    def preimage(self, matrix: ArrayLike, offset: ArrayLike | None = None) -> Polytope:
        """The points x with M x + offset in the set, M of shape (n, p).

        A row that M sends to zero must hold by itself: it is then left out. If it does not, InvalidValue.
        """
        matrix = checked("matrix", matrix, (self.dimension, None))
        shift = np.zeros(self.dimension) if offset is None else checked("offset", offset, (self.dimension,))
        H, h = self.H @ matrix, self.h - self.H @ shift
        keep = np.any(H != 0, axis=1)
        broken = np.flatnonzero(~keep & (h < 0))
        if broken.size:
            raise InvalidValue(f"no x maps into the set: '{self.labels[broken[0]]}' fails by {-h[broken[0]]:.6g}")
        return Polytope(H=H[keep], h=h[keep], labels=tuple(np.array(self.labels, dtype=object)[keep]))

    def minus(self, other: Zonotope) -> Polytope:
        """The Pontryagin difference {x : x + w in the set for every w of `other`}.

        Exact: {x : H x <= h - support of `other` along each row of H}. The result may be empty; `conflict` says why.
        Source: Kolmanovsky and Gilbert, Math. Probl. Eng. 4 (1998), theorem 2.3.
        """
        return Polytope(H=self.H, h=self.h - other.support(self.H), labels=self.labels)

    def conflict(self, *, tolerance: float = TOLERANCE) -> Conflict | None:
        """None if the set has a point, else the rows that exclude each other (a Farkas certificate of the LP)."""
        unit = self.normalized()
        if np.all(unit.h >= 0):  # the origin is in it
            return None
        slack, answer = _deepest(unit, cap=1.0)
        if slack >= -tolerance:
            return None
        price = answer.prices[: len(unit.h)]
        rows = np.flatnonzero(price > 1e-7 * price.max())
        shortfall = -float(price[rows] @ unit.h[rows]) / float(price.max())
        names = tuple(unit.labels[i] for i in rows)
        return Conflict(rows=tuple(int(i) for i in rows), labels=names, shortfall=shortfall)

    def is_empty(self, *, tolerance: float = TOLERANCE) -> bool:
        """Whether even with every unit row relaxed by `tolerance` there is no point."""
        return self.conflict(tolerance=tolerance) is not None

    def chebyshev(self, *, cap: float = 1e6) -> tuple[Array, float]:
        """Centre, shape (n,), and radius of a largest ball inside.

        The radius is negative for an empty set and at most `cap` for one that contains balls of any size.
        """
        unit = self.normalized()
        radius, answer = _deepest(unit, cap=cap)
        return answer.x[:-1], radius

    def reduced(self, *, tolerance: float = TOLERANCE) -> Polytope:
        """The same set, unit rows, without those that the others imply (to within `tolerance`)."""
        unit = self.normalized()
        kept = list(range(len(unit.h)))
        for row in range(len(unit.h)):
            others = [i for i in kept if i != row]
            if is_redundant(unit.H[row], float(unit.h[row]), unit.H[others], unit.h[others], tolerance=tolerance):
                kept = others
        return Polytope(H=unit.H[kept], h=unit.h[kept], labels=tuple(unit.labels[i] for i in kept))


def is_redundant(normal: Array, offset: float, H: Array, h: Array, *, tolerance: float = TOLERANCE) -> bool:
    """Whether normal'x <= offset + tolerance wherever H x <= h: one LP.

    The LP is kept bounded by asking only whether the row can be exceeded by one unit.
    """
    answer = minimise(-normal, np.vstack([H, normal]), np.r_[h, offset + 1.0])
    return answer.status != "failed" and -answer.value <= offset + tolerance


def _deepest(unit: Polytope, *, cap: float) -> tuple[float, LPAnswer]:
    """The largest t <= cap with H x + t <= h, and the LP's answer with x and t; its last row is the cap."""
    lift = np.zeros(unit.dimension + 1)
    lift[-1] = 1.0
    rows = np.vstack([np.hstack([unit.H, np.ones((len(unit.h), 1))]), lift])
    answer = minimise(-lift, rows, np.r_[unit.h, cap])
    if answer.status != "optimal":
        raise ArithmeticError(f"the linear solver failed on {len(unit.h)} rows that must have an answer")
    return -answer.value, answer
