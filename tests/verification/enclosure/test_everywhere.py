"""What is continuous for all real arguments, and intervals without ends, which that rests on."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from verification.enclosure.box import Box
from verification.enclosure.interval import PARTIAL, TOTAL
from verification.enclosure.outward import Span
from verification.enclosure.rounding import rounding
from verification.enclosure.smoothness import breaks_somewhere
from workbench.graph import DOUBLES
from workbench.graph.operations import OPERATIONS

x, u, k = (ca.SX.sym(name) for name in "xuk")
IF = ca.if_else

EVERYWHERE = [
    # expression, what breaks, empty for nothing
    ("a guarded root", IF(x > 0.3, ca.sqrt(x - 0.3), 0), ""),
    ("a guarded root, closed", IF(x >= 0.3, ca.sqrt(x - 0.3), 0), ""),
    ("a guarded root that jumps", IF(x > 0.3, ca.sqrt(x), 0), "jump"),
    ("a guard that lets the end in", IF(x > 0.2, ca.sqrt(x - 0.3), 0), "jump"),
    ("and does so where both sides agree", IF(x > 0.2, (x - 0.2) * ca.sqrt(x - 0.3), 0), "end of a domain"),
    ("a guarded quotient", IF(ca.fabs(x - 0.125) > 0.25, 1 / (x - 0.125), 16 * (x - 0.125)), ""),
    ("a guarded quotient that misses", IF(ca.fabs(x) > 0.25, 1 / x, 15 * x), "jump"),
    ("a guard of nothing", IF(ca.fabs(x) > 0, x / ca.fabs(x), 0), "jump"),
    ("a guard to the right of a pole", IF(x > 0.5, 1 / x, 2), ""),
    ("a guard at a pole", IF(x > 0, (ca.cos(x) - 1) / x, 0), "jump"),
    ("a guard beyond a pole", IF(x > -1, (x + 1) / x, 0), "pole"),
    ("a guarded logarithm", IF(x > 1, ca.log(x), 0), ""),
    ("a guarded logarithm at its end", IF(x > 0, x * ca.log(x), 0), "pole"),
    ("both guards", IF(ca.logic_and(x > 1, u > 0), u * ca.log(x), 0), ""),
    ("both guards, one of them a jump", IF(ca.logic_and(x > 1, u > 0), ca.log(x), 0), "jump"),
    ("a level that jumps", IF(u * ca.sign(x) > 0, (u * ca.sign(x)) ** 2, 0), "jump"),
    ("a switch of a sample and a state", IF(x > k, (x - k) ** 2, 0), ""),
    ("a divisor that is never zero", u / (1 + ca.exp(x)), ""),
    ("a divisor that is zero far out", 1 / (x - 1e300), "pole"),
    ("a divisor that is zero farther out than doubles are", 1 / (x * 2.0**-1000 - 2.0**1000), "pole"),
    ("a root that is never negative", ca.sqrt(x**2 + u**2), ""),
    ("a root beyond a large number", ca.sqrt(1e300 - x), "end of a domain"),
    ("a tangent of an arc", ca.tan(0.5 * ca.atan(x)), ""),
    ("a tangent", ca.tan(x), "pole"),
    ("a size times its sign", ca.sign(x) * x, ""),
]  # fmt: skip


@pytest.mark.parametrize(("name", "expression", "breaks"), EVERYWHERE, ids=[row[0] for row in EVERYWHERE])
def test_continuity_for_all_real_arguments(name, expression, breaks):
    found = breaks_somewhere(ca.Function("f", [x, u, k], [expression], ["x", "u", "k"], ["y"]), {"k": (0.0, 9.0)})
    assert (breaks in found) if breaks else found == ""


ENDLESS = [(-np.inf, np.inf), (-np.inf, 0.75), (0.3, np.inf), (-np.inf, -2.0), (1.5, np.inf), (-0.4, 0.6)]
POINTS = [-1e300, -5e5, -40.7, -2.0, -0.4, -0.1, 0.3, 0.5, 0.75, 1.5, 2.5, 3.2, 70.1, 4e7, 1e300]


@pytest.mark.parametrize("op", [op for op in (*TOTAL, *PARTIAL) if op in OPERATIONS])
def test_intervals_without_ends_hold_what_lies_in_them(op):
    """An oracle: the operation in doubles, at points of the interval, give or take its rounding."""
    arity = OPERATIONS[op].arity
    for first in ENDLESS:
        for second in ENDLESS[: len(ENDLESS) if arity == 2 else 1]:
            spans = [Span(np.array([low]), np.array([high])) for low, high in (first, second)[:arity]]
            with np.errstate(all="ignore"):
                span, bad = PARTIAL[op][0](*spans) if op in PARTIAL else (TOTAL[op](*spans), np.zeros(1, dtype=bool))
            if np.asarray(bad).any():
                continue
            low, high = (np.where(np.isnan(end), side, end) for end, side in zip(span, (-np.inf, np.inf), strict=True))
            for a in (one for one in POINTS if first[0] <= one <= first[1]):
                for b in (one for one in POINTS if second[0] <= one <= second[1]) if arity == 2 else (0.0,):
                    value = DOUBLES.operations[op](*(a, b)[:arity])
                    if np.isfinite(value):
                        room = 1e-9 * abs(value)
                        assert low[0] - room <= value <= high[0] + room, (first, second, a, b)


ROUNDED = [
    # expression, range of x, whether what it rounds is known
    ("a branch that counts", IF(x > 0.3, ca.sqrt(x), 0), (0.5, 0.6), True),
    ("a branch that does not", IF(x > 0.3, ca.sqrt(x - 0.3), 0), (0.1, 0.2), True),
    ("the other branch without a value", IF(x > 0.3, 0.1 * x, ca.sqrt(0.3 - x)), (0.5, 0.6), True),
    ("a branch that may count, without a value", IF(x > 0.3, ca.sqrt(x - 0.4), 0), (0.25, 0.35), False),
    ("a condition that rounding may turn", IF(0.1 * x > 0.03, 1, 0), (0.25, 0.35), False),
    ("a condition that is exact", IF(x > 0.3, 1, 0), (0.25, 0.35), True),
]


@pytest.mark.parametrize(("name", "expression", "over", "known"), ROUNDED, ids=[row[0] for row in ROUNDED])
def test_what_a_choice_rounds(name, expression, over, known):
    found = rounding(ca.Function("f", [x], [expression], ["x"], ["y"]), Box({"x": over}))["y"][0, 0]
    assert np.isfinite(found) == known and found <= (1e-15 if known else np.inf)
