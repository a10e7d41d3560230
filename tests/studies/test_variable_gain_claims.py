"""The variable-gain study's claims: their standings at the defaults, and that every check can say the opposite."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from models.metro_line import MetroLine
from studies.variable_gain.claims import BANDS, BOX
from studies.variable_gain.study import STUDY
from verification.checks.lipschitz import lipschitz
from verification.decide.verify import examination_of, judge, verify
from workbench.contracts import settings
from workbench.trials.campaign import run

DEFAULTS = {
    "spectral_radius_printed": "REFUTED",
    "speed_contraction": "PROVED",
    "relative_degree": "REFUTED",
    "relative_degree_speed": "PROVED",
    "lipschitz_box": "REFUTED",
    "lipschitz_box_between_portals": "PROVED",
    "position_only": "REFUTED",
    "initial_state_ratio": "PROVED",
    "global_initial_convergence": "SUPPORTED",
    "initial_learning_needed": "REFUTED",
    "noise_claim": "REFUTED",
    "faster_than_fixed": "REFUTED",
    "mismatch_limit": "REFUTED",
}


def standings(name, *assignments):
    campaign = run(settings.assigned(STUDY, assignments), show_progress=False)
    claims = [claim for claim in examination_of(campaign).claims if claim.name == f"variable-gain.{name}"]
    assert claims
    return {claim.controller: judge(claim) for claim in claims}


def test_every_claim_stands_as_known_at_the_defaults():
    report = verify(run(STUDY, show_progress=False), show_progress=False)
    found = {verdict.claim.removeprefix("variable-gain."): str(verdict.standing) for verdict in report.verdicts}
    assert {name: found.get(name) for name in DEFAULTS} == DEFAULTS
    assert len(report.conclusion) == 4 and report.tables[0].rows
    witness = next(verdict.witness for verdict in report.verdicts if verdict.claim.endswith("radius_printed"))
    assert witness is not None and max(witness["eigenvalues"]) == 1.0


@pytest.mark.parametrize(
    ("name", "assignments", "controller", "standing"),
    [
        ("speed_contraction", ["gain_mismatch=2.1"], "fixed", "REFUTED"),
        ("speed_contraction", ["gain_mismatch=1.99"], "variable", "PROVED"),
        ("initial_state_ratio", ["controllers.fixed.initial_learning=false"], "fixed", "REFUTED"),
        ("initial_state_ratio", ["controllers.variable.lam0=0.9"], "variable", "PROVED"),
        ("global_initial_convergence", ["trials=12"], "variable", "REFUTED"),
        ("initial_learning_needed", ["initial.speed=0", "initial.position=0"], None, "SUPPORTED"),
        ("noise_claim", ["controllers.variable.smoothing_s=20", "trials=6"], None, "SUPPORTED"),
        (
            "faster_than_fixed",
            ["gain_mismatch=1.9", "trials=60", "controllers.variable.lam_min=0.5"],
            None,
            "SUPPORTED",
        ),
        ("mismatch_limit", ["trials=5"], None, "SUPPORTED"),
        ("position_only", ["trials=1"], None, "UNDECIDED"),
        ("position_only", ["trials=2", "gain_mismatch=0.01"], None, "SUPPORTED"),
    ],
)
def test_checks_can_say_the_opposite(name, assignments, controller, standing):
    verdict = standings(name, *assignments)[controller]
    assert str(verdict.standing) == standing, verdict


def test_the_lipschitz_constant_is_above_every_slope_sampled_and_the_jump_is_there():
    plant = MetroLine(tunnel_resistance=0.0)
    found = lipschitz(plant, *BOX, BANDS)
    assert found.witness is not None
    rng, x = np.random.default_rng(2), ca.SX.sym("x", 2)
    f = ca.Function("f", [x], [plant.slope(x, ca.SX(0), ca.SX(0, 1), 0)])
    a, b = (rng.uniform(*np.array(BOX)[:, :], (4000, 2)).T for _ in range(2))
    b = a + 1e-3 * (b - a)
    ratios = np.abs(f(a).full() - f(b).full()).max(axis=0) / np.abs(a - b).max(axis=0)
    assert ratios.max() <= found.witness["constant"] < 5
    jump = lipschitz(MetroLine(), *BOX, BANDS)
    assert str(jump.standing) == "REFUTED" and jump.witness is not None
    assert jump.margin == pytest.approx(-9.81e-3 * 0.00013 * 400, rel=1e-3)
