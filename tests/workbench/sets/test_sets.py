"""Sets against brute force: vertices, random points, definitions by linear programs."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import linprog

from models.quantity import InvalidValue
from workbench.sets import (
    Polytope,
    Zonotope,
    maximal_rpi,
    minimal_rpi,
    reachable,
    rpi_residual,
    spectral_radius,
)

numbers = st.floats(-3, 3, allow_nan=False).map(lambda x: round(x, 3))
STABLE = np.array([[0.8, 0.3], [-0.2, 0.7]])


def vectors(*shape):
    return arrays(np.float64, shape, elements=numbers)


def corners(zonotope):
    signs = itertools.product([-1, 1], repeat=zonotope.generators.shape[1])
    return np.array([zonotope.center + zonotope.generators @ np.array(sign) for sign in signs])


@settings(max_examples=60, deadline=None)
@given(vectors(3), vectors(3, 4), vectors(5, 3))
def test_support_is_the_largest_value_at_a_corner(center, generators, directions):
    zonotope = Zonotope(center=center, generators=generators)
    assert np.allclose(zonotope.support(directions), (corners(zonotope) @ directions.T).max(axis=0), atol=1e-12)
    for direction in directions:
        assert np.isclose(direction @ zonotope.extreme(direction), zonotope.support(direction[None])[0], atol=1e-12)


@settings(max_examples=40, deadline=None)
@given(vectors(2), vectors(2, 3), vectors(2), vectors(2, 2), vectors(3, 2), vectors(4, 3))
def test_support_of_sums_and_images(c1, g1, c2, g2, matrix, directions):
    first, second = Zonotope(center=c1, generators=g1), Zonotope(center=c2, generators=g2)
    total = (first + second).mapped(matrix)
    parts = first.support(directions @ matrix) + second.support(directions @ matrix)
    assert np.allclose(total.support(directions), parts, atol=1e-10)


@settings(max_examples=30, deadline=None)
@given(vectors(2), vectors(2, 3), vectors(3))
def test_gauge_and_containment(center, generators, weights):
    zonotope = Zonotope(center=center, generators=generators)
    point = center + generators @ np.clip(weights, -1, 1)
    assert zonotope.contains(point, tolerance=1e-7)
    outward = np.array([1.0, 0.7])
    assert not zonotope.contains(zonotope.extreme(outward) + 0.01 * outward)


def test_gauge_of_a_segment_off_its_line_is_infinite():
    segment = Zonotope.segment([1.0, 2.0], -0.5, 1.0)
    assert segment.gauge([1.0, 2.1]) == np.inf
    assert np.isclose(segment.gauge([1.0, 2.0]), 1)
    assert Zonotope.point([1.0, 1.0]).contains([1.0, 1.0])
    assert not Zonotope.point([1.0, 1.0]).contains([1.0, 1.1])


def test_outline_is_the_convex_hull_of_the_corners():
    zonotope = Zonotope(center=np.array([1.0, -1.0]), generators=np.array([[1.0, -0.5, 0.2], [0.3, 0.8, -0.9]]))
    outline = zonotope.outline()
    assert outline.shape == (6, 2)
    for angle in np.linspace(0, 2 * np.pi, 37):
        direction = np.array([np.cos(angle), np.sin(angle)])
        assert np.isclose((outline @ direction).max(), zonotope.support(direction[None])[0])
    edges = np.roll(outline, -1, axis=0) - outline
    assert np.all(np.cross(np.c_[edges, np.zeros(6)], np.c_[np.roll(edges, -1, axis=0), np.zeros(6)])[:, 2] > 0)


@settings(max_examples=30, deadline=None)
@given(vectors(2), vectors(2, 3), arrays(np.float64, 7, elements=st.floats(0.1, 4).map(lambda x: round(x, 3))))
def test_pontryagin_difference_by_its_definition(center, generators, offsets):
    angles = np.linspace(0, 2 * np.pi, 7, endpoint=False)
    polytope = Polytope(H=np.c_[np.cos(angles), np.sin(angles)], h=offsets)
    zonotope = Zonotope(center=center, generators=generators)
    difference = polytope.minus(zonotope)
    shifted = Polytope(  # all x with x + corner in the polytope, corner by corner
        H=np.tile(polytope.H, (8, 1)), h=np.concatenate([offsets - polytope.H @ corner for corner in corners(zonotope)])
    )
    assert difference.is_empty() == shifted.is_empty()
    if difference.is_empty():
        return
    for angle in np.linspace(0, 2 * np.pi, 9):
        direction = np.array([np.cos(angle), np.sin(angle)])
        assert np.isclose(difference.support(direction), shifted.support(direction), atol=1e-7)


def test_polytope_support_by_another_program():
    random = np.random.default_rng(3)
    polytope = Polytope(H=random.normal(size=(14, 3)), h=random.uniform(0.5, 2, 14))
    for direction in random.normal(size=(10, 3)):
        other = linprog(-direction, A_ub=polytope.H, b_ub=polytope.h, bounds=(None, None), method="highs-ipm")
        expected = -other.fun if other.status == 0 else np.inf
        assert np.isclose(polytope.support(direction), expected)


def test_unbounded_and_empty_sets():
    half = Polytope.box([-np.inf, 0], [1, np.inf])
    assert half.support([1, 0]) == 1 and half.support([0, 1]) == np.inf
    assert half.chebyshev(cap=50.0)[1] == 50
    empty = Polytope(H=[[1.0], [-1.0]], h=[0.0, -0.5], labels=("x <= 0", "x >= 0.5"))
    assert empty.is_empty() and empty.support([1.0]) == -np.inf
    conflict = empty.conflict()
    assert conflict is not None and np.isclose(conflict.shortfall, 0.5)
    assert str(conflict) == "'x <= 0' and 'x >= 0.5' cannot both hold: they miss by 0.5"
    assert np.isclose(empty.chebyshev()[1], -0.25)
    thin = Polytope(H=[[1.0], [-1.0]], h=[0.0, 0.0])
    assert not thin.is_empty() and abs(thin.chebyshev()[1]) < 1e-9


def test_reduction_keeps_the_set_and_drops_what_is_implied():
    box = Polytope.box([-1, -1], [1, 1])
    loose = Polytope(H=[[1.0, 1.0], [2.0, 0.0], [3.0, 3.0]], h=[5.0, 2.0, 3.0])
    reduced = box.intersect(loose).reduced()
    assert len(reduced.h) == 5  # the diagonal cut at 1 and the square: two doubles and a loose row are gone
    for direction in np.random.default_rng(0).normal(size=(20, 2)):
        assert np.isclose(reduced.support(direction), box.intersect(loose).support(direction))


def test_preimage_is_what_maps_inside():
    box, matrix, offset = Polytope.box([-1, -1], [1, 2]), np.array([[1.0, 2.0], [0.0, 0.5]]), np.array([0.1, -0.2])
    inverse = box.preimage(matrix, offset)
    for x in np.random.default_rng(1).uniform(-4, 4, (200, 2)):
        assert inverse.contains(x) == box.contains(matrix @ x + offset)
    with pytest.raises(InvalidValue, match="no x maps into the set: 'x0 <= 1' fails by 1"):
        box.preimage(np.zeros((2, 2)), [2, 0])


def test_reachable_sets_hold_every_trajectory_and_touch_the_worst():
    W = Zonotope.segment([0.2, -0.1], -0.5, 1.0)
    sets = reachable(STABLE, W, 6)
    assert np.array_equal(sets[0].support(np.eye(2)), np.zeros(2))
    random = np.random.default_rng(5)
    directions = random.normal(size=(8, 2))
    for i in range(1, 7):
        x = np.zeros((4000, 2))
        for _ in range(i):
            x = x @ STABLE.T + np.outer(random.choice([-0.5, 1.0], 4000), [0.2, -0.1])
        reached = (x @ directions.T).max(axis=0)
        bound = sets[i].support(directions)
        assert np.all(reached <= bound + 1e-12)
        assert np.allclose(reached, bound)  # 2^6 corners, 4000 draws: all are met


@pytest.mark.parametrize("W", [Zonotope.segment([0.2, -0.1], -0.5, 1.0), Zonotope.box([-0.1, -0.2], [0.1, 0.3])])
def test_minimal_rpi_is_invariant_and_barely_larger_than_a_long_sum(W):
    minimal = minimal_rpi(STABLE, W)
    directions = np.random.default_rng(2).normal(size=(50, 2))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    stepped = minimal.support(directions @ STABLE) + W.support(directions)
    assert np.all(stepped <= minimal.support(directions) + 1e-14)
    assert np.allclose(minimal.support(directions), reachable(STABLE, W, 300)[300].support(directions), atol=1e-8)
    assert np.all(minimal.support(directions) >= reachable(STABLE, W, 300)[300].support(directions) - 1e-12)


def test_maximal_rpi_is_invariant_maximal_and_inside():
    W, X = Zonotope.box([-0.1, -0.05], [0.1, 0.05]), Polytope.box([-1, -1], [1, 1.5], names=("p", "q"))
    largest = maximal_rpi(STABLE, W, X)
    assert rpi_residual(STABLE, W, largest) <= 1e-9
    assert all(largest.support(row) <= offset + 1e-9 for row, offset in zip(X.H, X.h, strict=True))
    sets = reachable(STABLE, W, 80)
    random = np.random.default_rng(4)
    inside = outside = 0
    for x in random.uniform(-1.2, 1.7, (400, 2)):  # by definition: the nominal path stays in X less the tube
        steps = (np.linalg.matrix_power(STABLE, i) @ x for i in range(80))
        stays = all(X.minus(F).contains(p, tolerance=1e-9) for p, F in zip(steps, sets, strict=False))
        assert stays == largest.contains(x)
        inside, outside = inside + stays, outside + (not stays)
    assert inside > 50 and outside > 50


def test_rpi_residual_sees_a_set_that_is_not_invariant():
    W = Zonotope.box([-0.1, -0.05], [0.1, 0.05])
    assert rpi_residual(STABLE, W, Polytope.box([-1, -1], [1, 1])) > 0.1


def test_brake_invariant_set(tube):
    assert rpi_residual(tube.A_cl, tube.W_z, tube.Sigma) <= 1e-9
    minimal = minimal_rpi(tube.A_cl, tube.W_z)
    assert np.all(minimal.support(tube.Sigma.H) <= tube.Sigma.h + 1e-9)
    assert rpi_residual(tube.A_cl, tube.W_z.mapped(1.01 * np.eye(tube.plant.order)), tube.Sigma) > 1e-6


FAILURES = {
    "center must be finite, got nan": lambda: Zonotope.point([np.nan]),
    r"generators must have shape \(2, any\), got \(3, 1\)": lambda: Zonotope(
        center=np.zeros(2), generators=np.ones((3, 1))
    ),
    "low must be at most high, got low 1 and high 0": lambda: Zonotope.segment([1.0], 1, 0),
    "both sets must have one dimension, got 1 and 2": lambda: Zonotope.point([0.0]) + Zonotope.point([0.0, 0]),
    "outline needs a set in the plane": lambda: Zonotope.point([0.0]).outline(),
    "H must have no zero row, got one at 1": lambda: Polytope(H=[[1.0], [0.0]], h=[1.0, 1.0]),
    "labels must name each of the 1 rows, got 2": lambda: Polytope(H=[[1.0]], h=[1.0], labels=("a", "b")),
    "neither NaN": lambda: Polytope.box([np.nan], [1]),
    "A must be Schur .spectral radius below 1., got 1.1": lambda: maximal_rpi(
        np.eye(1) * 1.1, Zonotope.point([0.0]), Polytope.box([-1], [1])
    ),
    "steps must be at least 0, got -1": lambda: reachable(np.eye(1), Zonotope.point([0.0]), -1),
    "beyond 'p <= 1' by 0.5": lambda: maximal_rpi(
        [[0.8]], Zonotope.segment([1.0], -0.1, 0.3), Polytope.box([-1], [1], names=("p",))
    ),
}


@pytest.mark.parametrize("message", sorted(FAILURES))
def test_bad_input_is_told(message):
    with pytest.raises(InvalidValue, match=message):
        FAILURES[message]()


def test_arrays_are_read_only():
    center = np.zeros(2)
    zonotope = Zonotope.point(center)
    center[0] = 5.0
    assert zonotope.center[0] == 0
    with pytest.raises(ValueError, match="read-only"):
        zonotope.center[0] = 1.0
    assert spectral_radius(STABLE) < 1
