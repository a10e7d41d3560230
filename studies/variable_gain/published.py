"""What the patent says, beside what was measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, cast

from models.quantity import rebuilt
from studies.variable_gain.scores import peaks
from studies.variable_gain.study import NOISE, NOT_LEARNED
from workbench.contracts.examination import Table
from workbench.contracts.law import AnyLaw
from workbench.controllers.fixed_gain import FixedGain
from workbench.evidence.variants import Variants


class VariableLaw(Protocol):
    """What a law with a variable gain has: its least gain, and the gain of its initial-state learning."""

    @property
    def lam_min(self) -> float:
        """The least learning gain, 1."""

    @property
    def lam0(self) -> float:
        """The gain of initial-state learning, 1."""


class FixedLaw(Protocol):
    """What a law with a fixed gain has."""

    @property
    def lam(self) -> float:
        """The learning gain, 1."""

    @property
    def lam0(self) -> float:
        """The gain of initial-state learning, 1."""


def varies(law: AnyLaw) -> bool:
    """Tell whether a law's gain is variable: then it tells it."""
    return any(signal.name == "learning_gain" for signal in law.tells)


def variable_law(evidence: Variants) -> AnyLaw:
    """Return the study's first law with a variable gain."""
    found = [law for law in evidence.study.controllers.values() if varies(law)]
    if not found:
        raise ValueError("the study has no law with a variable gain")
    return found[0]


def noisy(evidence: Variants) -> dict[str, float]:
    """Return the largest speed error of the last trial under noise: variable, smoothed, fixed at lam_min and at 1."""
    law = variable_law(evidence)
    gain = cast(VariableLaw, law)
    laws: dict[str, AnyLaw] = {
        "variable": law,
        "smoothed": rebuilt(law, {"smoothing_s": 1.0}),
        "fixed-lam_min": FixedGain(lam=gain.lam_min, lam0=gain.lam0),
        "fixed-1": FixedGain(lam=1.0, lam0=gain.lam0),
    }
    data = evidence.variant(case=NOISE, laws=tuple(laws.items())).data
    return {name: float(peaks(data, name, "speed")[-1]) for name in laws}


def tables(evidence: Variants) -> Sequence[Table]:
    """Return what the patent says beside what was found."""
    scores = evidence.campaign.scores()
    first = next(iter(scores))
    own = scores[first]
    without = evidence.variant("noise.sigma=0", case=NOT_LEARNED).scores()[first]
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
