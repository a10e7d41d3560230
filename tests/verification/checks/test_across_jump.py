"""A2.lifted across jumps: two plans next to each other refute it, and nothing that is continuous is refuted."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from judging import judged
from small_plants import small

from models.quantity import InvalidValue
from verification.checks.across_jump import across_jump
from verification.checks.assumption_replays import replay_across
from verification.theorems.dossier import Dossier
from workbench import Study, run
from workbench.contracts.finding import Standing
from workbench.controllers import ICFDL, Increment

N, AT, HIGH = 12, 0.35, 0.2
REFERENCE = 0.2 + 0.8 * np.sin(np.linspace(0, 3, N + 1))
LAW = ICFDL(force_unit=1.0, lam=1.0, initial_input=0.3, phi0=0.5, mu=1.0)
ON_INCREMENTS = Increment(force_unit=1.0, lam=1.0, initial_input=0.3, phi0=0.5, mu=1.0)


def above(v: Any, at: float = AT) -> Any:
    return ca.if_else(v > at, HIGH, 0.0)


def ramp(v: Any, width: float) -> Any:
    """Return what rises from 0 to HIGH within a width, and is continuous however narrow that is."""
    return HIGH * ca.fmin(ca.fmax((v - AT) / width, 0.0), 1.0)


def spelled(v: Any, width: float) -> Any:
    return ca.if_else(v < AT, 0.0, ca.if_else(v < AT + width, (v - AT) * (HIGH / width), HIGH))


def gathered(equation: Any, law: Any = LAW, states: int = 1) -> Dossier:
    plant = small("Across", equation, states=states)
    study = Study(name="small", plant=plant, reference=REFERENCE, controllers={"law": law}, trials=6)
    return Dossier(run(study, show_progress=False), "law")


FROM_BELOW = ICFDL(force_unit=1.0, lam=1.0, initial_input=-0.1, phi0=0.5, mu=1.0)
JUMPS = [
    # what jumps, next state, states, law, by how much outputs are apart at the least
    ("with the input", lambda x, u, k: (2 * u + above(u),), 1, LAW, HIGH),
    ("downwards", lambda x, u, k: (2 * u - above(u),), 1, LAW, HIGH),
    ("upwards more than it rises", lambda x, u, k: (0.1 * u + 40 * above(u),), 1, LAW, 40 * HIGH),
    ("at the level itself", lambda x, u, k: (2 * u + ca.if_else(u >= AT, HIGH, 0.0),), 1, LAW, HIGH),
    ("below the level", lambda x, u, k: (2 * u + ca.if_else(u < AT, HIGH, 0.0),), 1, LAW, HIGH),
    ("by its sign", lambda x, u, k: (2 * u + HIGH * ca.sign(u - AT),), 1, LAW, HIGH),
    ("at every quarter", lambda x, u, k: (u + HIGH * ca.floor(4 * u),), 1, LAW, HIGH),
    ("at zero", lambda x, u, k: (2 * u + above(u, 0.0),), 1, FROM_BELOW, HIGH),
    ("at zero, by its sign", lambda x, u, k: (0.5 * x[0] + u + HIGH * ca.sign(u),), 1, FROM_BELOW, HIGH),
    ("with the state", lambda x, u, k: (0.5 * x[0] + u + above(x[0]),), 1, LAW, HIGH),
    ("its gain", lambda x, u, k: (0.5 * x[0] + (1 + above(x[0])) * u,), 1, LAW, 1e-3),
    ("on increments", lambda x, u, k: (0.9 * x[0] + u + above(u, 0.25),), 1, ON_INCREMENTS, HIGH),
    ("late", lambda x, u, k: (x[1], u + above(u)), 2, LAW, HIGH),
    ("a hidden state", lambda x, u, k: (0.5 * x[0] + x[1] + u, above(x[0])), 2, LAW, HIGH),
]


@pytest.mark.parametrize(("what", "equation", "states", "law", "apart"), JUMPS, ids=[row[0] for row in JUMPS])
def test_a_jump_is_refuted_by_two_plans_next_to_each_other(what, equation, states, law, apart):
    d = gathered(equation, law, states)
    found = judged(d, "A2.lifted")
    assert found.standing is Standing.REFUTED, found.method
    assert found.replayed == pytest.approx(found.margin, rel=1e-9)
    plans, m = np.array(found.witness["plans"]), found.witness["sample"]
    degree = d.evidence.degree
    signals = []
    for plan in plans:  # in plain numbers
        x, y = [np.zeros(states)], [0.0]
        for k, u in enumerate(plan[:m]):
            assert (d.box["x"][0].ravel() <= x[-1]).all() and (x[-1] <= d.box["x"][1].ravel()).all()
            assert d.box["u"][0] <= u <= d.box["u"][1]
            x.append(np.array([float(ca.DM(one)) for one in equation(tuple(map(float, x[-1])), float(u), k)]))
            y.append(x[-1][0])
        signals.append(y[m] - y[m - 1] if d.evidence.increment else y[m])
    du = np.abs(plans[1] - plans[0])[: m - degree + 1].max()
    assert (
        0 < du <= 4 * np.finfo(float).eps
        and np.isfinite(found.margin)
        and abs(signals[1] - signals[0]) >= apart * (1 - 1e-6)
    )
    assert abs(signals[1] - signals[0]) / du == pytest.approx(found.witness["ratios"][-1], rel=1e-6)
    growth = np.array(found.witness["ratios"]) * np.array(found.witness["du"])
    assert (np.diff(found.witness["du"]) < 0).all() and growth[-1] > 0.9 * growth[0]


CONTINUOUS = [
    # what looks like a jump, next state, states
    *((f"a ramp of {w:g}", lambda x, u, k, w=w: (2 * u + ramp(u, w),), 1) for w in (1e-3, 1e-9, 1e-13, 1e-16, 1e-300)),
    *((f"a ramp of {w:g} in x", lambda x, u, k, w=w: (0.5 * x[0] + u + ramp(x[0], w),), 1) for w in (1e-9, 1e-16)),
    *((f"a ramp of {w:g}, spelled", lambda x, u, k, w=w: (2 * u + spelled(u, w),), 1) for w in (0.125, 1e-6, 1e-13)),
    ("a steep tanh", lambda x, u, k: (2 * u + HIGH * ca.tanh(1e15 * (u - AT)),), 1),
    ("sides that agree", lambda x, u, k: (2 * u + ca.if_else(u > AT, u - AT, 0.0),), 1),
    ("a jump where no trial comes", lambda x, u, k: (2 * u + above(u, 5.0),), 1),
    ("a jump from sample to sample", lambda x, u, k: (2 * u + ca.if_else(k > 3, HIGH, 0.0),), 1),
    ("a state that no input moves", lambda x, u, k: (0.5 * x[0] + u + above(x[1]), 0.5 * x[1] + 0.3), 2),
    (
        "a ramp beside a jump that no input moves",
        lambda x, u, k: (0.5 * x[0] + u + ramp(u, 1e-16) + above(x[1]), 0.5 * x[1] + 0.3),
        2,
    ),
]


@pytest.mark.parametrize(("what", "equation", "states"), CONTINUOUS, ids=[row[0] for row in CONTINUOUS])
def test_what_is_continuous_is_not_refuted(what, equation, states):
    d = gathered(equation, states=states)
    assert judged(d, "A2.lifted").standing is not Standing.REFUTED
    assert across_jump(d.plant, d.evidence, d.box) is None


def test_where_a_hidden_state_jumps_nothing_is_supported_by_row_sums():
    """Row sums along one trial say nothing of two on either side, though the next output itself is continuous."""
    d = gathered(lambda x, u, k: (0.5 * x[0] + u, x[0] + above(x[1])), states=2)
    low, high = (end.ravel() for end in d.hull["x"])
    assert low[1] < AT < high[1]
    found = judged(d, "A2.lifted")
    assert found.standing is not Standing.PROVED and found.standing is not Standing.SUPPORTED, found.method


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"plans": [[0.3] * N] * 2}, "are the same"),
        ({"plans": [[0.3] * N]}, "two plans of 12 samples"),
        ({"plans": None}, "two plans of 12 samples"),
        ({"sample": N + 1}, "two plans of 12 samples"),
        ({"sample": None}, "its trial and sample"),
        ({"trial": 7}, "two plans of 12 samples"),
    ],
)
def test_a_witness_that_is_none_is_refused(changes, words):
    d = gathered(JUMPS[0][1])
    witness = {**judged(d, "A2.lifted").witness, **changes}
    with pytest.raises(InvalidValue, match=words):
        replay_across(d.plant, d.evidence, witness)


def test_a_replay_runs_the_plans():
    """Its margin is the row sum, 2, less the ratio of the two; plans with no jump between them are within."""
    d = gathered(JUMPS[0][1])
    witness = judged(d, "A2.lifted").witness
    low, high = np.array(witness["plans"])
    ratios = []
    for away in (0.0, 1e-6, 0.1):
        plans = [(low - away * (high > low)).tolist(), (high + away * (high > low)).tolist()]
        ratios.append(2.0 - replay_across(d.plant, d.evidence, {**witness, "plans": plans}))
    assert ratios[1:] == pytest.approx([2 + HIGH / 2e-6, 2 + HIGH / 0.2], rel=1e-4) and ratios[0] > 1e14
    flat = gathered(lambda x, u, k: (2 * u + above(u, 5.0),))
    plans = [[0.3] * N, [0.31] * N]
    margin = replay_across(flat.plant, flat.evidence, {"trial": 1, "sample": 5, "plans": plans})
    assert margin == pytest.approx(0, abs=1e-9)
