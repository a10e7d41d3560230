"""The answers about sets do not depend on units: the same sets in other numbers, and exact rational arithmetic."""

from __future__ import annotations

import itertools
from fractions import Fraction

import numpy as np
import pytest
from units import STATES, Units

from models.quantity import InvalidValue
from workbench.sets import (
    Polytope,
    Zonotope,
    is_redundant,
    linear_program,
    maximal_rpi,
    minimal_rpi,
    reachable,
    rpi_residual,
    spectral_radius,
)
from workbench.sets.balance import balanced, state_units
from workbench.sets.linear_program import SolverFailed, minimise

STABLE = np.array([[0.8, 0.3], [-0.2, 0.7]])
THREE = np.array([[0.9, 0.2, 0.0], [-0.1, 0.6, 0.3], [0.0, 0.0, 0.5]])  # the last drives the others and is not driven
LOOPS = {
    "plane": (
        STABLE,
        Zonotope.box([-0.1, -0.05], [0.1, 0.05]),
        Polytope.box([-1, -1], [1, 1.5], names=("p", "q")),
    ),
    "segment": (STABLE, Zonotope.segment([0.2, -0.1], -0.1, 0.3), Polytope.box([-1, -1], [2, 1], names=("p", "q"))),
    "one-sided": (STABLE, Zonotope.box([-0.1, -0.1], [0.1, 0.1]), Polytope(H=[[1.0, 1.0], [1.0, -1.0]], h=[1.0, 2.0])),
    "unequal": (STABLE, Zonotope.box([-1e-4, -20], [1e-4, 20]), Polytope.box([-300, -400], [300, 500])),
    "three": (
        THREE,
        Zonotope.box([-0.1, 0.0, -0.1], [0.1, 0.0, 0.1]),
        Polytope.box([-2, -np.inf, -1], [2, np.inf, 1]),
    ),
    "apart": (np.diag([0.5, -0.9]), Zonotope.box([-0.1, -0.1], [0.1, 0.1]), Polytope.box([-1, -2], [2, 3])),
}
"""A loop, its disturbances, its bounds."""


def exact(array):
    return [[Fraction(float(x)) for x in row] for row in np.atleast_2d(array)]


def solved(rows, right):
    """The solution of a square rational system, None if it has none or many."""
    n = len(rows)
    table = [[*row, value] for row, value in zip(rows, right, strict=True)]
    for i in range(n):
        pivot = next((r for r in range(i, n) if table[r][i] != 0), None)
        if pivot is None:
            return None
        table[i], table[pivot] = table[pivot], table[i]
        table[i] = [x / table[i][i] for x in table[i]]
        for r in range(n):
            if r != i and table[r][i] != 0:
                table[r] = [x - table[r][i] * y for x, y in zip(table[r], table[i], strict=True)]
    return [row[-1] for row in table]


def vertices(H, h):
    """The vertices of {x : H x <= h} by exact enumeration."""
    rows, right = exact(H), exact(h)[0]
    found = []
    for chosen in itertools.combinations(range(len(rows)), len(rows[0])):
        x = solved([rows[i] for i in chosen], [right[i] for i in chosen])
        if x is not None and all(dot(row, x) <= value for row, value in zip(rows, right, strict=True)):
            found.append(x)
    return found


def dot(a, b):
    return sum((x * y for x, y in zip(a, b, strict=True)), Fraction(0))


@pytest.mark.parametrize("units", sorted(STATES))
@pytest.mark.parametrize("name", sorted(LOOPS))
def test_invariant_sets_are_the_same_in_other_units(name, units):
    A, W, X = LOOPS[name]
    u = Units(STATES[units](len(A)))
    first, other = maximal_rpi(A, W, X), maximal_rpi(u.loop(A), u.zonotope(W), u.polytope(X))
    assert other.labels == first.labels
    assert rpi_residual(u.loop(A), u.zonotope(W), other) <= 1e-9
    assert rpi_residual(u.loop(A), u.zonotope(W), u.polytope(X)) == pytest.approx(rpi_residual(A, W, X), rel=1e-9)
    assert spectral_radius(u.loop(A)) == pytest.approx(spectral_radius(A), rel=1e-12)
    small, same = minimal_rpi(A, W), minimal_rpi(u.loop(A), u.zonotope(W))
    directions = np.random.default_rng(0).normal(size=(12, len(A)))
    ahead = [reachable(A, W, 9)[9], reachable(u.loop(A), u.zonotope(W), 9)[9]]
    for d in directions:
        assert other.support(d / u.c) == pytest.approx(first.support(d), rel=1e-9)
        assert same.support([d / u.c])[0] == pytest.approx(small.support([d])[0], rel=1e-8)
        assert ahead[1].support([d / u.c])[0] == pytest.approx(ahead[0].support([d])[0], rel=1e-12)


@pytest.mark.parametrize("units", sorted(STATES))
@pytest.mark.parametrize("name", ["plane", "segment", "unequal", "apart"])
def test_invariant_sets_are_invariant_by_exact_enumeration(name, units):
    """Every vertex of the set, pushed by every vertex of W, lies in it: in rational numbers, to 1e-9 of its width."""
    A, W, X = LOOPS[name]
    u = Units(STATES[units](len(A)))
    loop, push, largest = u.loop(A), u.zonotope(W), maximal_rpi(u.loop(A), u.zonotope(W), u.polytope(X))
    points = vertices(largest.H, largest.h)
    corners = [push.center + push.generators @ s for s in itertools.product([-1, 1], repeat=push.generators.shape[1])]
    assert len(points) >= 3
    rows, rational = exact(largest.H), exact(loop)
    for row, offset in zip(rows, exact(largest.h)[0], strict=True):
        width = offset - min(dot(row, x) for x in points)
        assert width > 0
        ahead = max(dot(row, [dot(line, x) for line in rational]) for x in points)
        assert ahead + max(dot(row, exact(w)[0]) for w in corners) <= offset + width / 10**9
        assert any(offset - dot(row, x) <= width / 10**9 for x in points)  # no row is idle


@pytest.mark.parametrize("units", sorted(STATES))
def test_a_set_that_is_not_invariant_is_seen_in_every_unit(units):
    A, W, X = LOOPS["plane"]
    u = Units(STATES[units](2))
    largest = maximal_rpi(A, W, X)
    for row in (0, len(largest.h) - 1):
        wider = largest.h * np.where(np.arange(len(largest.h)) == row, 1 + 1e-6, 1.0)
        grown = u.polytope(Polytope(H=largest.H, h=wider))
        assert rpi_residual(u.loop(A), u.zonotope(W), grown) == pytest.approx(
            rpi_residual(A, W, Polytope(H=largest.H, h=wider)), abs=1e-12
        )
    shrunk = Polytope(H=largest.H, h=largest.h * (1 - 1e-6))
    assert rpi_residual(u.loop(A), u.zonotope(W), u.polytope(shrunk)) > 1e-8


POINTS = [(0.0, 0.0), (0.3, -0.2), (1.0, -1.0), (1.0, 1.0), (-1.0, 0.3), (0.71, 0.72), (2.0, 5.0), (0.3, 0.7)]
SETS = {
    "box": Polytope.box([-1, -1], [1, 0.5]),
    "cut": Polytope(
        H=[[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0], [1.0, 1.0], [2.0, 2.1], [1.0, -3.0]],
        h=[1.0, 1.0, 1.0, 1.0, 1.2, 5.0, 3.9],
    ),
    "thin": Polytope(H=[[1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]], h=[1.0, -1.0, 1.0, 1.0]),
    "corner at the origin": Polytope.box([0, 0], [1, 2]),
    "with loose rows": Polytope(H=[[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0], [1.0, 1.0]], h=[1, 1, 1, 1, 1e7]),
    "with a row a long way off": Polytope(H=[[1.0, 0], [-1.0, 0], [0, 1.0], [0, -1.0], [1, 1.0]], h=[1, 1, 1, 1, 1e15]),
    "among looser ones": Polytope(
        H=np.vstack([np.eye(2), -np.eye(2), np.eye(2), -np.eye(2), [[1.0, 1.0], [1.0, -1.0]]]),
        h=[1, 1, 1, 1, *np.full(4, 1e12), 1e13, 1e14],
    ),
    "half open": Polytope.box([0, -np.inf], [1, 2]),
    "cone": Polytope(H=[[-1.0, 0.0], [0.0, -1.0], [-1.0, -1.0]], h=[0.0, 0.0, 0.0]),
    "strip": Polytope(H=[[1.0, 2.0], [-1.0, -2.0]], h=[1.0, 1.0]),
    "far off": Polytope.box([1e3, 2e3], [1e3 + 1, 2e3 + 1]),
}


@pytest.mark.parametrize("units", sorted(STATES))
@pytest.mark.parametrize("name", sorted(SETS))
def test_questions_about_a_set_have_the_same_answer_in_other_units(name, units):
    X, u = SETS[name], Units(STATES[units](2))
    other = u.polytope(X)
    for first, second in ((X, other), (X.reduced(), other.reduced())):
        assert first.labels == second.labels
        assert not first.is_empty() and not second.is_empty()
        for d in [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, 2), (0.3, -0.8)]:
            assert second.support(np.array(d) / u.c) == pytest.approx(first.support(d), rel=1e-9, abs=1e-9)
    for point in np.array(POINTS) + (np.array([1e3, 2e3]) if name == "far off" else 0):
        assert other.contains(point * u.c) == X.contains(point), point
    for small in (1e-6, 1e-3):
        W = Zonotope.box([-small, -small], [small, small])
        less, same = X.minus(W), other.minus(u.zonotope(W))
        assert less.is_empty() == same.is_empty() == (name == "thin")
    assert other.deepest()[1] == pytest.approx(X.deepest()[1], abs=1e-9)
    if name != "cone":  # it has no size: any will do
        assert np.allclose(other.sizes * np.linalg.norm(X.H / u.c, axis=1), X.sizes)


@pytest.mark.parametrize("units", sorted(STATES))
@pytest.mark.parametrize(
    "name", ["box", "cut", "corner at the origin", "with loose rows", "far off", "among looser ones"]
)
def test_supports_sizes_and_reduction_by_exact_enumeration(name, units):
    X = Units(STATES[units](2)).polytope(SETS[name])
    points, rows = vertices(X.H, X.h), exact(X.H)
    for row, offset, size in zip(rows, exact(X.h)[0], X.sizes, strict=True):
        assert X.support([float(x) for x in row]) == pytest.approx(float(max(dot(row, x) for x in points)), rel=1e-12)
        if name == "among looser ones" and float(offset) > 1e6 * min(X.h):
            continue  # its width is told by its offset, and rounded with it
        assert size == pytest.approx(float(offset - min(dot(row, x) for x in points)), rel=1e-7)
    touching = {
        label
        for row, offset, label in zip(rows, exact(X.h)[0], X.labels, strict=True)
        if sum(abs(dot(row, x) - offset) <= abs(offset) / 10**12 for x in points) >= 2
    }
    assert set(X.reduced().labels) == touching


EMPTY = {
    "two": ([[1.0], [-1.0]], [0.0, -0.5], (0, 1), 0.5),
    "far apart": ([[1.0], [-1.0]], [0.0, -5.0], (0, 1), 5.0),
    "a third between": ([[1.0], [-1.0], [1.0]], [0.0, -5.0, 3.0], (0, 1), 5.0),
    "barely": ([[1.0], [-1.0]], [1.0, -1.0 - 1e-7], (0, 1), 1e-7),
    "a triangle inside out": ([[-1.0, 0], [0, -1.0], [1, 1]], [0.0, 0.0, -1.0], (0, 1, 2), None),
    "beside an open side": ([[1.0, 0.0], [0.0, 1.0], [0.0, -1.0]], [1.0, 2.0, -3.0], (1, 2), 1.0),
}


@pytest.mark.parametrize("units", sorted(STATES))
@pytest.mark.parametrize("name", sorted(EMPTY))
def test_empty_sets_are_empty_and_stay_so(name, units):
    H, h, rows, miss = EMPTY[name]
    u = Units(STATES[units](len(H[0])))
    X = u.polytope(Polytope(H=H, h=h))
    assert not vertices(X.H, X.h)
    conflict = X.conflict()
    assert conflict is not None and conflict.rows == rows
    if miss is not None:
        assert conflict.shortfall == pytest.approx(miss * u.c[-1], rel=1e-6)
    assert X.is_empty() and X.reduced().is_empty() and X.deepest()[1] < 0
    assert X.support(np.ones(len(u.c)) / u.c) == -np.inf and X.support(np.zeros(len(u.c))) == -np.inf


@pytest.mark.parametrize("units", sorted(STATES))
def test_what_is_left_of_a_set_by_as_much_as_it_holds_is_not_empty(units):
    """0.3 = 0.1 + 0.2 but for rounding: a set less all of itself is a point, though its offsets come out negative."""
    u = Units(STATES[units](2))
    W = Zonotope.box([-0.1, -0.1], [0.1, 0.1]) + Zonotope.box([-0.2, -0.2], [0.2, 0.2])
    X = Polytope.box([-0.3, -0.3], [0.3, 0.3])
    left = u.polytope(X).minus(u.zonotope(W))
    assert not left.is_empty() and left.deepest()[1] == pytest.approx(0, abs=1e-12)
    assert left.minus(u.zonotope(Zonotope.box([-1e-6, 0], [1e-6, 0]))).is_empty()


@pytest.mark.parametrize("units", sorted(STATES))
def test_redundancy_is_told_from_emptiness_in_every_unit(units):
    c = float(STATES[units](1)[0])
    one = np.array([[1.0 / c]])
    assert is_redundant(one[0], 2.0, one, np.array([1.0]), size=1.0)
    assert not is_redundant(one[0], 1.0, one, np.array([2.0]), size=1.0)
    assert not is_redundant(one[0], 0.0, -one, np.array([-5.0]), size=1.0)  # all beyond the row, by more than its size
    assert not is_redundant(one[0], 0.0, -one, np.array([0.0]), size=1e-3)  # no end
    nowhere = np.array([[1.0 / c], [-1.0 / c]])
    assert is_redundant(one[0], 0.0, nowhere, np.array([1.0, -2.0]), size=1.0)


ZONOTOPES = {
    "box": Zonotope.box([-1, -1], [1, 1]),
    "segment": Zonotope.segment([1.0, 2.0], -0.5, 1.0),
    "hexagon": Zonotope(center=np.array([1.0, -1.0]), generators=np.array([[1.0, -0.5, 0.2], [0.3, 0.8, -0.9]])),
    "sliver": Zonotope(center=np.zeros(2), generators=np.array([[1.0, 1.0], [1.0, 1.0 + 1e-4]])),
    "point": Zonotope.point([1.0, 2.0]),
}


@pytest.mark.parametrize("units", sorted(STATES))
@pytest.mark.parametrize("name", sorted(ZONOTOPES))
def test_gauges_are_the_same_in_other_units(name, units):
    Z, u = ZONOTOPES[name], Units(STATES[units](2))
    other = u.zonotope(Z)
    for d in [(1.0, 0.3), (-0.2, 1.0), (-1.0, -1.1)]:
        edge = Z.extreme(d)
        for factor in (0.0, 0.5, 0.999, 1.001, 1.5):
            point = Z.center + factor * (edge - Z.center)
            expected = 0.0 if name == "point" else factor
            assert Z.gauge(point) == pytest.approx(expected, abs=1e-7)
            assert other.gauge(point * u.c) == pytest.approx(expected, abs=1e-7)
            assert other.contains(point * u.c) == (factor < 1 or name == "point")
    beside = (Z.center + np.array([0.1, -0.1])) * u.c
    assert other.contains(beside) == Z.contains(beside / u.c) == (name in ("box", "hexagon"))


def test_a_zonotope_thinner_than_any_tolerance_has_an_outside():
    tiny = Zonotope.box([-1e-12, -1e-12], [1e-12, 1e-12])
    assert tiny.contains([1e-12, -1e-12]) and not tiny.contains([1.5e-12, 0]) and not tiny.contains([0, 1.001e-12])
    flat = Zonotope.box([-1.0, -1e-12], [1.0, 1e-12])
    assert flat.contains([1.0, 1e-12]) and not flat.contains([0.5, 1.5e-12])


def random_program(seed, p=3, m=9):
    random = np.random.default_rng(seed)
    return random.normal(size=p).round(2), random.normal(size=(m, p)).round(2), random.uniform(0.5, 2, m).round(2)


@pytest.mark.parametrize("units", sorted(STATES))
@pytest.mark.parametrize("seed", range(6))
def test_linear_programs_by_exact_enumeration(seed, units):
    c, G, g = random_program(seed)
    G, g = np.vstack([G, np.eye(3), -np.eye(3)]), np.r_[g, np.full(6, 4.0)]
    scale, rows = STATES[units](3), 10.0 ** np.random.default_rng(seed).integers(-9, 9, len(g))
    C, M, r = c / scale, rows[:, None] * G / scale, rows * g
    answer = minimise(C, M, r)
    best = min(dot(exact(C)[0], x) for x in vertices(M, r))
    assert answer.status == "optimal" and answer.value == pytest.approx(float(best), rel=1e-12)
    assert np.all(M @ answer.x <= r * (1 + 1e-9)) and C @ answer.x == pytest.approx(float(best), rel=1e-12)
    assert np.all(answer.prices >= 0) and -answer.prices @ r == pytest.approx(float(best), rel=1e-9)  # strong duality


@pytest.mark.parametrize("units", sorted(STATES))
def test_what_became_of_a_program_is_told_apart(units):
    c = STATES[units](2)
    rows = np.array([[1.0, 0.0], [-1.0, 0.0]]) / c
    assert minimise(np.array([1.0, 0.0]) / c, rows, np.array([1.0, 2.0])).value == pytest.approx(-2.0)
    assert minimise(np.array([0.0, 1.0]) / c, rows, np.array([1.0, 2.0])).status == "unbounded"
    assert minimise(np.array([0.0, 1.0]) / c, rows, np.array([1.0, -2.0])).status == "infeasible"
    assert minimise(np.array([1.0, 0.0]) / c, rows, np.array([1.0, -2.0])).status == "infeasible"
    idle = np.vstack([rows, np.zeros((1, 2))])
    for g, status in ((0.0, "optimal"), (1e12, "optimal"), (-1e-12, "infeasible")):
        answer = minimise(np.array([1.0, 0.0]) / c, idle, np.array([1.0, 2.0, g]))
        assert answer.status == status and (status != "optimal" or answer.value == pytest.approx(-2.0))
        assert status != "optimal" or (answer.prices[2] == 0 and answer.prices[1] == pytest.approx(1.0))
    coupled = np.array([[1.0, 1e-10], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]) / c
    bound = minimise(np.array([-1.0, 0.0]) / c, coupled, np.array([0.0, 0.0, 1e10, 1e10]))
    assert bound.value == pytest.approx(-1.0)  # a coefficient of 1e-10 times 1e10 is one


class Broken:
    """What HiGHS answers when it fails."""

    status = 4


class Wrong:
    """What a solver might answer that is not right: feasible, not optimal."""

    status, fun = 0, 0.0

    def __init__(self, c, A_ub, A_eq):
        self.x = np.zeros(len(c))
        self.ineqlin = type("", (), {"marginals": np.zeros(len(A_ub))})
        self.eqlin = type("", (), {"marginals": np.zeros(0 if A_eq is None else len(A_eq))})


ANSWERS = {
    "fails": lambda c, A_ub, A_eq, **_: Broken(),
    "gives up": lambda c, A_ub, A_eq, **_: type("", (), {"status": 1}),
    "is wrong": lambda c, A_ub, A_eq, **_: Wrong(c, A_ub, A_eq),
}


@pytest.mark.parametrize("answer", sorted(ANSWERS))
def test_a_failure_of_the_solver_is_never_an_answer(answer, monkeypatch):
    box, tube = Polytope.box([-1, -1], [1, 1]), Zonotope.box([-1, -1], [1, 1])
    _ = box.sizes
    monkeypatch.setattr(linear_program, "linprog", ANSWERS[answer])
    assert minimise(np.array([1.0, 0.0]), box.H, box.h).status == "failed"
    for question in (
        lambda: box.support([1.0, 0.0]),
        lambda: box.reduced(),
        lambda: is_redundant(box.H[0], 1.0, box.H[1:], box.h[1:], size=1.0),
        lambda: Polytope.box([-1], [1]).contains([0.5]),
        lambda: tube.contains([0.5, 0.5]),
        lambda: maximal_rpi(STABLE, Zonotope.point([0.0, 0.0]), box),
        lambda: rpi_residual(STABLE, Zonotope.point([0.0, 0.0]), box),
        lambda: Polytope(H=[[1.0], [-1.0]], h=[1.0, -2.0]).is_empty(),
    ):
        with pytest.raises(SolverFailed):
            question()


@pytest.mark.parametrize("seed", range(5))
def test_scales_follow_every_change_of_units(seed):
    """By powers of two the balanced matrix is the same to the last bit, whatever it was multiplied with."""
    random = np.random.default_rng(seed)
    matrix = random.normal(size=(7, 4)) * (random.uniform(size=(7, 4)) < 0.7)
    matrix[0] = random.normal(size=4)
    g = random.normal(size=7)
    rows, columns = 2.0 ** random.integers(-60, 60, 7), 2.0 ** random.integers(-60, 60, 4)
    plain, other = balanced(matrix, beside=g), balanced(rows[:, None] * matrix * columns, beside=rows * g)
    first = plain.rows[:, None] * matrix * plain.columns
    second = other.rows[:, None] * rows[:, None] * matrix * columns * other.columns
    ratio = np.divide(second, first, out=np.ones_like(first), where=first != 0)
    assert np.all((ratio >= 0.25) & (ratio <= 4)) and np.all(np.abs(second).max(axis=1) <= 1)
    assert np.all(np.log2(other.rows) % 1 == 0) and np.all(np.log2(other.columns) % 1 == 0)
    A, b = random.normal(size=(4, 4)), random.normal(size=4)
    units = state_units(A * columns[:, None] / columns, b * columns) / columns / state_units(A, b)
    assert np.all((units / units[0] >= 0.25) & (units / units[0] <= 4))


@pytest.mark.parametrize("units", sorted(STATES))
def test_preimages_are_the_same_in_other_units(units):
    u = Units(STATES[units](2))
    box, matrix, offset = Polytope.box([-1, -1], [1, 2]), np.array([[1.0, 2.0], [0.0, 0.5]]), np.array([0.1, -0.2])
    inverse = u.polytope(box).preimage(u.loop(matrix), offset * u.c)
    for x in np.random.default_rng(1).uniform(-4, 4, (100, 2)):
        assert inverse.contains(x * u.c) == box.contains(matrix @ x + offset)
    row = Polytope(H=np.ones((1, 3)) / u.c[0], h=[0.3])  # M sends the row to zero and the offset uses it up, but for
    left = row.preimage(np.array([[0.1], [0.2], [-0.3]]) * u.c[0], np.array([0.1, 0.2, 0.0]) * u.c[0])  # rounding
    assert len(left.h) == 0
    with pytest.raises(InvalidValue, match="no x maps into the set: 'row 0' fails by"):
        row.preimage(np.array([[0.1], [0.2], [-0.3]]) * u.c[0], np.array([0.1, 0.2, 1e-7]) * u.c[0])
