"""Figures of a report on learning laws: what was computed, and the functions that draw it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from verification.checks import assumptions, convergence
from verification.checks.funnel import Open
from verification.theorems.dossier import Dossier
from verification.theorems.funnel import bands, words_of_scope
from workbench.contracts.examination import Figure
from workbench.evidence import bands as plots_bands
from workbench.evidence import figures as plots_ppd
from workbench.evidence import sweeps
from workbench.evidence.ppd import quantiles

SHOWN = (10, 50, 100)  # trials drawn along k


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
                caption=f"{name}: MSE by trial, observed and as predicted by the map between trials, "
                "frozen at the last one and run from the first trial's error with the recorded trial lengths.",
                draw=partial(plots_ppd.predicted_against_observed, name, d.predicted_mse, d.mse, unit=d.mse_unit),
            )
        if d.law.estimator is not None:
            found |= _adaptive_figures(d, full)
    return found


def funnel_figures(files: Sequence[Dossier]) -> Mapping[str, Figure]:
    """Return the figures of safe learning, of controllers whose funnel holds every trial (``covered``)."""
    found: dict[str, Figure] = {}
    for d in files:
        name, scope = d.controller, words_of_scope(d)
        found[f"funnel_{name}"] = Figure(
            caption=f"{name}: bands that every trial stays in, whatever the trial lengths and whatever the law "
            f"estimates{f' (for {scope})' if scope else ''}, and recorded trials in them. A band that is thin for many "
            "samples is drawn again, close up.",
            draw=partial(plots_bands.bands, f"{name}: what no trial leaves", _panels(d)),
        )
        curve = d.funnels.curve
        if not isinstance(curve, Open):
            errors = np.square(d.study.reference_samples[0] - d.funnels.taken.y)[:, 1 : curve.last + 1].mean(axis=1)
            found[f"learning_curve_{name}"] = Figure(
                caption=f"{name}: the bound of the mean square error over samples 1 to {curve.last}, which every trial "
                "reaches, over the recorded error computed likewise.",
                draw=partial(
                    plots_bands.learning_curve,
                    f"{name}: the error of every trial",
                    curve.common,
                    errors,
                    final=curve.final,
                    unit=d.mse_unit,
                ),
            )
    return found


def _panels(d: Dossier) -> list[plots_bands.Panel]:
    """Return the bands of states, output and input with what was recorded of each."""
    taken, states = d.funnels.taken, [signal.name for signal in d.plant.states]
    output = d.plant.outputs[0].name
    reached = np.arange(taken.u.shape[1])[None, :] < taken.lengths[:, None]
    panels = []
    for signal, ends in bands(d):
        if signal.name in states:
            recorded = taken.x[:, states.index(signal.name)]
        else:
            recorded = taken.y if signal.name == output else np.where(reached, taken.u, np.nan)
        wanted = d.study.reference_samples[0] if signal.name == output else None
        panels.append(plots_bands.Panel(signal.name, signal.unit, ends[:, 0], ends[:, 1], recorded, wanted))
    return panels


def _adaptive_figures(d: Dossier, full: bool) -> dict[str, Figure]:
    name, e = d.controller, d.evidence
    error = e.relative_error()
    share = np.where(np.isfinite(e.du), d.adaptation.share, np.nan)
    fired = np.where(np.isfinite(e.du), d.adaptation.reset_small | d.adaptation.reset_idle, np.nan)
    fired[0] = 0
    biggest = float(np.nanmax(np.abs(e.partial)))
    realised = float(np.nanmax(np.abs(e.ratio)))
    lines = {
        "(rho b)^2/16, b partial": convergence.lambda_min(e.estimator, biggest, one_sided=False),
        "(rho b)^2/4, b partial": convergence.lambda_min(e.estimator, biggest),
        "(rho b)^2/16, b realised": convergence.lambda_min(e.estimator, realised, one_sided=False),
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
                e.estimator.lam,
                units=(convergence.lambda_unit(e), d.mse_unit),
            ),
        ),
    }
    found = d.grid(full)
    b = biggest * found.force_unit
    bounds = {
        "(rho b)^2/16, b partial": (e.estimator.rho * b) ** 2 / 16,
        "(rho b)^2/4, b partial": (e.estimator.rho * b) ** 2 / 4,
    }
    result[f"sweep_{name}"] = Figure(
        caption=f"{name}: last MSE over lambda and the force unit, with the boundaries that theory predicts from the "
        "partial derivative; crosses mark where the law diverges, or learns so little that it ends above trial 1.",
        draw=partial(
            plots_ppd.sweep_map,
            name,
            found,
            bounds,
            (e.estimator.force_unit, e.estimator.lam),
            units=(*e.units, d.mse_unit),
        ),
    )
    return result
