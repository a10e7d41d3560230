"""The claims of learning laws in general: what the proofs of model-free adaptive ILC need, on any plant."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from verification.checks import assumptions, convergence, increment
from verification.checks.premises import same_plant
from verification.theorems import conclusion
from verification.theorems.dossier import Dossier
from verification.theorems.pictures import figures
from workbench.contracts.examination import Examination
from workbench.contracts.number import finite
from workbench.contracts.verdict import Claim, Finding, undecided
from workbench.evidence.trajectory import one_channel, trials_done
from workbench.trials.campaign import Campaign

PAPER = "Jiao & Hou 2025"


def examine(campaign: Campaign, *, full: bool = False) -> Examination:
    """Return the examination of every learning law of a campaign; ``full`` adds the sweep over the force unit."""
    several = one_channel(campaign.study.plant_that_runs)
    files = [] if several else dossiers(campaign)
    if several is not None:
        return Examination(claims=[], conclude=lambda verdicts: [f"No claim of learning laws was made: {several}."])
    claims = [claim for dossier in files for claim in claims_of(dossier)]
    if (moving := same_plant(campaign.study)) is not None:
        # no derivative is that of the plant: only what speaks of lengths alone is looked at
        claims = [claim if claim.name.endswith(".A3") else _left_open(claim, moving) for claim in claims]
        return Examination(claims=claims, conclude=lambda verdicts: [f"Nothing is proved here: {moving}."])
    return Examination(
        claims=claims,
        conclude=partial(conclusion.paragraphs, files),
        figures=partial(figures, files, full),
        tables=partial(conclusion.boxes, files),
        scores=partial(scores, campaign, files),
    )


def _left_open(claim: Claim, reason: str) -> Claim:
    """Return a claim whose check says that it cannot tell, and why."""
    return dataclasses.replace(claim, check=lambda: undecided(reason))


def dossiers(campaign: Campaign) -> list[Dossier]:
    """Return a dossier for every controller that learns and ran at least two trials."""
    names = [str(name) for name in campaign.data["controller"].values]
    learners = [name for name in names if campaign.study.controllers[name].learns_on is not None]
    return [Dossier(campaign, name) for name in learners if trials_done(campaign, name) >= 2]


def claims_of(d: Dossier) -> list[Claim]:
    """Return the claims on one controller, in the order of the paper."""
    study = d.study.name

    def claim(name: str, statement: str, source: str, check: Callable[[], Finding]) -> Claim:
        return Claim(name=f"{study}.{name}", statement=statement, source=source, check=check, controller=d.controller)

    plant = d.plant
    found = [
        claim(
            "A1",
            "The derivative of the output by the input exists and is continuous.",
            f"{PAPER}, Assumption 1",
            lambda: assumptions.continuous_slope(plant, d.box, d.evidence.degree),
        ),
        claim(
            "A2.printed",
            "One p bounds |ds(k+1, i)| <= p |du(k, i)| wherever du(k, i) is not 0.",
            f"{PAPER}, Assumption 2",
            lambda: assumptions.lipschitz_printed(plant, d.evidence, d.box),
        ),
        claim(
            "A2.lifted",
            "Repaired: |ds(k+1)| <= p max over j <= k of |du(j)|, p the largest row sum of the lifted plant.",
            f"ours, for {PAPER}, Assumption 2",
            lambda: assumptions.lipschitz_lifted(plant, d.evidence, d.box),
        ),
        claim(
            "A3",
            "Trial lengths follow their distribution, and p(k) is the probability that a trial reaches k.",
            f"{PAPER}, Assumption 3",
            lambda: assumptions.trial_lengths(d.study, d.lengths),
        ),
        claim(
            "A4.printed",
            "The realised PPD is positive at every trial and sample.",
            f"{PAPER}, Assumption 4",
            lambda: assumptions.sign_printed(plant, d.evidence, d.box),
        ),
        claim(
            "A4.partial",
            "The partial derivative of the output by the input is positive.",
            f"ours, for {PAPER}, Assumption 4",
            lambda: assumptions.sign_partial(plant, d.evidence, d.box),
        ),
        claim(
            "lemma1",
            "ds(k+1, i) = phi_c(k, i) du(k, i) with a bounded phi_c.",
            f"{PAPER}, Lemma 1, (5)",
            lambda: assumptions.data_model(plant, d.evidence, d.box),
        ),
    ]
    if d.law.estimator is not None:
        found += [
            claim(
                "estimator",
                "The estimate stays bounded, and keeps the sign of phi(k,1).",
                f"{PAPER}, (12), (13), (15)",
                lambda: convergence.estimator_bounded(d.evidence),
            ),
            claim(
                "lambda_min.partial",
                "lambda exceeds (rho b)^2/4 with b the largest partial derivative.",
                f"{PAPER}, Theorem 1",
                lambda: convergence.lambda_partial(plant, d.evidence, d.box),
            ),
            claim(
                "lambda_min.realised",
                "lambda exceeds (rho b)^2/4 with b the largest realised ratio, which is what the proof speaks of.",
                f"{PAPER}, Theorem 1",
                lambda: convergence.lambda_realised(d.evidence),
            ),
            claim(
                "theorem1",
                "The error contracts at every trial and sample: |1 - rho phi_c phi/(lambda + phi^2)| < 1.",
                f"{PAPER}, Theorem 1",
                lambda: convergence.theorem_printed(d.evidence, d.mse),
            ),
        ]
    found += [
        claim(
            "asymptotic",
            "Every diagonal entry of I - G L lies in (-1, 1): the error vanishes in the end.",
            "lifted ILC theory, asymptotic convergence",
            lambda: convergence.asymptotic(d.error_map, d.reach),
        ),
        claim(
            "monotone",
            "The largest singular value of I - G L is below 1: the error's 2-norm falls from trial to trial.",
            "lifted ILC theory, monotone convergence",
            lambda: convergence.monotone(d.error_map),
        ),
        claim(
            "peak",
            "The frozen map I - G L predicts the largest MSE of the campaign within a factor of 3.",
            "ours",
            lambda: convergence.peak(d.mse, d.predicted_mse),
        ),
    ]
    if d.law.learns_on == "increment" and d.law.estimator is not None:
        found += [
            claim(
                "increment_monotone",
                "The largest input error falls from trial to trial for every phi > 0.",
                "ours",
                lambda: increment.monotone(plant, d.evidence, d.box),
            ),
            claim(
                "increment_weighted",
                "The weighted input error max |d(k)| a^k falls from trial to trial for every phi > 0.",
                "ours",
                lambda: increment.weighted(plant, d.evidence, d.box),
            ),
        ]
    return found


def scores(campaign: Campaign, files: Sequence[Dossier]) -> Mapping[str, Mapping[str, float | None]]:
    """Return the PPD metrics of every controller, None where one has no such quantity."""
    names = (
        "ppd_partial_min",
        "ppd_partial_max",
        "ppd_ratio_negative_share",
        "ppd_ratio_abs_max",
        "ppd_estimate_median_relative_error",
        "contraction_inside_share",
        "lambda_min_partial",
        "lambda_min_realised",
        "lipschitz_lifted",
    )
    result: dict[str, dict[str, float | None]] = {
        str(name): dict.fromkeys(names) for name in campaign.data["controller"].values
    }
    for d in files:
        e = d.evidence
        ratio = e.ratio[np.isfinite(e.ratio)]
        largest = float(np.nanmax(np.abs(e.partial)))
        off, own = assumptions.lifted_along(d.plant, e).row_sums()
        metrics: dict[str, float | None] = {
            "ppd_partial_min": float(np.nanmin(e.partial)),
            "ppd_partial_max": float(np.nanmax(e.partial)),
            "ppd_ratio_negative_share": float((ratio <= 0).mean()) if ratio.size else None,
            "ppd_ratio_abs_max": float(np.abs(ratio).max()) if ratio.size else None,
            "lipschitz_lifted": float((off + own).max()),
        }
        if d.law.estimator is not None:
            factor = d.adaptation.factor[np.isfinite(d.adaptation.factor)]
            error = e.relative_error()
            metrics |= {
                "ppd_estimate_median_relative_error": float(np.nanmedian(error)),
                "contraction_inside_share": float((np.abs(factor) < 1).mean()) if factor.size else None,
                "lambda_min_partial": convergence.lambda_min(e.estimator, largest),
                "lambda_min_realised": convergence.lambda_min(e.estimator, float(np.abs(ratio).max()))
                if ratio.size
                else None,
            }
        result[d.controller].update({key: finite(value) for key, value in metrics.items()})
    return result
