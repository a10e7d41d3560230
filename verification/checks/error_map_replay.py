"""What a witness of the map between trials says, seen on the compiled trial: no derivative is asked for.

Two campaigns are run for two trials each, from the memory of the witness's trial, that differ by a little of the
vector that is amplified.

* Of an error (M = I): the two follow references that differ by it. A law that only plans then runs the same first
  trial twice, with errors that differ by the vector, and the second trial shows what is left of the difference. A
  law that uses the reference within the trial is given plans that bring the difference of errors about.
* Of a plan's distance to its limit: the two begin with plans that differ by the vector, and what a law learns from
  each trial is asked of its own ``learn``, with the estimate of the recorded one where it estimates.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy import linalg

from models.array import Array
from models.quantity import InvalidValue
from verification.checks.error_map import INCREMENT, PLAN
from workbench.evidence.closed_loop import LARGEST, images, product
from workbench.evidence.error_signal import Signal
from workbench.evidence.learning_step import LearningStep, Ran, learning_step, memories
from workbench.fold.fold import stream
from workbench.trials.campaign import Campaign

SMALL = 1e-4  # of the largest reference, or plan: the difference of the two campaigns


def replay_monotone(
    campaign: Campaign, controller: str, witness: Mapping[str, object], *, small: float = SMALL
) -> float:
    """Return 1 minus the amplification of a witness's vector by one learning step on the compiled trial.

    It is negative where the 2-norm grows. Raises InvalidValue for a witness without its vector, for a trial that the
    campaign does not have, and where the trial ends before the horizon.
    """
    vector = np.asarray(witness.get("vector", []), dtype=float)
    trial, first = witness.get("trial"), witness.get("first_sample")
    if not vector.size or not isinstance(trial, int) or not isinstance(first, int):
        raise InvalidValue("a witness is replayed with vector, trial and first_sample, got one without: verify again")
    ran = next((one for one in memories(campaign, controller) if one.trial == trial), None)
    if ran is None:
        raise InvalidValue(f"the witness must be of a trial of {controller}, got trial {trial}: verify this run")
    step = learning_step(campaign, controller, ran)
    if isinstance(step, str):
        raise InvalidValue(f"the witness must be of a law with a map between trials, but {step}")
    r, still = step.loop.r, np.zeros(step.learned.size)
    if witness.get("of") == PLAN:
        size = small * _largest(step.v, step.next()) / float(np.abs(vector).max())
        pair = [_ran(campaign, controller, ran, step, r, sign * size * vector) for sign in (1, -1)]
        before, after = 2 * size * vector, pair[0].v - pair[1].v
    else:
        signal = Signal(campaign.study.horizon, first, increment=witness.get("of") == INCREMENT)
        moves = signal.error(vector, np.zeros(first))[None, :]
        if step.loop.law.asks_reference:
            plan = _bringing(step, signal, vector)
            size = small * _largest(step.v, step.next()) / float(np.abs(plan).max())
            pair = [_ran(campaign, controller, ran, step, r, sign * size * plan) for sign in (1, -1)]
        else:
            size = small * _largest(r) / float(np.abs(moves).max())
            pair = [_ran(campaign, controller, ran, step, r + sign * size * moves, still) for sign in (1, -1)]
        before, after = (product(signal.of, pair[0].errors[i] - pair[1].errors[i]) for i in (0, 1))
    if not (np.isfinite(before).all() and np.isfinite(after).all()):
        raise InvalidValue(f"the witness is replayed over whole trials, and trial {trial} ends before the horizon")
    return 1 - float(np.linalg.norm(after) / np.linalg.norm(before))


class _Two(NamedTuple):
    """Two trials that follow each other: their errors, (N + 1,) each, and what the second was run with."""

    errors: tuple[Array, Array]
    v: Array


def _ran(campaign: Campaign, controller: str, ran: Ran, step: LearningStep, r: Array, move: Array) -> _Two:
    """Run a trial with a reference and with a plan that was moved, learn from it, and run the next one."""
    fold, given = campaign.runner(controller).fold, ran.given._replace(length=campaign.study.horizon)
    memory = step.learned.put(ran.memory, step.v + move)
    one, two = stream(fold, r, [given, given], memory=memory, keep_memory=True)
    v = step.learned.stacked(two.memory)
    if step.law.estimates:
        v = step.following_held(memory, one.y + given.noise)
    return _Two((r[0] - one.y[0], r[0] - two.y[0]), v)


def _bringing(step: LearningStep, signal: Signal, vector: Array) -> Array:
    """Return the change of the plan, (p,), that changes the signal's error by a vector."""
    if step.learned.size > LARGEST:
        raise InvalidValue(
            f"the law uses the reference within the trial, so its witness is replayed with at most {LARGEST} numbers "
            f"learned, got {step.learned.size}"
        )
    answers = product(signal.of, images(step.linear.apply, np.eye(step.learned.size)))
    spare = max(answers.shape) * np.finfo(float).eps
    found = np.asarray(linalg.lstsq(answers, -vector, cond=spare, lapack_driver="gelsy")[0])  # much faster than an SVD
    if np.linalg.norm(answers @ found + vector) > 1e-3:
        raise InvalidValue("no plan brings about the error of the witness, so it cannot be replayed on this law")
    return found


def _largest(*values: Array) -> float:
    """Return the largest magnitude of some arrays, 1 where all are zero."""
    return max(float(np.abs(one).max()) for one in values) or 1.0
