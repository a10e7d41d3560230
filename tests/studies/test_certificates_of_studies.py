"""What studies prove is re-checked: the sentence is the claim's, and another number, plant or law is rejected."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from fractions import Fraction
from functools import cache

import casadi as ca
import numpy as np
import pytest

from models.actuator import Actuator
from models.maglev import Maglev
from models.metro_line import MetroLine
from models.metro_profile import MetroProfile
from models.point_mass import PointMass
from studies.ato import effects
from studies.ato.study import STUDY as ATO
from studies.maglev.equations import decrease
from studies.maglev.study import STUDY as MAGLEV
from studies.same_plant.claims import examine as same_plant
from studies.variable_gain.direct_term import answered, contracting, effect
from studies.variable_gain.law_equations import LawEquations
from studies.variable_gain.study import STUDY as VARIABLE_GAIN
from verification.certificates.identity import constant, graph_of, identity
from verification.certificates.numbers import numbers
from verification.certificates.recheck import Recheck
from verification.checks.lipschitz import certified, lipschitz
from verification.decide.judge import Judge
from verification.decide.verify import examination_of
from workbench.contracts import settings
from workbench.contracts.certificate import hashed
from workbench.contracts.claim import NotCertified
from workbench.contracts.finding import Standing
from workbench.contracts.study import Study
from workbench.controllers.fipid import FIPID
from workbench.controllers.fixed_gain import FixedGain
from workbench.design.table import compare
from workbench.trials.campaign import run

SMALL = Study(
    name="small",
    plant=PointMass(),
    reference=MetroProfile(horizon=120),
    controllers={"own": FIPID()},
    actuator=Actuator(),
)
QUICK = {
    "maglev": (MAGLEV, ["trials=1"]),
    "variable-gain": (VARIABLE_GAIN, ["trials=1"]),
    "ato": (ATO, ["draws=1", "tune=false"]),
    "ato curve": (settings.in_case(ATO, "curve"), ["draws=1", "tune=false"]),
}
PROVED = [
    ("maglev", "positivity", "palc", "alpha > 0; lambda > 0; k > 0"),
    ("maglev", "error_dynamics", "palc", "left[0,0] = right[0,0]"),
    ("variable-gain", "relative_degree_speed", None, "d effect[0,0] / d u = 1,"),
    ("variable-gain", "learning_law", "variable", "left[0,0] = right[0,0]"),
    ("variable-gain", "learning_law", "fixed", "left[0,0] = right[0,0]"),
    ("variable-gain", "speed_contraction", "variable", "1040 entries of gain lies in ["),
    ("variable-gain", "speed_contraction", "fixed", "(slopes: d effect[0,0] / d u * gain: high) < 2"),
    ("variable-gain", "initial_state_ratio", "variable", "gain: high < 2"),
    ("ato", "relative_degree", None, "(d effect[0,0] / d u = 0,"),
    ("ato curve", "relative_degree", None, "(d effect[0,0] / d u = 0,"),
    ("ato", "relative_degree.dead_time", None, "d before[4,0] / d u = 0; d effect[0,0] / d u ="),
    ("ato", "f_continuous", "fipid-smooth", "du in [-1000000.0, 1000000.0]: f[0,0] exists and is continuous"),
    ("same-plant", "f_continuous", "fipid-smooth", "du in [-1000000.0, 1000000.0]: f[0,0] exists and is continuous"),
    ("same-plant", "unsaturated", "pid", "limits of the actuator = 0"),
    ("same-plant", "known_model", "palc", "mass as told = (largest factor of mass * mass as told)"),
]
SAYS_ITSELF = ("speed_contraction", "f_continuous")
"""Claims whose sentence is made of what the checker found, without the claim's own words."""


@cache
def claims(name):
    """Return the claims of a quick campaign by name and controller, and one judge of them all."""
    if name == "same-plant":
        laws, quick = ["pid", "fipid-smooth", "palc"], ["trials=2", "budget=2", "truth.mass.factor=1"]
        found = same_plant(compare(dataclasses.replace(SMALL, truth={"mass": 1.1}), laws, quick, show_progress=False))
    else:
        study, assignments = QUICK[name]
        found = examination_of(run(settings.assigned(study, assignments), show_progress=False))
    return {(one.name.split(".", 1)[1], one.controller): one for one in found.claims}, Judge(recheck=Recheck())


@pytest.mark.parametrize(("study", "name", "controller", "says"), PROVED, ids=[str(row[:3]) for row in PROVED])
def test_what_is_proved_is_checked_and_says_what_the_claim_says(study, name, controller, says):
    made, judge = claims(study)
    claim = made[name, controller]
    verdict = judge.verdict(claim)
    assert verdict.standing is Standing.PROVED and verdict.as_json()["evidence"]["checked"] is True, verdict
    assert says in verdict.sentence
    assert claim.statement in verdict.sentence or name in SAYS_ITSELF
    for premise in verdict.premises:
        assert premise.standing is Standing.PROVED


@pytest.mark.parametrize("study", ["maglev", "variable-gain", "ato", "same-plant"])
def test_the_checker_alone_accepts_a_folder_of_them(study, tmp_path):
    made, _ = claims(study)
    recheck = Recheck()
    judge = Judge(recheck=recheck)
    verdicts = [judge.verdict(made[name, law]) for of, name, law, _ in PROVED if of == study]
    recheck.write_into(tmp_path, verdicts)
    done = subprocess.run(
        [sys.executable, "-m", "verification.checker", str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"{len(verdicts)} of {len(verdicts)} claims accepted" in done.stdout


def test_a_claim_whose_certificate_fails_is_at_most_supported():
    made, _ = claims("maglev")
    claim = made["positivity", "palc"]

    def of_another(found, premises):
        return numbers(claim.statement, {"alpha": (-1.0, "1/s")}, (">", "alpha", 0))

    def none(found, premises):
        raise NotCertified("there is none")

    for certify, why in ((of_another, "is false"), (none, "there is none"), (None, "have no certificate")):
        changed = dataclasses.replace(claim, certify=certify)
        verdict = Judge(recheck=Recheck(demanded=True)).verdict(changed)
        assert verdict.standing is Standing.SUPPORTED and why in verdict.unchecked
        told = Judge(recheck=Recheck()).verdict(changed)
        assert told.standing is Standing.PROVED and why in told.unchecked and not told.as_json()["evidence"]["checked"]


def rejected(certificate):
    with pytest.raises(NotCertified):
        Recheck().sentence(certificate)


def parts(certificate):
    return [certificate, *(inner for one in certificate.rests_on for inner in parts(one))]


@pytest.mark.parametrize(("study", "name", "controller", "says"), PROVED, ids=[str(row[:3]) for row in PROVED])
def test_a_graph_that_is_another_plant_s_is_rejected(study, name, controller, says):
    made, _ = claims(study)
    claim = made[name, controller]
    certificate = claim.certify(claim.check(), {})
    other = graph_of(effect(MetroLine(input_gain=1.7), 1))
    for part in parts(certificate):
        for named in part.graphs:
            rejected(dataclasses.replace(part, graphs={named: other}))
            swapped = {**part.statement, "graph": hashed(other)}
            rejected(dataclasses.replace(part, statement=swapped, graphs={hashed(other): other}))


def doubled(number):
    value = float.fromhex(number) if "0x" in number else None
    return (2 * value + 1).hex() if value is not None else str(2 * Fraction(number) + 1)


@pytest.mark.parametrize(("study", "name", "controller", "says"), PROVED, ids=[str(row[:3]) for row in PROVED])
def test_another_number_is_rejected_where_the_claim_rests_on_it(study, name, controller, says):
    made, _ = claims(study)
    certificate = made[name, controller].certify(made[name, controller].check(), {})
    for part in parts(certificate):
        if part.kind == "identity":
            pairs = part.statement["equal"]
            for place, (side, number) in enumerate(pairs):
                if isinstance(number, str):
                    changed = [*pairs[:place], [side, doubled(number)], *pairs[place + 1 :]]
                    rejected(dataclasses.replace(part, statement={**part.statement, "equal": changed}))
        if part.kind == "range":
            for end, sign in (("low", 1), ("high", -1)):
                moved = (float.fromhex(part.statement[end]) + sign * 1e-9).hex()
                rejected(dataclasses.replace(part, statement={**part.statement, end: moved}))
        if part.kind == "numbers":
            turned = {">": "<", "<": ">", "=": ">", "<=": ">", ">=": "<"}
            for place, (sign, left, right) in enumerate(part.statement["holds"]):
                holds = [*part.statement["holds"]]
                holds[place] = [turned[sign], left, right]
                rejected(dataclasses.replace(part, statement={**part.statement, "holds": holds}))


PLANT = VARIABLE_GAIN.true_plant
SPEED = 1


def law(**fields):
    return LawEquations(dataclasses.replace(VARIABLE_GAIN, controllers={"fixed": FixedGain(**fields)}), "fixed")


SAY_NO = [
    ("V falls by more than the text says", lambda: decrease(MAGLEV.law("palc"), Maglev(), 0.0).certificate("So.")),
    ("V falls by less", lambda: decrease(MAGLEV.law("palc"), Maglev(), 0.51).certificate("So.")),
    ("the position answers no force", lambda: answered("So.", PLANT, 0)),
    ("b lambda is 2.1", lambda: contracting("So.", MetroLine(input_gain=2.1), SPEED, law(lam=1.0).gain_certificate())),
    ("b lambda is 2", lambda: contracting("So.", MetroLine(input_gain=2.0), SPEED, law(lam=1.0).gain_certificate())),
    ("it learns from the position", lambda: law(learns="position").learning().certificate("So.")),
    ("the start is not learned", lambda: law(initial_learning=False).ratio_certificate("So.")),
    ("dead times differ", lambda: effects.dead_time_certificate("So.", settings.in_case(ATO, "curve"))),
    (
        "u(k) does stand in y(k+6)",
        lambda: identity("So.", effects._later(ATO.plant_that_runs, 6), [(("effect", 0, 0, "u"), Fraction(0))]),
    ),
    (
        "u(k) does not stand in y(k+5)",
        lambda: identity("So.", effects._later(ATO.plant_that_runs, 6), [(("before", 4, 0, "u"), Fraction(1))]),
    ),
]


@pytest.mark.parametrize("make", [row[1] for row in SAY_NO], ids=[row[0] for row in SAY_NO])
def test_what_is_not_so_has_no_certificate(make):
    with pytest.raises(NotCertified):
        Recheck().sentence(make())


@pytest.mark.parametrize("case", ["", *VARIABLE_GAIN.cases])
def test_a_law_learns_as_the_patent_says_in_every_case_or_has_no_certificate(case):
    study = settings.in_case(VARIABLE_GAIN, case)
    for name in study.controllers:
        identity_of = LawEquations(study, name).learning()
        if identity_of.finding().standing is Standing.PROVED:
            assert Recheck().sentence(identity_of.certificate("It learns.")).endswith("where both exist.)")
        else:
            rejected(identity_of.certificate("It learns."))


@pytest.mark.parametrize("factor", [0.9, 1.0, 1.1])
def test_same_plant_knows_its_model_or_has_no_certificate(factor):
    small = dataclasses.replace(SMALL, truth={"mass": factor})
    done = compare(small, ["palc"], ["trials=1", "budget=1"], show_progress=False)
    (claim,) = [one for one in same_plant(done).claims if one.name == "same-plant.known_model"]
    made = claim.certify(claim.check(), {})
    if factor == 1:
        assert claim.check().standing is Standing.PROVED and Recheck().sentence(made).startswith(claim.statement)
    else:
        assert claim.check().standing is Standing.REFUTED
        rejected(made)


def test_limits_leave_no_certificate_of_a_command_that_is_never_cut():
    limited = dataclasses.replace(SMALL, actuator=Actuator(upper=1e9))
    done = compare(limited, ["pid"], ["trials=1", "budget=1"], show_progress=False)
    (claim,) = [one for one in same_plant(done).claims if one.name == "same-plant.unsaturated"]
    rejected(claim.certify(claim.check(), {}))


AROUND_A_PORTAL = (590.0, 1.0), (610.0, 25.0)


@cache
def open_line():
    """Return the bounds of slopes about the place of a portal, of a line that has none."""
    return lipschitz(MetroLine(tunnel_resistance=0.0), *AROUND_A_PORTAL, (1.0, 25.0))


def test_slopes_of_a_right_hand_side_are_certified_as_they_are_bounded():
    plant, low, high = MetroLine(tunnel_resistance=0.0), *AROUND_A_PORTAL
    good = certified(plant, open_line(), {})
    said = Recheck().sentence(good)
    assert "For all x_0 in [590.0, 610.0] m, x_1 in [1.0, 25.0] m/s: d f[0,0] / d x_0 is at least" in said
    assert said.count("is at least") == said.count("is at most") == 4
    x = ca.SX.sym("x", 2)
    slopes = ca.Function("slopes", [x], [ca.jacobian(plant.slope(x, ca.SX.zeros(1), ca.SX.zeros(0), 0), x)])
    points = np.vstack(
        [
            np.random.default_rng(0).uniform(low, high, (2000, 2)),
            [(place, speed) for place in (590.0, 610.0) for speed in (1.0, 25.0)],
        ]
    )
    seen = np.array([slopes(point).full() for point in points])
    claims, tried = good.statement["claims"], 0
    for place, one in enumerate(claims):
        row, column, upper = one["of"][1], int(one["by"][-1]), one["is"] == "at most"
        reached = seen[:, row, column].max() if upper else seen[:, row, column].min()
        bound = float.fromhex(one["bound"])
        assert reached <= bound if upper else reached >= bound
        beyond = reached - 0.01 * abs(reached) if upper else reached + 0.01 * abs(reached)
        if reached:
            tried += 1
            changed = [*claims[:place], {**one, "bound": float(beyond).hex()}, *claims[place + 1 :]]
            rejected(dataclasses.replace(good, statement={**good.statement, "claims": changed}))
    assert tried >= 4


def test_a_jump_within_the_box_leaves_no_certificate_of_slopes():
    with pytest.raises(NotCertified, match="no tree"):
        certified(MetroLine(), open_line(), {})


@pytest.mark.parametrize("gain", [0.3, 1.0, 2.1])
def test_the_input_gain_is_that_of_the_plant(gain):
    assert constant(effect(MetroLine(input_gain=gain), SPEED), ("effect", 0, 0, "u")) == Fraction(gain)
    assert constant(effect(MetroLine(input_gain=gain), 0), ("effect", 0, 0, "u")) == 0
