"""Claims of safe learning: the funnel, what is read off it, and the learning curve, for laws that learn on increments.

The theorem stands in :mod:`verification.checks.funnel`. What it asks of study and law is a premise each.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from models.array import Array
from models.plant import Signal
from verification.checks.funnel import WIDEST, Open, scale_of
from verification.checks.funnel_curve import falls
from verification.checks.settled import settled
from verification.theorems import limit
from verification.theorems.dossier import Dossier
from workbench.contracts.claim import Claim, Role
from workbench.contracts.finding import Finding, Grounds, Standing, undecided
from workbench.contracts.number import after_number

OURS = "ours"
GAIN = "a learning gain between declared ends (learning_gain)"
INCREMENT = "learning on the output's increments (learns_on)"


def claims_of(d: Dossier) -> list[Claim]:
    """Return what is claimed of the trials of one controller, whatever their lengths and whatever it estimates."""
    lacks = lacks_funnel(d)
    made = funnel_claim(d, lacks)
    slopes = partial(_slopes, d)
    return [
        made,
        limit.increment_limit(d, made, slopes, lambda: d.funnels.box()),
        _curve(d, lacks, made),
    ]


def lacks_funnel(d: Dossier) -> str:
    """Return the declared property without which there is no funnel to speak of, or an empty text."""
    if d.lacks:
        return d.lacks
    if d.law.learns_on != "increment":
        return INCREMENT
    return "" if d.law.learning_gain is not None else GAIN


def _slopes(d: Dossier) -> tuple[float, float]:
    return d.funnels.slopes


def funnel_claim(d: Dossier, lacks: str) -> Claim:
    """Return the claim that there is a funnel."""
    return Claim(
        name=f"{d.study.name}.increment_funnel",
        statement="In every trial each signal stays in a band that is computed beforehand, whatever the trial lengths "
        "and whatever the law estimates.",
        source=OURS,
        check=partial(_found, d),
        controller=d.controller,
        role=Role.REPAIRED,
        premises=() if lacks else _premises(d),
        lacks=lacks,
        scope=lambda: d.funnels.scope.shown(),
        attack=lambda found: d.funnels.held(found),
        certify=lambda found, premises: d.funnels.certify(found, premises),
    )


def _premises(d: Dossier) -> Sequence[Claim]:
    p = d.premises
    return (p.first_degree, p.unfiltered, p.plan_alone, p.update_form, _positive_gain(d), _starts_given(d))


def _positive_gain(d: Dossier) -> Claim:
    def why() -> str | None:
        gain = d.funnels.gain
        if gain.low >= 0 and gain.high > 0:
            return None
        return f"the theorem is for learning gains above 0, they lie between {gain.low:.4g} and {gain.high:.4g}"

    name = f"{d.study.name}.premise.positive_gain"
    return settled(
        name,
        "The learning gain is not negative.",
        OURS,
        why,
        facts=lambda: {
            "least learning gain": (d.funnels.gain.low, ""),
            "largest learning gain": (d.funnels.gain.high, ""),
        },
        holds=[(">=", "least learning gain", 0), (">", "largest learning gain", 0)],
        controller=d.controller,
    )


def _starts_given(d: Dossier) -> Claim:
    def why() -> str | None:
        return "the law itself moves the state in which a trial begins" if d.law.places else None

    name = f"{d.study.name}.premise.starts_given"
    return settled(
        name,
        "The law does not move the state in which a trial begins.",
        OURS,
        why,
        facts=lambda: {"the law places where trials begin": (int(d.law.places), "")},
        controller=d.controller,
    )


def _found(d: Dossier) -> Finding:
    found = d.funnels.found
    if isinstance(found, Open):
        return undecided(found.reason, sample=found.sample if found.sample >= 0 else None)
    sets, output = found.sets, d.plant.outputs[0]
    width = sets.y[:, 1] - sets.y[:, 0]
    k = int(np.argmax(width))
    of = {signal.name: [float(ends[:, 0].min()), float(ends[:, 1].max())] for signal, ends in bands(d)}
    told = ", ".join(
        f"{signal.name} {of[signal.name][0]:.5g} to {of[signal.name][1]:.5g}{after_number(signal.unit)}"
        for signal, _ in bands(d)
    )
    if found.same:
        told += f", for each value of {', '.join(found.same)} that stays the same in all trials ({found.parts} parts)"
    if d.funnels.scope.open:
        return undecided(
            f"it is shown for the scope ({told}), and the study may leave that: {'; '.join(d.funnels.scope.open)}",
            bands=of,
        )
    return Finding(
        grounds=Grounds.INDUCTION,
        margin=min(1 - found.reach / 2, 1 - float(width[k]) / (WIDEST * scale_of(d.study))),
        unit="share of what is allowed",
        bound=float(width[k]),
        bound_unit=output.unit,
        witness={
            "bands": of,
            "widest_at_sample": k,
            "b_low": found.slopes[0],
            "b_high": found.slopes[1],
            "l_max_b": found.reach,
        },
        method=f"sets carried from sample to sample, rounded outwards: {told}; the slope of the increment by the input "
        f"is {found.slopes[0]:.4g} to {found.slopes[1]:.4g} there, l_max B = {found.reach:.4g}. The margin is the "
        f"lesser of the room of l_max B below 2 and of the widest band below {WIDEST:g} times the reference's range",
    )


def covered(d: Dossier) -> bool:
    """Tell whether bands of a controller hold every trial within the scope: there are some, and premises are met."""
    if lacks_funnel(d) or isinstance(d.funnels.found, Open):
        return False
    return all(one.check().standing is Standing.PROVED for one in _premises(d))


def ends(low: float, high: float, unit: str, digits: int = 4) -> str:
    """Return a range in words, ``-1 to 2 m``; of a number alone that, and no unit of what has none."""
    said = f"{low:.{digits}g}" + (f" to {high:.{digits}g}" if low < high else "")
    return said if unit in ("", "1") else f"{said} {unit}"


def words_of_scope(d: Dossier) -> str:
    """Return for what the bands of a controller are shown, as it stands in brackets after them, or an empty text."""
    found, scope = d.funnels.funnel, d.funnels.scope
    said = [f"{what} {ends(one.low, one.high, one.unit, digits=6)}" for what, one in scope.shown().items()]
    if found.same:
        said.append("the same in all trials: " + ", ".join(found.same))
    return "; ".join([*said, *(f"but {one}" for one in scope.open)])


def bands(d: Dossier) -> list[tuple[Signal, Array]]:
    """Return the signals of the plant with their bands, each name once."""
    sets, plant = d.funnels.funnel.sets, d.plant
    rows = [(signal, sets.x[:, i]) for i, signal in enumerate(plant.states)]
    names = {signal.name for signal, _ in rows}
    rows += [(signal, sets.y) for signal in plant.outputs if signal.name not in names]
    return [*rows, (plant.inputs[0], sets.u)]


def _curve(d: Dossier, lacks: str, made: Claim) -> Claim:
    def check() -> Finding:
        found = d.funnels.curve
        return undecided(found.reason) if isinstance(found, Open) else falls(found, d.mse_unit)

    return Claim(
        name=f"{d.study.name}.learning_curve",
        statement="The mean square error over the samples that every trial reaches stays, in every trial, below a "
        "bound that is computed beforehand and falls from the first trial to the last.",
        source=OURS,
        check=check,
        controller=d.controller,
        role=Role.REPAIRED,
        premises=() if lacks else (made,),
        lacks=lacks,
        scope=lambda: d.funnels.scope.shown(),
        attack=lambda found: d.funnels.held_curve(found),
    )
