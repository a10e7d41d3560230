"""What is proved of learning laws on small plants is re-checked, and its sentence says what was proved.

Beside every case stands one just beyond: a changed number, another plant, a plant that the checker has no rule for.
"""

from __future__ import annotations

import json
import math
import re
from typing import Any

import casadi as ca
import numpy as np
import pytest
from small_plants import small
from small_studies import gathered, in_plant_units

from verification.certificates.bounds import Ask, bounds, plain
from verification.certificates.funnel import Asked, funnel
from verification.certificates.link import linked
from verification.certificates.recheck import Recheck
from verification.certificates.rows import rows
from verification.checker.bounds import Quantity
from verification.checker.graph import Graph as Checked
from verification.checks.delayed import delayed_step
from verification.decide.judge import Judge
from verification.enclosure.box import Box
from verification.enclosure.recursion import step_of
from verification.theorems import learning
from workbench import TrialLength
from workbench.contracts.certificate import Certificate
from workbench.contracts.claim import NotCertified
from workbench.contracts.finding import Standing
from workbench.contracts.verdict import NotMade, Verdict
from workbench.controllers import ICFDL, Increment
from workbench.graph import read

N = 12
RAMP = np.sin(np.linspace(0, 2, N + 1))
LENGTHS = TrialLength(law="uniform", minimum=N // 2)
PLANTS = {
    "linear": small("Linear", lambda x, u, k: (0.6 * x[0] + 0.5 * u,)),
    "kinked": small("Kinked", lambda x, u, k: (0.3 * ca.fabs(x[0] - 0.2) + 0.5 * u,)),
    "smooth": small("Smooth", lambda x, u, k: (0.5 * x[0] + 0.1 * ca.sin(x[0]) + 0.5 * u + 0.05 * ca.tanh(u),)),
    "timed": small("Timed", lambda x, u, k: (0.6 * x[0] + (0.5 + 0.2 * ca.sin(k)) * u,)),
    "drag": small("Drag", lambda x, u, k: (x[0] - 0.05 * x[0] * ca.fabs(x[0]) + 0.5 * u,)),
    "quotient": small("Quotient", lambda x, u, k: (0.6 * x[0] / (1 + x[0] ** 2) + 0.5 * u,)),
}
GUARDED = small("Guarded", lambda x, u, k: (0.3 * ca.if_else(x[0] > 0.3, ca.sqrt(x[0] - 0.3), 0) + 0.5 * u,))
GENERAL = ("A1", "A2.lifted", "A4.partial", "lambda_min.partial")


def judged(plant: Any, kind: Any, *, demanded: bool = True, **changes: Any) -> dict[str, Verdict]:
    """Return the verdicts of a law on a plant by the claims' names, and see that the checker was asked."""
    taken = {"trials": 5, "reference": RAMP, "lengths": LENGTHS, **changes}
    d = gathered(plant, in_plant_units(kind), **taken)
    judge = Judge(recheck=Recheck(demanded=demanded))
    found = [judge.verdict(claim) for claim in learning.claims_of(d)]
    return {one.claim.split(".", 1)[1]: one for one in found if not isinstance(one, NotMade)}


@pytest.mark.parametrize("plant", PLANTS)
def test_what_is_proved_is_rechecked(plant):
    output, increment = judged(PLANTS[plant], ICFDL), judged(PLANTS[plant], Increment)
    alone = judged_alone(PLANTS[plant])
    for found in (output, increment):
        assert all(found[name].certificate for name in GENERAL if found[name].standing is Standing.PROVED)
        assert {name: str(found[name].standing) for name in GENERAL} == alone[found is increment]
    assert increment["increment_funnel"].certificate and increment["increment_limit"].certificate
    assert not increment["learning_curve"].certificate and increment["learning_curve"].unchecked


def judged_alone(plant: Any) -> list[dict[str, str]]:
    """Return how the claims stand where the methods are taken at their word."""
    found = []
    for kind in (ICFDL, Increment):
        d = gathered(plant, in_plant_units(kind), trials=5, reference=RAMP, lengths=LENGTHS)
        judge = Judge()
        made = [judge.verdict(claim) for claim in learning.claims_of(d)]
        found.append({one.claim.split(".", 1)[1]: str(one.standing) for one in made if isinstance(one, Verdict)})
    return [{name: one[name] for name in GENERAL} for one in found]


@pytest.mark.parametrize(
    ("claim", "kind", "words"),
    [
        ("A1", ICFDL, r"d y\[0,0\] / d u exists and is continuous"),
        ("A2.lifted", ICFDL, r"In trials of 12 samples .* and \d\.\d+ over j <= k"),
        ("A4.partial", ICFDL, r"d y\[0,0\] / d u is at least 0\.4999"),
        ("lambda_min.partial", ICFDL, r"Lambda exceeds \(rho b\)\^2/4"),
        ("theorem1.conclusion", ICFDL, r"With probability 1 the error .* gain in \[0\.0, 0\.25\d*\] times the error"),
        ("increment_funnel", Increment, r"In every trial of 12 samples or less, .* x0 in \[.*\], u in \["),
        ("increment_limit", Increment, r"With probability 1 u\(k\) goes to the input"),
    ],
)
def test_sentences_say_what_claims_say(claim, kind, words):
    found = judged(PLANTS["linear"], kind)[claim]
    assert found.standing is Standing.PROVED and re.search(words, found.sentence), found.sentence
    evidence = found.as_json()["evidence"]
    assert evidence["checked"] is True and evidence["certificate"] == found.certificate


def test_what_has_no_rule_is_supported_at_most():
    found = judged(GUARDED, ICFDL)["A2.lifted"]
    assert found.standing is not Standing.PROVED and not found.certificate
    told = judged(GUARDED, ICFDL, demanded=False)
    proved = [one for one in told.values() if one.standing is Standing.PROVED]
    assert all(one.certificate or one.unchecked for one in proved)


def test_a_premise_that_fails_has_no_certificate():
    given = judged(PLANTS["linear"], Increment, lengths=TrialLength(law="given", lengths=[N] * 5))
    assert given["increment_limit"].standing is Standing.UNDECIDED and not given["increment_limit"].certificate


# ------------------------------------------------------------------ makers against what is known

DRAG = PLANTS["drag"]
BOX = Box({"x": (-1.0, 1.0), "u": (-1.0, 1.0), "w": (np.zeros(0),) * 2, "k": (0.0, N - 1.0)}, whole=("k",))


def boxed(degree: int = 1) -> Box:
    """Return the box with what is later."""
    none = np.zeros((1, 0))
    return Box({**BOX, "later_u": (none, none), "later_w": (np.zeros((0, 0)),) * 2}, whole=("k",))


@pytest.mark.parametrize(
    ("by", "side", "best"),
    [
        ("x0", "at least", 0.9),  # d/dx (x - 0.05 x |x|) = 1 - 0.1 |x|
        ("x0", "at most", 1.0),
        ("u", "at least", 0.5),
        ("u", "at most", 0.5),
        (None, "at most", 0.95 + 0.5),
        (None, "at least", -0.95 - 0.5),
    ],
)
def test_bounds_come_to_their_best_and_no_further(by, side, best):
    graph = read(delayed_step(DRAG, 1))
    off = 1e-6 if side == "at most" else -1e-6
    good = bounds(graph, boxed(), {}, [Ask(("y", 0, 0), by, side, best + off)])
    assert side in Recheck().sentence(good)
    with pytest.raises(NotCertified):
        bounds(graph, boxed(), {}, [Ask(("y", 0, 0), by, side, best - off)])


def test_row_sums_are_those_of_the_lifted_plant():
    graph = read(delayed_step(PLANTS["linear"], 1))
    asks = [
        Ask((of, 0, 0), by, side, bound)
        for of in ("x_next", "y")
        for by, value in (("x0", 0.6), ("u", 0.5))
        for side, bound in (("at least", value * (1 - 1e-12)), ("at most", value * (1 + 1e-12)))
    ]
    slopes = bounds(graph, boxed(), {}, asks)
    made = rows(slopes, graph, N, 1.0)
    lifted = [[0.5 * 0.6 ** (k - j) for j in range(k + 1)] for k in range(N)]
    largest = max(math.fsum(row) for row in lifted)
    assert float.fromhex(str(made.statement["p"])) == pytest.approx(largest, rel=1e-9)
    assert float.fromhex(str(made.statement["p"])) >= largest
    assert Recheck().sentence(made)
    less = Certificate(kind="rows", statement={**made.statement, "p": (0.99 * largest).hex()}, rests_on=made.rests_on)
    with pytest.raises(NotCertified, match="row sums must be smaller"):
        Recheck().sentence(less)
    with pytest.raises(NotCertified, match="must be bounded on both sides"):
        rows(bounds(graph, boxed(), {}, asks[:-1]), graph, N, 1.0)


def test_the_funnel_of_an_integrator_is_what_it_is():
    """With x+ = x + u the target is the increment itself, so U(k) is the hull of plan and increment."""
    plant = small("Sum", lambda x, u, k: (x[0] + u,))
    graph, rise, plan = read(step_of(plant)), np.diff(RAMP), np.full(N, 0.3)
    asked = Asked(
        start=np.zeros((1, 2)),
        others={},
        plan=plan,
        reference=RAMP,
        noise=0.0,
        gain=0.9,
        targets=np.stack([rise, rise], -1),
    )
    made = funnel(graph, asked)
    low, high = np.minimum(plan, rise), np.maximum(plan, rise)
    ends = [[float.fromhex(end) for end in one] for one in made.statement["bands"]]
    assert ends[0] == pytest.approx([min(0.0, np.cumsum(low).min()), np.cumsum(high).max()], abs=1e-6)
    assert ends[1] == pytest.approx([low.min(), high.max()], abs=1e-6)
    assert Recheck().sentence(made)
    for name, value, words in (
        ("gain", (2.1).hex(), "moved out of their set"),
        ("gain", (1.9).hex(), "moved out of their set"),
        ("noise", (0.1).hex(), "must lie between"),
        ("plan", [(0.9).hex()] * N, "plan and targets"),
        ("bands", [[(0.0).hex()] * 2, made.statement["bands"][1]], "must hold its sets"),
        ("reference", [(2 * one).hex() for one in RAMP], "must lie between"),
    ):
        other = Certificate(
            kind="funnel", statement={**made.statement, name: value}, proof=made.proof, graphs=made.graphs
        )
        with pytest.raises(NotCertified, match=words):
            Recheck().sentence(other)


def test_a_graph_of_another_plant_is_seen():
    one, other = (delayed_step(PLANTS[name], 1) for name in ("linear", "drag"))
    linked(one, read(one), boxed())
    with pytest.raises(NotCertified, match="compiled plant"):
        linked(other, read(one), boxed())


def test_certificates_are_plain_data():
    made = bounds(read(delayed_step(DRAG, 1)), boxed(), {"x0": "m"}, [Ask(("y", 0, 0), None, "continuous")])
    assert json.loads(json.dumps(made.as_json())) == json.loads(json.dumps(dict(made.as_json())))
    assert "x0 in [-1.0, 1.0] m" in Recheck().sentence(made)


def test_what_is_decided_on_a_box_is_decided_on_its_parts():
    """At u = 0 both arguments of the lesser are equal, but on u >= 0 it is the second: the slope is 1 + x^2 once."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    f = ca.Function("f", [x, u], [(ca.fmin(u, 0) + u) * (1 + x**2)], ["x", "u"], ["f"])
    graph = Checked(plain(read(f)))
    slope = Quantity(graph, graph.outputs["f", 0, 0], 1)
    low, high = (slope.tight([(-1.0, 2.0), (0.0, 1.0)], low=side) for side in (True, False))
    assert low is not None and high is not None and low[0] <= 1 <= high[1]
