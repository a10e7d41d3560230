"""Certificates of inclusions against the corners of polygons in fractions, and against linear programs."""

from __future__ import annotations

import copy
from fractions import Fraction
from itertools import combinations

import numpy as np
import pytest
from scipy.optimize import linprog

from verification.certificates.recheck import Recheck
from verification.certificates.sets import Inclusion, Need, Space, Term, drawn_in
from verification.checker.matrices import check_sets
from verification.checker.reading import Rejected
from workbench.contracts.claim import NotCertified
from workbench.sets import Polytope, Zonotope, maximal_rpi

TINY = Fraction(1, 10**30)
BOX = ([[1, 0], [-1, 0], [0, 1], [0, -1]], [1, 1, 1, 1])
NOTHING = Zonotope.point([0.0, 0.0])
STEP = Term(("^", "M", 0), "M", 1, ("^", "M", 0), "W")


def corners(H, h):
    """Return the corners of a bounded polygon: where two rows meet and the others hold, in fractions."""
    found = []
    for i, j in combinations(range(len(H)), 2):
        (a, b), (c, d) = H[i], H[j]
        if det := a * d - b * c:
            x, y = (h[i] * d - b * h[j]) / det, (a * h[j] - c * h[i]) / det
            if all(p * x + q * y <= r for (p, q), r in zip(H, h, strict=True)):
                found.append((x, y))
    return found


def farthest(H, h, M, W, normals):
    """Return how far M x + w reaches along each normal, exactly: x a corner, w an end of the zonotope."""
    F = [[Fraction(one) for one in line] for line in (W.center, *W.generators.T)]
    M = [[Fraction(one) for one in line] for line in M]
    along = []
    for p, q in normals:
        image = [p * M[0][0] + q * M[1][0], p * M[0][1] + q * M[1][1]]
        push = p * F[0][0] + q * F[0][1] + sum(abs(p * g[0] + q * g[1]) for g in F[1:])
        along.append(max(image[0] * x + image[1] * y for x, y in corners(H, h)) + push)
    return along


def drawn(seed):
    """Return a bounded polygon, a map and a zonotope by chance, in doubles, as fractions where they are lists."""
    random = np.random.default_rng(seed)
    angles = np.sort(random.uniform(0, 2 * np.pi, 5 + seed % 9)) if seed % 3 else np.arange(6) * np.pi / 3
    normals = np.array([*np.c_[np.cos(angles), np.sin(angles)], [1, 0], [-1, 0], [0, 1], [0, -1]])
    normals *= 10.0 ** random.uniform(-4, 4)
    H = [[Fraction(one) for one in line] for line in normals.tolist()]
    h = [Fraction(one) for one in random.uniform(0.5, 1.5, len(H)).tolist()]
    W = Zonotope(center=random.normal(size=2), generators=random.normal(size=(2, seed % 4)))
    return H, h, random.normal(size=(2, 2)).tolist(), W


def within(H, h, M, W, outer):
    return Space(matrices={"M": M}, polytopes={"S": (H, h), "T": outer}, disturbances={"W": W})


def shown(space, *claims):
    certificate = space.certificate("They lie in it.", claims or [Inclusion("T", (STEP,), "S", "M")])
    assert Recheck().sentence(certificate).startswith("They lie in it. (for every x in S")
    return certificate


@pytest.mark.parametrize("seed", range(40))
def test_an_inclusion_is_shown_where_the_corners_keep_it_and_nowhere_else(seed):
    H, h, M, W = drawn(seed)
    reach = farthest(H, h, M, W, H)
    made = shown(within(H, h, M, W, (H, reach)))  # touched by every row
    for row in range(len(H)):
        short = [*reach[:row], reach[row] - TINY, *reach[row + 1 :]]
        false = copy.deepcopy(made.statement)
        false["polytopes"]["T"][row][1] = str(short[row])
        with pytest.raises(Rejected, match=f"row {row} of T must follow"):
            check_sets(false, made.proof)
        with pytest.raises(NotCertified, match=f"row {row} of T"):
            shown(within(H, h, M, W, (H, short)))


@pytest.mark.parametrize("seed", range(10))
def test_doubles_in_four_dimensions_agree_with_a_linear_program(seed):
    random = np.random.default_rng(seed)
    H = np.vstack([random.normal(size=(20, 4)), np.eye(4), -np.eye(4)])
    h, M = random.uniform(0.5, 1.5, 28), random.normal(size=(4, 4))
    reach = np.array([-linprog(-row @ M, A_ub=H, b_ub=h, bounds=(None, None)).fun for row in H])
    space = {"matrices": {"M": M.tolist()}, "disturbances": {}}
    for share, holds in ((1 + 1e-9, True), (1 - 1e-9, False)):
        polytopes = {"S": (H.tolist(), h.tolist()), "T": (H.tolist(), (share * reach).tolist())}
        claim = Inclusion("T", (), "S", "M")
        if holds:
            shown(Space(polytopes=polytopes, **space), claim)
        else:
            with pytest.raises(NotCertified):
                shown(Space(polytopes=polytopes, **space), claim)


@pytest.mark.parametrize(
    ("more", "holds"),
    [(Fraction(0), True), (TINY, False), (Fraction(1, 10**12), False), (-TINY, True)],
    ids=["just", "by 1e-30", "by 1e-12", "with room"],
)
def test_a_set_that_is_left_by_little_is_left(more, holds):
    H, h = BOX
    half = [[Fraction(1, 2), 0], [0, Fraction(1, 2) + more]]
    claim = Inclusion("S", (STEP,), "S", "M")
    space = within(H, h, half, Zonotope.box([-0.5, -0.5], [0.5, 0.5]), BOX)
    if holds:
        shown(space, claim)
    else:
        with pytest.raises(NotCertified, match="row 2 of S was not seen to follow from S"):
            shown(space, claim)


FLAT = ([[1, 0], [-1, 0]], [1, 1])
"""A strip without an end."""


@pytest.mark.parametrize(
    ("inner", "M", "holds"),
    [
        (FLAT, [[Fraction(1, 2), 0], [7, 3]], True),
        (FLAT, [[Fraction(1, 2), TINY], [0, 0]], False),
        (([[2, 4], [-2, -4]], [2, 2]), [[1, 2], [0, 0]], True),
        (([[2, 4], [-2, -4]], [2, 2]), [[1, 2 + TINY], [0, 0]], False),
        (([[1, 0]], [1]), [[1, 0], [0, 1]], False),
    ],
)
def test_sets_without_an_end(inner, M, holds):
    space = within(*inner, M, NOTHING, FLAT)
    if holds:
        shown(space, Inclusion("T", (), "S", "M"))
    else:
        with pytest.raises(NotCertified):
            shown(space, Inclusion("T", (), "S", "M"))


@pytest.mark.parametrize("times", [0, 1, 3])
def test_sums_reach_as_far_as_their_terms(times):
    H, h, M, W = drawn(3)
    power, far = np.eye(2), np.zeros(len(H))
    normals = np.array(H, dtype=float)
    for _ in range(times):
        far = far + W.mapped(np.array(M) @ power).support(normals)
        power = power @ np.array(M)
    term = Term("M", "M", times, ("^", "M", 0), "W")
    for share, holds in ((1e-9, True), (-1e-9, False)):
        space = within(H, h, M, W, (H, [Fraction(one) for one in (far + share * np.abs(normals).max()).tolist()]))
        if holds:
            space.certificate("It does.", [Inclusion("T", (term,))])
        else:
            with pytest.raises(NotCertified, match="from nothing"):
                space.certificate("It does.", [Inclusion("T", (term,))])


def slipped(statement, proof, change):
    statement, proof = copy.deepcopy(statement), copy.deepcopy(proof)
    change(statement, proof)
    return statement, proof


def _more(path, text):
    def change(statement, proof):
        place = {"statement": statement, "proof": proof}
        for step in path[:-1]:
            place = place[step]
        place[path[-1]] = text(place[path[-1]]) if callable(text) else text

    return change


def _without_a_row(statement, proof):
    del statement["polytopes"]["S"][0]


def _less(number):
    return str(Fraction(number) - TINY)


CHANGES = {
    "a multiplier of -1e-30": _more(["proof", "multipliers", 0, 0, 0, 1], "-1/" + str(10**30)),
    "a multiplier less": _more(["proof", "multipliers", 0, 0, 0, 1], _less),
    "another row": _more(["proof", "multipliers", 0, 0, 0, 0], lambda i: (i + 1) % 4),
    "no row": _more(["proof", "multipliers", 0, 0, 0, 0], -1),
    "no multipliers": _more(["proof", "multipliers", 0, 0], []),
    "a row's multipliers less": _more(["proof", "multipliers", 0], lambda shares: shares[:-1]),
    "a claim's multipliers less": _more(["proof", "multipliers"], []),
    "a row dropped": _without_a_row,
    "a narrower outer set": _more(["statement", "polytopes", "T", 0, 1], _less),
    "a wider inner set": _more(["statement", "polytopes", "S", 0, 1], "1000001/1000000"),
    "a larger map": _more(["statement", "matrices", "M", 0, 0], "500001/1000000"),
    "a longer generator": _more(["statement", "disturbances", "W", 1, 0], "500001/1000000"),
    "a moved centre": _more(["statement", "disturbances", "W", 0, 0], "1/1000000"),
    "a term more": _more(["statement", "claims", 0, "plus", 0, "count"], 2),
    "half a term": _more(["statement", "claims", 0, "plus", 0, "count"], 0.5),
    "a longer term": _more(["statement", "claims", 0, "plus", 0, "left"], ["+", "M", "M2"]),
    "another map": _more(["statement", "claims", 0, "map"], ["+", "M", "M"]),
    "a map of nothing": _more(["statement", "claims", 0, "inner"], None),
    "a set that there is not": _more(["statement", "claims", 0, "inner"], "U"),
    "an operation that there is not": _more(["statement", "claims", 0, "map"], ["/", "M", "M"]),
    "a power below 0": _more(["statement", "claims", 0, "map"], ["^", "M", -1]),
    "no claim": _more(["statement", "claims"], []),
}


@pytest.mark.parametrize("name", CHANGES)
def test_what_is_changed_is_not_accepted(name):
    half = [[Fraction(1, 2), 0], [0, Fraction(1, 2)]]
    H, h = BOX
    space = Space(
        matrices={"M": half, "M2": [[1, 0], [0, 1]]},
        polytopes={"S": BOX, "T": (H, h)},
        disturbances={"W": Zonotope.box([-0.5, -0.5], [0.5, 0.5])},
    )
    made = shown(space, Inclusion("T", (STEP,), "S", "M"))
    check_sets(made.statement, made.proof)
    with pytest.raises((Rejected, ValueError, TypeError, LookupError)):
        check_sets(*slipped(made.statement, made.proof, CHANGES[name]))


def test_a_wider_claim_needs_its_rows():
    space = within(*FLAT, [[1, 0], [0, 1]], NOTHING, BOX)
    with pytest.raises(NotCertified, match="row 2 of T"):
        shown(space, Inclusion("T", (), "S", "M"))


@pytest.mark.parametrize("seed", range(5))
def test_what_rounding_leaves_is_mended_by_little(seed):
    random = np.random.default_rng(seed)
    turn = random.uniform(0.1, 1.4)
    A = 0.9 * np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    W, X = Zonotope.box([-0.01, -0.02], [0.01, 0.02]), Polytope.box([-1, -1], [1, 1])
    S = maximal_rpi(A, W, X)
    later = S.h - W.support(S.H)
    needs = [Need(row @ A, b, i, size) for i, (row, b, size) in enumerate(zip(S.H, later, S.sizes, strict=True))]
    claim = Inclusion("S", (STEP,), "S", "M")

    def made(h):
        return within(S.H.tolist(), h.tolist(), A.tolist(), W, BOX)

    ins = drawn_in(S, needs, most=1e-9)
    assert ins is not None and (ins > 0).all() and (ins < 1e-9 * S.sizes).all()
    shown(made(S.h - ins), claim)
    deep = drawn_in(S, needs)
    assert deep is not None and (deep > ins).all() and (S.h - deep >= 0).all()
    shown(made(S.h - deep), claim)
    with pytest.raises(NotCertified):  # far from invariant: rows are drawn in against what follows from what
        shown(made(S.h * np.where(np.arange(len(S.h)) % 2, 1, 0.5)), claim)
    far = [one._replace(bound=one.bound - 0.1) for one in needs]
    assert drawn_in(S, far, most=1e-9) is None


NO_NUMBERS = ("inner", "outer", "of", "says", "map", "M", "^")


def numbers_of(content, path=()):
    """Go through the places of a certificate that hold a number, in text or not."""
    if isinstance(content, (dict, list)):
        for key, inner in content.items() if isinstance(content, dict) else enumerate(content):
            yield from numbers_of(inner, (*path, key))
    elif path[-1] not in NO_NUMBERS and content not in NO_NUMBERS:
        yield path


def replaced(content, path, value):
    for step in path[:-1]:
        content = content[step]
    content[path[-1]] = value(content[path[-1]])


def number(written):
    return Fraction(*float.fromhex(written).as_integer_ratio()) if "0x" in written else Fraction(written)


def fractions(lines):
    return [[number(one) for one in line] for line in lines]


def true(statement):
    """Tell by corners whether what a statement with one sum of powers of M says is true."""
    polytopes = statement["polytopes"].items()
    sets = {name: [(fractions([row])[0], number(bound)) for row, bound in one] for name, one in polytopes}
    M, ends = fractions(statement["matrices"]["M"]), fractions(statement["disturbances"]["W"])
    (term,) = statement["claims"][0]["plus"]
    points = corners(*zip(*sets["S"], strict=True))
    assert points, "the mutated set must have corners"

    def times(p, power):
        for _ in range(power):
            p = (M[0][0] * p[0] + M[0][1] * p[1], M[1][0] * p[0] + M[1][1] * p[1])
        return p

    for (p, q), bound in sets["T"]:
        reach = max(p * x + q * y for x, y in (times(one, 1) for one in points))
        for j in range(term["count"]):
            moved = [times(one, j + term["left"][2] + term["right"][2]) for one in ends]
            reach += p * moved[0][0] + q * moved[0][1] + sum(abs(p * x + q * y) for x, y in moved[1:])
        if reach > bound:
            return False
    return True


@pytest.mark.parametrize("seed", range(8))
def test_a_mutant_that_is_accepted_is_true(seed):
    H, h, M, W = drawn(seed)
    made = shown(within(H, h, M, W, (H, [one + abs(one) / 100 for one in farthest(H, h, M, W, H)])))
    random, accepted = np.random.default_rng(seed), 0
    whole = {"statement": made.statement, "proof": made.proof}
    places = list(numbers_of(whole))

    def mutated(old):
        if isinstance(old, int):
            return max(0, old + int(random.integers(-1, 2)))
        factor = Fraction(1) + Fraction(int(random.integers(-5, 6)), 10 ** int(random.integers(1, 12)))
        return str(number(old) * factor)

    for _ in range(250):
        one = copy.deepcopy(whole)
        replaced(one, places[random.integers(len(places))], mutated)
        try:
            check_sets(one["statement"], one["proof"])
        except (Rejected, ValueError, TypeError, LookupError, ArithmeticError):
            continue
        assert true(one["statement"])
        accepted += 1
    assert 10 < accepted < 240
