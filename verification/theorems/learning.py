"""The claims of learning laws in general: what the proofs of model-free adaptive ILC need, on any plant.

They are about the derivative of one output by one input and about what a law takes from trial to trial, so they have no
meaning for plants with several channels or for laws that learn nothing between trials: there each claim says what it
lacks, and a study has claims of its own. What any study's run shows is asked in
:mod:`verification.theorems.outcomes`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial

from verification.checks import (
    assumption_replays,
    assumptions,
    continuity,
    convergence,
    error_map,
    increment,
    learning_curve,
)
from verification.checks.error_map_replay import replay_monotone
from verification.checks.premises import same_plant
from verification.theorems import conclusion, funnel, limit, safe_words
from verification.theorems.dossier import Dossier, dossiers_of
from verification.theorems.learning_scores import scores
from verification.theorems.pictures import figures, funnel_figures
from workbench.contracts.claim import Certify, Claim, Held, Range, Role
from workbench.contracts.examination import Examination
from workbench.contracts.finding import Finding, undecided
from workbench.trials.campaign import Campaign

PAPER = "Jiao & Hou 2025"
GUESS = "an estimate of the pseudo partial derivative (estimator)"


def examine(campaign: Campaign, *, full: bool = False) -> Examination:
    """Return the examination of every law of a campaign; ``full`` adds the sweep over the force unit.

    Every claim is made of every law, or says which declared property it lacks.
    """
    files = dossiers_of(campaign)
    shown = [one for one in files if not one.lacks and one.done >= 2 and same_plant(campaign.study) is None]
    ran = [one for one in files if one.done]
    kept = cache(lambda: [one for one in ran if funnel.covered(one)])
    return Examination(
        claims=[claim for dossier in files for claim in claims_of(dossier)],
        conclude=lambda verdicts: [*conclusion.paragraphs(shown, verdicts), *safe_words.paragraphs(ran, verdicts)],
        figures=lambda: {**figures(shown, full), **funnel_figures(kept())},
        tables=lambda: [*conclusion.boxes(shown), *safe_words.table(kept())],
        scores=partial(scores, campaign, shown),
    )


def dossiers(campaign: Campaign) -> list[Dossier]:
    """Return a dossier for every controller of which the claims have a meaning, and that ran at least two trials."""
    files = dossiers_of(campaign)
    return [one for one in files if not one.lacks and one.done >= 2]


def claims_of(d: Dossier) -> list[Claim]:
    """Return the claims on one controller, in the order of the paper."""
    return [*_assumptions(d), *_adaptive(d), *_maps(d), *_increments(d), *funnel.claims_of(d), *limit.claims_of(d)]


def _claim(
    d: Dossier,
    name: str,
    statement: str,
    source: str,
    check: Callable[[], Finding],
    *,
    role: Role,
    lacks: str = "",
    premises: Sequence[Claim] = (),
    rests_on: Sequence[Claim] = (),
    scope: Callable[[], Mapping[str, Range]] = dict,
    replay: Callable[[Mapping[str, object]], float] | None = None,
    attack: Callable[[Finding], Held] | None = None,
    certify: Certify | None = None,
) -> Claim:
    """Return a claim on a controller; a law of which too few trials ran leaves it open."""

    def looked() -> Finding:
        if d.done < 2:
            why = d.stopped or "run more"
            return undecided(f"fewer than two trials were run, so there is nothing to look at: {why}")
        return check()

    missing = d.lacks or lacks
    return Claim(
        name=f"{d.study.name}.{name}",
        statement=statement,
        source=source,
        check=looked,
        controller=d.controller,
        role=role,
        premises=() if missing or d.done < 2 else premises,
        rests_on=rests_on,
        lacks=missing,
        scope=scope,
        replay=replay,
        attack=attack,
        certify=certify,
    )


def _assumptions(d: Dossier) -> list[Claim]:
    """Return the claims about the plant and the trials: Assumptions 1 to 4 and Lemma 1."""
    study, law = d.study, d.study.scenario.trial_length
    alike, one, scope = d.premises.same_but_for_the_input, d.premises.same_plant, d.premises.scope_holds_disturbances
    unknown = "a distribution of trial lengths: " if study.plant_that_runs.ends or law.lengths else ""
    if unknown:
        unknown += "trials end by an event of the plant" if study.plant_that_runs.ends else "the lengths are given"
    return [
        _claim(
            d,
            "A1",
            "The derivative of the output by the input exists and is continuous, at every sample of the scope.",
            f"{PAPER}, Assumption 1",
            lambda: d.refuted_in_the_hull(lambda box: continuity.continuous_slope(d.plant, box, d.evidence.degree)),
            role=Role.PRINTED,
            premises=(one, scope),
            scope=d.scope,
            replay=lambda witness: continuity.replay(d.plant, d.evidence.degree, witness),
            attack=d.attack_continuity,
            certify=d.certified.continuous_slope,
        ),
        _claim(
            d,
            "A2.printed",
            "One p bounds |ds(k+1, i)| <= p |du(k, i)| wherever du(k, i) is not 0.",
            f"{PAPER}, Assumption 2",
            lambda: d.refuted_in_the_hull(lambda box: assumptions.lipschitz_printed(d.plant, d.evidence, box)),
            role=Role.PRINTED,
            premises=(alike, scope),
            scope=d.scope,
            replay=lambda witness: assumption_replays.replay_vanishing(d.plant, d.evidence, witness),
            attack=d.attack_ratio,
            certify=d.certified.ratio,
        ),
        _claim(
            d,
            "A2.lifted",
            "Repaired: |ds(k+d)| <= p max over j <= k of |du(j)|, p the largest row sum of the lifted plant, d the "
            "relative degree, for trials that stay in the scope.",
            f"ours, for {PAPER}, Assumption 2",
            lambda: assumptions.lipschitz_lifted(d.plant, d.evidence, d.slopes, d.box),
            role=Role.REPAIRED,
            premises=(alike,),
            scope=d.scope,
            replay=lambda witness: assumption_replays.replay_across(d.plant, d.evidence, witness),
            attack=d.attack_row_sums,
            certify=d.certified.row_sums,
        ),
        _claim(
            d,
            "A3",
            "Trial lengths follow their distribution, and p(k) is the probability that a trial reaches k.",
            f"{PAPER}, Assumption 3",
            lambda: assumptions.trial_lengths(d.study, d.lengths),
            role=Role.PRINTED,
            lacks=unknown,
        ),
        _claim(
            d,
            "A4.printed",
            "The realised PPD is positive at every trial and sample.",
            f"{PAPER}, Assumption 4",
            lambda: d.refuted_in_the_hull(lambda box: assumptions.sign_printed(d.plant, d.evidence, box)),
            role=Role.PRINTED,
            premises=(alike, scope),
            scope=d.scope,
            replay=lambda witness: assumption_replays.replay_sign(d.plant, d.evidence, witness),
            attack=d.attack_slopes,
            certify=d.certified.positive_slope,
        ),
        _claim(
            d,
            "A4.partial",
            "The partial derivative of the learned signal by the input is positive.",
            f"ours, for {PAPER}, Assumption 4",
            lambda: d.refuted_in_the_hull(lambda box: assumptions.sign_partial(d.plant, d.evidence, box)),
            role=Role.REPAIRED,
            premises=(one, scope),
            scope=d.scope,
            replay=lambda witness: assumption_replays.slope_at(d.plant, d.evidence, witness),
            attack=d.attack_slopes,
            certify=d.certified.positive_slope,
        ),
        _claim(
            d,
            "lemma1",
            "ds(k+1, i) = phi_c(k, i) du(k, i) with a bounded phi_c.",
            f"{PAPER}, Lemma 1, (5)",
            lambda: d.refuted_in_the_hull(lambda box: assumptions.data_model(d.plant, d.evidence, box)),
            role=Role.PRINTED,
            premises=(alike, scope),
            scope=d.scope,
            replay=lambda witness: assumption_replays.replay_lemma(d.plant, d.evidence, witness),
            attack=d.attack_ratio,
            certify=d.certified.ratio,
        ),
    ]


def _adaptive(d: Dossier) -> list[Claim]:
    """Return the claims on the estimate, and on what Theorem 1's argument asks of it."""
    guess = "" if d.lacks or d.law.estimator is not None else GUESS
    alike, one, scope = d.premises.same_but_for_the_input, d.premises.same_plant, d.premises.scope_holds_disturbances
    return [
        _claim(
            d,
            "estimator",
            "In the run the estimate stays bounded, and keeps the sign of phi(k,1).",
            f"{PAPER}, (12), (13), (15)",
            lambda: convergence.estimator_bounded(d.evidence),
            role=Role.PRINTED,
            lacks=guess,
        ),
        _claim(
            d,
            "lambda_min.partial",
            "lambda exceeds (rho b)^2/4 with b the largest partial derivative.",
            f"{PAPER}, Theorem 1",
            lambda: d.refuted_in_the_hull(
                lambda box: convergence.lambda_partial(d.plant, d.evidence, d.gains_over(box), box)
            ),
            role=Role.PRINTED,
            lacks=guess,
            premises=(one, scope),
            scope=d.scope,
            replay=lambda witness: (
                d.estimator.lam
                - convergence.lambda_min(d.estimator, abs(assumption_replays.slope_at(d.plant, d.evidence, witness)))
            ),
            attack=d.attack_slopes,
            certify=d.certified.lambda_min,
        ),
        _claim(
            d,
            "lambda_min.realised",
            "lambda exceeds (rho b)^2/4 with b the largest realised ratio, which is what the proof speaks of.",
            f"{PAPER}, Theorem 1",
            lambda: convergence.lambda_realised(d.evidence),
            role=Role.PRINTED,
            lacks=guess,
            premises=(alike,),
            replay=lambda witness: (
                d.estimator.lam
                - convergence.lambda_min(d.estimator, abs(assumption_replays.ratio_at(d.plant, d.evidence, witness)))
            ),
        ),
        _claim(
            d,
            "theorem1",
            "The error contracts at every trial and sample: |1 - rho phi_c phi/(lambda + phi^2)| < 1.",
            f"{PAPER}, Theorem 1",
            lambda: convergence.theorem_printed(d.evidence, d.mse),
            role=Role.PRINTED,
            lacks=guess,
            premises=(alike,),
            replay=lambda witness: convergence.factor_margin(d.plant, d.evidence, witness),
        ),
    ]


def _maps(d: Dossier) -> list[Claim]:
    """Return the claims on the map between trials, which is taken along the last trial."""
    ran, one = d.premises.ran, d.premises.same_plant
    return [
        _claim(
            d,
            "asymptotic",
            "The map between trials along the last one has a spectral radius below 1, and its limit has no error.",
            "lifted ILC theory, asymptotic convergence",
            lambda: error_map.asymptotic(d.error_map, d.reach),
            role=Role.REPAIRED,
            premises=(ran, one, d.premises.no_noise),
        ),
        _claim(
            d,
            "monotone",
            "The map's largest singular value is below 1: the 2-norm of the error, or of the plan's distance to its "
            "limit, falls from trial to trial.",
            "lifted ILC theory, monotone convergence",
            lambda: error_map.monotone(d.error_map),
            role=Role.REPAIRED,
            premises=(one,),
            replay=lambda witness: replay_monotone(d.campaign, d.controller, witness),
        ),
        _claim(
            d,
            "peak",
            "The map between trials, frozen at the last one, predicts the largest MSE of the campaign within a factor "
            "of 3.",
            "ours",
            lambda: learning_curve.peak(d.mse, d.predicted_mse),
            role=Role.REPAIRED,
            lacks=_no_rise(d),
            premises=(one,),
        ),
    ]


def _no_rise(d: Dossier) -> str:
    """Return that there is no rise whose height could be predicted, or an empty text."""
    rise = None if d.lacks or d.done < 2 else learning_curve.no_rise(d.mse)
    return f"a rise of the error: {rise}" if rise else ""


def _increments(d: Dossier) -> list[Claim]:
    """Return the theorems on learning from the output's increments."""
    lacks = "" if d.lacks or d.law.estimator is not None else GUESS
    if not d.lacks and d.law.learns_on != "increment":
        lacks = "learning on the output's increments (learns_on)"
    p = d.premises
    shared = (
        p.first_degree,
        p.unfiltered,
        p.positive_estimate,
        p.same_but_for_the_input,
        p.scope_holds_disturbances,
        p.no_noise,
        p.nothing_between,
        p.plan_alone,
    )
    return [
        _claim(
            d,
            "increment_monotone",
            "The largest input error max |u* - u| falls from trial to trial for every phi > 0, in trials that stay in "
            "the scope.",
            "ours",
            lambda: increment.monotone(d.estimator, d.slopes, d.wanted, d.plant, d.box),
            role=Role.REPAIRED,
            lacks=lacks,
            premises=shared,
            rests_on=(p.follows,),
            scope=d.scope,
            replay=lambda witness: increment.replay(d.estimator, d.wanted, witness),
            attack=lambda found: d.attack_contraction(1.0),
            certify=d.certified.monotone,
        ),
        _claim(
            d,
            "increment_weighted",
            "The weighted input error max |u*(k) - u(k)| a^k falls from trial to trial for every phi > 0, in trials "
            "that stay in the scope.",
            "ours",
            lambda: increment.weighted(d.estimator, d.slopes, d.plant, d.box, d.study.horizon),
            role=Role.REPAIRED,
            lacks=lacks,
            premises=shared,
            rests_on=(p.follows,),
            scope=d.scope,
            attack=lambda found: d.attack_contraction(found.bound or 1.0),
            certify=d.certified.weighted,
        ),
    ]
