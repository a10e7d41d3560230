"""Statements about rational matrices and polytopes: what is positive definite, and sets that lie in others."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from typing import NamedTuple

from flint import fmpq, fmpq_mat

from verification.checker.reading import Rejected, exact, need, record, rows, text, whole

Row = tuple[list[fmpq], fmpq]
Said = tuple[fmpq_mat, str]
_MADE: Mapping[str, Callable[[fmpq_mat, fmpq_mat], fmpq_mat]] = {
    "+": operator.add, "-": operator.sub, "*": operator.mul, "'": lambda a, b: a.transpose() * b
}  # fmt: skip

LONGEST = 10**6
"""Binary digits that powers may come to."""


class Sets(NamedTuple):
    """What claims of inclusion speak of, by name: matrices, polytopes, and what disturbs, as its ends' matrices."""

    matrices: Mapping[str, fmpq_mat]
    polytopes: Mapping[str, list[Row]]
    disturbances: Mapping[str, fmpq_mat]
    """The centre and then the generators, a row each."""


def _matrix(given: object, height: int | None = None, width: int | None = None) -> fmpq_mat:
    lines = [[exact(one) for one in rows(line, width)] for line in rows(given, height)]
    need(lines and lines[0] and len({len(line) for line in lines}) == 1, "a matrix must have rows of one length")
    return fmpq_mat(lines)


def is_positive(matrix: fmpq_mat) -> bool:
    """Tell whether a matrix is symmetric and positive definite, by the pivots of an exact elimination."""
    left = matrix.tolist()
    for i, line in enumerate(left):
        if not line[i] > 0:
            return False
        for j in range(i + 1, len(left)):
            share = left[j][i] / line[i]
            left[j] = [a - share * b for a, b in zip(left[j], line, strict=True)]
    return bool(matrix == matrix.transpose())


def _rows(given: object) -> list[Row]:
    found, width = [], None
    for one in rows(given):
        normal, bound = rows(one, 2)
        found.append(([exact(entry) for entry in rows(normal, width)], exact(bound)))
        width = len(found[0][0])
    need(found and found[0][0], "a polytope must have a row")
    return found


def _follows(row: Row, by: list[Row], multipliers: object) -> bool:
    """Tell whether a row h x <= c is a sum of others, none taken less than 0 times, or weaker than that."""
    normal, bound = [fmpq(0)] * len(row[0]), fmpq(0)
    for pair in rows(multipliers):
        place, times = rows(pair, 2)
        share, (of, edge) = exact(times), by[whole(place, 0, len(by) - 1)]
        need(share >= 0, "a row must be taken 0 times or more")
        normal, bound = [a + share * b for a, b in zip(normal, of, strict=True)], bound + share * edge
    return normal == row[0] and bound <= row[1]


def _named(given: object) -> dict[str, fmpq_mat]:
    if not isinstance(given, dict):
        raise Rejected("matrices must be a record")
    need(
        all(name.isidentifier() and name != "I" for name in given), "a matrix must have one word as its name, and not I"
    )
    return {text(name): _matrix(one) for name, one in given.items()}


def formula(given: object, of: Mapping[str, fmpq_mat], depth: int = 0) -> Said:
    """Return the value of a formula and its words: a name, ``[op, a, b]`` (``'`` is a' b), or ``["^", a, power]``."""
    need(depth < 40, "a formula is nested too deep")
    if isinstance(given, str):
        need(given in of, f"a matrix must be named, got {given!r:.40}")
        return of[given], given
    op, a, b = rows(given, 3)
    left, of_left = formula(a, of, depth + 1)
    whole_left = of_left if isinstance(a, str) or a[0] in ("+", "-") else f"({of_left})"
    if op == "^":
        need(left.nrows() == left.ncols(), "a power is one of a square matrix")
        need(_digits(left) * whole(b, 0, 2000) <= LONGEST, "a power has too many digits")
        return left ** whole(b, 0, 2000), f"{whole_left}^{b}" if b else "I"
    need(op in _MADE, f"a formula must be made of {' '.join(_MADE)} ^, got {op!r:.20}")
    right, of_right = formula(b, of, depth + 1)
    value = _MADE[op](left, right)
    if op in ("+", "-"):
        return value, f"({of_left} {op} {of_right})"
    return value, f"{of_left} {of_right}" if op == "*" else f"{whole_left}' {of_right}"


def _digits(matrix: fmpq_mat) -> int:
    return max((one.p.bit_length() + one.q.bit_length() for one in matrix.entries()), default=0)


def check_definite(statement: object) -> str:
    """Check that matrices, each made of others that are given, are symmetric and positive definite."""
    says, given, positive = record(statement, "says", "matrices", "positive")
    matrices, said = _named(given), []
    for one in rows(positive):
        value, words = formula(one, matrices)
        need(value.nrows() == value.ncols() and is_positive(value), f"{words} must be positive definite"[:300])
        said.append(words)
    need(said, "there must be a matrix that is positive definite")
    return f"{text(says)} (Positive definite: {'; '.join(said)}.)"


def check_sets(statement: object, proof: object) -> str:
    """Check inclusions of polytopes {x: H x <= h}, by multipliers that are not negative (Farkas).

    A claim says that ``map`` x + ``plus`` lies in ``outer`` for every x of ``inner``, or for x = 0 where there is no
    inner set. ``plus`` are sums over j < ``count`` of ``left`` ``base``^j ``right`` w_j, whatever the w_j of a
    disturbance, which is a centre and generators taken between -1 and 1 times.
    """
    says, given, polytopes, disturbances, claims = record(
        statement, "says", "matrices", "polytopes", "disturbances", "claims"
    )
    need(isinstance(polytopes, dict) and rows(claims), "there must be polytopes and a claim")
    of = Sets(_named(given), {text(name): _rows(one) for name, one in polytopes.items()}, _named(disturbances))
    shares = rows(record(proof, "multipliers")[0], len(claims))
    return f"{text(says)} ({'; '.join(_inclusion(of, *pair) for pair in zip(claims, shares, strict=True))}.)"


def _inclusion(of: Sets, claim: object, shares: object) -> str:
    inner, matrix, plus, outer = record(claim, "inner", "map", "plus", "outer")
    need(outer in of.polytopes, f"a polytope must be named, got {outer!r:.40}")
    goal, by = of.polytopes[outer], list[Row]()
    normals, said, start = fmpq_mat([row[0] for row in goal]), list[str](), "0"
    if inner is not None:
        need(inner in of.polytopes, f"a polytope must be named, got {inner!r:.40}")
        by = of.polytopes[inner]
        moved, words = formula(matrix, of.matrices)
        need(moved.ncols() == len(by[0][0]), f"the map must be one of the space of {inner}")
        start, left = f"{words} x", (normals * moved).tolist()
    else:
        need(matrix is None, "without an inner set there is no map")
        left = [[fmpq(0)] for _ in goal]
    room = [row[1] for row in goal]
    for one in rows(plus):
        less, words = pushed(normals, one, of)
        room = [a - b for a, b in zip(room, less, strict=True)]
        said.append(words)
    for i, (row, bound, multipliers) in enumerate(zip(left, room, rows(shares, len(goal)), strict=True)):
        need(_follows((row, bound), by, multipliers), f"row {i} of {outer} must follow from those of {inner}")
    who = "" if inner is None else f"for every x in {inner}, "
    return f"{who}{' + '.join([start, *said])} lies in {outer}"


def pushed(normals: fmpq_mat, term: object, of: Sets) -> tuple[list[fmpq], str]:
    """Return how far a sum of disturbances reaches along each normal at most, and its words."""
    left, base, count, right, name = record(term, "left", "base", "count", "right", "of")
    need(name in of.disturbances, f"a disturbance must be named, got {name!r:.40}")
    (first, of_left), (power, of_base), (last, of_right) = (formula(one, of.matrices) for one in (left, base, right))
    ends, along = of.disturbances[name].transpose(), normals * first
    last, far, number = last * ends, [fmpq(0)] * normals.nrows(), whole(count, 0, 2000)
    need(_digits(power) * number <= LONGEST, "a sum has too many digits")
    for _ in range(number):
        reach = (along * last).tolist()
        far = [a + line[0] + sum((abs(one) for one in line[1:]), fmpq(0)) for a, line in zip(far, reach, strict=True)]
        along = along * power
    return far, f"the sum over j < {number} of {of_left} {of_base}^j {of_right} w_j, w_j in {name},"
