"""The claims of learning laws in general: what the proofs of model-free adaptive ILC need, on any plant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np

from verification.checks import assumptions, convergence, increment
from verification.checks.domain import domain
from verification.enclosure.box import Box
from verification.theorems import conclusion
from workbench.contracts.examination import Examination, Figure
from workbench.contracts.number import finite
from workbench.contracts.verdict import Claim
from workbench.evidence import figures as plots_ppd
from workbench.evidence import sweeps
from workbench.evidence.ppd import Evidence, evidence, quantiles
from workbench.evidence.trajectory import rollout, trials_done
from workbench.trials.campaign import Campaign

PAPER = "Jiao & Hou 2025"
SHOWN = (10, 50, 100)  # trials drawn along k


class Dossier:
    """Everything that several checks need about one controller of a campaign, each computed once."""

    def __init__(self, campaign: Campaign, controller: str) -> None:
        self.campaign, self.controller = campaign, controller
        self.study, self.plant = campaign.study, campaign.study.plant
        self.law = campaign.study.controllers[controller]

    @cached_property
    def evidence(self) -> Evidence:
        """The three PPD quantities."""
        return evidence(self.campaign, self.controller)

    @cached_property
    def box(self) -> Box:
        """The box that proofs are stated for."""
        drawn = [one.w for one in self.study.inputs()] if self.plant.disturbances else []
        return domain(self.plant, self.evidence.trajectories, np.hstack(drawn) if drawn else None)

    @cached_property
    def error_map(self) -> convergence.Monotone | str:
        """I - G L at the last trial, or why there is none."""
        return convergence.error_map(self.campaign, self.evidence)

    @cached_property
    def adaptation(self) -> convergence.Adaptation:
        """What the estimator did."""
        return convergence.adaptation(self.evidence)

    @cached_property
    def mse(self) -> Any:
        """Mean square error of the trials that were run."""
        values = self.campaign.data["mse"].sel(controller=self.controller).values
        return values[: trials_done(self.campaign, self.controller)]

    @property
    def mse_unit(self) -> str:
        """The unit of the mean square error."""
        return str(self.campaign.data["mse"].attrs["units"])

    @cached_property
    def lambda_sweep(self) -> sweeps.Sweep:
        """The law run with other values of lambda."""
        return sweeps.sweep(self.campaign, self.controller, "lam", sweeps.around(self.law.lam))

    def grid(self, full: bool) -> sweeps.Grid:
        """The law run over lambda and force unit, coarsely, or finely where ``full``."""
        lam = sweeps.around(self.law.lam, 4.0, 25 if full else 9)
        unit = sweeps.around(self.law.force_unit, 2.0, 17 if full else 5)
        return sweeps.grid(self.campaign, self.controller, lam, unit)

    @cached_property
    def predicted_mse(self) -> Any:
        """The MSE by trial that the frozen map predicts, empty where there is no map."""
        found = self.error_map
        if isinstance(found, str):
            return np.zeros(0)
        taken, degree = self.evidence.trajectories, self.evidence.degree
        reference = self.study.reference_samples[0]
        _, y = rollout(self.plant, taken.x[0, :, 0], np.nan_to_num(taken.u[0]))
        signal = (reference - y)[degree:]
        if self.evidence.increment:
            signal = np.diff(reference - y)[degree - 1 :]
        lengths = np.minimum(taken.lengths - degree + 1, signal.size)
        return convergence.predicted_mse(found, signal, lengths, self.evidence.increment)

    @cached_property
    def reach(self) -> Any:
        """Probability that a trial reaches k + d, by row of the lifted plant."""
        return self.study.trial_length.reach_probability(self.study.horizon)[self.evidence.degree :]


def examine(campaign: Campaign, *, full: bool = False) -> Examination:
    """Return the examination of every learning law of a campaign; ``full`` adds the sweep over the force unit."""
    files = dossiers(campaign)
    claims = [claim for dossier in files for claim in claims_of(dossier)]
    return Examination(
        claims=claims,
        conclude=partial(conclusion.paragraphs, files),
        figures=partial(figures, files, full),
        tables=partial(conclusion.boxes, files),
        scores=partial(scores, campaign, files),
    )


def dossiers(campaign: Campaign) -> list[Dossier]:
    """Return a dossier for every controller that learns and ran at least two trials."""
    names = [str(name) for name in campaign.data["controller"].values]
    learners = [name for name in names if campaign.study.controllers[name].learns_on is not None]
    return [Dossier(campaign, name) for name in learners if trials_done(campaign, name) >= 2]


def claims_of(d: Dossier) -> list[Claim]:
    """Return the claims on one controller, in the order of the paper."""
    study = d.study.name

    def claim(name: str, statement: str, source: str, check: Any) -> Claim:
        return Claim(name=f"{study}.{name}", statement=statement, source=source, check=check, controller=d.controller)

    plant = d.plant
    lengths = d.campaign.data["trial_length"].values
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
            lambda: assumptions.trial_lengths(d.study, lengths),
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
                "lambda_min_partial": convergence.lambda_min(d.law, largest),
                "lambda_min_realised": convergence.lambda_min(d.law, float(np.abs(ratio).max()))
                if ratio.size
                else None,
            }
        result[d.controller].update({key: finite(value) for key, value in metrics.items()})
    return result


def figures(files: Sequence[Dossier], full: bool) -> Mapping[str, Figure]:
    """Return the figures of every learning law; ``full`` adds the sweep over the force unit."""
    found: dict[str, Figure] = {}
    for d in files:
        name = d.controller
        e = d.evidence
        found[f"ppd_sign_{name}"] = Figure(
            caption=f"{name}: realised ratio of output to input differences over the partial derivative, by trial and "
            "sample. Brown is not positive: there A4 as printed fails. White beyond a trial's end: not reached.",
            draw=partial(plots_ppd.sign_map, e),
        )
        found[f"ppd_histogram_{name}"] = Figure(
            caption=f"{name}: how often the realised ratio takes which multiple of the partial derivative. If A2 and "
            "A4 held, one narrow peak would stand at 1; multiples beyond the axis are counted at its ends.",
            draw=partial(plots_ppd.ratio_histogram, e),
        )
        found[f"row_sums_{name}"] = Figure(
            caption=f"{name}: what all earlier inputs together can do to the learned signal at a sample (row sum off "
            "the diagonal) beside what its own input does. The sup norm contracts only where the diagonal is larger.",
            draw=partial(plots_ppd.row_sums, name, *assumptions.lifted_along(d.plant, e).row_sums(), unit=e.unit),
        )
        if d.predicted_mse.size:
            found[f"predicted_{name}"] = Figure(
                caption=f"{name}: MSE by trial, observed and as the map I - G L predicts it, frozen at the last trial "
                "and run from the first trial's error with the recorded trial lengths.",
                draw=partial(plots_ppd.predicted_against_observed, name, d.predicted_mse, d.mse, unit=d.mse_unit),
            )
        if d.law.estimator is not None:
            found |= _adaptive_figures(d, full)
    return found


def _adaptive_figures(d: Dossier, full: bool) -> dict[str, Figure]:
    name, e = d.controller, d.evidence
    error = e.relative_error()
    share = np.where(np.isfinite(e.du), d.adaptation.share, np.nan)
    fired = np.where(np.isfinite(e.du), d.adaptation.reset_small | d.adaptation.reset_idle, np.nan)
    fired[0] = 0
    biggest = float(np.nanmax(np.abs(e.partial)))
    realised = float(np.nanmax(np.abs(e.ratio)))
    lines = {
        "(rho b)^2/16, b partial": convergence.lambda_min(d.law, biggest, one_sided=False),
        "(rho b)^2/4, b partial": convergence.lambda_min(d.law, biggest),
        "(rho b)^2/16, b realised": convergence.lambda_min(d.law, realised, one_sided=False),
    }
    observed = sweeps.boundary(d.lambda_sweep)
    if observed is not None:
        lines["observed boundary"] = observed
    result = {
        f"ppd_along_{name}": Figure(
            caption=f"{name}: partial derivative, realised ratio and estimate along the samples of some trials. The "
            "proof identifies all three; the law only ever sees the ratio.",
            draw=partial(plots_ppd.three_along, e, [t for t in SHOWN if t <= e.ratio.shape[0]] or [e.ratio.shape[0]]),
        ),
        f"ppd_error_{name}": Figure(
            caption=f"{name}: relative error of the estimate against the partial derivative, by trial and sample (1 is "
            "100 %).",
            draw=partial(plots_ppd.error_map, e),
        ),
        f"ppd_error_by_trial_{name}": Figure(
            caption=f"{name}: the estimate's relative error by trial (above); the share by which the data of the trial "
            "could move it, and the share of samples that the reset (13) put back to phi(k,1) (below).",
            draw=partial(
                plots_ppd.error_by_trial, name, quantiles(error, 1), quantiles(share, 1), np.nanmean(fired, axis=1)
            ),
        ),
        f"ppd_error_by_sample_{name}": Figure(
            caption=f"{name}: the estimate's relative error against the partial derivative by sample, over all trials.",
            draw=partial(plots_ppd.error_by_sample, name, quantiles(error, 0)),
        ),
        f"excitation_{name}": Figure(
            caption=f"{name}: the share eta du^2/(mu + du^2) by which the data of a trial can move the estimate: where "
            "it is dark the estimate learns nothing.",
            draw=partial(plots_ppd.excitation_map, name, share),
        ),
        f"contraction_{name}": Figure(
            caption=f"{name}: the factor 1 - rho phi_c phi/(lambda + phi^2) by which Theorem 1 has the error shrink, "
            "by trial and sample: its argument needs every one inside (-1, 1).",
            draw=partial(plots_ppd.contraction_map, name, d.adaptation.factor),
        ),
        f"lambda_{name}": Figure(
            caption=f"{name}: last and largest MSE at other values of lambda; the boundaries that theory "
            "predicts from the partial derivative and the realised ratios, the observed one, and the lambda used.",
            draw=partial(
                plots_ppd.lambda_sweep,
                name,
                d.lambda_sweep,
                lines,
                d.law.lam,
                units=(convergence.lambda_unit(e), d.mse_unit),
            ),
        ),
    }
    found = d.grid(full)
    b = biggest * found.force_unit
    bounds = {
        "(rho b)^2/16, b partial": (d.law.rho * b) ** 2 / 16,
        "(rho b)^2/4, b partial": (d.law.rho * b) ** 2 / 4,
    }
    result[f"sweep_{name}"] = Figure(
        caption=f"{name}: last MSE over lambda and the force unit, with the boundaries that theory predicts from the "
        "partial derivative; crosses mark where the law diverges, or learns so little that it ends above trial 1.",
        draw=partial(
            plots_ppd.sweep_map, name, found, bounds, (d.law.force_unit, d.law.lam), units=(*e.units, d.mse_unit)
        ),
    )
    return result
