"""The claims of the stopping study: what Liu, Xun, Gao & Yin say of RMPC and RSMPC, and what is true."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import xarray as xr

from studies.stopping import outcomes as stopping_outcomes
from studies.stopping.design import CONFIGS, Control
from studies.stopping.outcomes import LIMIT_CM, within_window
from studies.stopping.published import published
from studies.stopping.scores import scores as scores_of
from studies.stopping.settings import Stopping, own
from verification.checks import predictive as predictive_checks
from verification.checks import tube as tube_checks
from verification.checks.feasibility import Deciding
from workbench.contracts.examination import Examination
from workbench.contracts.study import Scores, Study
from workbench.contracts.verdict import Claim, Finding, Standing, Verdict, undecided
from workbench.predictive import Tube
from workbench.trials.campaign import Campaign

PAPER = "Liu, Xun, Gao & Yin 2022"
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
RUNS, RUNS_FULL = 200, 1000
SEEDS, SEEDS_FULL = 8, 60


def examine(campaign: Campaign, *, full: bool = False) -> Examination:
    """Return the claims of a stopping campaign.

    The long checks look at its shortest and longest horizon, with ``full`` at every horizon and both configurations.
    """
    study, data, lengths = campaign.study, campaign.data, own(campaign.study).lengths
    horizons = lengths if full else tuple(dict.fromkeys((min(lengths), max(lengths))))
    claims = [
        *_design(study, horizons),
        *_costs(study, horizons),
        *_feasibility(study, horizons, full),
        *_runs(study, data, horizons, SEEDS_FULL if full else SEEDS),
    ]
    return Examination(
        claims=claims,
        conclude=partial(_conclude, campaign),
        tables=partial(published, campaign, seeds=SEEDS_FULL if full else SEEDS),
    )


def _design(study: Study, horizons: Sequence[int]) -> list[Claim]:
    settings = own(study)
    checks = [
        ("schur", "A + b K is Schur", "(15), repaired: the paper prints Hurwitz", tube_checks.schur),
        (
            "hurwitz_as_printed",
            "A + b K is Hurwitz: every eigenvalue has a negative real part",
            "step 1 of the algorithm, as printed",
            tube_checks.hurwitz_as_printed,
        ),
        ("lyapunov", "P satisfies (19) with equality", "(19)", tube_checks.lyapunov),
        ("lmi20", "the matrix of (20) is positive semidefinite", "(20)", tube_checks.lmi20),
        ("tube_inside", "Z, the tube in the end, lies inside Sigma", "(16)", tube_checks.tube_inside),
        (
            "rpi",
            "Sigma is robust positively invariant",
            "(16), repaired: Z in Sigma in Sigma_0 is not enough",
            tube_checks.rpi,
        ),
    ]
    claims = [
        Claim(
            name=f"stopping.{name}",
            statement=statement,
            source=f"{PAPER}, {source}",
            check=partial(_on_tube, settings, check),
        )
        for name, statement, source, check in checks
    ]
    claims += [
        Claim(
            name="stopping.horizon27",
            statement=f"R_(M+N)^M lies inside Sigma for every hold M = 1 ... {N - 1}",
            source=f"{PAPER}, (27)",
            check=partial(_on_tube, settings, partial(tube_checks.horizon27, N=N)),
            controller=f"rsmpc-n{N}",
        )
        for N in own(study).lengths
    ]
    longest = max(horizons)
    holds = tuple(sorted({1, 2, longest - 1} & set(range(1, longest))))
    claims.append(
        Claim(
            name="stopping.tightening_sound",
            statement="no disturbance of W moves the true error further from a plan than the bounds were tightened by",
            source=f"{PAPER}, (14), (26), repaired: A^l W and the prediction error over the dead time",
            check=partial(
                _on_tube,
                settings,
                partial(tube_checks.tightening_sound, stages=longest, holds=holds, seed=study.seed),
            ),
        )
    )
    return claims


def _on_tube(settings: Stopping, check: Callable[[Tube], Finding]) -> Finding:
    return check(settings.design)


def _costs(study: Study, horizons: Sequence[int]) -> list[Claim]:
    claims = []
    for N in horizons:
        short, long = own(study).rmpc(N), own(study).rsmpc(N)
        rows: list[tuple[str, str, str, str, Callable[[], Finding]]] = [
            (
                "nominal_decrease",
                "without disturbance J falls by at least the stage cost at each sample",
                "(18), repaired: only without disturbance",
                f"rmpc-n{N}",
                partial(predictive_checks.nominal_decrease, short, seed=study.seed),
            ),
            (
                "nominal_decrease.printed",
                "J falls by at least the stage cost at each sample, under any disturbance of W",
                "(18), (21)",
                f"rmpc-n{N}",
                partial(predictive_checks.disturbed_decrease, short),
            ),
            (
                "suboptimality32",
                "without disturbance the cost of the whole run stays below beta J(t0)",
                "(32), repaired: only without disturbance, J being J^1",
                f"rsmpc-n{N}",
                partial(predictive_checks.suboptimality, long, seed=study.seed),
            ),
            (
                "suboptimality32.printed",
                "the cost of the whole run stays below beta J(t0), under any disturbance of W",
                "(30)-(32)",
                f"rsmpc-n{N}",
                partial(predictive_checks.disturbed_suboptimality, long),
            ),
        ]
        claims += [
            Claim(
                name=f"stopping.{name}",
                statement=statement,
                source=f"{PAPER}, {source}",
                check=check,
                controller=controller,
            )
            for name, statement, source, controller, check in rows
        ]
    return claims


def _feasibility(study: Study, horizons: Sequence[int], full: bool) -> list[Claim]:
    statement = "once feasible, always feasible and within the bounds, whatever disturbance of W acts"
    runs = RUNS_FULL if full else RUNS
    claims = []
    for kind in ("rmpc", "rsmpc"):
        for N in horizons:
            claims.append(
                Claim(
                    name="stopping.recursive_feasibility",
                    statement=statement,
                    source=f"{PAPER}, (14)-(18), (26)-(29), with the repaired sets",
                    check=partial(_feasible, study, own(study), kind, N, runs),
                    controller=f"{kind}-n{N}",
                )
            )
            others = {name: config for name, config in CONFIGS.items() if full and config != own(study).config}
            claims += [
                Claim(
                    name=f"stopping.recursive_feasibility.config_{name}",
                    statement=f"{statement}, in configuration {name}",
                    source=f"{PAPER}, (14)-(18), (26)-(29), with the repaired sets",
                    check=partial(_feasible, study, dataclasses.replace(own(study), config=config), kind, N, runs),
                    controller=f"{kind}-n{N}",
                )
                for name, config in others.items()
            ]
    claims += [
        Claim(
            name=f"stopping.recursive_feasibility.{name}",
            statement=f"negative control: {statement}, with {wrong}",
            source="ours: it must be refuted, which shows that the check can fail",
            check=partial(
                _feasible, study, dataclasses.replace(own(study), tube=control), "rmpc", CONTROL_HORIZON, RUNS
            ),
            controller=f"rmpc-n{CONTROL_HORIZON}",
        )
        for name, (control, wrong) in CONTROLS.items()
    ]
    return claims


def _feasible(study: Study, chosen: Stopping, kind: str, N: int, runs: int) -> Finding:
    true = chosen.tube_for(control=Control())
    law: Deciding = chosen.rmpc(N) if kind == "rmpc" else chosen.rsmpc(N)
    return predictive_checks.recursive_feasibility(law, true.plant, true.bounds, runs=runs, seed=study.seed)


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
        )
        for name in (f"{kind}-n{N}" for kind in ("rmpc", "rsmpc", "offset-free") for N in horizons)
    ]
    for N in own(study).lengths:
        pair = (f"rmpc-n{N}", f"rsmpc-n{N}")
        claims += [
            Claim(
                name="stopping.comfort",
                statement="self-triggering lowers the largest jerk of the brake",
                source=f"{PAPER}, section 4",
                check=partial(_lower, scores, *pair, ("max_jerk",), "m/s^3"),
                controller=pair[1],
            ),
            Claim(
                name="stopping.fewer_switches",
                statement="self-triggering updates and switches the brake command less often",
                source=f"{PAPER}, section 4",
                check=partial(_lower, scores, *pair, ("updates", "switches"), "1"),
                controller=pair[1],
            ),
        ]
    return claims


def _kept(data: xr.Dataset, name: str) -> Finding:
    one = data.sel(controller=name)
    excess, lost = one["bound_excess"].values, one["infeasible"].values
    if np.isnan(excess).all():
        return undecided("the run has no finite sample")
    k = int(np.nanargmax(excess))
    worst = float(excess[k])
    without = np.flatnonzero(lost > 0)
    held = worst <= ROUNDING and not without.size
    method = f"every sample of the run; {without.size} without a plan"
    if without.size:
        method += f", at first: {one['stopped'].values!s}"
    return Finding(
        standing=Standing.SUPPORTED if held else Standing.REFUTED,
        margin=ROUNDING - worst,
        unit="units of the bound",
        witness={"sample": int(without[0]) if without.size else k, "excess": worst},
        method=method,
    )


def _stopped(scores: Scores, name: str) -> Finding:
    error = scores[name]["stop_error_cm"]
    if error is None:
        witness = {"stop_error_cm": None, "stopped": False}
        return Finding(standing=Standing.REFUTED, method="the train never stopped in the run", witness=witness)
    return Finding(
        standing=Standing.SUPPORTED if within_window(error) else Standing.REFUTED,
        margin=LIMIT_CM - abs(error),
        unit="cm",
        witness={"stop_error_cm": error},
        method="the first zero of the speed, interpolated between fine steps of the continuous plant",
    )


def _lower(scores: Scores, before: str, after: str, metrics: Sequence[str], unit: str) -> Finding:
    """Compare metrics of two laws: the second must have less of each."""
    values = {metric: (scores[before][metric], scores[after][metric]) for metric in metrics}
    gains = [first - second for first, second in values.values() if first is not None and second is not None]
    if len(gains) < len(metrics):
        return undecided(f"a metric is missing: {values}")
    return Finding(
        standing=Standing.SUPPORTED if min(gains) > 0 else Standing.REFUTED,
        margin=min(gains),
        unit=unit,
        witness={
            f"{metric}, {law}": pair[i] for metric, pair in values.items() for i, law in enumerate((before, after))
        },
        method="metrics of the two runs, the same line and horizon",
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
            f"Nothing keeps {names} within 50 cm for every resistance inside W: the tube alone allows metres. What "
            "stops the train near the mark on this line is that its last grade is small."
        )
    if jerky:
        paragraphs.append(
            f"Self-triggering saves updates but not comfort: in {jerky} of {len(lengths)} horizons its largest "
            "jerk is above that of RMPC, for it corrects rarely and then at once."
        )
    return paragraphs
