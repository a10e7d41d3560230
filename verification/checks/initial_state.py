"""Initial-state learning: from where a study's laws still converge, and how initial errors change along a record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from models.array import Array
from workbench.contracts.claim import Held
from workbench.contracts.finding import Finding, Grounds
from workbench.contracts.study import Study
from workbench.trials.simulation import runner_of

ROUNDING = 8 * float(np.finfo(float).eps)
"""What a recorded initial error may be off by, as a share of what it was computed from."""


def converges_from(study: Study, controller: str, starts: Array, tolerances: Sequence[float]) -> Finding:
    """Run all trials of a study from every start, shape (starts, states), and look at the last trial's errors.

    ``tolerances`` are the largest errors allowed, one an output; the start that comes nearest to them is the witness.
    """
    shares = [share_from(study, controller, start, tolerances) for start in starts]
    count, trials = len(starts), study.trials
    failed = sum(not share < 1 for share in shares)
    seldom = f": of all starts at most {100 * (1 - 0.05 ** (1 / count)):.2g} % fail, at 95 %" if not failed else ""
    method = (
        f"{trials} trials from each of {count} starts drawn from the study's seed: {failed} of {count} fail{seldom}; "
        "the tightest is the witness"
    )
    worst = int(np.argmax(shares))
    start = [float(one) for one in starts[worst]]
    if not np.isfinite(shares[worst]):
        return Finding(
            grounds=Grounds.TRIES,
            tries=count,
            holds=bool(np.isfinite(shares[worst])),
            method=f"{method}, from which the law was stopped as diverged",
            witness={"start": start},
        )
    return Finding(
        grounds=Grounds.TRIES,
        tries=count,
        method=method,
        margin=1 - shares[worst],
        unit="share of the tolerance",
        witness={"start": start, "share": shares[worst]},
    )


def share_from(study: Study, controller: str, start: Array | Sequence[float], tolerances: Sequence[float]) -> float:
    """Return the last trial's largest error from a start as a share of what is allowed, infinite if it diverged."""
    runner, r = runner_of(study, controller), study.reference_samples
    begun = np.asarray(start, dtype=float)
    inputs = [one._replace(x0=np.append(begun, one.x0[begun.size :])) for one in study.inputs()]
    *_, left = runner.trials(inputs)  # what an actuator holds begins as it does in the study
    last = np.abs(r - left.y).max(axis=1)
    return float((last / np.asarray(tolerances)).max()) if np.isfinite(last).all() else float("inf")


def converges_at(study: Study, controller: str, tolerances: Sequence[float], witness: Mapping[str, object]) -> float:
    """Return the margin at a witness, run anew from its start."""
    return 1 - share_from(study, controller, np.asarray(witness["start"], dtype=float), tolerances)


def held_against(errors: Array, sizes: Array, factor: float) -> Held:
    """Hold a factor between initial errors against those of all recorded trials, (trials,).

    ``sizes`` are the magnitudes that each was computed from, by trial: what they round to is allowed for.
    """
    done = np.isfinite(errors)
    errors, sizes = errors[done], sizes[done]
    off = np.abs(errors[1:] - factor * errors[:-1])
    room = ROUNDING * (sizes[1:] + sizes[:-1]) - off
    if not room.size:
        return Held(0, 0.0, {"trials": int(errors.size)})
    worst = int(np.argmin(room))
    scale = float(sizes[worst] + sizes[worst + 1])
    return Held(
        int(room.size),
        float(room[worst]) / scale if scale else 0.0,
        {"trial": worst + 2, "initial_error": errors[worst + 1], "of_the_trial_before": errors[worst]},
    )
