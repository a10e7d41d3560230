"""Equations that are applied many times over: the same graph and the same numbers as a plain loop gives."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from models.repeated import repeated

A, B = ca.SX.sym("a"), ca.SX.sym("b")
TIMES = [0, 1, 2, 7]


def advance(column):
    return ca.vertcat(column[0] + 0.1 * ca.sin(A * column[1]), ca.fmax(column[1] * 0.9, B) - 0.01 * column[0])


def plain(column, times):
    for _ in range(times):
        column = advance(column)
    return column


@pytest.mark.parametrize("times", TIMES)
@pytest.mark.parametrize("begun", ["symbols", "a number and a symbol"])
def test_the_graph_is_that_of_a_plain_loop(times, begun):
    x = ca.SX.sym("x", 2)
    column = x if begun == "symbols" else ca.vertcat(0.0, x[1])
    copied, looped = (
        ca.Function("f", [x, A, B], [made(column, times)]) for made in (lambda c, n: repeated(advance, c, n), plain)
    )
    assert copied.n_instructions() == looped.n_instructions()
    rng = np.random.default_rng(times)
    for _ in range(20):
        point = rng.standard_normal(2), *rng.standard_normal(2)
        np.testing.assert_array_equal(copied(*point), looped(*point))


def test_the_equations_are_asked_once():
    asked = []
    repeated(lambda column: asked.append(1) or column + A, ca.SX.sym("x"), 50)
    assert len(asked) == 1


@pytest.mark.parametrize("kind", [ca.DM, ca.MX])
def test_what_is_no_sx_goes_through_the_loop(kind):
    made = repeated(lambda column: column * 0.5 + 1, kind(ca.DM([1.0, 2.0])), 3)
    assert type(made) is kind
    value = made if kind is ca.DM else ca.evalf(made)
    np.testing.assert_array_equal(value.full().ravel(), [1.875, 2.0])
