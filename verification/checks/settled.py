"""Premises that the study's own settings meet or fail: no noise, nothing in between, every trial alike."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from verification.certificates.numbers import Facts, Relation, numbers
from verification.checks import premises
from workbench.contracts.certificate import Certificate
from workbench.contracts.claim import Claim
from workbench.contracts.finding import Finding, Grounds
from workbench.contracts.study import Study

Why = Callable[[], str | None]
"""Why a premise is not met, in one sentence, or None."""


def settled(
    name: str,
    statement: str,
    source: str,
    why: Why,
    *,
    facts: Callable[[], Facts],
    holds: Sequence[Relation] = (),
    controller: str | None = None,
    shown: Mapping[str, object] | None = None,
) -> Claim:
    """Return a premise as a claim: met where ``why`` finds no reason against it in the settings.

    ``facts`` gives the settings that it is about, and ``holds`` the relations between them that say so; by default
    each of them is 0.
    """

    def check() -> Finding:
        reason = why()
        return Finding(
            grounds=Grounds.SETTINGS,
            holds=reason is None,
            method=reason or "the study's settings, as they stand",
            witness=None if reason is None else {"because": reason, **(shown or {})},
        )

    def certify(found: Finding, premises: Mapping[str, Certificate]) -> Certificate:
        given = facts()
        return numbers(statement, given, *(holds or [("=", fact, 0) for fact in given]))

    return Claim(name=name, statement=statement, source=source, check=check, controller=controller, certify=certify)


def nothing_between(study: Study, source: str) -> Claim:
    """Return the premise that commands act as they are, at once and without limits."""
    return settled(
        f"{study.name}.premise.no_actuator",
        "Commands act on the plant as they are: no lag, dead time or limit lies between.",
        source,
        partial(premises.nothing_between, study),
        facts=partial(premises.between, study),
    )


def no_noise(study: Study, source: str, output: str | None = None) -> Claim:
    """Return the premise that an output, or every one, is measured without noise."""
    names = [signal.name for signal in study.plant.outputs]
    rows = range(len(names)) if output is None else [names.index(output)]

    def why() -> str | None:
        bound = study.scenario.noise.bound(study.plant)
        noisy = [row for row in rows if bound[row] > 0]
        if not noisy:
            return None
        size = "without a bound" if np.isinf(bound[noisy]).any() else f"of up to {bound[noisy].max():g}"
        return f"noise {size} is added to the measured {' and '.join(names[row] for row in noisy)}"

    what = "Outputs are" if output is None else f"The {output} is"
    return settled(
        f"{study.name}.premise.no_noise{'' if output is None else f'.{output}'}",
        f"{what} measured without noise.",
        source,
        why,
        facts=lambda: {
            f"bound of the noise of {names[row]}": (
                float(study.scenario.noise.bound(study.plant)[row]),
                study.plant.outputs[row].unit,
            )
            for row in rows
        },
    )


def same_disturbance(study: Study, source: str) -> Claim:
    """Return the premise that what disturbs the plant is the same in every trial."""

    def why() -> str | None:
        if not study.plant.disturbances or study.scenario.disturbance.repeats:
            return None
        return "the disturbance is drawn anew for every trial"

    return settled(
        f"{study.name}.premise.same_disturbance",
        "What disturbs the plant is the same in every trial.",
        source,
        why,
        facts=lambda: {"disturbances that differ between trials": (premises.moving_disturbances(study), "")},
    )


def same_plant(study: Study, source: str) -> Claim:
    """Return the premise that the plant is the same in every trial."""
    return settled(
        f"{study.name}.premise.same_plant",
        "The plant is the same in every trial.",
        source,
        partial(premises.same_plant, study),
        facts=lambda: {
            "quantities of the plant that change between trials": (len(premises.moving(study)), ""),
            **premises.factors(study),
        },
        holds=[
            ("=", "quantities of the plant that change between trials", 0),
            *(("=", f"least true {name}", f"largest true {name}") for name in study.scenario.truth),
        ],
    )


def same_start(study: Study, source: str) -> Claim:
    """Return the premise that every trial would begin in the same state if nothing were learned."""

    def why() -> str | None:
        if study.continues:
            return "a trial begins where the last one ended"
        return None if study.scenario.initial.repeats else "where trials begin is drawn anew for every trial"

    return settled(
        f"{study.name}.premise.same_start",
        "Without learning every trial would begin in the same state.",
        source,
        why,
        facts=lambda: {
            "trials go on where the last one ended": (int(study.continues), ""),
            "starts are drawn anew": (int(not study.scenario.initial.repeats), ""),
        },
    )


def whole_trials(study: Study, source: str) -> Claim:
    """Return the premise that no trial ends early."""

    def why() -> str | None:
        early = study.scenario.trial_length.least(study.horizon) < study.horizon
        return "trials may end early" if early else None

    return settled(
        f"{study.name}.premise.whole_trials",
        "Every trial lasts to its end.",
        source,
        why,
        facts=lambda: {
            "samples of a trial": (study.horizon, ""),
            "least length": (int(study.scenario.trial_length.least(study.horizon)), ""),
        },
        holds=[("=", "least length", "samples of a trial")],
    )
