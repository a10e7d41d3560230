"""What safe learning comes to in the plain words of a report, and the bands that no trial leaves as a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import SupportsFloat

import numpy as np

from models.array import Array
from models.plant import Signal
from verification.theorems.dossier import Dossier
from verification.theorems.funnel import bands, ends, words_of_scope
from workbench.contracts.examination import Table
from workbench.contracts.finding import Standing
from workbench.contracts.number import after_number
from workbench.contracts.verdict import Verdict

READ_OFF = ("increment_funnel", "increment_limit", "learning_curve")
"""Claims that speak of every trial, and not of boxes of recorded ones."""


def paragraphs(files: Sequence[Dossier], verdicts: Sequence[Verdict]) -> Sequence[str]:
    """Return what is known of all trials of each controller whose funnel was claimed, a paragraph each."""
    own = by_controller(files, verdicts)
    return [said for d in files if (said := " ".join(_sentences(d, own[d.controller])))]


def by_controller(files: Sequence[Dossier], verdicts: Sequence[Verdict]) -> Mapping[str, Mapping[str, Verdict]]:
    """Return the verdicts on each controller by the claim's name without its study's."""
    return {
        d.controller: {v.claim.split(".", 1)[1]: v for v in verdicts if v.controller == d.controller} for d in files
    }


def of_every_trial(own: Mapping[str, Verdict]) -> Sequence[str]:
    """Return which claims on a controller are PROVED of every trial, in a box or not."""
    return [name for name in READ_OFF if name in own and own[name].standing is Standing.PROVED]


def beyond_the_box(d: Dossier) -> str:
    """Say where the bands of a controller reach beyond the box of its other proofs, or that they do not."""
    shown = [
        f"{signal.name} {ends(float(band[:, 0].min()), float(band[:, 1].max()), signal.unit)}"
        for signal, band in bands(d)
        if (inside := _in_the_box(d, signal.name, band)) is not None and not inside
    ]
    if not shown:
        return f"no later trial of {d.controller} leaves its box, as its bands lie inside"
    return f"the bands of {d.controller} reach beyond its box ({', '.join(shown)}), so a later trial may leave that"


def table(files: Sequence[Dossier]) -> Sequence[Table]:
    """Return the bands of controllers whose funnel holds every trial (``covered``): a table a scope, a row a signal."""
    rows: dict[str, list[Sequence[str]]] = {}
    for d in files:
        rows.setdefault(words_of_scope(d), []).extend(_row(d.controller, signal, band) for signal, band in bands(d))
    header = ["controller", "signal", "unit", "least, at sample", "largest, at sample", "widest, at sample"]
    title = "Bands that no trial leaves, whatever the trial lengths (increment_funnel)"
    return [
        Table(title=f"{title}, for {scope}" if scope else title, header=header, rows=found)
        for scope, found in rows.items()
    ]


def _row(controller: str, signal: Signal, band: Array) -> Sequence[str]:
    width = band[:, 1] - band[:, 0]
    low, high, wide = int(np.argmin(band[:, 0])), int(np.argmax(band[:, 1])), int(np.argmax(width))
    places = [(band[low, 0], low), (band[high, 1], high), (width[wide], wide)]
    return [controller, signal.name, signal.unit, *(f"{value:.5g} at {k}" for value, k in places)]


def _in_the_box(d: Dossier, name: str, band: Array) -> bool | None:
    """Tell whether a band lies in the box of a controller; None for a signal that has no place there."""
    for key, named in (("x", d.plant.states), ("u", d.plant.inputs)):
        for i, signal in enumerate(named):
            if signal.name == name:
                low, high = (float(end.ravel()[i]) for end in d.box[key])
                return bool(low <= band[:, 0].min() and band[:, 1].max() <= high)
    return None


def _sentences(d: Dossier, own: Mapping[str, Verdict]) -> list[str]:
    made = own.get("increment_funnel")
    if made is None:
        return []
    if made.standing is not Standing.PROVED:
        return [
            f"Of {d.controller} no band is known that every trial stays in (increment_funnel is {made.standing}): "
            f"{made.method}."
        ]
    scope = words_of_scope(d)
    kept = [
        f"{signal.name} {ends(float(band[:, 0].min()), float(band[:, 1].max()), signal.unit)}"
        for signal, band in bands(d)
    ]
    text = [
        f"No trial of {d.controller} ever leaves the bands below{f' (for {scope})' if scope else ''}, whatever the "
        f"trial lengths and whatever the law estimates: {', '.join(kept)} over a whole trial (increment_funnel)."
    ]
    return [*text, *_curve(d, own), *_limit(own)]


def _curve(d: Dossier, own: Mapping[str, Verdict]) -> list[str]:
    found, unit = own.get("learning_curve"), after_number(d.mse_unit.replace("^2", "²"))
    if found is None:
        return []
    told = found.witness or {}
    bounds, last, final = told.get("bounds"), told.get("last_sample"), told.get("final_bound")
    if not isinstance(bounds, Sequence):
        return [f"How its error falls from trial to trial was not bounded: {found.method}."]
    over = f"over samples 1 to {last}, which every trial reaches"
    goes = f", and below {float(final):.3g}{unit} as trials go on" if isinstance(final, SupportsFloat) else ""
    if found.standing is Standing.PROVED:
        return [
            f"Its mean square error {over}, is below {float(bounds[0]):.4g}{unit} in the first trial, below "
            f"{float(bounds[-1]):.3g}{unit} in trial {d.study.trials}{goes} (learning_curve)."
        ]
    return [
        f"That its error falls is not shown (learning_curve is {found.standing}): {over}, its mean square error is "
        f"below {float(bounds[-1]):.4g}{unit} in trial {d.study.trials}, and in the first below "
        f"{float(bounds[0]):.4g}{unit}."
    ]


def _limit(own: Mapping[str, Verdict]) -> list[str]:
    if "increment_limit" not in own or own["increment_limit"].standing is not Standing.PROVED:
        return []
    return ["As trials go on its inputs go to those that give the reference's increments (increment_limit)."]
