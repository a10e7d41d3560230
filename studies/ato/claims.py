"""The claims of the ato study: what Chu, Yu, Lin, Yuan & Jiang say of FIPID and BP-FIPID, and what is true."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import cast

import casadi as ca
import numpy as np

from models.plant import FirstEffect
from studies.ato.evidence import Evidence, Immune, is_immune
from studies.ato.published import tables
from studies.ato.scores import FOUR, better_all_four, gains, jerks, slopes
from studies.ato.study import own
from verification.checks.jump import find_jump
from verification.checks.linear_loop import critical_gain, incremental_pid
from verification.enclosure.smoothness import continuous_everywhere
from workbench.contracts.examination import Examination
from workbench.contracts.study import Study
from workbench.contracts.verdict import Claim, Finding, Standing, Verdict, undecided
from workbench.controllers.parts import immune
from workbench.trials.campaign import Campaign

JERK_LIMIT = 0.75
LEARNS = 0.01
NEAR = 12
"""Decimals to which the point of a jump is given: rounding of the memberships moves it by 1e-16."""
CANCELS = "u(k) stands in the composed equations, but no point was found at which it changes the output"
PAPER = "Chu, Yu, Lin, Yuan & Jiang"


def examine(campaign: Campaign, *, full: bool = False) -> Examination:
    """Return the claims of an ato campaign, step or curve test."""
    evidence, study = Evidence(campaign), campaign.study
    names = list(study.controllers)
    claims = [
        Claim(
            name="ato.relative_degree",
            statement="dy(k+1)/du(k) = 0: behind a dead time of d samples u(k) first reaches y(k+1+d)",
            source="repaired: the derivative is that of the delayed sample",
            check=partial(_relative_degree, study),
        ),
        Claim(
            name="ato.relative_degree.printed",
            statement="dy(k+1)/du(k) is not zero, so that its sign can direct the gradient",
            source=f"{PAPER}, back-propagation through the plant",
            check=partial(_printed_degree, study),
        ),
    ]
    for name in names:
        law = study.controllers[name]
        if is_immune(law):
            claims.append(
                Claim(
                    name="ato.f_continuous",
                    statement="the stimulus f(u, du) is continuous",
                    source=f"{PAPER}, fuzzy rules with the mean of maxima; smooth form: ours",
                    check=partial(f_continuous, cast(Immune, law).f),
                    controller=name,
                )
            )
    for name in names:
        claims += [
            Claim(
                name="ato.critical_gain",
                statement="the largest p1 - p2 f stays below the critical gain of the linear loop",
                source="ours: the loop with a constant gain, by python-control",
                check=partial(_critical_gain, evidence, name),
                controller=name,
            ),
            Claim(
                name="ato.jerk_limit",
                statement=f"the jerk stays below {JERK_LIMIT} m/s^3, for every seed",
                source=f"{PAPER}, comfort",
                check=partial(_jerk, evidence, name),
                controller=name,
            ),
        ]
    if "bp-fipid" in names:
        claims += _network(evidence, names)
    return Examination(
        claims=claims,
        conclude=partial(_conclude, evidence),
        tables=partial(tables, evidence),
    )


def _network(evidence: Evidence, names: Sequence[str]) -> list[Claim]:
    claims = [
        Claim(
            name="ato.sign_of_slope",
            statement="the sign of the finite difference of y by u is that of the plant's derivative",
            source=f"{PAPER}, back-propagation through the plant",
            check=partial(_sign, evidence),
            controller="bp-fipid",
        )
    ]
    if "bp-frozen" in names:
        claims.append(
            Claim(
                name="ato.network_learns",
                statement="learning lowers the median ISE by more than 1 % against weights frozen at their start",
                source=f"{PAPER}, on-line tuning by the network",
                check=partial(_learns, evidence),
                controller="bp-fipid",
            )
        )
    if "fixed-best" in names:
        claims.append(
            Claim(
                name="ato.better_than_fixed_gain",
                statement="ISE, IAE, ITSE and ITAE all lie below those of the best fixed gain p1 = p2, for most seeds",
                source="ours: what a comparison with an untuned FIPID leaves open",
                check=partial(_better, evidence, "fixed-best", 0.5),
                controller="bp-fipid",
            )
        )
    if "fipid" in names:
        claims.append(
            Claim(
                name="ato.better_than_fipid",
                statement="ISE, IAE, ITSE and ITAE all lie below those of FIPID, for every start of the weights",
                source=f"{PAPER}, tables 2 and 3",
                check=partial(_better, evidence, "fipid", 1.0),
                controller="bp-fipid",
            )
        )
    return claims


def _dead_times(study: Study) -> dict[str, int]:
    """Return a step k of every dead time that the test's plant has."""
    return {"traction": 0, "braking": 1500} if own(study).curve else {"traction": 0}


def _effects(study: Study) -> dict[str, FirstEffect | None]:
    plant = study.plant_that_runs
    return {name: plant.first_effect(limit=100, k=k) for name, k in _dead_times(study).items()}


def _relative_degree(study: Study) -> Finding:
    found = _effects(study)
    late = {name: one for name, one in found.items() if one is not None and one.degree > 1}
    if any(one is not None and not one.shown for one in found.values()):
        return undecided(CANCELS)
    if len(late) < len(found):
        witness = {name: one.degree if one else None for name, one in found.items()}
        return Finding(standing=Standing.REFUTED, method="jacobian of the composed steps", witness=witness)
    return Finding(
        standing=Standing.PROVED,
        margin=float(min(one.degree for one in late.values()) - 1),
        unit="samples",
        witness={
            name: {"first sample reached": f"k+{one.degree}", f"dy(k+{one.degree})/du(k)": one.slope_at_rest}
            for name, one in late.items()
        },
        method="the symbolic plant composed step by step: u(k) does not occur in y(k+1), ..., y(k+d)",
    )


def _printed_degree(study: Study) -> Finding:
    found = _effects(study)["traction"]
    if found is not None and found.degree == 1:
        if not found.shown:
            return undecided(CANCELS)
        return Finding(standing=Standing.PROVED, method="jacobian of the step", margin=abs(found.slope_at_rest))
    reached = f"k+{found.degree}" if found else "none"
    return Finding(
        standing=Standing.REFUTED,
        margin=0.0,
        witness={"dy(k+1)/du(k)": 0.0, "at": "every state and sample", "first sample reached": reached},
        method="the symbolic plant: u(k) does not occur in y(k+1)",
    )


def f_continuous(kind: str) -> Finding:
    """Check whether a stimulus is continuous on [-1, 1]^2 and beyond."""
    u, du = ca.SX.sym("u"), ca.SX.sym("du")
    f = ca.Function("stimulus", [u, du], [immune.stimulus(kind, u, du)], ["u", "du"], ["f"])
    if continuous_everywhere(f):
        return Finding(
            standing=Standing.PROVED, method="composed of sums, products and tanh, which are continuous everywhere"
        )
    jump = find_jump(lambda a, b: float(f(a, b)), (0.1, -0.3), (0.9, 0.3), cells=4)
    if jump is None:
        return undecided("f has operations that may jump, but no jump was found on [0.1, 0.9] x [-0.3, 0.3]")
    at = tuple(round(value, NEAR) + 0.0 for value in jump.after)
    sides = [tuple(p + side * (a != b) for p, a, b in zip(at, *jump[:2], strict=True)) for side in (-1e-9, 1e-9)]
    values = [float(f(*side)) for side in sides]
    return Finding(
        standing=Standing.REFUTED,
        margin=-abs(values[1] - values[0]),
        unit="1",
        witness={"point (u, du)": at, "on both sides": sides, "f there": values},
        method="bisection along u and du to neighbouring floating-point numbers; the largest jump found",
    )


def _loop_gain(study: Study, law: Immune) -> float:
    plant = study.plant_that_runs
    linear = plant.linearised([0.0] * len(plant.states), [0.0] * len(plant.inputs))
    return critical_gain(linear * incremental_pid(law.ki, law.kd, float(plant.sampling_time)))


def _critical_gain(evidence: Evidence, name: str) -> Finding:
    law = evidence.study.controllers[name]
    if not is_immune(law):
        return undecided(f"{name} has no gain p1 - p2 f")
    critical = _loop_gain(evidence.study, cast(Immune, law))
    largest = evidence.metric(name, "gain_max")
    worst = evidence.worst(largest)
    gain = float(largest[worst.at])
    return Finding(
        standing=Standing.SUPPORTED if gain < critical else Standing.REFUTED,
        margin=critical - gain,
        unit="1",
        witness={
            **worst.witness,
            "sample": int(np.nanargmax(gains(evidence.signals(worst.at), name))),
            "p1 - p2 f": gain,
            "critical gain": critical,
            "draws above": int(np.sum(largest >= critical)),
        },
        method="poles of the loop linearised from the symbolic plant against the gains of all draws; the gain varies, "
        "so neither side of the limit decides stability by itself",
    )


def _jerk(evidence: Evidence, name: str) -> Finding:
    jerk = evidence.metric(name, "max_jerk")
    worst = evidence.worst(jerk)
    largest = float(jerk[worst.at])
    y = evidence.signals(worst.at)["output"].sel(controller=name).values[-1, :-1]
    return Finding(
        standing=Standing.SUPPORTED if largest < JERK_LIMIT else Standing.REFUTED,
        margin=JERK_LIMIT - largest,
        unit="m/s^3",
        witness={
            **worst.witness,
            "sample": int(np.argmax(jerks(y, float(evidence.study.plant.sampling_time)))) + 1,
            "jerk": largest,
        },
        method="second differences of the recorded speed, all draws",
    )


def _sign(evidence: Evidence) -> Finding:
    shares = evidence.metric("bp-fipid", "wrong_sign_share")
    found = _effects(evidence.study)["traction"]
    if found is None or found.slope_at_rest <= 0:
        return undecided("the plant's derivative is not positive")
    if not shares.any():
        return Finding(standing=Standing.SUPPORTED, margin=0.0, method="all samples and draws")
    first = evidence.draw(int(np.flatnonzero(shares)[0]))
    dy, du = slopes(evidence.signals(first.at), "bp-fipid")
    k = int(np.flatnonzero(np.sign(dy * du) < 0)[0])
    return Finding(
        standing=Standing.REFUTED,
        margin=-float(np.mean(shares)),
        unit="share of samples",
        witness={
            **first.witness,
            "sample": k + 1,
            "y(k) - y(k-1)": float(dy[k]),
            "u(k) - u(k-1)": float(du[k]),
            f"dy(k+{found.degree})/du(k)": found.slope_at_rest,
        },
        method="finite differences of the record against the symbolic derivative of the delayed sample",
    )


def _learns(evidence: Evidence) -> Finding:
    learned, frozen = (evidence.metric(name, "ise") for name in ("bp-fipid", "bp-frozen"))
    a, b = float(np.median(learned)), float(np.median(frozen))
    gained = 1 - a / b
    worst = evidence.worst(learned / frozen)
    return Finding(
        standing=Standing.SUPPORTED if gained > LEARNS else Standing.REFUTED,
        margin=gained - LEARNS,
        unit="1",
        witness={
            "median ISE learned": a,
            "median ISE frozen": b,
            "gained": gained,
            "least favourable": worst.witness,
            "its ISE learned and frozen": [float(learned[worst.at]), float(frozen[worst.at])],
        },
        method=f"medians over {learned.size} draw(s), each learned and frozen from the same start",
    )


def _better(evidence: Evidence, against: str, needed: float) -> Finding:
    share = better_all_four(evidence.drawn, "bp-fipid", against)
    ratios = np.stack([evidence.metric("bp-fipid", i) / evidence.metric(against, i) for i in FOUR], axis=1)
    worst = evidence.worst(ratios.max(axis=1))
    holds = share >= needed if needed == 1.0 else share > needed
    return Finding(
        standing=Standing.SUPPORTED if holds else Standing.REFUTED,
        margin=share - needed,
        unit="share of draws",
        witness={
            "share of draws better on all four": share,
            **{f"median {i} relative to {against}": float(np.median(ratios[:, n])) for n, i in enumerate(FOUR)},
            "furthest off": worst.witness,
            "its largest ratio": float(ratios[worst.at].max()),
        },
        method=f"{ratios.shape[0]} draw(s) of the weights",
    )


def _conclude(evidence: Evidence, verdicts: Sequence[Verdict]) -> list[str]:
    standings = {verdict.claim: verdict.standing for verdict in verdicts}
    standing = standings.get
    ise = {name: float(np.median(evidence.metric(name, "ise"))) for name in evidence.study.controllers}
    said = [
        f"On the {'curve' if own(evidence.study).curve else 'step'} test the median ISE is "
        + ", ".join(f"{value:.4g} ({name})" for name, value in ise.items())
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
    return said
