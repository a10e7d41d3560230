"""The variable-gain study's claims: what the patent says of convergence, initial states and noise, and what holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache, partial
from typing import cast

import numpy as np
from matplotlib.figure import Figure as Drawn

from studies.variable_gain.direct_term import (
    answered,
    answers_at,
    answers_at_once,
    contracting,
    contraction,
    contracts_at,
    held_terms,
    spectral_radius,
)
from studies.variable_gain.figures import errors_by_trial
from studies.variable_gain.law_equations import SPEED as SPEED_ROW
from studies.variable_gain.law_equations import LawEquations
from studies.variable_gain.outcomes import (
    POSITION,
    SPEED,
    faster_than_fixed,
    held_gains,
    held_ratio,
    initial_learning_needed,
    initial_state_ratio,
    mismatch_limit,
    noise_claim,
    position_only,
)
from studies.variable_gain.published import EXPECTED, tables, varies
from studies.variable_gain.study import MISMATCH, NOISE, NOT_LEARNED
from verification.checks import settled
from verification.checks.initial_state import converges_at, converges_from
from verification.checks.lipschitz import certified, held_slopes, jump_at, lipschitz
from workbench.contracts.claim import Claim, Range, Role
from workbench.contracts.examination import Examination, Figure
from workbench.contracts.finding import Standing
from workbench.contracts.study import Study, rebuilt_plant
from workbench.contracts.verdict import Verdict
from workbench.evidence.variants import Variants
from workbench.trials.campaign import Campaign

PATENT = "Nanjing Institute of Technology, patent application 2017"
STARTS = 20
"""How many random starts ``global_initial_convergence`` tries."""
BOX, BANDS = ((-50.0, -2.0), (1550.0, 25.0)), (-2.0, -0.3, -0.05, 0.0, 0.05, 0.3, 25.0)
"""States (m, m/s) on which ``lipschitz_box`` looks, and the bands of speed that it cuts them into."""

ANSWERS = "The speed answers the force after one differentiation (the repair: learn from the speed)."
LEARNING = "The force of the next trial is F + lambda de_v/dt, and no feedback acts within the trial."
RATIO = "The initial position error shrinks by exactly 1 - lambda_0 from one trial to the next."
"""Statements that certificates say too."""
INPUT_GAIN = "dv/dt answers the force by the factor b."


def examine(campaign: Campaign, *, full: bool = False) -> Examination:
    """Return the claims on a campaign of the variable-gain study, with tables and conclusion."""
    evidence = Variants(campaign)
    study = campaign.study
    given = Premises(study)
    claims = [
        *_of_the_plant(study, given),
        *(claim for name in study.controllers for claim in _of_a_law(evidence, name, given)),
        *_of_runs(evidence),
    ]
    return Examination(
        claims=claims,
        conclude=conclude,
        figures=partial(_figures, evidence),
        tables=partial(tables, evidence),
        expectations=EXPECTED,
    )


class Premises:
    """The premises of what is said of the plant and of a law, each one claim however many conclusions rest on it."""

    def __init__(self, study: Study) -> None:
        self.acting = settled.nothing_between(study, PATENT)
        self.plant = settled.same_plant(study, PATENT)
        self.start = settled.same_start(study, PATENT)
        self.position = settled.no_noise(study, PATENT, "position")


def _of_the_plant(study: Study, given: Premises) -> list[Claim]:
    plant = study.true_plant
    open_tunnels = rebuilt_plant(plant, {"tunnel_resistance": 0.0})
    both, speed = ("position", "speed"), ("speed",)
    settings = [given.acting, given.plant]
    return [
        Claim(
            name="variable-gain.spectral_radius_printed",
            statement="With u = [0, F] and both position and speed as outputs, the spectral radius of "
            "I - h_x B lambda is below 1 for every learning gain in (0, 1].",
            source=f"{PATENT}, condition below (13)",
            check=partial(spectral_radius, plant, 1.0),
            role=Role.PRINTED,
            premises=settings,
            scope=lambda: {"learning gain": Range(0.0, 1.0, "1")},
        ),
        Claim(
            name="variable-gain.relative_degree",
            statement="Every output answers the force after one differentiation, so a D-type law has a direct term.",
            source=f"{PATENT}, (2), (8)-(10)",
            check=partial(answers_at_once, plant, both),
            role=Role.PRINTED,
            premises=settings,
            replay=partial(answers_at, plant),
            attack=partial(held_terms, plant),
        ),
        Claim(
            name="variable-gain.relative_degree_speed",
            statement=ANSWERS,
            source=f"ours, after {PATENT}, (2)",
            check=partial(answers_at_once, plant, speed),
            role=Role.REPAIRED,
            premises=settings,
            replay=partial(answers_at, plant),
            attack=partial(held_terms, plant),
            certify=lambda found, premises: answered(ANSWERS, plant, SPEED_ROW),
        ),
        Claim(
            name="variable-gain.lipschitz_box",
            statement="f is Lipschitz in the state for positions of -50 to 1550 m and speeds of -2 to 25 m/s.",
            source=f"{PATENT}, assumption 1",
            check=partial(lipschitz, plant, *BOX, BANDS),
            role=Role.PRINTED,
            premises=[given.plant],
            scope=_box,
            replay=partial(jump_at, plant),
            attack=partial(held_slopes, plant, *BOX),
            certify=partial(certified, plant),
        ),
        Claim(
            name="variable-gain.lipschitz_box_between_portals",
            statement="The same where no tunnel begins or ends (the repair: tunnel resistance 0).",
            source=f"ours, after {PATENT}, assumption 1",
            check=partial(lipschitz, open_tunnels, *BOX, BANDS),
            role=Role.REPAIRED,
            premises=[given.plant],
            scope=_box,
            replay=partial(jump_at, open_tunnels),
            attack=partial(held_slopes, open_tunnels, *BOX),
            certify=partial(certified, open_tunnels),
        ),
    ]


def _box() -> dict[str, Range]:
    (s, v), (s_end, v_end) = BOX
    return {"position": Range(s, s_end, "m"), "speed": Range(v, v_end, "m/s")}


def _of_a_law(evidence: Variants, name: str, given: Premises) -> list[Claim]:
    study = evidence.study
    plant = study.true_plant
    refused = name in study.refusals()
    law = cache(lambda: LawEquations(study, name))
    ratio, learned = cache(lambda: law().ratio()), cache(lambda: law().learning())
    starts = np.random.default_rng([study.seed, STARTS]).uniform([-20, -2], [20, 2], (STARTS, 2))
    lacks = "a task that suits the law" if refused else ""
    learning = Claim(
        name="variable-gain.learning_law",
        statement=LEARNING,
        source=f"{PATENT}, (3)",
        check=lambda: learned().finding(),
        controller=name,
        role=Role.PRINTED,
        lacks=lacks,
        replay=lambda witness: learned().replay(witness),
        attack=lambda _: learned().held(),
        certify=lambda found, premises: learned().certificate(LEARNING),
    )
    return [
        learning,
        Claim(
            name="variable-gain.speed_contraction",
            statement="On the speed alone (the repair), |1 - b lambda| < 1 for every gain that the law can take.",
            source=f"ours, in place of {PATENT}, condition below (13)",
            check=lambda: contraction(plant, SPEED_ROW, law()),
            controller=name,
            role=Role.REPAIRED,
            lacks=lacks,
            premises=[given.acting, given.plant, learning],
            scope=lambda: {"learning gain": Range(float(law().gains.low), float(law().gains.high), "1")},
            replay=lambda witness: contracts_at(plant, SPEED_ROW, law(), witness),
            attack=lambda finding: held_gains(evidence, name, law(), finding),
            certify=lambda found, premises: contracting(INPUT_GAIN, plant, SPEED_ROW, law().gain_certificate()),
        ),
        Claim(
            name="variable-gain.initial_state_ratio",
            statement=RATIO,
            source=f"{PATENT}, (5)",
            check=lambda: initial_state_ratio(law(), ratio()),
            controller=name,
            role=Role.PRINTED,
            lacks=lacks or ("" if law().learns_initially else "a gain lambda_0 of initial-state learning"),
            premises=[given.start, given.position],
            replay=lambda witness: ratio().replay(witness),
            attack=lambda finding: held_ratio(evidence, name, finding),
            certify=lambda found, premises: law().ratio_certificate(RATIO),
        ),
        Claim(
            name="variable-gain.global_initial_convergence",
            statement=f"From {STARTS} random starts (up to 20 m and 2 m/s off) the largest errors of the last "
            f"trial are below {100 * POSITION:g} cm and {SPEED:g} m/s.",
            source=f"{PATENT}, abstract: convergence from any initial state",
            check=partial(converges_from, study, name, starts, (POSITION, SPEED)),
            controller=name,
            role=Role.OUTCOME,
            lacks=lacks,
            replay=partial(converges_at, study, name, (POSITION, SPEED)),
        ),
    ]


def _of_runs(evidence: Variants) -> list[Claim]:
    varying = "" if any(varies(law) for law in evidence.study.controllers.values()) else "a law with a variable gain"
    return [
        Claim(
            name="variable-gain.position_only",
            statement="A D-type law that learns from the position alone reduces the position error in every trial.",
            source=f"{PATENT}, (3), read for the position",
            check=partial(position_only, evidence),
            role=Role.PRINTED,
        ),
        Claim(
            name="variable-gain.initial_learning_needed",
            statement="The same convergence is had without learning the initial state.",
            source=f"{PATENT}, step 3 says the opposite",
            check=partial(initial_learning_needed, evidence),
            role=Role.CONTROL,
        ),
        Claim(
            name="variable-gain.noise_claim",
            statement="With speed noise of 0.02 m/s the variable gain ends with a smaller error than a fixed gain of "
            "lambda_min.",
            source=f"{PATENT}, step 2: a smaller estimation error in steady state",
            check=partial(noise_claim, evidence),
            role=Role.OUTCOME,
            lacks=varying,
        ),
        Claim(
            name="variable-gain.faster_than_fixed",
            statement="The variable gain reaches 0.1 m and 0.01 m/s in fewer trials than a fixed gain of 1.",
            source=f"{PATENT}, step 2: fast convergence",
            check=partial(faster_than_fixed, evidence),
            role=Role.OUTCOME,
            lacks=varying,
        ),
        Claim(
            name="variable-gain.mismatch_limit",
            statement="A fixed gain of 1 converges where the train's input gain is 2.1 times the assumed one: its "
            f"last speed error is below {SPEED:g} m/s.",
            source="ours: the bound b lambda < 2 from outside",
            check=partial(mismatch_limit, evidence),
            role=Role.CONTROL,
        ),
    ]


def conclude(verdicts: Sequence[Verdict]) -> Sequence[str]:
    """Return what the verdicts mean, in plain words."""
    standing = {(one.claim.removeprefix("variable-gain."), one.controller): one for one in verdicts}

    def stands(name: str, wanted: Standing) -> bool:
        found = [one for (claim, _), one in standing.items() if claim == name]
        return bool(found) and all(one.standing is wanted for one in found)

    said: list[str] = []
    if stands("spectral_radius_printed", Standing.REFUTED) and stands("speed_contraction", Standing.PROVED):
        said.append(
            "The convergence condition as printed never holds: no force acts on the position directly, so one "
            "eigenvalue is always 1. What does contract is the speed error, by |1 - b lambda| a trial, and the "
            "position error is its integral plus the initial position error. The method works because the initial "
            "state is learned too, not because of the printed condition."
        )
    growing = [
        str(law)
        for (claim, law), one in standing.items()
        if claim == "speed_contraction" and one.standing is Standing.REFUTED
    ]
    if growing:
        said.append(f"For the gain of this train {' and '.join(growing)} may enlarge the speed error: do not run it.")
    unlearned = standing.get(("initial_learning_needed", None))
    if unlearned is not None and unlearned.standing is Standing.REFUTED and unlearned.margin is not None:
        seen = unlearned.witness or {}
        said.append(
            f"Without learning the initial state {seen['controller']} ends {seen['max_speed_error_last']:.2g} m/s and "
            f"{seen['max_position_error_last']:.3g} m off: the force does not correct the initial speed error."
        )
    if stands("faster_than_fixed", Standing.REFUTED):
        said.append("A fixed gain of 1 converges in fewer trials than the variable gain here.")
    loud = standing.get(("noise_claim", None))
    if loud is not None and loud.standing is Standing.REFUTED and loud.margin is not None:
        last = cast(Mapping[str, float | None], (loud.witness or {})["max_speed_error_last"])
        ends = ", ".join(f"{name} {value:.2g} m/s" for name, value in last.items() if value is not None)
        said.append(f"Under measurement noise the variable gain ends worse than a fixed one of lambda_min: {ends}.")
    return said


def _figures(evidence: Variants) -> Mapping[str, Figure]:
    def drawn(case: str, *assignments: str) -> Drawn:
        return errors_by_trial(evidence.variant(*assignments, case=case).data)

    return {
        "without_initial_learning": Figure(
            caption="Largest errors by trial when the initial state is not learned.",
            draw=partial(drawn, NOT_LEARNED, "noise.sigma=0"),
        ),
        "mismatch": Figure(
            caption="Largest errors by trial with an input gain of 2.1 times the assumed one: the fixed gain of 1 is "
            "stopped.",
            draw=partial(drawn, MISMATCH, "noise.sigma=0"),
        ),
        "noise": Figure(
            caption="Largest true errors by trial with speed noise of 0.02 m/s.", draw=partial(drawn, NOISE)
        ),
    }
