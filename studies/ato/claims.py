"""The claims of the ato study: what Chu, Yu, Lin, Yuan & Jiang say of FIPID and BP-FIPID, and what is true."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import cast

import numpy as np

from studies.ato import effects, outcomes
from studies.ato.evidence import Evidence, Immune, is_immune
from studies.ato.outcomes import JERK_LIMIT
from studies.ato.published import EXPECTED, tables
from studies.ato.stimulus import continuity
from studies.ato.study import own
from workbench.contracts.claim import Claim, Role
from workbench.contracts.examination import Examination
from workbench.contracts.finding import Standing
from workbench.contracts.study import Study
from workbench.contracts.verdict import Verdict
from workbench.trials.campaign import Campaign

PAPER = "Chu, Yu, Lin, Yuan & Jiang"
GAIN = "a gain p1 - p2 f"
NOTHING_NEXT = "dy(k+1)/du(k) = 0 at every sample k of the horizon: u(k) does not stand in y(k+1)"
BY_DEAD_TIME = "at every sample k, u(k) first reaches y(k+1+d), d being the dead time that stands at sample k"
CURVE = "a speed curve: a unit step is no train's trip, and its jerk is that of the step"


def examine(campaign: Campaign, *, full: bool = False) -> Examination:
    """Return the claims of an ato campaign, step or curve test."""
    evidence, study = Evidence(campaign), campaign.study
    names = list(study.controllers)
    claims = _degrees(study)
    claims += [_continuous(campaign, name) for name in names if is_immune(study.controllers[name])]
    for name in names:
        claims += [
            Claim(
                name="ato.critical_gain",
                statement="in the draws that were run, the largest p1 - p2 f stays below the critical gain of the "
                "linear loop",
                source="ours: the loop with a constant gain, by python-control",
                check=partial(outcomes.below_critical, evidence, name),
                controller=name,
                role=Role.REQUIREMENT,
                lacks="" if is_immune(study.controllers[name]) else GAIN,
                replay=partial(outcomes.below_critical_margin, study, name),
            ),
            Claim(
                name="ato.jerk_limit",
                statement=f"the jerk stays below {JERK_LIMIT} m/s^3 in every draw that was run",
                source=f"{PAPER}, comfort",
                check=partial(outcomes.small_jerk, evidence, name),
                controller=name,
                role=Role.OUTCOME,
                lacks="" if own(study).curve else CURVE,
                replay=partial(outcomes.small_jerk_margin, study, name),
            ),
        ]
    if "bp-fipid" in names:
        claims += _network(evidence, names)
    return Examination(
        claims=claims,
        conclude=partial(_conclude, evidence),
        tables=partial(tables, evidence),
        expectations=EXPECTED,
    )


def _degrees(study: Study) -> list[Claim]:
    return [
        Claim(
            name="ato.relative_degree",
            statement=NOTHING_NEXT,
            source="repaired: the derivative must be that of a later sample",
            check=partial(effects.nothing_next, study),
            role=Role.REPAIRED,
            replay=partial(effects.nothing_next_margin, study),
            attack=partial(effects.held_by_pulses, study),
            certify=lambda found, premises: effects.nothing_next_certificate(NOTHING_NEXT, study),
        ),
        Claim(
            name="ato.relative_degree.dead_time",
            statement=BY_DEAD_TIME,
            source="ours: what a dead time that does not switch makes true",
            check=partial(effects.by_dead_time, study),
            role=Role.REPAIRED,
            replay=partial(effects.by_dead_time_margin, study),
            attack=partial(effects.held_by_dead_times, study),
            certify=lambda found, premises: effects.dead_time_certificate(BY_DEAD_TIME, study),
        ),
        Claim(
            name="ato.relative_degree.printed",
            statement="dy(k+1)/du(k) is not zero at any sample k, so that its sign can direct the gradient",
            source=f"{PAPER}, back-propagation through the plant",
            check=partial(effects.something_next, study),
            role=Role.PRINTED,
            replay=partial(effects.something_next_margin, study),
        ),
    ]


def _continuous(campaign: Campaign, name: str) -> Claim:
    law = cast(Immune, campaign.study.controllers[name])
    return continuity("ato", law.f, law.input_unit, campaign.data, name)


def _network(evidence: Evidence, names: Sequence[str]) -> list[Claim]:
    study = evidence.study
    claims = [
        Claim(
            name="ato.sign_of_slope",
            statement="the sign of the finite difference of y by u is that of the plant's derivative dy(k+j)/du(k), "
            "y(k+j) being the first output that u(k) reaches",
            source=f"{PAPER}, back-propagation through the plant",
            check=partial(outcomes.right_sign, evidence),
            controller="bp-fipid",
            role=Role.PRINTED,
            replay=partial(outcomes.right_sign_margin, study),
        )
    ]
    if "bp-frozen" in names:
        claims.append(
            Claim(
                name="ato.network_learns",
                statement="in the draws that were run, learning lowers the median ISE by more than 1 % against weights "
                "frozen at their start",
                source=f"{PAPER}, on-line tuning by the network",
                check=partial(outcomes.learns, evidence),
                controller="bp-fipid",
                role=Role.OUTCOME,
            )
        )
    if "fixed-best" in names:
        claims.append(
            Claim(
                name="ato.better_than_fixed_gain",
                statement="ISE, IAE, ITSE and ITAE all lie below those of the best fixed gain p1 = p2, in more than "
                "half of the draws that were run",
                source="ours: what a comparison with an untuned FIPID leaves open",
                check=partial(outcomes.better_in_most, evidence, "fixed-best"),
                controller="bp-fipid",
                role=Role.OUTCOME,
            )
        )
    if "fipid" in names:
        claims.append(
            Claim(
                name="ato.better_than_fipid",
                statement="ISE, IAE, ITSE and ITAE all lie below those of FIPID, in every draw of the weights that was "
                "run",
                source=f"{PAPER}, tables 2 and 3",
                check=partial(outcomes.better_in_all, evidence, "fipid"),
                controller="bp-fipid",
                role=Role.OUTCOME,
                replay=partial(outcomes.better_in_all_margin, study, "fipid"),
            )
        )
    return claims


def _conclude(evidence: Evidence, verdicts: Sequence[Verdict]) -> list[str]:
    standings = {verdict.claim: verdict.standing for verdict in verdicts}
    standing = standings.get
    ise = {name: float(np.median(evidence.metric(name, "ise"))) for name in evidence.study.controllers}
    ended = {name: value for name, value in ise.items() if np.isfinite(value)}
    said = [
        f"On the {'curve' if own(evidence.study).curve else 'step'} test the median ISE is "
        + (", ".join(f"{value:.4g} ({name})" for name, value in ended.items()) or "that of no law")
        + "."
    ]
    learns = standing("ato.network_learns")
    if learns is Standing.REFUTED:
        said.append(
            "The network does not learn here: weights frozen at their random start do as well within 1 %. What is "
            "better than FIPID is the gain that the random start happens to give."
        )
    elif learns is Standing.SUPPORTED:
        said.append("The network does learn here: it is clearly better than its own random start.")
    if standing("ato.better_than_fixed_gain") is Standing.REFUTED:
        said.append("A fixed gain p1 = p2, found by trying a grid, is at least as good as the network.")
    elif standing("ato.better_than_fixed_gain") is Standing.SUPPORTED:
        said.append("The network is better than the best fixed gain of the grid for most seeds.")
    beyond = [v.controller for v in verdicts if v.claim == "ato.critical_gain" and v.standing is Standing.REFUTED]
    if beyond:
        said.append(
            f"The gain of {', '.join(str(name) for name in beyond)} passes the critical gain of the linear loop in "
            "places: being tuned for the ISE alone, it has no margin left."
        )
    if standing("ato.relative_degree") is Standing.PROVED:
        said.append(
            "The dead time makes dy(k+1)/du(k) zero: the learning rule's derivative must be that of the delayed "
            "sample, and the sign it takes instead is wrong at a part of the samples."
        )
    if standing("ato.relative_degree.dead_time") is Standing.REFUTED:
        said.append(
            "Where the dead time switches, an input arrives sooner or later than its dead time says, or never: no one "
            "delayed sample is right for every k."
        )
    return said
