"""Certificates of inclusions between polytopes: floating point proposes which rows to add up, rationals do the sum."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from flint import fmpq, fmpq_mat

from verification.certificates.matrices import Formula, Matrix, formula_of, lines_of, rational
from verification.certificates.numbers import Number
from verification.checker.matrices import Row, Sets, formula, pushed
from workbench.contracts.certificate import Certificate, Json
from workbench.contracts.claim import NotCertified
from workbench.sets import Polytope, Zonotope
from workbench.sets.array import Array
from workbench.sets.linear_program import minimise

PIVOTS = 500
"""Changes of one row for another within which multipliers are sought."""


class Term(NamedTuple):
    """The sum over j < ``times`` of ``left`` ``base``^j ``right`` w_j, whatever the w_j of the disturbance ``of``."""

    left: Formula
    base: Formula
    times: int
    right: Formula
    of: str


class Inclusion(NamedTuple):
    """``map`` x + ``plus`` lies in ``outer`` for every x of ``inner``; without an inner set x is 0."""

    outer: str
    plus: tuple[Term, ...] = ()
    inner: str | None = None
    map: Formula | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Space:
    """What inclusions speak of, by name. Doubles in it are taken as the rationals that they are."""

    matrices: Mapping[str, Matrix]
    polytopes: Mapping[str, tuple[Matrix, Sequence[Number]]]
    """Rows and their bounds."""
    disturbances: Mapping[str, Zonotope]
    _known: dict[Inclusion, list[Json]] = field(default_factory=dict)

    @cached_property
    def rationals(self) -> Sets:
        """The same, in rationals."""
        return Sets(
            {name: fmpq_mat(rational(one)) for name, one in self.matrices.items()},
            {name: list(zip(rational(H), rational([h])[0], strict=True)) for name, (H, h) in self.polytopes.items()},
            {name: fmpq_mat(rational(_ends(one))) for name, one in self.disturbances.items()},
        )

    def rooms(self, asked: Inclusion) -> tuple[list[list[fmpq]], list[fmpq]]:
        """Return the rows that must follow from the inner set: their normals, and what is left of their bounds."""
        goal = self.rationals.polytopes[asked.outer]
        normals, left = fmpq_mat([row[0] for row in goal]), [row[1] for row in goal]
        for term in asked.plus:
            far, _ = pushed(normals, _term(term), self.rationals)
            left = [a - b for a, b in zip(left, far, strict=True)]
        if asked.map is None:
            return [[fmpq(0)] * len(row[0]) for row in goal], left
        lines: list[list[fmpq]] = (normals * formula(formula_of(asked.map), self.rationals.matrices)[0]).tolist()
        return lines, left

    def certificate(self, says: str, claims: Sequence[Inclusion]) -> Certificate:
        """Return the certificate of inclusions. Raises NotCertified for the first row that was not seen to follow."""
        return Certificate(
            kind="sets",
            statement={
                "says": says,
                "matrices": {name: lines_of(one) for name, one in self.matrices.items()},
                "polytopes": {
                    name: [[row, bound] for row, bound in zip(lines_of(H), lines_of([h])[0], strict=True)]
                    for name, (H, h) in self.polytopes.items()
                },
                "disturbances": {name: lines_of(_ends(one)) for name, one in self.disturbances.items()},
                "claims": [
                    {
                        "inner": one.inner,
                        "map": None if one.map is None else formula_of(one.map),
                        "plus": [_term(term) for term in one.plus],
                        "outer": one.outer,
                    }
                    for one in claims
                ],
            },
            proof={"multipliers": [self._shares(one) for one in claims]},
        )

    def _shares(self, asked: Inclusion) -> list[Json]:
        if asked not in self._known:
            by, found = [] if asked.inner is None else self.rationals.polytopes[asked.inner], list[Json]()
            for i, row in enumerate(zip(*self.rooms(asked), strict=True)):
                shares = multipliers(row, by)
                if shares is None:
                    of = asked.inner or "nothing"
                    raise NotCertified(f"row {i} of {asked.outer} was not seen to follow from {of}")
                found.append([[place, str(share)] for place, share in shares.items()])
            self._known[asked] = found
        return self._known[asked]


def multipliers(row: Row, by: Sequence[Row]) -> dict[int, fmpq] | None:
    """Return how often to take which rows for their sum to be a row, or to imply it; None where none were found.

    The simplex method in rationals, from the corner that a linear program in floating point ends in.
    """
    normal, bound = row
    if not any(normal):
        return {} if bound >= 0 else None
    same = [i for i, (other, edge) in enumerate(by) if other == normal and edge <= bound]
    if same:
        return {same[0]: fmpq(1)}
    columns = _columns([other for other, _ in by])
    basis = _corner(row, by, columns)
    for pivot in range(PIVOTS if len(basis) == len(columns) else 0):
        square = fmpq_mat([[by[i][0][k] for k in columns] for i in basis])
        goal = fmpq_mat([[normal[k]] for k in columns])
        shares = [line[0] for line in square.transpose().solve(goal).tolist()]
        negative = [place for place, share in enumerate(shares) if share < 0]
        if not negative:
            found = {i: share for i, share in zip(basis, shares, strict=True) if share}
            return found if _implies(found, row, by) else None
        # by turns the steepest and, against going in circles, the first
        out = min(negative, key=lambda place: shares[place]) if pivot < PIVOTS // 2 else negative[0]
        entering = _entering(by, columns, basis, square, out)
        if entering is None:
            return None
        basis[out] = entering
    return None


def _implies(shares: Mapping[int, fmpq], row: Row, by: Sequence[Row]) -> bool:
    total = [sum((share * by[i][0][k] for i, share in shares.items()), fmpq(0)) for k in range(len(row[0]))]
    return total == row[0] and sum((share * by[i][1] for i, share in shares.items()), fmpq(0)) <= row[1]


def _columns(lines: Sequence[Sequence[fmpq]]) -> list[int]:
    """Return columns that tell all of a matrix's: where its row echelon form has its pivots."""
    if not lines:
        return []
    echelon, rank = fmpq_mat(lines).rref()
    found = echelon.tolist()[:rank]
    return [next(k for k, entry in enumerate(line) if entry) for line in found]


def _corner(row: Row, by: Sequence[Row], columns: Sequence[int]) -> list[int]:
    """Return independent rows that are nearest to being met where the row is largest, by floating point."""
    H, h = _floats([other for other, _ in by]), _floats([[edge for _, edge in by]])[0]
    answer = minimise(-_floats([row[0]])[0], H, h) if columns else None
    if answer is None or answer.status != "optimal":
        return []
    size = np.abs(H) @ np.abs(answer.x) + np.abs(h)
    slack = (h - H @ answer.x) / np.where(size > 0, size, 1.0)
    nearest = np.lexsort((slack, answer.prices <= 0))  # those with a price, and then by slack
    found: list[int] = []
    lines: list[list[fmpq]] = []
    for i in nearest.tolist():
        if fmpq_mat([*lines, by[i][0]]).rank() > len(lines):
            found.append(i)
            lines.append(by[i][0])
        if len(found) == len(columns):
            break
    return found


def _entering(
    by: Sequence[Row], columns: Sequence[int], basis: Sequence[int], square: fmpq_mat, out: int
) -> int | None:
    """Return the row that is met first on the edge that leaves one row of a corner, None where there is none."""
    ends = fmpq_mat([[by[i][1], -fmpq(place == out)] for place, i in enumerate(basis)])
    corner = square.solve(ends).tolist()
    best, first = None, fmpq(0)
    for i, (normal, bound) in enumerate(by):
        along = sum((normal[k] * line[1] for k, line in zip(columns, corner, strict=True)), fmpq(0))
        if i in basis or along <= 0:
            continue
        far = (bound - sum((normal[k] * line[0] for k, line in zip(columns, corner, strict=True)), fmpq(0))) / along
        if best is None or far < first:
            best, first = i, far
    return best


class Need(NamedTuple):
    """That ``normal`` x is at most ``bound`` over a set, less what the set's own row ``own`` is drawn in by."""

    normal: Array
    bound: float
    own: int | None
    size: float
    """What counts as rounding, in the row's unit."""


def drawn_in(S: Polytope, needs: Sequence[Need], *, most: float | None = None) -> Array | None:
    """Return how far to draw in each row of a set for needs to be met with some room.

    Rounding leaves rows that follow from each other exactly a little too narrow or too wide. With ``most``, a share of
    the set's sizes, rows are drawn in by as little as will do, and None is returned where so much will not. Without,
    every row is drawn in by as large a share as can be had with 0 left in the set. One linear program a need, and one
    for all. In floating point: what comes of it is to be checked.
    """
    rows, unit = len(S.h), 1.0 if most is None else most
    spare = min(1e-3 if most else 1e-9, 0.5 / max(rows, 1))
    lines: list[Array] = []
    right: list[float] = []
    for one in needs:
        answer = minimise(-one.normal, S.H, S.h)
        if answer.status != "optimal":
            return None
        line = -answer.prices * S.sizes
        if one.own is not None:
            line[one.own] += S.sizes[one.own]
        line /= one.size
        lines.append(np.r_[line, 0.0])
        right.append(-(float(answer.prices @ S.h) - one.bound) / (unit * one.size) - spare)
    sign = 1.0 if most is None else -1.0  # of the least share, or of the largest
    each = np.hstack([-sign * np.eye(rows), np.full((rows, 1), sign)])
    ends = np.hstack([np.vstack([np.eye(rows), -np.eye(rows)]), np.zeros((2 * rows, 1))])
    end = np.r_[np.ones(rows) if most else S.h / S.sizes, np.full(rows, -spare)]
    answer = minimise(
        np.append(np.zeros(rows), -sign), np.vstack([*lines, each, ends]), np.r_[right, np.zeros(rows), end]
    )
    if answer.status != "optimal":
        return None
    shares: Array = answer.x[:-1] * unit * S.sizes
    return shares


def _floats(lines: Sequence[Sequence[fmpq]]) -> Array:
    return np.array([[int(one.p) / int(one.q) for one in line] for line in lines])


def _ends(one: Zonotope) -> Matrix:
    ends: Matrix = [one.center.tolist(), *one.generators.T.tolist()]
    return ends


def _term(term: Term) -> Json:
    return {
        "left": formula_of(term.left),
        "base": formula_of(term.base),
        "count": term.times,
        "right": formula_of(term.right),
        "of": term.of,
    }
