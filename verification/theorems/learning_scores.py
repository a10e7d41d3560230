"""Numbers of learning laws that stand in ``scores.json``: the three PPDs, and how far the estimate is off."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from verification.checks import assumptions, convergence
from verification.theorems.dossier import Dossier
from workbench.contracts.number import finite
from workbench.trials.campaign import Campaign


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
