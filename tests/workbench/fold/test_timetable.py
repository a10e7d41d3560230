"""What is taken out of a sample because it depends on time alone."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from models.line import FLAT
from models.point_mass import PointMass
from workbench.controllers import ICFDL
from workbench.fold.fold import TIMETABLE, build
from workbench.fold.timetable import timetable

X, K, P = ca.SX.sym("x"), ca.SX.sym("k"), ca.SX.sym("p", 2)

CASES = {
    # expression, how many rows are taken out
    "a sine of time": (X + ca.sin(P[0] * K), 1),
    "used twice": (X * ca.sin(K) + ca.sin(K) ** 2, 2),
    "two of them": (ca.sin(K) * X + X / ca.exp(P[1] * K), 2),
    "cheap ones stay": (X + P[0] * K + 3, 0),
    "of parameters alone stays": (X * ca.sin(P[0]), 0),
    "of the state stays": (ca.sin(X * K), 0),
    "with a condition": (ca.if_else(K > 3, ca.sin(K), X), 1),
    "nothing but time": (ca.cos(K) + P[0], 1),
    "several entries": (ca.vertcat(ca.sin(K), X, ca.sin(K) * X), 1),
}


@pytest.mark.parametrize(("expression", "rows"), CASES.values(), ids=CASES)
def test_taken_out_and_put_back(expression, rows):
    found = timetable([expression, X], K, P)
    assert found.symbols.numel() == rows
    whole = ca.Function("whole", [X, K, P], [expression])
    values = ca.Function("values", [K, P], [found.values])
    rest = ca.Function("rest", [X, P, K, found.symbols], [found.results[0]])
    for x, k in ((0.3, 2.0), (-1.7, 11.0)):
        p = np.array([0.7, -0.2])
        np.testing.assert_array_equal(whole(x, k, p).full(), rest(x, p, k, values(k, p)).full())


@pytest.mark.parametrize("plant", [PointMass(), PointMass(line=FLAT, reading="seconds")], ids=["metro", "seconds"])
def test_a_fold_computes_the_resistance_coefficients_once(plant):
    fold = build(plant, ICFDL(), 20)
    assert fold.memory[-1] == TIMETABLE and TIMETABLE not in fold.law_memory
    begun = fold.start.call({"r": np.zeros((1, 21)), "sampling_time": 0.1, "p": ca.DM(fold.values)})
    swing = np.sin(0.0037 * np.arange(20) * (0.1 if plant.reading == "seconds" else 1.0))
    expected = [2977 + 275 * swing, 25.17 + 2.5 * swing, 0.2864 + 0.04 * swing]
    taken = sorted(begun[TIMETABLE].full(), key=lambda row: -row[0])
    np.testing.assert_allclose(taken, expected, rtol=1e-14)
