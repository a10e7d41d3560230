"""The claims of a comparison, and who is said to have a proof that applies."""

from __future__ import annotations

import dataclasses

import control
import numpy as np
import pytest

from models.actuator import Actuator
from models.metro_profile import MetroProfile
from models.point_mass import PointMass
from studies.same_plant.claims import whose_proof
from verification.checks.linear_loop import incremental_pid, observed, positional_pid, spectral_radius
from verification.decide.verify import verify
from workbench.contracts.finding import Standing
from workbench.contracts.scenario import Between
from workbench.contracts.study import Study
from workbench.controllers.cfdl import CFDL
from workbench.controllers.fipid import FIPID
from workbench.controllers.pid import PID
from workbench.controllers.tracking_mpc import TrackingMPC
from workbench.design.table import compare

PROVED, SUPPORTED, REFUTED, UNDECIDED = Standing.PROVED, Standing.SUPPORTED, Standing.REFUTED, Standing.UNDECIDED
SMALL = Study(
    plant=PointMass(),
    reference=MetroProfile(horizon=120),
    controllers={"own": CFDL()},
    actuator=Actuator(lower=-450e3, upper=450e3, rate=500e3),
    noise=0.05,
    truth={"mass": 1.1},
)
FREE = ["actuator.lower=null", "actuator.upper=null", "actuator.rate=null", "truth.mass.factor=1"]


def standings(laws, *assignments):
    done = compare(SMALL, laws, ["trials=4", "budget=4", *assignments], show_progress=False)
    report = verify(done, show_progress=False)
    return {(v.claim.split(".", 1)[1], v.controller): v.standing for v in report.verdicts}, report


@pytest.fixture(scope="module")
def limited():
    return standings(["pid", "fipid", "fipid-smooth", "icfdl", "increment"])


def test_limits_break_what_proofs_assume(limited):
    found, report = limited
    assert found["A1", "icfdl"] is REFUTED
    assert found["unsaturated", "pid"] is REFUTED
    assert found["f_continuous", "fipid"] is REFUTED and found["f_continuous", "fipid-smooth"] is PROVED
    assert found["stable_loop", "pid"] in (SUPPORTED, REFUTED)
    assert found["asymptotic", "increment"] is UNDECIDED
    titles = [table.title for table in report.tables]
    assert titles == ["Every law on the same plant", "Who wins, and whose proof applies", "Settings that tuning found"]
    assert {row[0] for row in report.tables[1].rows} == {"pid", "fipid", "fipid-smooth", "icfdl", "increment"}
    assert report.conclusion


def test_quadratic_programs_that_are_not_solved_are_seen():
    found, _ = standings(["tracking-mpc"])
    assert found["qp_solved", "tracking-mpc"] is SUPPORTED
    found, _ = standings(["tracking-mpc"], "laws.tracking-mpc.law.sweeps=1", "laws.tracking-mpc.law.blocks=8")
    assert found["qp_solved", "tracking-mpc"] is REFUTED


def test_without_limits_the_plant_is_smooth():
    found, _ = standings(["pid", "icfdl"], *FREE)
    assert found["A1", "icfdl"] is PROVED
    assert found["unsaturated", "pid"] is PROVED
    wide = ["actuator.lower=-1e9", "actuator.upper=1e9", "actuator.rate=null", "noise.sigma=0"]
    found, _ = standings(["pid"], *wide)
    assert found["unsaturated", "pid"] is SUPPORTED


@pytest.mark.parametrize(
    ("found", "words"),
    [
        ({"increment_monotone": REFUTED, "increment_weighted": PROVED, "A1": REFUTED}, "applies"),
        ({"increment_monotone": REFUTED, "increment_weighted": UNDECIDED}, "not proved here"),
        ({"A1": REFUTED, "A4.printed": REFUTED, "theorem1": SUPPORTED}, "does not apply: A1, A4.printed refuted"),
        ({"known_model": REFUTED, "unsaturated": SUPPORTED}, "does not apply: known_model refuted"),
        ({"contraction": SUPPORTED, "unsaturated": PROVED, "A1": PROVED}, "applies as far as checked: contraction"),
        ({"qp_solved": SUPPORTED, "unsaturated": SUPPORTED}, "none claimed; quadratic programs solved: supported"),
        ({"A1": PROVED, "asymptotic": SUPPORTED}, "lifted condition supported"),
        ({"stable_loop": SUPPORTED, "unsaturated": REFUTED}, "linear loop stable: supported, and the command is cut"),
        ({"unsaturated": SUPPORTED}, "none claimed"),
    ],
)
def test_whose_proof(found, words):
    assert whose_proof(found).startswith(words) or words in whose_proof(found)


def test_what_palc_and_variable_gain_need():
    found, _ = standings(["palc", "variable-gain"])
    assert found["known_model", "palc"] is REFUTED and found["contraction", "variable-gain"] is SUPPORTED
    found, report = standings(["palc", "variable-gain"], *FREE, "budget=1", "laws.variable-gain.law.input_unit=800000")
    assert found["known_model", "palc"] is PROVED and found["contraction", "variable-gain"] is REFUTED
    words = {row[0]: row[2] for row in report.tables[1].rows}
    assert words["palc"].startswith("applies as far as checked") and words["variable-gain"].startswith("does not")


def test_what_a_law_knows_is_held_against_what_every_trial_has():
    drawn = dataclasses.replace(SMALL, truth={"mass": Between(low=0.9, high=1.02), "b0_mean": 1.0})
    done = compare(drawn, ["palc"], ["trials=4", "budget=1"], show_progress=False)
    (found,) = [v for v in verify(done, show_progress=False).verdicts if v.claim == "same-plant.known_model"]
    assert found.standing is REFUTED and found.margin == pytest.approx(-100 * (1 / 0.9 - 1))
    assert found.witness == {"mass that the law knows": 350_000.0, "mass of the plant": pytest.approx(315_000.0)}


def test_claims_follow_from_what_laws_declare_whatever_they_are_called():
    own = {"one": PID(input_unit=1e5), "two": FIPID(f="smooth", input_unit=1e5), "three": TrackingMPC(input_unit=1e5)}
    done = compare(dataclasses.replace(SMALL, controllers=own), [*own], ["budget=1", "trials=2"], show_progress=False)
    names = {(v.claim.split(".", 1)[1], v.controller) for v in verify(done, show_progress=False).verdicts}
    assert names == {
        *((claim, name) for claim in ("unsaturated", "does_not_diverge", "conditioning") for name in own),
        ("stable_loop", "one"),
        ("stable_loop", "two"),
        ("f_continuous", "two"),
        ("qp_solved", "three"),
    }


def test_a_loop_is_refuted_when_its_gain_is_too_large():
    found, _ = standings(["pid"], "laws.pid.law.kp=100", "laws.pid.law.kd=10", "budget=1")
    assert found["stable_loop", "pid"] is REFUTED


def test_linear_laws_are_those_of_a_loop():
    rng = np.random.default_rng(2)
    e = rng.normal(size=40)
    kp, ki, kd, ts = 2.0, 0.7, 0.3, 0.1
    integral = ts * np.cumsum(e)
    change = np.diff(e, prepend=0.0)
    expected = kp * e + ki * integral + kd * change / ts
    t = np.arange(40) * ts
    given = control.forced_response(positional_pid(kp, ki, kd, ts), t, e).outputs
    np.testing.assert_allclose(given, expected, rtol=1e-9, atol=1e-9)
    increments = change + ki * e + kd * np.diff(change, prepend=0.0)
    given = control.forced_response(incremental_pid(ki, kd, ts), t, e).outputs
    np.testing.assert_allclose(given, np.cumsum(increments), rtol=1e-9, atol=1e-9)


def test_states_that_the_output_does_not_see_are_left_out():
    a = np.array([[0.5, 0.0, 0.2], [0.3, 1.0, 0.0], [0.0, 0.0, 0.1]])
    system = control.ss(a, np.array([[1.0], [1.0], [1.0]]), np.array([[1.0, 0.0, 0.0]]), 0, 0.1)
    kept = observed(system)
    assert kept.nstates == 2
    assert spectral_radius(0.1 * system) == pytest.approx(1.0) and spectral_radius(0.1 * kept) < 1
    time = np.arange(20) * 0.1
    np.testing.assert_allclose(
        control.forced_response(system, time, np.ones(20)).outputs,
        control.forced_response(kept, time, np.ones(20)).outputs,
    )
