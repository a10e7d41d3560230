"""The claims of the stopping study: what Liu, Xun, Gao & Yin say of RMPC and RSMPC, and what is true."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
import xarray as xr

from studies.stopping import outcomes as stopping_outcomes
from studies.stopping.design import CONFIGS, Control
from studies.stopping.design_claims import PAPER, cost_claims, design_claims
from studies.stopping.outcomes import room_cm
from studies.stopping.published import EXPECTED, published
from studies.stopping.scores import scores as scores_of
from studies.stopping.settings import Stopping, own
from verification.checks import predictive as predictive_checks
from verification.checks.feasibility import Deciding
from workbench.contracts.claim import Claim, Role
from workbench.contracts.examination import Examination
from workbench.contracts.finding import Finding, Grounds, Standing, undecided
from workbench.contracts.study import Scores, Study
from workbench.contracts.verdict import Verdict
from workbench.trials.campaign import Campaign, run

CONTROL_HORIZON = 15
"""Horizon of the negative controls: a term too many in the tube is felt only by long plans."""
CONTROLS = {
    "index_off_by_one": (
        Control(index_off_by_one=True),
        "the tube summed to the printed upper index, one term too many",
    ),
    "ignore_delay": (Control(ignore_delay=True), "the tube made with W and X, as if the brake had no dead time"),
}
ROUNDING = 1e-9
"""What a recorded error may exceed a bound by, in the bound's unit: 1, m/s or m."""
RUNS, RUNS_FULL = 300, 1000
SEEDS, SEEDS_FULL = 8, 60


def examine(campaign: Campaign, *, full: bool = False) -> Examination:
    """Return the claims of a stopping campaign.

    The long checks look at its shortest and longest horizon, with ``full`` at every horizon and both configurations.
    """
    study, data, lengths = campaign.study, campaign.data, own(campaign.study).lengths
    horizons = lengths if full else tuple(dict.fromkeys((min(lengths), max(lengths))))
    claims = [
        *design_claims(study, horizons),
        *cost_claims(study, horizons),
        *_feasibility(study, horizons, full),
        *_runs(study, data, horizons, SEEDS_FULL if full else SEEDS),
    ]
    return Examination(
        claims=claims,
        conclude=partial(_conclude, campaign),
        tables=partial(published, campaign, seeds=SEEDS_FULL if full else SEEDS),
        expectations=EXPECTED,
    )


def _feasibility(study: Study, horizons: Sequence[int], full: bool) -> list[Claim]:
    statement = (
        "once feasible, always feasible and within the bounds, whatever disturbance of W acts on the linear model that "
        "the law plans with"
    )
    runs = RUNS_FULL if full else RUNS
    claims = []
    chosen = {"recursive_feasibility": (own(study), "")}
    if full:
        chosen |= {
            f"recursive_feasibility.config_{name}": (
                dataclasses.replace(own(study), config=config),
                f", in configuration {name}",
            )
            for name, config in CONFIGS.items()
            if config != own(study).config
        }
    for kind in ("rmpc", "rsmpc"):
        for N in horizons:
            claims += [
                Claim(
                    name=f"stopping.{name}",
                    statement=f"{statement}{said}",
                    source=f"{PAPER}, (14)-(18), (26)-(29), with the repaired sets",
                    check=partial(_feasible, study, settings, kind, N, runs),
                    controller=f"{kind}-n{N}",
                    role=Role.REPAIRED,
                    replay=partial(_feasible_at, settings, kind, N),
                )
                for name, (settings, said) in chosen.items()
            ]
    for name, (control, wrong) in CONTROLS.items():
        settings = dataclasses.replace(own(study), tube=control)
        claims.append(
            Claim(
                name=f"stopping.recursive_feasibility.{name}",
                statement=f"negative control: {statement}, with {wrong}",
                source="ours: it must be refuted, which shows that the check can fail",
                check=partial(_feasible, study, settings, "rmpc", CONTROL_HORIZON, RUNS, until_first=True),
                controller=f"rmpc-n{CONTROL_HORIZON}",
                role=Role.CONTROL,
                replay=partial(_feasible_at, settings, "rmpc", CONTROL_HORIZON),
            )
        )
    return claims


def _deciding(chosen: Stopping, kind: str, N: int) -> Deciding:
    return chosen.rmpc(N) if kind == "rmpc" else chosen.rsmpc(N)


def _feasible(study: Study, chosen: Stopping, kind: str, N: int, runs: int, *, until_first: bool = False) -> Finding:
    true = chosen.tube_for(control=Control())
    return predictive_checks.recursive_feasibility(
        _deciding(chosen, kind, N), true.plant, true.bounds, runs=runs, seed=study.seed, until_first=until_first
    )


def _feasible_at(chosen: Stopping, kind: str, N: int, witness: Mapping[str, object]) -> float:
    true = chosen.tube_for(control=Control())
    return predictive_checks.feasibility_margin(_deciding(chosen, kind, N), true.plant, true.bounds, witness)


def _runs(study: Study, data: xr.Dataset, horizons: Sequence[int], seeds: int) -> list[Claim]:
    names = [str(name) for name in data["controller"].values]
    scores = scores_of(study, data)
    claims = [
        Claim(
            name="stopping.tightened_bounds",
            statement="the run has a plan at every sample, and its predicted error never leaves the tightened bounds",
            source=f"{PAPER}, (14), (26)",
            check=partial(_kept, data, name),
            controller=name,
            role=Role.OUTCOME,
            replay=partial(_kept_again, study, name),
        )
        for name in names
        if name.startswith(("rmpc", "rsmpc", "offset-free"))
    ]
    claims += [
        Claim(
            name="stopping.stop_within_50cm",
            statement="the train stops within 50 cm of the mark in this run",
            source=f"{PAPER}, section 4",
            check=partial(_stopped, scores, name),
            controller=name,
            role=Role.OUTCOME,
        )
        for name in names
    ]
    claims += [
        Claim(
            name="stopping.stop_within_50cm.all_w",
            statement="the train stops within 50 cm of the mark whatever the resistance inside W",
            source=f"{PAPER}, abstract: robustly",
            check=partial(stopping_outcomes.robustly_within, study, name, seeds),
            controller=name,
            role=Role.PRINTED if name.startswith(("rmpc", "rsmpc")) else Role.REQUIREMENT,
            replay=partial(stopping_outcomes.robust_margin, study, name),
        )
        for name in (f"{kind}-n{N}" for kind in ("rmpc", "rsmpc", "offset-free") for N in horizons)
    ]
    for N in own(study).lengths:
        pair = (f"rmpc-n{N}", f"rsmpc-n{N}")
        claims += [
            Claim(
                name="stopping.comfort",
                statement="self-triggering lowers the largest jerk of the brake in this run",
                source=f"{PAPER}, section 4",
                check=partial(_lower, scores, *pair, ("max_jerk",), "m/s^3"),
                controller=pair[1],
                role=Role.OUTCOME,
            ),
            Claim(
                name="stopping.fewer_switches",
                statement="self-triggering updates and switches the brake command less often in this run",
                source=f"{PAPER}, section 4",
                check=partial(_lower, scores, *pair, ("updates", "switches"), "samples"),
                controller=pair[1],
                role=Role.OUTCOME,
            ),
        ]
    return claims


def _kept(data: xr.Dataset, name: str) -> Finding:
    one = data.sel(controller=name)
    excess, without = one["bound_excess"].values, np.flatnonzero(one["infeasible"].values > 0)
    if np.isnan(excess).all():
        return undecided("nothing of a run of this law was recorded; it was refused, or met an error at once")
    k = int(np.nanargmax(excess))
    worst = float(excess[k])
    method = f"every sample of one run; {without.size} without a plan"
    if without.size:
        return Finding(
            grounds=Grounds.RUN,
            margin=-float(without.size),
            unit="samples without a plan",
            weak=True,
            witness={"sample": int(without[0]), "samples without a plan": without, "excess": worst, "trial": 1},
            method=f"{method}, at first: {one['stopped'].values!s}",
        )
    if worst <= ROUNDING and not _stood(one):
        return undecided("the train did not stand at the end of this run, which so is no whole stop")
    return Finding(
        grounds=Grounds.RUN,
        margin=ROUNDING - worst,
        unit="units of the bound",
        weak=True,
        bound=worst,
        bound_unit="units of the bound, the largest excess",
        witness={"sample": k, "excess": worst, "trial": 1},
        method=f"{method}, {ROUNDING:g} counts as rounding",
    )


def _kept_again(study: Study, name: str, witness: Mapping[str, object]) -> float:
    """Return the margin of a law's plans and bounds in a run of the law alone, at the sample of a witness."""
    alone = run(dataclasses.replace(study, controllers={name: study.controllers[name]}), show_progress=False)
    one = alone.data.sel(controller=name)
    if "samples without a plan" in witness:
        return -float((one["infeasible"].values > 0).sum())
    return ROUNDING - float(one["bound_excess"].values[int(str(witness["sample"]))])


def _stood(one: xr.Dataset) -> bool:
    return bool(np.isfinite(one["stop_position"]))


def _stopped(scores: Scores, name: str) -> Finding:
    error = scores.get(name, {}).get("stop_error_cm")
    if error is None:
        return Finding(
            grounds=Grounds.RUN,
            holds=error is not None,
            method="the train never stopped in this run",
            witness={"stop_error_cm": error, "stopped": error is not None, "trial": 1},
        )
    return Finding(
        grounds=Grounds.RUN,
        margin=room_cm(error),
        unit="cm",
        weak=True,
        bound=error,
        bound_unit="cm, where it stops beyond the mark",
        witness={"stop_error_cm": error, "trial": 1},
        method="one run; the first zero of the speed, interpolated between fine steps of the continuous plant",
    )


def _lower(scores: Scores, before: str, after: str, metrics: Sequence[str], unit: str) -> Finding:
    """Compare metrics of two laws: the second must have less of each."""
    for law in (before, after):
        if scores.get(law, {}).get("stop_error_cm") is None:
            return undecided(f"{law} never stopped in this run, so that nothing of it can be told of a whole stop")
    values = {metric: (scores[before][metric], scores[after][metric]) for metric in metrics}
    gains = [first - second for first, second in values.values() if first is not None and second is not None]
    if len(gains) < len(metrics):
        return undecided(f"{' or '.join(metrics)} was not recorded for {before} or {after}")
    return Finding(
        grounds=Grounds.RUN,
        margin=min(gains),
        unit=unit,
        witness={
            f"{metric}, {law}": pair[i] for metric, pair in values.items() for i, law in enumerate((before, after))
        },
        method="metrics of one run of each, the same line and horizon",
    )


def _conclude(campaign: Campaign, verdicts: Sequence[Verdict]) -> list[str]:
    lengths, scores = own(campaign.study).lengths, campaign.scores()
    errors = {name: row["stop_error_cm"] for name, row in scores.items()}

    def span(kind: str) -> str:
        known = [value for name, value in errors.items() if name.startswith(f"{kind}-n") and value is not None]
        return f"{min(known):.3g} to {max(known):.3g} cm" if known else "nowhere"

    def standing(name: str) -> list[Verdict]:
        return [verdict for verdict in verdicts if verdict.claim == f"stopping.{name}"]

    feasible = standing("recursive_feasibility")
    good = sum(verdict.standing is Standing.SUPPORTED for verdict in feasible)
    controls = [v for name in CONTROLS for v in standing(f"recursive_feasibility.{name}")]
    broken = sum(verdict.standing is Standing.REFUTED for verdict in controls)
    outside = [v for v in standing("stop_within_50cm.all_w") if v.standing is Standing.REFUTED]
    jerky = sum(verdict.standing is Standing.REFUTED for verdict in standing("comfort"))
    paragraphs = [
        f"On this line RMPC stops {span('rmpc')} from the mark over its horizons, RSMPC {span('rsmpc')}, and the "
        f"offset-free law, which estimates the resistance from the last sample, {span('offset-free')}.",
        f"Recursive feasibility, with the repaired sets, stood in {good} of {len(feasible)} settings; of the "
        f"{len(controls)} negative controls {broken} were caught.",
    ]
    if outside:
        names = ", ".join(str(verdict.controller) for verdict in outside)
        paragraphs.append(
            f"Nothing keeps {names} within 50 cm for every resistance inside W: the tube alone allows metres, and an "
            "estimate from the last sample comes too late for a resistance that steps shortly before the mark. What "
            "stops the train near the mark on this line is that its last grade is small."
        )
    if jerky:
        paragraphs.append(
            f"Self-triggering saves updates but not comfort: in {jerky} of {len(lengths)} horizons its largest "
            "jerk is above that of RMPC, for it corrects rarely and then at once."
        )
    return paragraphs
