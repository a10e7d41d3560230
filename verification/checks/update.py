"""Whether a law learns in the form that it declares: u(k) <- u(k) + l(k) e_s(k+1), with l between two ends.

It is shown from the law's own expressions, for every memory that can come and whatever trials leave, in real numbers
that doubles hold; a trial reaches every sample before its last one. Where it is not shown, trials are drawn in which
the plan moves otherwise.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.array import Array
from verification.checks.learned_gain import kinds
from verification.checks.learned_graph import NEXT, PLAN, Learned, OtherForm, first_plan, learned_graph, numbers
from workbench.contracts.claim import Held
from workbench.contracts.finding import Finding, Grounds, undecided
from workbench.contracts.law import AnyLaw, LearningGain, Task

__all__ = ["Moved", "first_plan", "held_update", "learns_as_declared", "replay"]

ROUNDED = 2.0**-44
"""What the few operations of an update round, as a share of the numbers in them."""
LOST = 1e300
"""How far a plan that is no number is counted to be from what it should be."""
DRAWS, TRIALS = 12, 4
"""Campaigns that are drawn to refute a form, and trials in each."""
UNIT = "plant input"


class Moved(NamedTuple):
    """The plans of two trials that follow each other, and what was learned from in between."""

    u: Array
    """The plan of the first, (N,), in the plant's units."""
    following: Array
    """That of the second, (N,)."""
    r: Array
    """The reference, (N + 1,)."""
    y: Array
    """What the law saw of the output, (N + 1,)."""
    length: int
    """The last sample that the first trial reached."""


def learns_as_declared(law: AnyLaw, task: Task) -> Finding:
    """The law changes the plan of a sample by l e_s(k+1), and keeps it where k + 1 was not reached."""
    law = law.ready_for(task)
    gain = law.learning_gain
    if gain is None:
        return undecided("the law declares no ends of its learning gain (learning_gain)")
    if law.filters_plan:
        return undecided("the law filters its plan as a whole, so that a sample's input is no more its own")
    try:
        learned = learned_graph(law, task)
    except OtherForm as error:
        return undecided(str(error))
    try:
        differ = kinds(learned, gain)
    except OtherForm as error:
        return _tried(learned, numbers(task.reference), gain, str(error))
    return Finding(
        grounds=Grounds.ENCLOSURE,
        holds=differ > 0,
        bound=max(abs(gain.low), abs(gain.high)),
        bound_unit="input per unit of what is learned on",
        method=f"the graph of what the law learns, at {task.samples} samples of {differ} kind(s): in "
        "normal form every product of the plan's change holds the error of what is learned on, and what stands "
        f"before it lies in [{gain.low + 0.0:.6g}, {gain.high + 0.0:.6g}]; "
        + (
            "where the trial did not reach k + 1 nothing is left of the change, and nothing missing enters it"
            if task.varying_lengths
            else "trials all reach their end"
        ),
    )


def _tried(learned: Learned, r: Array, gain: LearningGain, why: str) -> Finding:
    """Look for a trial after which a plan moves otherwise than is declared."""
    for draw in range(DRAWS):
        for trial, moved in enumerate(_drawn(learned, r, draw)):
            room = _room(moved, gain, learned.increment, kept=ROUNDED)
            k = int(room.argmin())
            if room[k] < 0:
                return Finding(
                    grounds=Grounds.TRIES,
                    tries=draw + 1,
                    margin=float(room[k]),
                    unit=UNIT,
                    method=f"{why}; after a trial that was drawn the plan of sample {k} moved otherwise",
                    witness={"draw": draw, "trial": trial + 1, **_place(moved, gain, learned.increment, k)},
                )
    return undecided(
        f"{why}; in {DRAWS} drawn campaigns of {TRIALS} trials it learned as is declared: a law of a simpler form, or "
        "wider ends of learning_gain, would decide"
    )


def replay(law: AnyLaw, task: Task, witness: Mapping[str, object]) -> float:
    """Return the room at a witness of :func:`learns_as_declared`, with its trials run once more."""
    law = law.ready_for(task)
    learned, r, gain = learned_graph(law, task), numbers(task.reference), law.learning_gain
    assert gain is not None, "a law without a gain is not refuted"
    draw, trial, sample = (int(str(witness[name])) for name in ("draw", "trial", "sample"))
    moved = list(_drawn(learned, r, draw))[trial - 1]
    return float(_room(moved, gain, learned.increment, kept=ROUNDED)[sample])


def _drawn(learned: Learned, r: Array, draw: int) -> Iterator[Moved]:
    """Run trials of a law from its first memory on, with outputs and lengths drawn from a seed."""
    rng = np.random.default_rng(draw)
    n = learned.samples
    memory: Mapping[str, Array] = learned.memory
    size = float(np.ptp(r) or np.abs(r).max() or 1.0) * 10.0 ** rng.uniform(-3, 2)
    for _ in range(TRIALS):
        length = int(rng.integers(1, n + 1)) if learned.varying_lengths else n
        y = r + size * rng.normal(size=r.shape) * rng.uniform(0, 2)
        reached = (np.arange(n + 1) <= length).astype(float)[None]
        y = np.where(reached > 0, y, np.nan)
        out = learned.function.call({**memory, "r": r, "y": y, "e": r - y, "reached": reached})
        plan, following = (np.asarray(out[name].full())[0] for name in (PLAN, NEXT))
        yield Moved(plan, following, r[0], y[0], length)
        memory = {name: np.asarray(out[f"next_{name}"].full()) for name in learned.memory}


def _room(moved: Moved, gain: LearningGain, increment: bool, *, kept: float) -> Array:
    """Return how far the plan of each sample is from moving otherwise than declared, (N,), rounding allowed for.

    ``kept`` is the share of it that a plan that must be kept may have changed by.
    """
    error = moved.r - moved.y
    scale = np.abs(moved.r) + np.abs(moved.y)
    signal, size = (np.diff(error), scale[1:] + scale[:-1]) if increment else (error[1:], scale[1:])
    reached = np.arange(1, len(moved.r)) <= moved.length
    step = moved.following - moved.u
    with np.errstate(invalid="ignore", over="ignore"):
        ends = np.sort([gain.low * signal, gain.high * signal], axis=0)
        plans = np.abs(moved.u) + np.abs(moved.following)
        spare = ROUNDED * (plans + max(abs(gain.low), abs(gain.high)) * size)
        left = np.where(step == 0, np.inf, kept * plans - np.abs(step))
        room = np.where(reached, np.minimum(step - ends[0], ends[1] - step) + spare, left)
    return np.nan_to_num(room, nan=-LOST, posinf=LOST, neginf=-LOST)


def _place(moved: Moved, gain: LearningGain, increment: bool, k: int) -> dict[str, object]:
    """Return what a plan moved by at a sample."""
    error = moved.r - moved.y
    signal = error[k + 1] - error[k] if increment else error[k + 1]
    return {
        "sample": k,
        "reached": bool(k + 1 <= moved.length),
        "moved": float(moved.following[k] - moved.u[k]),
        "error": float(signal),
        "low": gain.low,
        "high": gain.high,
    }


def held_update(law: AnyLaw, r: Array, u: Array, seen: Array, lengths: NDArray[np.int64]) -> Held:
    """Hold the form against trials that were run, rounding allowed for; what must be kept is kept bit for bit.

    ``u`` (trials, N) are the plans, ``seen`` (trials, N + 1) what the law saw of the output, ``lengths`` the last
    sample that each trial reached.
    """
    gain = law.learning_gain
    if gain is None:
        return Held(0, 0.0, {})
    increment = law.learns_on == "increment"
    worst, place = np.inf, dict[str, object]()
    for i in range(u.shape[0] - 1):
        moved = Moved(u[i], u[i + 1], r, seen[i], int(lengths[i]))
        room = _room(moved, gain, increment, kept=0.0)
        k = int(room.argmin())
        if room[k] < worst:
            worst, place = float(room[k]), {"trial": i + 1, **_place(moved, gain, increment, k)}
    return Held(max(u.shape[0] - 1, 0), worst if np.isfinite(worst) else 0.0, place)
