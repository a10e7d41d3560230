"""What the patent says, beside what was measured."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

from studies.variable_gain.scores import peaks
from workbench.contracts.examination import Table
from workbench.controllers.fixed_gain import FixedGain
from workbench.evidence.variants import Variants


def variable_law(evidence: Variants) -> Any:
    """Return the study's first law with a variable gain."""
    found = [law for law in evidence.study.controllers.values() if hasattr(law, "lam_min")]
    if not found:
        raise ValueError("the study has no law with a variable gain")
    return found[0]


def noisy(evidence: Variants) -> dict[str, float]:
    """Return the largest speed error of the last trial under noise: variable, smoothed, fixed at lam_min and at 1."""
    law = variable_law(evidence)
    laws = {
        "variable": law,
        "smoothed": dataclasses.replace(law, smoothing_s=1.0),
        "fixed-lam_min": FixedGain(lam=law.lam_min, lam0=law.lam0),
        "fixed-1": FixedGain(lam=1.0, lam0=law.lam0),
    }
    data = evidence.variant("noise.speed_sigma=0.02", laws=tuple(laws.items())).data
    return {name: float(peaks(data, name, "error_speed")[-1]) for name in laws}


def tables(evidence: Variants) -> Sequence[Table]:
    """Return what the patent says beside what was found."""
    scores = evidence.campaign.scores()
    first = next(iter(scores))
    own = scores[first]
    without = evidence.variant("initial_learning=false", "noise.speed_sigma=0").scores()[first]
    last = noisy(evidence)

    def shown(value: float | None, unit: str) -> str:
        return "-" if value is None else f"{value:.3g} {unit}"

    rows = [
        (
            "converges from any initial state",
            f"{shown(own['max_position_error_last'], 'm')}, {shown(own['max_speed_error_last'], 'm/s')} "
            f"after {evidence.study.trials} trials ({first})",
            "true because the initial state is learned as well; the printed condition does not show it",
        ),
        (
            "spectral radius of I - h_x lambda below 1",
            "exactly 1",
            "position has no direct input; the speed alone contracts",
        ),
        (
            "needs initial-state learning",
            f"{shown(without['max_position_error_last'], 'm')}, "
            f"{shown(without['max_speed_error_last'], 'm/s')} without",
            "the initial speed error is never corrected by the force",
        ),
        (
            "smaller estimation error in steady state",
            "; ".join(f"{name}: {value:.3g} m/s" for name, value in last.items()),
            "the gain is computed from the noisy sample that it multiplies",
        ),
    ]
    return [
        Table(title="What the patent says, and what was found", header=("claim", "measured", "why"), rows=rows),
    ]
