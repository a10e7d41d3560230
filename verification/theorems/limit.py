"""Claims of what learning comes to in the end: the conclusion of Theorem 1 as a limit, and the same for increments.

The proof stands in :mod:`verification.checks.limit`. What it asks of study, plant and law is a premise each.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import casadi as ca
import numpy as np

from models.expression import as_expression
from models.quantity import InvalidValue
from verification.certificates.numbers import numbers
from verification.checks import limit
from verification.checks.delayed import delayed_graph
from verification.checks.estimate_form import certificate, estimate_form
from verification.checks.settled import settled
from verification.enclosure.box import Box
from verification.enclosure.rounding import rounding
from verification.enclosure.tables import told
from verification.theorems.dossier import Dossier
from workbench.contracts.claim import Claim, Held, Role
from workbench.contracts.finding import Finding, Grounds, undecided
from workbench.contracts.law import LearnedSignal
from workbench.controllers.parts.rows import joined

PAPER = "Jiao & Hou 2025"
OURS = "ours"
GUESS = "an estimate of the pseudo partial derivative (estimator)"
GAIN = "a learning gain between declared ends (learning_gain)"
ON: dict[LearnedSignal, str] = {
    "output": "learning on the output (learns_on)",
    "increment": "learning on the output's increments (learns_on)",
}
Slopes = Callable[[], limit.Slope]
"""Gives b_low and b_high, or raises InvalidValue with the reason why they are not known."""


def claims_of(d: Dossier) -> list[Claim]:
    """Return what is claimed of the end of Theorem 1, and of the way there, for one controller."""
    lacks = _lacks(d, "output") or ("" if d.law.estimator is not None else GUESS)
    return [
        Claim(
            name=f"{d.study.name}.theorem1.conclusion",
            statement="The error of every sample k = 1..N goes to zero as trials go on, with probability 1.",
            source=f"{PAPER}, Theorem 1",
            check=partial(_enough, d, partial(_conclusion, d)),
            controller=d.controller,
            role=Role.PRINTED,
            premises=() if lacks or d.done < 2 else _premises_of_the_conclusion(d),
            lacks=lacks,
            attack=partial(_attack, d),
            certify=d.certified.conclusion,
        ),
        Claim(
            name=f"{d.study.name}.theorem1.transient",
            statement="In the run the mean square error over the samples that every trial reaches never rises above "
            "that of the first trial.",
            source=f"{OURS}, for {PAPER}, Theorem 1",
            check=partial(_enough, d, partial(_transient, d)),
            controller=d.controller,
            role=Role.OUTCOME,
            lacks=lacks,
        ),
    ]


def increment_limit(d: Dossier, funnel: Claim, slopes: Slopes, over: Callable[[], Box] | None = None) -> Claim:
    """Return the limit for a law that learns on the output's increment.

    ``funnel`` is the claim of a set that holds every trial and its targets, ``slopes`` gives the ends of the mean slope
    over it, ``over`` a box that holds the set, where the plant is not continuous for all states and inputs.
    """
    lacks = _lacks(d, "increment")
    return Claim(
        name=f"{d.study.name}.increment_limit",
        statement="For every k the input u(k) goes to the one that gives the reference's increment, and so does the "
        "output's increment, as trials go on, with probability 1.",
        source=OURS,
        check=partial(_enough, d, lambda: limit.increment_limit(d.study, d.law, *slopes(), fell=_fell(d))),
        controller=d.controller,
        role=Role.REPAIRED,
        premises=() if lacks or d.done < 2 else (funnel, *_shared_premises(d, over)),
        lacks=lacks,
        attack=partial(_attack, d),
        certify=d.certified.limit,
    )


def _lacks(d: Dossier, signal: LearnedSignal) -> str:
    """Return the declared property without which a limit of this kind has no meaning, or an empty text."""
    if d.lacks:
        return d.lacks
    if d.law.learns_on != signal:
        return ON[signal]
    return "" if d.law.learning_gain is not None else GAIN


def _enough(d: Dossier, check: Callable[[], Finding]) -> Finding:
    """Return what a check finds, unless too few trials were run."""
    if d.done < 2:
        why = d.stopped or "run more"
        return undecided(f"fewer than two trials were run, so there is nothing to look at: {why}")
    return check()


def _fell(d: Dossier) -> str:
    """Return where the recorded run was stopped, or an empty text."""
    if d.done >= d.study.trials:
        return ""
    return f"this run fell at trial {d.done + 1}" + (f" ({d.stopped})" if d.stopped else "")


def _conclusion(d: Dossier) -> Finding:
    errors = np.asarray(d.campaign.data["error"].sel(controller=d.controller).values[: d.done, 1], dtype=float)
    return limit.output_limit(d.study, d.law, limit.slope_everywhere(d.plant, d.study.horizon), _fell(d), errors)


def _transient(d: Dossier) -> Finding:
    last = int(d.lengths[: d.done].min())
    error = d.campaign.data["error"].sel(controller=d.controller).values[: d.done, 1 : last + 1]
    with np.errstate(over="ignore"):  # a law that fell may have left errors whose square is no double
        mse = np.mean(np.square(error.reshape(d.done, -1)), axis=1)
    return limit.transient(mse, last, d.mse_unit)


def _attack(d: Dossier, found: Finding) -> Held:
    """Hold the proof's step against every two trials that follow each other, at the first sample."""
    gain, witness = d.law.learning_gain, found.witness or {}
    low, high = (witness.get(name) for name in ("b_low", "b_high"))
    if gain is None or not isinstance(low, float) or not isinstance(high, float):
        raise InvalidValue("a limit is held against runs with the slopes that it was proved for, and they are missing")
    data = d.campaign.data.sel(controller=d.controller)
    first = slice(0, 2)
    error, output = (data[name].values[: d.done, first] for name in ("error", "output"))
    errors = error[:, 1] - error[:, 0] if d.law.learns_on == "increment" else error[:, 1]
    met = (output, error, high * data["input"].values[: d.done, :1], d.begun.x0)
    magnitude = float(max(np.nanmax(np.abs(one)) for one in met if one.size))
    return limit.held_at_first_sample(errors, gain, (low, high), magnitude, _rounds(d))


def _rounds(d: Dossier) -> float:
    """Return what the plant's equations round of the output at samples 0 and 1, whatever they compute in between."""
    inputs, begun = d.campaign.data["input"].sel(controller=d.controller).values[: d.done, 0], d.begun
    met = Box({"x": begun.x0, "u": (inputs.min(), inputs.max()), "w": begun.w[:, 0], "k": 0.0}, whole=("k",))
    after, now = d.plant.next_output_function(), d.plant.output_function()
    off = rounding(after, met), rounding(now, Box({"x": begun.x0}))
    return float(sum(one.max() for rounded in off for one in rounded.values()))


def _shared_premises(d: Dossier, over: Callable[[], Box] | None = None) -> Sequence[Claim]:
    """Return what a limit asks whatever is learned on."""
    p, name = d.premises, f"{d.study.name}.premise"
    return (
        p.first_degree,
        p.same_but_for_the_input,
        p.no_noise,
        p.nothing_between,
        p.plan_alone,
        p.unfiltered,
        p.update_form,
        Claim(
            name=f"{name}.every_sample_reached",
            statement="Trial lengths are drawn independently, and every sample is reached with a probability above 0.",
            source=OURS,
            check=partial(limit.unreached, d.study),
            controller=d.controller,
            certify=lambda found, premises: numbers(
                "Trial lengths are drawn independently, and every sample is reached with a probability above 0.",
                {
                    "least probability that a sample is reached": (found.margin or 0.0, "1"),
                    "trials end by an event of the plant": (int(bool(d.plant.ends)), ""),
                    "lengths that are given": (len(d.study.scenario.trial_length.lengths or ()), ""),
                },
                (">", "least probability that a sample is reached", 0),
                ("=", "trials end by an event of the plant", 0),
                ("=", "lengths that are given", 0),
            ),
        ),
        Claim(
            name=f"{name}.continuous_everywhere",
            statement="States and outputs are defined and continuous, for all states and inputs that trials may meet.",
            source=OURS,
            check=partial(_continuous, d, over),
            controller=d.controller,
            certify=lambda found, premises: d.certified.continuous(None if over is None else over()),
        ),
        settled(
            f"{name}.first_plan",
            "The first plan is made of finite numbers.",
            OURS,
            partial(_first_plan, d),
            facts=lambda: {
                "samples at which the first plan is no finite number": (int(_first_plan(d) is not None), "")
            },
            controller=d.controller,
        ),
    )


def _premises_of_the_conclusion(d: Dossier) -> Sequence[Claim]:
    """Return what the conclusion asks: a law that itself keeps its gain above 0 need not bound its estimate."""
    gain = d.law.learning_gain
    if gain is not None and gain.low > 0:
        return _shared_premises(d)
    return (
        *_shared_premises(d),
        d.premises.positive_estimate,
        Claim(
            name=f"{d.study.name}.premise.estimate_form",
            statement="The estimate moves by (12) and (13) with 0 < eta <= 1, and the plan by (14) with that estimate.",
            source=f"{PAPER}, (12) to (15)",
            check=partial(_estimate_form, d),
            controller=d.controller,
            certify=lambda found, premises: certificate(d.law, d.study.task(d.law)),
        ),
    )


def _continuous(d: Dossier, over: Callable[[], Box] | None) -> Finding:
    increment = d.law.learns_on == "increment"
    why = limit.not_continuous(d.plant, d.study.horizon, increment=increment)
    if why is None:
        return Finding(
            grounds=Grounds.ALGEBRA,
            holds=why is None,
            method="the equations have no pole or end of a domain anywhere, and no jump that they do not mend"
            + told(delayed_graph(d.plant, 1, increment=increment)),
        )
    if over is None:
        return undecided(why)
    why = limit.not_continuous(d.plant, d.study.horizon, increment=increment, over=over())
    if why is not None:
        return undecided(why)
    return Finding(
        grounds=Grounds.ENCLOSURE,
        holds=why is None,
        method="no pole, jump or end of a domain is reached in a box that holds every trial"
        + told(delayed_graph(d.plant, 1, increment=increment)),
    )


def _estimate_form(d: Dossier) -> Finding:
    why = estimate_form(d.law, d.study.task(d.law))
    if why is not None:
        return undecided(why)
    return Finding(
        grounds=Grounds.ALGEBRA,
        holds=why is None,
        method="the next estimate and plan in the law's own expressions are the formulas', operation by operation",
    )


def _first_plan(d: Dossier) -> str | None:
    """Return why the first plan is not made of finite numbers, or None."""
    law, task = d.law, d.study.task(d.law)
    if law.stepped:
        return "the law decides in numbers, so its first plan is not known before it runs"
    memory = law.start(task)
    n, nothing = task.samples, as_expression(ca.DM.zeros(1, 1))
    for k in range(n):
        at_k = type(memory)(*(one[:, k] if one.shape[1] >= n else one for one in map(as_expression, memory)))
        u = joined(law.act(at_k, law.ready(at_k), nothing, nothing, nothing)[0])
        if not np.isfinite(np.asarray(ca.evalf(ca.SX(u)).full())).all():
            return f"the first plan has no finite number at sample {k}"
    return None
