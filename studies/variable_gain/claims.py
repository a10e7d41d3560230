"""The variable-gain study's claims: what the patent says of convergence, initial states and noise, and what holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import cast

import numpy as np
from matplotlib.figure import Figure as Drawn

from studies.variable_gain.direct_term import answers_at_once, contraction, spectral_radius
from studies.variable_gain.figures import errors_by_trial
from studies.variable_gain.published import FixedLaw, VariableLaw, noisy, tables, variable_law, varies
from studies.variable_gain.scores import peaks
from studies.variable_gain.study import MISMATCH, NOISE, NOT_LEARNED, Start
from verification.checks.initial_state import converges_from, initial_factor
from verification.checks.lipschitz import lipschitz
from workbench.contracts.examination import Examination, Figure
from workbench.contracts.law import AnyLaw
from workbench.contracts.study import rebuilt_plant
from workbench.contracts.verdict import Claim, Finding, Standing, Verdict, undecided
from workbench.controllers.fixed_gain import FixedGain
from workbench.evidence.variants import Variants
from workbench.trials.campaign import Campaign
from workbench.trials.record import OUTPUT

PATENT = "Nanjing Institute of Technology, patent application 2017"
STARTS = 20
"""How many random starts ``global_initial_convergence`` tries."""
POSITION, SPEED = 0.01, 5e-4
"""What counts as converged after all trials, m and m/s."""

BOX, BANDS = ((-50.0, -2.0), (1550.0, 25.0)), (-2.0, -0.3, -0.05, 0.0, 0.05, 0.3, 25.0)
"""States (m, m/s) on which ``lipschitz_box`` looks, and the bands of speed that it cuts them into."""


def examine(campaign: Campaign, *, full: bool = False) -> Examination:
    """Return the claims on a campaign of the variable-gain study, with tables and conclusion."""
    evidence = Variants(campaign)
    plant, laws = campaign.study.plant_that_runs, campaign.study.controllers
    claims = [
        Claim(
            name="variable-gain.spectral_radius_printed",
            statement="With u = [0, F] and both position and speed as outputs, the spectral radius of "
            "I - h_x B lambda is below 1 for every learning gain in (0, 1].",
            source=f"{PATENT}, condition below (13)",
            check=partial(spectral_radius, plant, 1.0),
        ),
        *(
            Claim(
                name="variable-gain.speed_contraction",
                statement="On the speed alone (the repair), |1 - b lambda| < 1 for every gain that the law can take.",
                source=f"ours, in place of {PATENT}, condition below (13)",
                check=partial(contraction, plant, 1, gains(laws[name])),
                controller=name,
            )
            for name in laws
        ),
        Claim(
            name="variable-gain.relative_degree",
            statement="Every output answers the force after one differentiation, so a D-type law has a direct term.",
            source=f"{PATENT}, (2), (8)-(10)",
            check=partial(answers_at_once, plant, ("position", "speed")),
        ),
        Claim(
            name="variable-gain.relative_degree_speed",
            statement="The speed answers the force after one differentiation (the repair: learn from the speed).",
            source=f"ours, after {PATENT}, (2)",
            check=partial(answers_at_once, plant, ("speed",)),
        ),
        Claim(
            name="variable-gain.lipschitz_box",
            statement="f is Lipschitz in the state for positions of -50 to 1550 m and speeds of -2 to 25 m/s.",
            source=f"{PATENT}, assumption 1",
            check=partial(lipschitz, plant, *BOX, BANDS),
        ),
        Claim(
            name="variable-gain.lipschitz_box_between_portals",
            statement="The same where no tunnel begins or ends (the repair: tunnel resistance 0).",
            source=f"ours, after {PATENT}, assumption 1",
            check=partial(lipschitz, rebuilt_plant(plant, {"tunnel_resistance": 0.0}), *BOX, BANDS),
        ),
        Claim(
            name="variable-gain.position_only",
            statement="A D-type law that learns from the position alone reduces the position error in every trial.",
            source=f"{PATENT}, (3), read for the position",
            check=partial(position_only, evidence),
        ),
        *(
            Claim(
                name="variable-gain.initial_state_ratio",
                statement="The initial position error shrinks by exactly 1 - lambda_0 from one trial to the next.",
                source=f"{PATENT}, (5)",
                check=partial(initial_state_ratio, evidence, name),
                controller=name,
            )
            for name in laws
        ),
        *(
            Claim(
                name="variable-gain.global_initial_convergence",
                statement=f"From {STARTS} random starts (up to 20 m and 2 m/s off) the largest errors of the last "
                f"trial are below {100 * POSITION:g} cm and {SPEED:g} m/s.",
                source=f"{PATENT}, abstract: convergence from any initial state",
                check=partial(global_initial_convergence, evidence, name),
                controller=name,
            )
            for name in laws
        ),
        Claim(
            name="variable-gain.initial_learning_needed",
            statement="The same convergence is had without learning the initial state.",
            source=f"{PATENT}, step 3 says the opposite",
            check=partial(initial_learning_needed, evidence),
        ),
        Claim(
            name="variable-gain.noise_claim",
            statement="With speed noise of 0.02 m/s the variable gain ends with a smaller error than a fixed gain of "
            "lambda_min.",
            source=f"{PATENT}, step 2: a smaller estimation error in steady state",
            check=partial(noise_claim, evidence),
        ),
        Claim(
            name="variable-gain.faster_than_fixed",
            statement="The variable gain reaches 0.1 m and 0.01 m/s in fewer trials than a fixed gain of 1.",
            source=f"{PATENT}, step 2: fast convergence",
            check=partial(faster_than_fixed, evidence),
        ),
        Claim(
            name="variable-gain.mismatch_limit",
            statement="A fixed gain of 1 converges where the train's input gain is 2.1 times the assumed one.",
            source="ours: the bound b lambda < 2 from outside",
            check=partial(mismatch_limit, evidence),
        ),
    ]
    return Examination(
        claims=claims,
        conclude=conclude,
        figures=partial(_figures, evidence),
        tables=partial(tables, evidence),
    )


def gains(law: AnyLaw) -> tuple[float, float]:
    """Return the least and the largest gain that a law can take."""
    if varies(law):
        return cast(VariableLaw, law).lam_min, 1.0
    gain = cast(FixedLaw, law).lam
    return gain, gain


def position_only(evidence: Variants) -> Finding:
    """Run a law that learns from the slope of the position error."""
    law = FixedGain(lam=1.0, learns="position")
    data = evidence.variant("noise.sigma=0", laws=(("position", law),)).data
    errors = peaks(data, "position", "position")
    errors = errors[np.isfinite(errors)]
    if errors.size < 2:
        return undecided("one trial shows no learning: give more trials")
    rising = np.flatnonzero(np.diff(errors) > 0)
    method = f"{errors.size} trials of the study with lambda = 1 on the slope of the position error"
    if not rising.size:
        return Finding(standing=Standing.SUPPORTED, method=method, margin=float(-np.diff(errors).max()), unit="m")
    worst = int(np.argmax(errors))
    return Finding(
        standing=Standing.REFUTED,
        method=method,
        margin=float(errors[0] - errors[worst]),
        unit="m",
        witness={
            "first_rise_at_trial": int(rising[0]) + 2,
            "max_position_error_first": errors[0],
            "largest": errors[worst],
            "at_trial": worst + 1,
            "last": errors[-1],
        },
    )


def initial_state_ratio(evidence: Variants, name: str) -> Finding:
    """Differentiate the law's own equations, and look at the run."""
    law = evidence.study.law(name)
    factor = initial_factor(law)
    if factor is None:
        return undecided("the factor depends on the trial")
    expected = 1 - cast(FixedLaw, law).lam0
    start = evidence.campaign.data["error"].sel({"controller": name, OUTPUT: "position"}).isel(sample=0).values
    measured = float(start[1] / start[0]) if start.size > 1 and start[0] else None
    exact = abs(factor - expected) <= 1e-15
    return Finding(
        standing=Standing.PROVED if exact else Standing.REFUTED,
        method="exact differentiation of the law's place and learn, without noise and with the same offset in every "
        "trial; the run's ratio of trial 2 to trial 1 stands beside it",
        margin=1 - abs(factor),
        unit="1",
        witness={"factor": factor, "1 - lambda_0": expected, "measured": measured},
    )


def global_initial_convergence(evidence: Variants, name: str) -> Finding:
    """Run the study from random starts, drawn from its seed."""
    study = evidence.study
    starts = np.random.default_rng([study.seed, STARTS]).uniform([-20, -2], [20, 2], (STARTS, 2))
    return converges_from(study, name, starts, (POSITION, SPEED))


def initial_learning_needed(evidence: Variants) -> Finding:
    """Run the study without initial-state learning."""
    data = evidence.variant("noise.sigma=0", case=NOT_LEARNED).data
    last = {
        name: (peaks(data, name, "position")[-1], peaks(data, name, "speed")[-1]) for name in evidence.study.controllers
    }
    worst = max(last, key=lambda name: last[name][1])
    start = cast(Start, evidence.study.initial)
    converged = all(position < POSITION and speed < SPEED for position, speed in last.values())
    return Finding(
        standing=Standing.SUPPORTED if converged else Standing.REFUTED,
        method=f"the study run in the case {NOT_LEARNED}",
        margin=float(SPEED - last[worst][1]),
        unit="m/s",
        witness={
            "controller": worst,
            "max_position_error_last": last[worst][0],
            "max_speed_error_last": last[worst][1],
            "initial.speed": start.speed,
        },
    )


def noise_claim(evidence: Variants) -> Finding:
    """Compare the last trial's true speed error under noise."""
    last = noisy(evidence)
    margin = last["fixed-lam_min"] - last["variable"]
    return Finding(
        standing=Standing.SUPPORTED if margin > 0 else Standing.REFUTED,
        method="the study with noise.sigma = 0.02 m/s; largest true speed error of the last trial. The gain is "
        "computed from the same noisy sample that it multiplies, so noise is learned with the largest gains; "
        "smoothing |e_v| over 1 s helps",
        margin=margin,
        unit="m/s",
        witness={"max_speed_error_last": last},
    )


def faster_than_fixed(evidence: Variants) -> Finding:
    """Compare the trials to tolerance of the variable gain and of a fixed gain of 1."""
    law = variable_law(evidence)
    laws: tuple[tuple[str, AnyLaw], ...] = (
        ("variable", law),
        ("fixed", FixedGain(lam=1.0, lam0=cast(VariableLaw, law).lam0)),
    )
    scores = evidence.variant(laws=laws).scores()
    trials = {name: scores[name]["trials_to_tolerance"] for name, _ in laws}
    counted = {name: np.inf if number is None else number for name, number in trials.items()}
    if np.isinf(list(counted.values())).all():
        return undecided("neither law reached the tolerance")
    margin = counted["fixed"] - counted["variable"]
    return Finding(
        standing=Standing.SUPPORTED if margin > 0 else Standing.REFUTED,
        method="the same study run with both laws",
        margin=float(margin),
        unit="trials",
        witness={"trials_to_tolerance": trials},
    )


def mismatch_limit(evidence: Variants) -> Finding:
    """Run a fixed gain of 1 on a train whose input gain is 2.1 times the assumed one."""
    campaign = evidence.variant("noise.sigma=0", case=MISMATCH, laws=(("fixed", FixedGain(lam=1.0)),))
    peaked = peaks(campaign.data, "fixed", "speed")
    diverged = campaign.scores()["fixed"]["diverged_at_trial"]
    done = peaked[np.isfinite(peaked)]
    return Finding(
        standing=Standing.REFUTED if diverged else Standing.SUPPORTED,
        method="the study with an input gain of 2.1 times the assumed one; a watch over the slope of the speed error "
        "stops it",
        margin=float(SPEED - done[-1]),
        unit="m/s",
        witness={"diverged_at_trial": diverged, "max_speed_error_first": done[0], "max_speed_error_last": done[-1]},
    )


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
    if not stands("speed_contraction", Standing.PROVED):
        said.append("For the gain of this train, at least one law does not contract the speed error: do not run it.")
    if stands("initial_learning_needed", Standing.REFUTED):
        said.append(
            "Without learning the initial state the speed error stays at the initial speed error and the position "
            "error grows with it to tens of metres."
        )
    if stands("faster_than_fixed", Standing.REFUTED):
        said.append("A fixed gain of 1 converges in fewer trials than the variable gain here.")
    if stands("noise_claim", Standing.REFUTED):
        said.append(
            "Under measurement noise the variable gain ends worse than a small fixed gain: it learns the noise with "
            "the largest gains. Smooth the error that sets the gain, or use a small fixed gain."
        )
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
