"""Requirements that signals stay within bounds in every trial (``verify.limits``): looked up, or read off a funnel."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from models.array import Array
from models.plant import Signal
from verification.checks.funnel import Open
from verification.theorems.dossier import Dossier, dossiers_of
from verification.theorems.funnel import bands, funnel_claim, lacks_funnel
from workbench.contracts.claim import Claim, Role
from workbench.contracts.finding import Finding, Grounds, undecided
from workbench.contracts.number import after_number
from workbench.trials.campaign import Campaign

Ends = tuple[float, float]


def limits(campaign: Campaign) -> Sequence[Claim]:
    """Return what ``verify.limits`` asks of every controller, a claim a signal."""
    study = campaign.study
    if not study.verify.limits:
        return []
    files = dossiers_of(campaign)
    return [
        _limit(d, name, (-np.inf if low is None else low, np.inf if high is None else high))
        for d in files
        for name, (low, high) in study.verify.limits.items()
    ]


def _limit(d: Dossier, name: str, ends: Ends) -> Claim:
    plant, refused = d.study.plant, d.study.refusals().get(d.controller)
    signal = next(one for one in (*plant.states, *plant.inputs, *plant.outputs) if one.name == name)
    asked = " and ".join(
        f"{word} {value:g}{after_number(signal.unit)}"
        for word, value in zip(("not below", "not above"), ends, strict=True)
        if np.isfinite(value)
    )
    without = refused or lacks_funnel(d)
    return Claim(
        name=f"{d.study.name}.limit.{name}",
        statement=f"In every trial the {name} is {asked}.",
        source="required of the study (verify.limits)",
        check=partial(_within, d, signal, ends, bool(without)),
        controller=d.controller,
        role=Role.REQUIREMENT,
        lacks="" if refused is None else f"a task that the law is for: {refused}",
        rests_on=() if without else (funnel_claim(d, ""),),
        scope=dict if without else lambda: d.funnels.scope.shown(),
    )


def _within(d: Dossier, signal: Signal, ends: Ends, no_funnel: bool) -> Finding:
    """Look whether a signal stays within bounds: in the record, and where there is a funnel in all trials."""
    low, high = ends
    seen = _recorded(d, signal.name)
    room = np.minimum(seen - low, high - seen)
    if not np.isfinite(room).any():
        return undecided("nothing was recorded of it")
    trial, k = (int(one) for one in np.unravel_index(int(np.nanargmin(room)), room.shape))
    trials = int(np.isfinite(seen).any(axis=1).sum())
    beside: dict[str, object] = {"trial": trial + 1, "sample": k, "value": float(seen[trial, k])}
    if room[trial, k] < 0 or no_funnel:
        return Finding(
            grounds=Grounds.RUN,
            tries=trials,
            margin=float(room[trial, k]),
            weak=True,
            unit=signal.unit,
            bound=float(seen[trial, k]),
            bound_unit=signal.unit,
            witness=beside,
            method=f"of {trials} recorded trials trial {trial + 1} comes nearest, with {seen[trial, k]:.5g}"
            f"{after_number(signal.unit)} at sample {k}",
        )
    found = d.funnels.found
    if isinstance(found, Open):
        return undecided(
            f"recorded trials stay within, and no band of all trials is known: {found.reason}", beside=beside
        )
    band = next(sets for one, sets in bands(d) if one.name == signal.name)
    return _read(signal, band, np.minimum(band[:, 0] - low, high - band[:, 1]), high, beside)


def _read(signal: Signal, band: Array, left: Array, high: float, beside: dict[str, object]) -> Finding:
    """Return what the band of a signal, (samples, 2), says of its bounds, with what room it leaves by sample."""
    at = int(np.argmin(left))
    told = f"{band[at, 0]:.5g} to {band[at, 1]:.5g}{after_number(signal.unit)}"
    if left[at] < 0:
        return undecided(
            f"recorded trials stay within, and the band of all trials is {told} at sample {at}: a first plan nearer to "
            "what the reference needs (workbench.safe_plan), or a narrower scope, would decide",
            beside=beside,
        )
    return Finding(
        grounds=Grounds.INDUCTION,
        margin=float(left[at]),
        weak=True,
        unit=signal.unit,
        bound=float(band[at, 1] if high - band[at, 1] == left[at] else band[at, 0]),
        bound_unit=signal.unit,
        witness={"sample": at, "low": float(band[at, 0]), "high": float(band[at, 1])},
        method=f"read off the funnel: at sample {at}, where it comes nearest, {signal.name} is {told} in all trials",
    )


def _recorded(d: Dossier, name: str) -> Array:
    """Return what was recorded of a signal, (trials, samples), NaN where no trial was."""
    data, plant = d.campaign.data.sel(controller=d.controller), d.study.plant
    if name in [signal.name for signal in plant.states]:
        found = data[f"state_{name}"]
    elif name in [signal.name for signal in plant.outputs]:
        found = data["output"].sel(output_name=name) if "output_name" in data["output"].dims else data["output"]
    else:
        found = data["input"].sel(input_name=name) if "input_name" in data["input"].dims else data["input"]
        lengths = np.asarray(data["trial_length"].values, dtype=float).reshape(-1, 1)
        found = found.where(np.arange(found.sizes["sample"])[None, :] < lengths)
    return np.asarray(found.values, dtype=float)
