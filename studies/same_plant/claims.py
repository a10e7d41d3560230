"""The claims of a comparison: what each law's proof assumes, checked on the one plant that all laws ran on."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from functools import cache, partial
from typing import Any

import numpy as np

from studies.ato.claims import f_continuous
from verification.checks.linear_loop import incremental_pid, observed, positional_pid, spectral_radius
from verification.decide.verify import judge
from verification.theorems import learning
from workbench.contracts.examination import Examination, Table
from workbench.contracts.verdict import Claim, Finding, Standing, Verdict, undecided
from workbench.controllers.bp_fipid import BPFIPID
from workbench.controllers.fipid import FIPID
from workbench.controllers.odometry import Odometry
from workbench.controllers.palc import PALC
from workbench.controllers.pid import PID
from workbench.controllers.tracking_mpc import TrackingMPC
from workbench.controllers.variable_gain import VariableGain
from workbench.design.table import table
from workbench.design.tuning import PROCEDURE
from workbench.trials.campaign import Campaign

SOLVED = 0.01
POINTS = 9  # along the reference, at which the loop is linearised
NEEDED = {
    "theorem1": ("A1", "A2.printed", "A4.printed", "theorem1"),
    "known_model": ("known_model", "unsaturated"),
    "contraction": ("contraction", "unsaturated"),
}
"""What a law's convergence proof rests on, by a claim that only laws with that proof have."""
REPAIRED = ("increment_monotone", "increment_weighted")


def examine(campaign: Campaign, *, full: bool = False) -> Examination:
    """Return the claims on every law of a comparison."""
    study, data = campaign.study, campaign.data
    laws = study.tuned_laws(data)
    ran = Campaign(study.study(laws, true=True, seed=study.seed), data)
    files = [d for d in learning.dossiers(ran) if len(d.plant.outputs) == 1]
    claims = [claim for d in files for claim in learning.claims_of(d)]
    for name, law in laws.items():
        claims += _acting(ran, name, law)
    claims = [dataclasses.replace(claim, check=cache(claim.check)) for claim in claims]
    return Examination(
        claims=claims,
        conclude=partial(_conclude, campaign),
        tables=partial(_tables, campaign, claims),
        scores=partial(learning.scores, ran, files),
    )


def _acting(ran: Campaign, name: str, law: Any) -> list[Claim]:
    """Return the claims on what a law does within a trial."""
    claims = [
        Claim(
            name="same-plant.unsaturated",
            statement="the command of the last trial is never cut by limits: the plant is as smooth as proofs need it",
            source="ours",
            check=partial(_unsaturated, ran.data, name),
            controller=name,
        )
    ]
    if isinstance(law, Odometry) and isinstance(law.law, PALC):
        claims.append(
            Claim(
                name="same-plant.known_model",
                statement="the law knows the train's mass",
                source=f"{law.law.source}: feed-forward and compensation use M",
                check=partial(_known_model, ran, law),
                controller=name,
            )
        )
    if isinstance(law, Odometry) and isinstance(law.law, VariableGain):
        claims.append(
            Claim(
                name="same-plant.contraction",
                statement="|1 - lambda b| < 1 for every lambda in [lam_min, 1], b what a unit of input does to dv/dt",
                source=f"{law.law.source}, convergence condition of D-type learning",
                check=partial(_contraction, ran, law),
                controller=name,
            )
        )
    if isinstance(law, TrackingMPC):
        claims.append(
            Claim(
                name="same-plant.qp_solved",
                statement=f"a further sweep would move no plan by more than {SOLVED:g} of its unit",
                source="ours: the fixed point of projected Gauss-Seidel is the optimum of a strictly convex QP",
                check=partial(_solved, ran.data, name),
                controller=name,
            )
        )
    if isinstance(law, (FIPID, BPFIPID)):
        claims.append(
            Claim(
                name="same-plant.f_continuous",
                statement="the stimulus f(u, du) is continuous",
                source="Chu, Yu, Lin, Yuan & Jiang, fuzzy rules with the mean of maxima; smooth form: ours",
                check=partial(f_continuous, law.f),
                controller=name,
            )
        )
    if isinstance(law, (FIPID, BPFIPID, PID)):
        claims.append(
            Claim(
                name="same-plant.stable_loop",
                statement="the loop linearised along the reference is stable, at the least and the largest gain seen",
                source="ours: constant gains, by python-control",
                check=partial(_stable_loop, ran, name, law),
                controller=name,
            )
        )
    return claims


def _unsaturated(data: Any, name: str) -> Finding:
    applied = [str(variable) for variable in data if str(variable).startswith("applied_")]
    if not applied:
        return Finding(standing=Standing.PROVED, method="the plant has no actuator")
    one = data.sel(controller=name).isel(trial=-1)
    command, acted = one["input"].values[:-1], one[applied[0]].values[:-1]
    if not np.isfinite(command).any():
        return undecided("the law diverged before its last trial")
    unit = data["input"].attrs["units"]
    cut = np.abs(command - acted)
    worst = int(np.nanargmax(cut))
    scale = float(np.nanmax(np.abs(command)))
    if cut[worst] <= 1e-9 * scale:
        return Finding(
            standing=Standing.SUPPORTED, margin=0.0, unit=unit, method="command and applied input, last trial"
        )
    return Finding(
        standing=Standing.REFUTED,
        margin=-float(cut[worst]),
        unit=unit,
        witness={
            "sample": worst,
            "command": float(command[worst]),
            "applied": float(acted[worst]),
            "share of samples cut": float(np.mean(cut > 1e-9 * scale)),
        },
        method="command and applied input, last trial",
    )


def _inner(plant: Any) -> Any:
    """Return the plant behind its actuators."""
    while hasattr(plant, "plant"):
        plant = plant.plant
    return plant


def _known_model(ran: Campaign, law: Any) -> Finding:
    believed, true = float(law.law.model.mass), float(_inner(ran.study.plant).mass)
    off = abs(believed - true) / true
    return Finding(
        standing=Standing.PROVED if off == 0 else Standing.REFUTED,
        margin=-100 * off,
        unit="%",
        witness={"mass that the law knows": believed, "mass of the train": true},
        method="the settings of law and plant",
    )


def _contraction(ran: Campaign, law: Any) -> Finding:
    plant = _inner(ran.study.plant)
    rest = [0.0] * len(plant.states)
    slope = float(plant.derivative("u", of="y_next")(rest, 0.0, [0.0] * len(plant.disturbances), 0))
    b = slope * law.input_unit / (law.speed_unit * float(plant.sampling_time))
    factors = {gain: abs(1 - gain * b) for gain in (law.law.lam_min, 1.0)}
    worst = max(factors, key=lambda gain: factors[gain])
    return Finding(
        standing=Standing.SUPPORTED if factors[worst] < 1 else Standing.REFUTED,
        margin=1 - factors[worst],
        unit="1",
        witness={"lambda": worst, "b": b, "|1 - lambda b|": factors[worst]},
        method="exact derivative of the plant behind its actuators; the factor is convex in lambda",
    )


def _solved(data: Any, name: str) -> Finding:
    residual = data["law_residual"].sel(controller=name).values
    trial, k = (int(i) for i in np.unravel_index(int(np.nanargmax(residual)), residual.shape))
    largest = float(residual[trial, k])
    return Finding(
        standing=Standing.SUPPORTED if largest <= SOLVED else Standing.REFUTED,
        margin=SOLVED - largest,
        unit="1",
        witness={"trial": trial + 1, "sample": k, "residual": largest},
        method=f"the residual of all {int(np.isfinite(residual).sum())} quadratic programs",
    )


def _stable_loop(ran: Campaign, name: str, law: Any) -> Finding:
    plant, ts = ran.study.plant, float(ran.study.plant.sampling_time)
    if isinstance(law, PID):
        laws = {"gains": law.input_unit * positional_pid(law.kp, law.ki, law.kd, ts)}
    else:
        one = ran.data.sel(controller=name)
        gain = (one["law_p1"] - one["law_p2"] * one["law_f"]).values
        scale = law.input_unit / law.output_unit
        laws = {
            f"p1 - p2 f = {value:.4g}": value * scale * incremental_pid(law.ki, law.kd, ts)
            for value in (float(np.nanmin(gain)), float(np.nanmax(gain)))
        }
    worst: tuple[float, dict[str, Any]] = (0.0, {})
    states = [signal.name for signal in plant.states]
    for k in np.linspace(0, ran.study.horizon - 1, POINTS).astype(int):
        x = [0.0] * len(states)
        x[states.index(plant.outputs[0].name)] = float(ran.study.reference_samples[0, k])
        linear = observed(plant.linearised(x, [0.0], k=int(k)))
        for which, controller in laws.items():
            radius = spectral_radius(linear * controller)
            if radius > worst[0]:
                worst = radius, {"at": which, "sample": int(k), "output": x[0], "largest pole": radius}
    return Finding(
        standing=Standing.SUPPORTED if worst[0] < 1 else Standing.REFUTED,
        margin=1 - worst[0],
        unit="1",
        witness=worst[1],
        method=f"poles at {POINTS} points along the reference, the actuator inside its limits",
    )


def _standing(claims: Sequence[Claim], law: str) -> dict[str, Standing]:
    return {one.name.split(".", 1)[1]: judge(one).standing for one in claims if one.controller == law}


def whose_proof(found: Mapping[str, Standing]) -> str:
    """Return in words whether the convergence proof of a law applies, from the standings of its claims."""
    if any(found.get(name) is Standing.PROVED for name in REPAIRED):
        return "applies: the input error provably falls"
    if REPAIRED[0] in found:
        return "not proved here: " + ", ".join(f"{name} {found[name].lower()}" for name in REPAIRED)
    for sign, needed in NEEDED.items():
        if sign in found:
            broken = [name for name in needed if found.get(name) is Standing.REFUTED]
            if broken:
                return f"does not apply: {', '.join(broken)} refuted"
            return "applies as far as checked: " + ", ".join(f"{name} {found[name].lower()}" for name in needed)
    if "qp_solved" in found:
        return f"none claimed; quadratic programs solved: {found['qp_solved'].lower()}"
    if "asymptotic" in found:
        lifted = found["asymptotic"]
        return f"lifted condition {lifted.lower()}, which is no proof of the nonlinear plant"
    if "stable_loop" in found:
        cut = ", and the command is cut" if found.get("unsaturated") is Standing.REFUTED else ""
        return f"none claimed; linear loop stable: {found['stable_loop'].lower()}{cut}"
    return "none claimed"


def _tables(campaign: Campaign, claims: Sequence[Claim]) -> list[Table]:
    rows = table(campaign)
    proofs = []
    for name, metrics in sorted(campaign.scores().items(), key=lambda item: item[1]["mse_last"] or np.inf):
        last = metrics["mse_last"]
        found = _standing(claims, name)
        proofs.append((name, "-" if last is None else f"{last:.4g}", whose_proof(found) if found else "does not suit"))
    found_settings = campaign.data["tuned"]
    tuned = [
        (str(name), str(found_settings.sel(controller=name).values)) for name in campaign.data["controller"].values
    ]
    return [
        Table(title="Every law on the same plant", header=rows[0], rows=rows[1:]),
        Table(title="Who wins, and whose proof applies", header=("law", "final MSE", "proof"), rows=proofs),
        Table(title="Settings that tuning found", header=("law", "settings"), rows=tuned),
    ]


def _conclude(campaign: Campaign, verdicts: Sequence[Verdict]) -> list[str]:
    study = campaign.study
    scores = {name: row["mse_last"] for name, row in campaign.scores().items() if row["mse_last"] is not None}
    order = sorted(scores, key=lambda name: scores[name] or 0.0)
    said = [
        f"{PROCEDURE} The budget was {study.budget} evaluations a law, on the nominal plant; the run has a mass "
        f"that is {study.mass_off_percent:g} % off, and other noise.",
        f"The least final MSE is that of {order[0]} ({scores[order[0]]:.4g}), the largest that of {order[-1]} "
        f"({scores[order[-1]]:.4g}).",
    ]
    standings = {
        name: {v.claim.split(".", 1)[1]: v.standing for v in verdicts if v.controller == name} for name in order
    }
    applies = [name for name in order if whose_proof(standings[name]).startswith("applies")]
    said.append(
        f"A convergence proof applies on this plant to: {', '.join(applies)}."
        if applies
        else "No law's convergence proof applies on this plant: limits make it non-smooth, or printed assumptions fail."
    )
    return said
