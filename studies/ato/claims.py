"""The claims of the ato study: what Chu, Yu, Lin, Yuan & Jiang say of FIPID and BP-FIPID, and what is true."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from models.plant import FirstEffect
from studies.ato.published import tables
from studies.ato.scores import FOUR, better_all_four
from verification.checks.jump import find_jump
from verification.checks.linear_loop import critical_gain, incremental_pid
from verification.enclosure.smoothness import continuous_everywhere
from workbench.contracts.examination import Examination
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
    study, data = campaign.study, campaign.data
    names = [str(name) for name in data["controller"].values]
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
        if hasattr(law, "f"):
            claims.append(
                Claim(
                    name="ato.f_continuous",
                    statement="the stimulus f(u, du) is continuous",
                    source=f"{PAPER}, fuzzy rules with the mean of maxima; smooth form: ours",
                    check=partial(f_continuous, law.f),
                    controller=name,
                )
            )
    for name in names:
        claims += [
            Claim(
                name="ato.critical_gain",
                statement="the largest p1 - p2 f stays below the critical gain of the linear loop",
                source="ours: the loop with a constant gain, by python-control",
                check=partial(_critical_gain, study, data, name),
                controller=name,
            ),
            Claim(
                name="ato.jerk_limit",
                statement=f"the jerk stays below {JERK_LIMIT} m/s^3, for every seed",
                source=f"{PAPER}, comfort",
                check=partial(_jerk, study, data, name),
                controller=name,
            ),
        ]
    if "bp-fipid" in names:
        claims += _network(study, data, names)
    return Examination(
        claims=claims,
        conclude=partial(_conclude, campaign),
        tables=partial(tables, campaign),
    )


def _network(study: Any, data: Any, names: Sequence[str]) -> list[Claim]:
    claims = [
        Claim(
            name="ato.sign_of_slope",
            statement="the sign of the finite difference of y by u is that of the plant's derivative",
            source=f"{PAPER}, back-propagation through the plant",
            check=partial(_sign, study, data),
            controller="bp-fipid",
        )
    ]
    if "bp-frozen" in names:
        claims.append(
            Claim(
                name="ato.network_learns",
                statement="learning lowers the median ISE by more than 1 % against weights frozen at their start",
                source=f"{PAPER}, on-line tuning by the network",
                check=partial(_learns, data),
                controller="bp-fipid",
            )
        )
    if "fixed-best" in names:
        claims.append(
            Claim(
                name="ato.better_than_fixed_gain",
                statement="ISE, IAE, ITSE and ITAE all lie below those of the best fixed gain p1 = p2, for most seeds",
                source="ours: what a comparison with an untuned FIPID leaves open",
                check=partial(_better, data, "fixed-best", 0.5),
                controller="bp-fipid",
            )
        )
    if "fipid" in names:
        claims.append(
            Claim(
                name="ato.better_than_fipid",
                statement="ISE, IAE, ITSE and ITAE all lie below those of FIPID, for every start of the weights",
                source=f"{PAPER}, tables 2 and 3",
                check=partial(_better, data, "fipid", 1.0),
                controller="bp-fipid",
            )
        )
    return claims


def _dead_times(study: Any) -> dict[str, int]:
    """Return a step k of every dead time that the test's plant has."""
    return {"traction": 0, "braking": 1500} if study.test == "curve" else {"traction": 0}


def _effects(study: Any) -> dict[str, FirstEffect | None]:
    plant = study.setting.plant
    return {name: plant.first_effect(limit=100, k=k) for name, k in _dead_times(study).items()}


def _relative_degree(study: Any) -> Finding:
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


def _printed_degree(study: Any) -> Finding:
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


def _loop_gain(study: Any, law: Any) -> float:
    plant = study.setting.plant
    linear = plant.linearised([0.0] * len(plant.states), [0.0] * len(plant.inputs))
    return critical_gain(linear * incremental_pid(law.ki, law.kd, float(study.plant.sampling_time)))


def _critical_gain(study: Any, data: Any, name: str) -> Finding:
    law = study.controllers[name]
    if not hasattr(law, "ki"):
        return undecided(f"{name} has no gain p1 - p2 f")
    critical = _loop_gain(study, law)
    one = data.sel(controller=name)
    gain = (one["p1"] - one["p2"] * one["f"]).values
    seed, k = (int(i) for i in np.unravel_index(int(np.nanargmax(gain)), gain.shape))
    largest = float(gain[seed, k])
    above = int(np.sum(np.nanmax(gain, axis=1) >= critical))
    return Finding(
        standing=Standing.SUPPORTED if largest < critical else Standing.REFUTED,
        margin=critical - largest,
        unit="1",
        witness={"seed": seed + 1, "sample": k, "p1 - p2 f": largest, "critical gain": critical, "seeds above": above},
        method="poles of the loop linearised from the symbolic plant against the gains of all seeds; the gain varies, "
        "so neither side of the limit decides stability by itself",
    )


def _jerk(study: Any, data: Any, name: str) -> Finding:
    y = data["output"].sel(controller=name).values[:, :-1]
    jerk = np.abs(np.diff(y, 2, axis=1)) / float(study.plant.sampling_time) ** 2
    seed, k = (int(i) for i in np.unravel_index(int(np.argmax(jerk)), jerk.shape))
    largest = float(jerk[seed, k])
    return Finding(
        standing=Standing.SUPPORTED if largest < JERK_LIMIT else Standing.REFUTED,
        margin=JERK_LIMIT - largest,
        unit="m/s^3",
        witness={"seed": seed + 1, "sample": k + 1, "jerk": largest},
        method="second differences of the recorded speed, all seeds",
    )


def _sign(study: Any, data: Any) -> Finding:
    one = data.sel(controller="bp-fipid")
    u, y = one["input"].values[:, :-1], one["output"].values[:, :-1]
    sign = np.sign(np.diff(y, axis=1) * np.diff(u, axis=1))
    wrong = sign < 0
    found = _effects(study)["traction"]
    if found is None or found.slope_at_rest <= 0:
        return undecided("the plant's derivative is not positive")
    if not wrong.any():
        return Finding(standing=Standing.SUPPORTED, margin=0.0, method="all samples and seeds")
    seed, k = (int(i) for i in np.argwhere(wrong)[0])
    share = float(np.mean(wrong))
    return Finding(
        standing=Standing.REFUTED,
        margin=-share,
        unit="share of samples",
        witness={
            "seed": seed + 1,
            "sample": k + 1,
            "y(k) - y(k-1)": float(np.diff(y, axis=1)[seed, k]),
            "u(k) - u(k-1)": float(np.diff(u, axis=1)[seed, k]),
            f"dy(k+{found.degree})/du(k)": found.slope_at_rest,
        },
        method="finite differences of the record against the symbolic derivative of the delayed sample",
    )


def _learns(data: Any) -> Finding:
    learned, frozen = (data["ise"].sel(controller=name).values for name in ("bp-fipid", "bp-frozen"))
    a, b = float(np.median(learned)), float(np.median(frozen))
    gained = 1 - a / b
    worst = int(np.argmax(learned / frozen))
    return Finding(
        standing=Standing.SUPPORTED if gained > LEARNS else Standing.REFUTED,
        margin=gained - LEARNS,
        unit="1",
        witness={
            "median ISE learned": a,
            "median ISE frozen": b,
            "gained": gained,
            "least favourable seed": worst + 1,
            "its ISE learned and frozen": [float(learned[worst]), float(frozen[worst])],
        },
        method=f"medians over {learned.size} seed(s), each learned and frozen from the same start",
    )


def _better(data: Any, against: str, needed: float) -> Finding:
    share = better_all_four(data, "bp-fipid", against)
    ratios = np.stack(
        [(data[i].sel(controller="bp-fipid") / data[i].sel(controller=against)).values for i in FOUR], axis=1
    )
    worst = int(np.argmax(ratios.max(axis=1)))
    holds = share >= needed if needed == 1.0 else share > needed
    return Finding(
        standing=Standing.SUPPORTED if holds else Standing.REFUTED,
        margin=share - needed,
        unit="share of seeds",
        witness={
            "share of seeds better on all four": share,
            **{f"median {i} relative to {against}": float(np.median(ratios[:, n])) for n, i in enumerate(FOUR)},
            "seed furthest off": worst + 1,
            "its largest ratio": float(ratios[worst].max()),
        },
        method=f"{ratios.shape[0]} seed(s) of the weights",
    )


def _conclude(campaign: Campaign, verdicts: Sequence[Verdict]) -> list[str]:
    data, study = campaign.data, campaign.study
    standings = {verdict.claim: verdict.standing for verdict in verdicts}
    standing = standings.get
    ise = {str(name): float(np.median(data["ise"].sel(controller=name))) for name in data["controller"].values}
    said = [
        f"On the {study.test} test the median ISE is "
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
