"""What every study's run shows of its laws: whether they diverge, their error falls, their estimates are useful.

These claims are made of any study, whatever its plant and laws are. They are about recorded runs, and say so.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from models.array import Array
from verification.theorems.conditioning import conditioning
from workbench.contracts.claim import Claim, Role
from workbench.contracts.finding import Finding, Grounds, undecided
from workbench.evidence.digits import Digits
from workbench.evidence.trajectory import Lineariser, one_channel, recorded, trials_done
from workbench.evidence.trajectory import partial as slope
from workbench.trials.campaign import Campaign

LEVEL = 0.05
"""Level of the test that an error falls."""
LATE = 0.1
"""Share of the trials, at the end, whose median error is compared with the first trial's."""


def outcomes(campaign: Campaign, digits: Digits | None = None) -> Sequence[Claim]:
    """Return the claims on what the run of every controller shows; ``digits`` are those of the campaign's scores."""
    names = [str(name) for name in campaign.data["controller"].values]
    of_scores = Digits(campaign) if digits is None else digits
    return [claim for name in names for claim in (*_of(campaign, name), conditioning(of_scores, name))]


def _of(campaign: Campaign, name: str) -> list[Claim]:
    study, law = campaign.study, campaign.study.controllers[name]
    plant = study.plant_that_runs
    refused = study.refusals().get(name)
    wrong = "" if refused is None else f"a task that the law is for: {refused}"
    silent = wrong or ("" if law.learns_on is not None else "learning between trials (learns_on)")
    guess = wrong or ("" if law.estimator is not None else "an estimate of the pseudo partial derivative (estimator)")
    several = "" if one_channel(plant) is None else "one input and one output"
    return [
        Claim(
            name=f"{study.name}.does_not_diverge",
            statement="The law runs every trial of the study to its end without diverging.",
            source="ours",
            role=Role.OUTCOME,
            controller=name,
            check=lambda: does_not_diverge(campaign, name),
            lacks=wrong,
        ),
        Claim(
            name=f"{study.name}.error_falls",
            statement="The mean square error falls from the first trials to the last, beyond chance at a level of "
            f"{100 * LEVEL:g} %.",
            source="ours",
            role=Role.OUTCOME,
            controller=name,
            check=lambda: error_falls(campaign, name),
            lacks=silent or ("" if study.trials > 1 else "more than one trial (trials)"),
        ),
        Claim(
            name=f"{study.name}.estimate_useful",
            statement="In the later half of the trials the estimate is nearer to the partial derivative than its first "
            "value is, in the median.",
            source="ours",
            role=Role.OUTCOME,
            controller=name,
            check=lambda: estimate_useful(campaign, name),
            lacks=guess or several,
        ),
    ]


def _stopped(campaign: Campaign, name: str) -> str:
    data = campaign.data
    return str(data["stopped"].sel(controller=name).values) if "stopped" in data else ""


def does_not_diverge(campaign: Campaign, name: str) -> Finding:
    """Count the trials that ran; a law that fell, or was refused, is named with the reason."""
    trials, done = campaign.study.trials, trials_done(campaign, name)
    why = _stopped(campaign, name)
    diverged = float(campaign.data["diverged_at_trial"].sel(controller=name))
    missing = max(trials - done, int(np.isfinite(diverged)))
    return Finding(
        grounds=Grounds.RUN,
        tries=max(done, 1),
        margin=(1 if missing == 0 else -missing) / trials,
        unit="share of the trials",
        bound=float(done),
        bound_unit="trials",
        witness={"trials_run": done, "trials": trials, "diverged_at_trial": diverged, "why": why},
        method=f"{done} of {trials} trials ran to their end" + (f"; {why}" if missing and why else ""),
    )


def error_falls(campaign: Campaign, name: str) -> Finding:
    """Compare the mean square errors over samples that every trial reached; of several outputs the worst decides.

    Two tests, each at half the level: Kendall's rank correlation of error and trial, and how many later trials are as
    bad as the first. REFUTED where the median of the last trials is no smaller than the first trial's error, or the
    law fell.
    """
    trials, done = campaign.study.trials, trials_done(campaign, name)
    if done < trials:
        return Finding(
            grounds=Grounds.RUN,
            tries=max(done, 1),
            margin=(done - trials) / trials,
            unit="share of the trials",
            witness={"trials_run": done, "trials": trials, "why": _stopped(campaign, name)},
            method=f"the law fell: {done} of {trials} trials ran; {_stopped(campaign, name)}",
        )
    found = [_fallen(errors) for errors in _errors(campaign, name)]
    worst = min(found, key=lambda one: (one.standing.value != "REFUTED", one.margin or 0.0))
    open_ones = [one for one in found if one.reason]
    return worst if worst.fails or not open_ones else open_ones[0]


def _errors(campaign: Campaign, name: str) -> list[Array]:
    """Return the mean square error by trial over samples that every trial reached, an array an output."""
    data = campaign.data.sel(controller=name)
    error = np.asarray(data["error"].values, dtype=float)
    rows = error[:, None] if error.ndim == 2 else error  # (trials, outputs, N + 1)
    if data["error"].dims[-1] != "sample":
        rows = np.moveaxis(rows, data["error"].dims.index("sample"), -1)
    last = int(np.nanmin(data["trial_length"].values))
    return [np.mean(np.square(rows[:, i, 1 : last + 1]), axis=-1) for i in range(rows.shape[1])]


def _fallen(errors: Array) -> Finding:
    from scipy import stats  # it takes longer to load than most of what is here

    if not np.isfinite(errors).all():
        return undecided("samples are missing that every trial reached by its length")
    first, late = float(errors[0]), float(np.median(errors[-max(1, int(LATE * errors.size)) :]))
    later = errors[1:]
    worse = int((later >= first).sum())
    rank = (1 + worse) / (1 + later.size)
    trend = (
        float(stats.kendalltau(np.arange(errors.size), errors, alternative="less").pvalue) if errors.size > 2 else 1.0
    )
    chance = min(1.0, 2 * min(rank, trend if np.isfinite(trend) else 1.0))
    witness = {"first_mse": first, "last_mse": late, "later_trials_as_bad_as_the_first": worse, "p_value": chance}
    words = f"the mean square error went from {first:.4g} to {late:.4g} (median of the last trials)"
    if late < first and chance > LEVEL:
        return undecided(
            f"{words}, which chance alone explains with {100 * chance:.3g} %: run more trials", beside=witness
        )
    return Finding(
        grounds=Grounds.RUN,
        tries=int(errors.size),
        margin=1 - late / first if first else -late,
        unit="share of the first error",
        weak=first == 0,
        bound=late,
        witness=witness,
        method=f"{words}, over samples that every trial reached; {worse} of {later.size} later trials are as bad as "
        f"the first; such a fall comes by chance with at most {100 * chance:.3g} %",
    )


def estimate_useful(campaign: Campaign, name: str) -> Finding:
    """Compare the estimate's error against the exact partial derivative with that of phi(k,1) held for ever."""
    if trials_done(campaign, name) < 2:
        return undecided("fewer than two trials were run: there is no later estimate")
    taken, plant = recorded(campaign, name), campaign.study.plant_that_runs
    degree = campaign.study.relative_degree
    if degree is None:
        return undecided("the input reaches no output, so there is no derivative to compare an estimate with")
    along = Lineariser(plant, taken.u.shape[1])
    trials, half = taken.u.shape[0], taken.u.shape[0] // 2
    true = np.array([slope(along.at(taken.x[i], taken.u[i], taken.w[i]), degree) for i in range(half, trials)])
    estimate = taken.estimate[half:, : true.shape[1]]
    first, size = np.broadcast_to(taken.estimate[:1, : true.shape[1]], true.shape), np.abs(true)
    usable = np.isfinite(estimate) & np.isfinite(first) & np.isfinite(size) & (size > 0)
    if not usable.any():
        return undecided("the partial derivative is zero at every sample: no estimate can be compared with it")
    off = np.abs(estimate - true)[usable] / size[usable]
    held = np.abs(first - true)[usable] / size[usable]
    now, before = float(np.median(off)), float(np.median(held))
    return Finding(
        grounds=Grounds.RUN,
        tries=int(usable.sum()),
        margin=before - now,
        unit="relative error",
        bound=now,
        bound_unit="relative error",
        witness={"median_error": now, "median_error_of_the_first_estimate": before, "from_trial": half + 1},
        method="median relative error against the exact derivative along trials "
        f"{half + 1} to {trials}: {now:.3g}, where the first estimate held for ever has {before:.3g}",
    )
