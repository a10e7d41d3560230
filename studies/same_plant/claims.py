"""The claims of a comparison: what each law's proof assumes, checked on the one plant that all laws ran on.

Which claims are made of a law follows from what it declares: that it learns with a model, from the error's slope,
that it is a PID, that it solves problems.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from functools import cache, partial
from typing import cast

import numpy as np
import xarray as xr

from models.actuator import Actuator
from models.plant import Plant
from models.quantity import is_declared, symbolised, walked
from studies.ato.evidence import Immune
from studies.ato.stimulus import continuity
from studies.same_plant.published import EXPECTED
from verification.certificates.numbers import Number, Relation, numbers
from verification.checks import premises
from verification.checks.linear_loop import incremental_pid, observed, positional_pid, spectral_radius
from verification.decide.judge import Judge
from verification.theorems import learning, learning_scores
from workbench.contracts.certificate import Certificate
from workbench.contracts.claim import Claim, Role
from workbench.contracts.examination import Examination, Table
from workbench.contracts.finding import Finding, Grounds, Standing, undecided
from workbench.contracts.law import AnyLaw, PIDAction, SlopeLearning
from workbench.contracts.study import Study
from workbench.contracts.verdict import Verdict
from workbench.controllers.parts.scales import at_output
from workbench.design.search import Search
from workbench.design.table import settled, table
from workbench.design.tuning import PROCEDURE
from workbench.trials.campaign import Campaign

UNSATURATED = "the command of the last trial is never cut by limits: the plant is as smooth as proofs need it"
KNOWN = "the law knows the plant: all quantities of the plant that runs are those that it was told"
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
    ran = settled(campaign)
    files = learning.dossiers(ran)
    claims = list(learning.examine(ran, full=full).claims)
    for name, law in ran.study.controllers.items():
        claims += _acting(ran, name, law if law.stepped else ran.study.law(name))
    claims = [dataclasses.replace(claim, check=cache(claim.check)) for claim in claims]
    return Examination(
        claims=claims,
        conclude=partial(_conclude, campaign),
        tables=partial(_tables, campaign, claims),
        scores=partial(learning_scores.scores, ran, files),
        expectations=EXPECTED,
    )


def _acting(ran: Campaign, name: str, law: AnyLaw) -> list[Claim]:
    """Return the claims on what a law does within a trial."""
    claims = [
        Claim(
            name="same-plant.unsaturated",
            role=Role.OUTCOME,
            statement=UNSATURATED,
            source="ours",
            check=partial(_unsaturated, ran, name),
            controller=name,
            certify=lambda found, premises: _unsaturated_certificate(ran.study),
        )
    ]
    if "model" in law.told and law.learns_on is not None:
        claims.append(
            Claim(
                name="same-plant.known_model",
                role=Role.REPAIRED,
                statement=KNOWN,
                source=f"{law.origin}: feed-forward and compensation use the model",
                check=partial(_known_model, ran.study),
                controller=name,
                certify=lambda found, premises: _model_certificate(ran.study),
            )
        )
    if law.slope_learning is not None:
        claims.append(
            Claim(
                name="same-plant.contraction",
                role=Role.REPAIRED,
                statement="|1 - lambda b| < 1 for every gain lambda that learning may use, b what a unit of input does "
                "to the output's slope",
                source=f"{law.origin}, convergence condition of D-type learning",
                check=partial(_contraction, ran.study, law.slope_learning),
                controller=name,
            )
        )
    if law.solves_per_sample and any(signal.name == "residual" for signal in law.tells):
        claims.append(
            Claim(
                name="same-plant.qp_solved",
                role=Role.OUTCOME,
                statement=f"a further sweep would move no plan by more than {SOLVED:g} of its unit",
                source="ours: the fixed point of projected Gauss-Seidel is the optimum of a strictly convex QP",
                check=partial(_solved, ran.data, name),
                controller=name,
            )
        )
    return claims + _of_pid(ran, name, law.pid)


def _of_pid(ran: Campaign, name: str, pid: PIDAction | None) -> list[Claim]:
    """Return the claims on a law that is a PID."""
    if pid is None:
        return []
    claims = []
    if pid.stimulus is not None:
        unit = cast(Immune, ran.study.controllers[name]).input_unit
        claims.append(continuity("same-plant", pid.stimulus, unit, ran.data, name))
    claims.append(
        Claim(
            name="same-plant.stable_loop",
            role=Role.REPAIRED,
            statement="the loop linearised along the reference is stable, at the least and the largest gain seen",
            source="ours: constant gains, by python-control",
            check=partial(_stable_loop, ran, name, pid),
            controller=name,
        )
    )
    return claims


def _unsaturated(ran: Campaign, name: str) -> Finding:
    if type(ran.study.plant_that_runs).applied is Plant.applied:
        return Finding(
            grounds=Grounds.SETTINGS,
            holds=type(ran.study.plant_that_runs).applied is Plant.applied,
            method="the plant has no actuator",
        )
    one = ran.data.sel(controller=name).isel(trial=-1)
    command, acted = one["input"].values[..., :-1], one["applied"].values[..., :-1]
    if not np.isfinite(command).any():
        return undecided("the law diverged before its last trial")
    unit = ran.data["input"].attrs["units"]
    cut = np.abs(command - acted)
    worst = np.unravel_index(int(np.nanargmax(cut)), cut.shape)
    scale = float(np.nanmax(np.abs(command)))
    which = {"input": ran.study.plant.inputs[int(worst[0])].name} if len(worst) > 1 else {}
    return Finding(
        grounds=Grounds.RUN,
        tries=command.size,
        margin=1e-9 * scale - float(cut[worst]),
        weak=True,
        unit=unit,
        witness={
            **which,
            "sample": int(worst[-1]),
            "command": float(command[worst]),
            "applied": float(acted[worst]),
            "share of samples cut": float(np.mean(cut > 1e-9 * scale)),
        },
        method="command and applied input, last trial",
    )


def _known_model(study: Study) -> Finding:
    told = dict(zip(*symbolised(study.plant)[1::2], strict=True))
    off: dict[str, float] = {}
    true: dict[str, float] = {}
    for name, departure in study.scenario.truth.items():
        low, high = (told[name] * factor for factor in departure.range)
        for value in (low, high):
            share = abs(told[name] - value) / abs(value) if value else np.inf
            if value != told[name] and share > off.get(name, 0.0):
                off[name], true[name] = share, value
    worst = max(off, key=lambda name: off[name], default="")
    known = {f"{worst} that the law knows": told[worst], f"{worst} of the plant": true[worst]} if off else None
    return Finding(
        grounds=Grounds.SETTINGS,
        margin=-100 * off.get(worst, 0.0),
        weak=True,
        unit="%",
        witness=known,
        method="the settings of the plant, believed and true",
    )


def _unsaturated_certificate(study: Study) -> Certificate:
    facts = premises.between(study)
    return numbers(UNSATURATED, facts, *(("=", fact, 0) for fact in facts))


def _model_certificate(study: Study) -> Certificate:
    """Return the certificate that every quantity is in every trial what the law was told."""
    told = dict(zip(*symbolised(study.plant)[1::2], strict=True))
    units = {path: spec.unit for path, spec, _ in walked(study.plant, lambda _, inner: is_declared(inner))}
    facts: dict[str, tuple[Number, str]] = {f"{name} as told": (value, units[name]) for name, value in told.items()}
    holds: list[Relation] = []
    for name, departure in study.scenario.truth.items():
        for end, factor in zip(("least", "largest"), departure.range, strict=True):
            facts[f"{end} factor of {name}"] = (factor, "1")
            holds.append(("=", f"{name} as told", ("*", f"{end} factor of {name}", f"{name} as told")))
    facts["quantities that may be others"] = (len(study.scenario.truth.keys() - told.keys()), "")
    return numbers(KNOWN, facts, ("=", "quantities that may be others", 0), *holds)


def _contraction(study: Study, learning: SlopeLearning) -> Finding:
    inner = dataclasses.replace(study, actuator=Actuator(), compose=None).plant_that_runs
    effect = inner.first_effect(limit=min(200, study.horizon))
    if effect is None:
        return undecided("the input reaches no output")
    b = effect.slope_at_rest * learning.unit / float(study.plant.sampling_time)
    factors = {gain: abs(1 - gain * b) for gain in (learning.low, learning.high)}
    worst = max(factors, key=lambda gain: factors[gain])
    return Finding(
        grounds=Grounds.NUMERICS,
        margin=1 - factors[worst],
        unit="1",
        witness={"lambda": worst, "b": b, "|1 - lambda b|": factors[worst]},
        method="exact derivative of the plant behind its actuators; the factor is convex in lambda",
    )


def _solved(data: xr.Dataset, name: str) -> Finding:
    residual = data["law_residual"].sel(controller=name).values
    trial, k = (int(i) for i in np.unravel_index(int(np.nanargmax(residual)), residual.shape))
    largest = float(residual[trial, k])
    return Finding(
        grounds=Grounds.RUN,
        tries=int(np.isfinite(residual).sum()),
        weak=True,
        margin=SOLVED - largest,
        unit="1",
        witness={"trial": trial + 1, "sample": k, "residual": largest},
        method=f"the residual of all {int(np.isfinite(residual).sum())} quadratic programs",
    )


def _stable_loop(ran: Campaign, name: str, pid: PIDAction) -> Finding:
    plant, ts = ran.study.plant_that_runs, float(ran.study.plant.sampling_time)
    if pid.form == "positional":
        action = positional_pid(pid.kp, pid.ki, pid.kd, ts)
    else:
        action = incremental_pid(pid.ki, pid.kd, ts)
    laws = {"gains": pid.unit * action}
    if pid.gain is not None:
        one = ran.data.sel(controller=name)
        told = ran.study.controllers[name].tells
        gain = pid.gain({signal.name: one[f"law_{signal.name}"].values for signal in told})
        ends = float(np.nanmin(gain)), float(np.nanmax(gain))
        laws = {f"gain = {value:.4g}": value * pid.unit * action for value in ends}
    radii: dict[tuple[str, int], float] = {}
    outputs: dict[int, float] = {}
    for k in np.linspace(0, ran.study.horizon - 1, POINTS).astype(int):
        x = [0.0] * len(plant.states)
        level = float(ran.study.reference_samples[0, k])
        own = at_output(ran.study.plant, level)
        x[: len(own)] = own.tolist()
        outputs[int(k)] = level
        linear = observed(plant.linearised(x, [0.0], k=int(k)))
        for which, controller in laws.items():
            radii[which, int(k)] = spectral_radius(linear * controller)
    which, k = max(radii, key=lambda at: radii[at])
    worst = radii[which, k]
    return Finding(
        grounds=Grounds.NUMERICS,
        margin=1 - worst,
        unit="1",
        witness={"at": which, "sample": k, "output": outputs[k], "largest pole": worst},
        method=f"poles at {POINTS} points along the reference, the actuator inside its limits",
    )


def _standing(claims: Sequence[Claim], law: str) -> dict[str, Standing]:
    """Return how the claims made of a law stand by their checks, which are kept: nothing is replayed once more."""
    judge = Judge()
    made = [dataclasses.replace(one, replay=None, attack=None) for one in claims if one.controller == law]
    found = [judge.verdict(one) for one in made]
    return {one.claim.split(".", 1)[1]: one.standing for one in found if isinstance(one, Verdict)}


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
    settings = campaign.data["tuned"]
    tuned = [(name, str(settings.sel(controller=name).values)) for name in map(str, settings["controller"].values)]
    return [
        Table(title="Every law on the same plant", header=rows[0], rows=rows[1:]),
        Table(title="Who wins, and whose proof applies", header=("law", rows[0][2], "proof"), rows=proofs),
        Table(title="Settings that tuning found", header=("law", "settings"), rows=tuned),
    ]


def _conclude(campaign: Campaign, verdicts: Sequence[Verdict]) -> list[str]:
    study = campaign.study
    scores = {name: row["mse_last"] for name, row in campaign.scores().items() if row["mse_last"] is not None}
    order = sorted(scores, key=lambda name: scores[name] or 0.0)
    assert isinstance(study.tuning, Search)
    said = [
        f"{PROCEDURE} The budget was {study.tuning.budget} evaluations a law, on the nominal plant; the run has "
        f"{_departed(study)}."
    ]
    if order:
        said.append(
            f"The least final MSE is that of {order[0]} ({scores[order[0]]:.4g}), the largest that of {order[-1]} "
            f"({scores[order[-1]]:.4g})."
        )
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


def _departed(study: Study) -> str:
    """Return in words how the plant that ran differs from the believed one."""
    off = []
    for name, departure in study.scenario.truth.items():
        low, high = (100 * (factor - 1) for factor in departure.range)
        if low or high:
            off.append(f"a {name} that is {f'{low:.4g} %' if low == high else f'{low:.4g} to {high:.4g} %'} off")
    return f"{', '.join(off) or 'no quantity off'}, and other random parts"
