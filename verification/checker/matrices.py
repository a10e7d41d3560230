"""Statements about rational matrices and polytopes: loops that contract, and sets that lie in others."""

from __future__ import annotations

from flint import fmpq, fmpq_mat

from verification.checker.reading import exact, need, record, rows, text, whole

Row = tuple[list[fmpq], fmpq]


def _matrix(given: object, height: int | None = None, width: int | None = None) -> fmpq_mat:
    lines = [[exact(one) for one in rows(line, width)] for line in rows(given, height)]
    need(lines and lines[0] and len({len(line) for line in lines}) == 1, "a matrix must have rows of one length")
    return fmpq_mat(lines)


def _positive(matrix: fmpq_mat) -> bool:
    """Tell whether a matrix is symmetric and positive definite, by the pivots of an exact elimination."""
    left = matrix.tolist()
    for i, line in enumerate(left):
        if not line[i] > 0:
            return False
        for j in range(i + 1, len(left)):
            share = left[j][i] / line[i]
            left[j] = [a - share * b for a, b in zip(left[j], line, strict=True)]
    return bool(matrix == matrix.transpose())


def check_loops(statement: object, proof: object) -> str:
    """Check that matrices M contract in one norm x'Px: P - M'PM (``discrete``) or -(PM + M'P) is positive definite."""
    says, form, given = record(statement, "says", "form", "matrices")
    need(form in ("discrete", "continuous"), f"the form must be discrete or continuous, got {form!r:.20}")
    loops = [_matrix(one) for one in rows(given)]
    need(loops and len({n for one in loops for n in (one.nrows(), one.ncols())}) == 1, "matrices must be of one size")
    norm = _matrix(record(proof, "norm")[0], loops[0].nrows(), loops[0].nrows())
    need(_positive(norm), "the norm must be positive definite")
    for i, m in enumerate(loops):
        falls = norm - m.transpose() * norm * m if form == "discrete" else -(norm * m + m.transpose() * norm)
        need(_positive(falls), f"matrix {i} must contract in the norm")
    return f"{text(says)} ({len(loops)} matrices, {form}, contract in one quadratic norm.)"


def _rows(given: object) -> list[Row]:
    found, width = [], None
    for one in rows(given):
        normal, bound = rows(one, 2)
        found.append(([exact(entry) for entry in rows(normal, width)], exact(bound)))
        width = len(found[0][0])
    need(found, "a polytope must have a row")
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


def check_sets(statement: object, proof: object) -> str:
    """Check inclusions of polytopes {x: H x <= h}, by multipliers that are not negative (Farkas).

    A claim says that for every x of ``inner`` and every t_i in [-1, 1], map x + shift + sum of g_i t_i, the g_i its
    ``generators``, lies in ``outer``.
    """
    says, given, claims = record(statement, "says", "polytopes", "claims")
    need(isinstance(given, dict) and rows(claims), "there must be polytopes and a claim")
    sets = {text(name): _rows(one) for name, one in given.items()}
    said = []
    for claim, shares in zip(claims, rows(record(proof, "multipliers")[0], len(claims)), strict=True):
        inner, matrix, shift, generators, outer = record(claim, "inner", "map", "shift", "generators", "outer")
        need(inner in sets and outer in sets, f"polytopes must be named, got {inner!r:.40} and {outer!r:.40}")
        height = len(sets[outer][0][0])
        a = _matrix(matrix, height, len(sets[inner][0][0]))
        offset, *spans = ([exact(one) for one in rows(line, height)] for line in [shift, *rows(generators)])
        for i, (row, multipliers) in enumerate(zip(sets[outer], rows(shares, len(sets[outer])), strict=True)):
            room = row[1] - _dot(row[0], offset) - sum((abs(_dot(row[0], one)) for one in spans), fmpq(0))
            moved = ((fmpq_mat([row[0]]) * a).tolist()[0], room)
            need(_follows(moved, sets[inner], multipliers), f"row {i} of {outer} must follow from those of {inner}")
        said.append(f"{inner} under its map, with all that is added, lies in {outer}")
    return f"{text(says)} ({'; '.join(said)}.)"


def _dot(a: list[fmpq], b: list[fmpq]) -> fmpq:
    return sum((x * y for x, y in zip(a, b, strict=True)), fmpq(0))
