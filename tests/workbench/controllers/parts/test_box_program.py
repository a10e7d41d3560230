"""The minimum over a box against an active-set solver, on random programs of the kind that a tracking law makes."""

from __future__ import annotations

import casadi as ca
import daqp
import numpy as np
import pytest

from workbench.controllers.parts.box_program import minimum


def programs(blocks, horizon, count, seed=0):
    """Yield (H, g, low, high, start) of tracking programs, weights from light to heavy, limits from wide to narrow."""
    rng = np.random.default_rng(seed)
    for index in range(count):
        a, weight = rng.choice([1.0, 0.999, 0.95, 0.8, 1.01]), 10 ** rng.uniform(-3, 4)
        gains, free, row, y, d = np.zeros((horizon, blocks)), [], np.zeros(blocks), 10 * rng.normal(), rng.normal()
        for j in range(horizon):
            y, row = a * y + d, a * row
            row[j * blocks // horizon] += 1.0
            gains[j] = row
            free.append(y)
        change = np.eye(blocks) - np.eye(blocks, k=-1)
        ahead = np.cumsum(rng.normal(size=horizon)) * 10 ** rng.uniform(-1, 1) + 10 * rng.normal()
        g = gains.T @ (np.array(free) - ahead) - weight * rng.uniform(-1, 1) * np.eye(blocks)[0]
        high = 10 ** rng.uniform(-1.5, 1)
        low = -high * rng.uniform(0.5, 1)
        start = np.zeros(blocks) if index % 2 else rng.uniform(low, high, blocks)
        yield gains.T @ gains + weight * change.T @ change, g, low, high, start


def folded(blocks, rounds):
    H, g, start = ca.SX.sym("H", blocks, blocks), ca.SX.sym("g", blocks), ca.SX.sym("start", blocks)
    low, high = ca.SX.sym("low"), ca.SX.sym("high")
    u, residual = minimum(H, g, low, high, start, rounds)
    return ca.Function("minimum", [H, g, low, high, start], [u, residual])


def by_daqp(H, g, low, high):
    n = len(g)
    bounds = np.full(n, high), np.full(n, low), np.zeros(n, dtype=np.intc)
    x, _, flag, _ = daqp.solve(H, g, np.zeros((0, n)), *bounds, primal_tol=1e-12, dual_tol=1e-13)
    assert flag == 1
    return x


@pytest.mark.parametrize(
    ("blocks", "horizon", "rounds", "count"),
    [(1, 5, 6, 100), (5, 20, 6, 1500), (5, 200, 6, 500), (10, 20, 6, 200), (15, 30, 8, 40)],
)
def test_it_is_the_optimum(blocks, horizon, rounds, count):
    solve, limited = folded(blocks, rounds), 0
    for H, g, low, high, start in programs(blocks, horizon, count):
        u, residual = (np.asarray(value).ravel() for value in solve(H, g, low, high, start))
        best = by_daqp(H, g, low, high)
        assert np.abs(u - best).max() <= 1e-11 * (high - low)
        assert residual[0] <= 1e-13 * (high - low) and low <= u.min() and u.max() <= high
        limited += int(((best == low) | (best == high)).any())
    assert count / 2 < limited < count or blocks == 1  # some stand at a limit, and some do not


def test_two_rounds_are_not_enough_and_say_so():
    solve = folded(5, 2)
    told = [(float(solve(*one)[1]), one) for one in programs(5, 20, 300)]
    residual, (H, g, low, high, start) = max(told, key=lambda pair: pair[0])
    u = np.asarray(solve(H, g, low, high, start)[0]).ravel()
    assert residual > 1e-3 * (high - low) and np.abs(u - by_daqp(H, g, low, high)).max() > 1e-3 * (high - low)


def test_without_limits_it_is_a_linear_system():
    solve = folded(5, 1)
    for H, g, _, _, start in programs(5, 20, 50):
        u, residual = solve(H, g, -np.inf, np.inf, start)
        best = np.linalg.solve(H, -g)
        np.testing.assert_allclose(np.asarray(u).ravel(), best, rtol=0, atol=1e-9 * np.abs(best).max())
        assert float(residual) <= 1e-9 * np.abs(best).max()
        one_sided = np.asarray(folded_six(H, g, -np.inf, 0.1, start)[0]).ravel()
        np.testing.assert_allclose(one_sided, by_daqp(H, g, -1e9, 0.1), rtol=0, atol=1e-9 * max(1, np.abs(best).max()))


folded_six = folded(5, 6)
