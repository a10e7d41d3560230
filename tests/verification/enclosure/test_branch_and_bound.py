"""Which boxes are split: those that may improve the answer, counted on functions whose extrema are known."""

from __future__ import annotations

import re
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import verification
from verification.enclosure import branch_and_bound
from verification.enclosure.bounds import bound, prove_bounds
from verification.enclosure.box import Box

x, y = ca.SX.sym("x"), ca.SX.sym("y")
BOX = Box({"x": (-2, 2), "y": (-2, 2)})
KNOWN = [
    # expression, its least value on the box
    (x * x - x, -0.25),
    ((1 - x) ** 2 + 100 * (y - x * x) ** 2, 0.0),
    (x * x + y * y - x * y, 0.0),
    (ca.hypot(x - 0.3, y + 0.2), 0.0),
    ((x * x - 1) ** 2 + (y * y - 2) ** 2, 0.0),
    (ca.cos(x) * ca.cos(y), float(np.cos(2.0))),
]


def scalar(expression) -> ca.Function:
    return ca.Function("f", [x, y], [expression], ["x", "y"], ["f"])


def _counted(monkeypatch, question) -> tuple[int, int]:
    """Return how many boxes a question takes, and how many if the boxes of smallest bound are split as they come."""
    own = question()
    with monkeypatch.context() as patched:
        patched.setattr(branch_and_bound, "unsettled", lambda bounds, chosen, best, settled: chosen)
        return own.boxes_used, question().boxes_used


@pytest.mark.parametrize("slopes", [True, False])
def test_fewer_boxes_bound_known_functions_to_the_same_tolerance(monkeypatch, slopes):
    totals = np.zeros(2, dtype=int)
    for expression, least in KNOWN:
        f = scalar(expression)
        found = bound(f, BOX, tolerance=1e-3, slopes=slopes)
        assert found.reason is None
        assert found.lower <= least <= found.attained_min.upper + 1e-12
        counts = _counted(monkeypatch, lambda f=f: bound(f, BOX, tolerance=1e-3, slopes=slopes))
        assert counts[0] <= counts[1]
        totals += counts
    assert totals[0] < 0.9 * totals[1], totals


@pytest.mark.parametrize("slopes", [True, False])
def test_fewer_boxes_prove_known_bounds(monkeypatch, slopes):
    totals = np.zeros(2, dtype=int)
    for expression, least in KNOWN:
        f, level = scalar(expression), least - 0.05
        assert prove_bounds(f, BOX, lower=level, slopes=slopes).standing == "proved"
        totals += _counted(monkeypatch, lambda f=f, level=level: prove_bounds(f, BOX, lower=level, slopes=slopes))
    assert totals[0] < 0.8 * totals[1], totals


def test_what_is_settled_or_may_prove_useless_is_not_split():
    bounds = np.array([0.9, 0.0, 0.4, 0.6, 0.995])

    def settled(smallest: float, best: float) -> bool:
        return best - smallest <= 0.01

    chosen = branch_and_bound.unsettled(bounds, np.arange(5), 1.0, settled)
    assert chosen.tolist() == [1, 2]
    assert branch_and_bound.unsettled(bounds[[0, 4]], np.arange(2), 1.0, settled).tolist() == [0]
    unknown = branch_and_bound.unsettled(bounds, np.arange(5), np.inf, lambda smallest, best: False)
    assert unknown.tolist() == [0, 1, 2, 3, 4]
    nothing = np.array([-np.inf, 0.0])
    assert branch_and_bound.unsettled(nothing, np.arange(2), 1.0, settled).tolist() == [0, 1]


def test_a_search_ends_where_only_a_box_that_cannot_be_split_is_unsettled():
    """3 x = 1 at no double: the box around 1/3 stays open, and all others are settled at once."""
    f = ca.Function("f", [x], [ca.if_else(3 * x == 1, -5, 0)], ["x"], ["f"])
    found = bound(f, Box({"x": (0, 1)}))
    assert "boxes cannot be split any further" in found.reason and found.lower == -5
    assert found.boxes_used < 512


def test_the_same_question_takes_the_same_boxes():
    f = scalar(ca.sin(3 * x) * ca.cos(2 * y) + x * y / 5)
    first, second = (bound(f, BOX) for _ in range(2))
    assert (first.boxes_used, first.lower, first.upper) == (second.boxes_used, second.lower, second.upper)


def test_no_verdict_looks_at_a_clock():
    """Budgets are boxes, evaluations and draws; a limit in seconds would make verdicts depend on the machine."""
    clock = re.compile(r"perf_counter|monotonic\(|time\.time\(|process_time|timeout=|alarm\(|time_limit|deadline")
    sources = sorted(Path(verification.__file__).parent.rglob("*.py"))
    assert len(sources) > 50
    assert [str(path) for path in sources if clock.search(path.read_text())] == []
