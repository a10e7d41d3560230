"""Whether a train's line resistance turns with its direction of travel."""

from __future__ import annotations

import casadi as ca
import numpy as np

from models.maglev import Maglev
from workbench.contracts.verdict import Finding, Standing


def turns(train: Maglev, distance: float, speed: float) -> Finding:
    """Compare the line resistance at +v and -v on every metre: opposite everywhere if it is f_res(x) sgn(v).

    distance in m, speed in m/s.
    """
    x, v = ca.SX.sym("x"), ca.SX.sym("v")
    d = ca.Function("line_resistance", [x, v], [train.line_resistance(x, v)], ["x", "v"], ["d"])
    places = np.arange(0.0, float(distance) + 1)
    there, back = (d(places[None, :], sign * speed).full()[0] for sign in (1, -1))
    gap = np.abs(there + back)
    at = int(np.argmax(gap))
    return Finding(
        standing=Standing.REFUTED if gap[at] > 1e-9 * train.mass else Standing.SUPPORTED,
        method="d(x, v) + d(x, -v) at every metre: zero on curves, twice the weight's pull on grades, which does not "
        "turn with the train; f_res must depend on the direction of travel",
        margin=-float(gap[at]),
        unit="N",
        witness={"x": places[at], "v": speed, "d(x, v)": there[at], "d(x, -v)": back[at]},
    )
