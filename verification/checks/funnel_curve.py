"""A proved learning curve: the funnel, once a trial.

Where the input of a sample is known to lie in U_i(k) in trial i, and the state in X_i(k), it lies in the next trial in
U_i(k) moved towards the targets t(X_i(k), k) by a share l B, with l between the ends of the learning gain where the
trial reached k + 1, and unmoved where it did not. So the first plan gives a bound of the mean square error of every
trial. Samples that every trial reaches depend on no trial length, as nothing depends on a later sample.

A bound that has come to where it ends is not worth a pass a trial. The funnel is proved of whatever first plan lies in
given sets, and nothing but the plan is handed from trial to trial; so the funnel of the sets U_i(k), one pass, holds
every trial from i on, of any length. It is taken for all of them where its bound lies no more than a share ``GAINED``
above those that passes of their own would come to: between that of trial i and that where learning ends, or, where the
gain may vanish and inputs may stay where they are, that of trial i.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.array import Array
from verification.checks.funnel import Funnel, Maker, Open, parts_of
from verification.enclosure.recursion import Carried
from workbench.contracts.claim import Range
from workbench.contracts.finding import Finding, Grounds, undecided
from workbench.contracts.number import after_number

SPARE = 1e-12
"""More than what a sum of squares rounds, as a share of it."""
GAINED = 1.5e-3
"""Share of a bound that is not worth carrying sets through every later trial for."""
PAUSE = 4
"""Trials until it is looked once more whether one funnel is as good."""
SHOWN = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)


class Curve(NamedTuple):
    """Bounds of the mean square error by trial, what doubles round included, and where learning ends."""

    common: Array
    """Over the samples 1..``last``, which every trial reaches, whatever the lengths, (trials,)."""
    own: Array
    """Over the samples of each trial of the lengths that it was made with, (trials,)."""
    last: int
    final: float | None
    """What ``common`` goes to as trials go on; None where the gain may vanish."""
    rounded: bool
    """Whether what doubles round is in it."""
    alike: int | None = None
    """The trial from which on one funnel (of each part) bounds all; None where each has a pass of its own."""


def curve(maker: Maker, found: Funnel, lengths: NDArray[np.int64], last: int) -> Curve | Open:
    """Return the learning curve for trials of given lengths, the first of which runs the first plan.

    ``last`` is the sample that every trial reaches, whatever its length. A curve of several parts of the scope is
    the largest of them at every trial.
    """
    curves: list[Curve] = []
    for values in parts_of(maker.scope.parameters, found.same):
        one = _of_part(maker, found, values, lengths, last)
        if isinstance(one, Open):
            return one
        curves.append(one)
    ends = [one.final for one in curves if one.final is not None]
    alike = [one.alike for one in curves if one.alike is not None]
    return Curve(
        common=np.max([one.common for one in curves], axis=0),
        own=np.max([one.own for one in curves], axis=0),
        last=last,
        final=max(ends) if len(ends) == len(curves) else None,
        rounded=all(one.rounded for one in curves),
        alike=max(alike) if len(alike) == len(curves) else None,
    )


def _of_part(
    maker: Maker, found: Funnel, values: Mapping[str, Range], lengths: NDArray[np.int64], last: int
) -> Curve | Open:
    carried = maker.question(values, found.sets)
    rounded = carried.jolt is not None and bool(np.isfinite(carried.jolt).all() and np.isfinite(carried.wanted).all())
    question = carried if rounded else maker.question(values)
    n, gain = maker.samples, maker.gain
    final = None
    if gain.low > 0:
        settled = maker.carry(replace(question, settled=True))
        final = None if isinstance(settled, Open) else _mean_square(maker.reference, settled, last)
    plan, common, own = question.plan, np.zeros(lengths.size), np.zeros(lengths.size)
    looked = 0
    for i, length in enumerate(lengths):
        reached = np.arange(1, n + 1) <= length
        moves = np.where(reached[:, None], [[gain.low, gain.high]], 0.0)
        one = maker.carry(replace(question, plan=plan, moves=moves))
        if isinstance(one, Open):
            return Open(reason=f"the learning curve ends at trial {i + 1}: {one.reason}", sample=one.sample)
        common[i], own[i] = (_mean_square(maker.reference, one, end) for end in (last, int(length)))
        most = (1 + GAINED) * min(common[i], common[i] if final is None else final)
        if i >= looked and common[i] <= most and (final is not None or gain.low <= 0):
            looked = i + PAUSE
            rest = maker.carry(replace(question, plan=plan))
            if not isinstance(rest, Open) and (bound := _mean_square(maker.reference, rest, last)) <= most:
                common[i + 1 :] = bound
                own[i + 1 :] = [_mean_square(maker.reference, rest, int(end)) for end in lengths[i + 1 :]]
                return Curve(common, own, last, final, rounded, i + 1)
        plan = _within(one.after, found.sets.u if not rounded else None)
    return Curve(common, own, last, final, rounded)


def _within(ends: Array, known: Array | None) -> Array:
    """Return sets cut to what holds them in every trial, where that is known."""
    if known is None:
        return ends
    return np.stack([np.maximum(ends[:, 0], known[:, 0]), np.minimum(ends[:, 1], known[:, 1])], axis=-1)


def _mean_square(reference: Array, sets: Carried, last: int) -> float:
    """Bound the mean square error over samples 1..last."""
    off = np.maximum(np.abs(reference - sets.y[:, 0]), np.abs(reference - sets.y[:, 1]))[1 : last + 1]
    return float(np.mean(np.square(off)) * (1 + SPARE))


def falls(found: Curve, unit: str) -> Finding:
    """The bound of the mean square error falls from the first trial to the last: how far, and where learning ends."""
    first, end = float(found.common[0]), float(found.common[-1])
    trials = found.common.size
    at = [i for i in SHOWN if i < trials] + [trials]
    beside: dict[str, object] = {
        "trials": at,
        "bounds": [float(found.common[i - 1]) for i in at],
        "last_sample": found.last,
        "final_bound": found.final,
    }
    of = after_number(unit)
    goes = "" if found.final is None else f"; as trials go on it goes below {found.final:.4g}{of}"
    each = f"{trials} trials, once each"
    if found.alike is not None and found.alike < trials:
        each = f"the first {found.alike} of {trials} trials, once each, and through all later ones at once"
    words = (
        f"sets carried through {each}: over samples 1 to {found.last}, which every trial reaches, "
        f"the mean square error is at most {first:.4g}{of} in the first trial and {end:.4g}{of} in trial "
        f"{trials}{goes}"
    )
    if not first > end:
        return undecided(
            f"{words}, which does not fall: a narrower scope, or a first plan nearer to the targets, would decide",
            beside=beside,
        )
    return Finding(
        grounds=Grounds.INDUCTION,
        margin=1 - end / first,
        unit="share of the first bound",
        bound=end,
        bound_unit=unit,
        witness=beside,
        method=f"{words}; the margin is the share by which the bound falls",
    )


class Below(NamedTuple):
    """Where an error comes nearest to its bound, and the room that it leaves, as a share of the bound."""

    room: float
    trial: int
    bound: float
    seen: float


def below(bounds: Array, seen: Array) -> Below | None:
    """Return where errors by trial come nearest to their bounds; None where there are none of both."""
    count = min(bounds.size, seen.size)
    if not count:
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(bounds[:count] > 0, seen[:count] / bounds[:count], np.where(seen[:count] > 0, np.inf, 0.0))
    i = int(np.argmax(share))
    return Below(float(1 - share[i]), i + 1, float(bounds[i]), float(seen[i]))
