"""What the patent says, beside what was measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, cast

from models.quantity import rebuilt
from studies.variable_gain.scores import peaks
from studies.variable_gain.study import FROM_POSITION, MISMATCH, NOISE, NOT_LEARNED, SMOOTHED
from workbench.contracts.claim import Expectations, Expected, Role
from workbench.contracts.examination import Table
from workbench.contracts.finding import Standing
from workbench.contracts.law import AnyLaw
from workbench.contracts.number import finite
from workbench.controllers.fixed_gain import FixedGain
from workbench.evidence.variants import Variants

_SAME_EVERYWHERE = "the equations of plant and law are the same in every case"

EXPECTED: Expectations = {
    "spectral_radius_printed": (
        Expected(
            standing=Standing.REFUTED,
            why="no force acts on the position directly, so I - h_x B lambda has the eigenvalue 1",
            published="below 1",
        ),
    ),
    "relative_degree": (
        Expected(standing=Standing.REFUTED, why="the position answers a force after two differentiations"),
    ),
    "relative_degree_speed": (Expected(standing=Standing.PROVED, why="dv/dt holds the force with a constant factor"),),
    "lipschitz_box": (Expected(standing=Standing.REFUTED, why="the tunnel's resistance begins and ends at once"),),
    "lipschitz_box_between_portals": (
        Expected(standing=Standing.PROVED, why="grades and curves enter and leave along the train, sgn(v) is smoothed"),
    ),
    "learning_law": (
        Expected(standing=Standing.PROVED, why=_SAME_EVERYWHERE),
        Expected(
            standing=Standing.REFUTED,
            why="this case makes the fixed gain learn from the position",
            role=Role.CONTROL,
            controllers=("fixed",),
            cases=(FROM_POSITION,),
        ),
    ),
    "speed_contraction": (
        Expected(standing=Standing.PROVED, why="b is 1, and the gains lie between 0.3 and 1"),
        Expected(
            standing=Standing.REFUTED,
            why="b is 2.1, and both laws reach a gain of 1",
            role=Role.CONTROL,
            cases=(MISMATCH,),
        ),
        Expected(
            standing=Standing.UNDECIDED,
            why="the law learns from the position, of which this does not speak: position_only decides",
            controllers=("fixed",),
            cases=(FROM_POSITION,),
        ),
    ),
    "initial_state_ratio": (
        Expected(standing=Standing.PROVED, why="no case adds noise to the position or moves the start by trial"),
        Expected(
            standing=Standing.REFUTED,
            why="this case switches the learning of the initial state off",
            role=Role.CONTROL,
            cases=(NOT_LEARNED,),
        ),
    ),
    "global_initial_convergence": (
        Expected(
            standing=Standing.SUPPORTED,
            why="the speed error contracts and the start is learned, from wherever",
            published="any initial state",
        ),
        Expected(
            standing=Standing.REFUTED,
            why="an initial speed error is not corrected by the force",
            role=Role.CONTROL,
            cases=(NOT_LEARNED,),
        ),
        Expected(standing=Standing.REFUTED, why="noise of 0.02 m/s is above the tolerance", cases=(NOISE, SMOOTHED)),
        Expected(standing=Standing.REFUTED, why="b lambda is above 2", role=Role.CONTROL, cases=(MISMATCH,)),
        Expected(
            standing=Standing.REFUTED,
            why="a D-type law on the position has no direct term",
            role=Role.CONTROL,
            controllers=("fixed",),
            cases=(FROM_POSITION,),
        ),
    ),
    "position_only": (
        Expected(standing=Standing.REFUTED, why="the position has no direct term: its error grows from trial to trial"),
    ),
    "initial_learning_needed": (
        Expected(standing=Standing.REFUTED, why="without it the initial speed error stays, and the position drifts"),
    ),
    "noise_claim": (
        Expected(
            standing=Standing.REFUTED,
            why="the gain is made of the noisy sample that it multiplies, so it is largest where noise is",
            published="a smaller estimation error in steady state",
        ),
    ),
    "faster_than_fixed": (
        Expected(standing=Standing.REFUTED, why="with b = 1 a gain of 1 is the fastest", published="fast convergence"),
        Expected(
            standing=Standing.UNDECIDED,
            why="neither law comes within the tolerance under this noise: a wider tolerance would decide",
            cases=(NOISE, SMOOTHED),
        ),
        Expected(
            standing=Standing.UNDECIDED,
            why="neither law converges without it: initial-state learning would decide",
            cases=(NOT_LEARNED,),
        ),
        Expected(
            standing=Standing.UNDECIDED,
            why="neither law converges where b lambda is above 2: a smaller gain would decide",
            cases=(MISMATCH,),
        ),
    ),
    "mismatch_limit": (Expected(standing=Standing.REFUTED, why="b lambda is 2.1, above the bound of 2"),),
    "does_not_diverge": (
        Expected(standing=Standing.SUPPORTED, why="the gains suit the train"),
        Expected(
            standing=Standing.REFUTED,
            why="a fixed gain of 1 is too large for it",
            controllers=("fixed",),
            cases=(MISMATCH, FROM_POSITION),
        ),
    ),
    "conditioning": (
        Expected(standing=Standing.SUPPORTED, why="what is off is multiplied by some thousands at most"),
        Expected(
            standing=Standing.REFUTED,
            why="the speed is learned to the last bit: what is left of its error, 1e-23, is rounding",
            controllers=("fixed",),
            cases=("default",),
        ),
        Expected(
            standing=Standing.REFUTED,
            why="with 2.1 times the gain a part of the error grows from trial to trial, and what is off with it",
            controllers=("variable",),
            cases=(MISMATCH,),
        ),
    ),
    "error_falls": (
        Expected(standing=Standing.SUPPORTED, why="errors fall by 1 - b lambda a trial"),
        Expected(
            standing=Standing.UNDECIDED,
            why="the start is not learned, so the error falls once and then stands still: a longer run would decide",
            cases=(NOT_LEARNED,),
        ),
        Expected(
            standing=Standing.REFUTED,
            why="a fixed gain of 1 is too large for it",
            controllers=("fixed",),
            cases=(MISMATCH, FROM_POSITION),
        ),
    ),
}
"""How the claims stand in the cases as shipped."""


class VariableLaw(Protocol):
    """What a law with a variable gain has: its least gain, and the gain of its initial-state learning."""

    @property
    def lam_min(self) -> float:
        """The least learning gain, 1."""

    @property
    def lam0(self) -> float:
        """The gain of initial-state learning, 1."""

    @property
    def initial_learning(self) -> bool:
        """Whether the initial state is learned."""


def varies(law: AnyLaw) -> bool:
    """Tell whether a law's gain is variable: then it tells it."""
    return any(signal.name == "learning_gain" for signal in law.tells)


def variable_law(evidence: Variants) -> AnyLaw:
    """Return the study's first law with a variable gain."""
    found = [law for law in evidence.study.controllers.values() if varies(law)]
    if not found:
        raise ValueError("the study has no law with a variable gain")
    return found[0]


def compared(law: VariableLaw, lam: float) -> FixedGain:
    """Return the fixed gain that a variable one is compared with: the initial state is learned alike."""
    return FixedGain(lam=lam, lam0=law.lam0, initial_learning=law.initial_learning)


def noisy(evidence: Variants) -> dict[str, float | None]:
    """Return the largest speed error of the last trial under noise: variable, smoothed, fixed at lam_min and at 1.

    None for a law that was stopped before.
    """
    law = variable_law(evidence)
    gain = cast(VariableLaw, law)
    laws: dict[str, AnyLaw] = {
        "variable": law,
        "smoothed": rebuilt(law, {"smoothing_s": 1.0}),
        "fixed-lam_min": compared(gain, gain.lam_min),
        "fixed-1": compared(gain, 1.0),
    }
    data = evidence.variant(case=NOISE, laws=tuple(laws.items())).data
    return {name: finite(peaks(data, name, "speed")[-1]) for name in laws}


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
            "; ".join(f"{name}: {shown(value, 'm/s')}" for name, value in last.items()),
            "the gain is computed from the noisy sample that it multiplies",
        ),
    ]
    return [
        Table(title="What the patent says, and what was found", header=("claim", "measured", "why"), rows=rows),
    ]
