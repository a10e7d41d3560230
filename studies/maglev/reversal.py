"""Whether a train's line resistance turns with its direction of travel."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

from models.maglev import Maglev
from workbench.contracts.finding import Finding, Grounds

ROUNDING = 1e-9
"""What two resistances may differ by from rounding alone, N per kg of the train."""


def along(train: Maglev) -> ca.Function:
    """Return the line resistance d in N at a position in m and a speed in m/s."""
    x, v = ca.SX.sym("x"), ca.SX.sym("v")
    return ca.Function("line_resistance", [x, v], [train.line_resistance(x, v)], ["x", "v"], ["d"])


def turns(train: Maglev, distance: float, speed: float) -> Finding:
    """Compare the line resistance at +v and -v on every metre: opposite everywhere if it is f_res(x) sgn(v).

    distance in m, speed in m/s.
    """
    d = along(train)
    places = np.arange(0.0, float(distance) + 1)
    there, back = (d(places[None, :], sign * speed).full()[0] for sign in (1, -1))
    gap = np.abs(there + back)
    at = int(np.argmax(gap))
    return Finding(
        grounds=Grounds.TRIES,
        tries=places.size,
        method=f"d(x, v) + d(x, -v) at each of {places.size} metres: zero on curves, twice the weight's pull on "
        "grades, which does not turn with the train; f_res must depend on the direction of travel",
        margin=float(ROUNDING * train.mass - gap[at]),
        unit="N",
        witness={"x": places[at], "v": speed, "d(x, v)": there[at], "d(x, -v)": back[at]},
    )


def turned(train: Maglev, witness: Mapping[str, object]) -> float:
    """Return the margin at a witness, N."""
    d = along(train)
    x, v = float(str(witness["x"])), float(str(witness["v"]))
    return ROUNDING * train.mass - abs(float(d(x, v)) + float(d(x, -v)))
