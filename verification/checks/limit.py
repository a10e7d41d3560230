"""What learning comes to in the end, sample by sample: a theorem, and what is looked at for it.

**Setting.** x(k+1) = f(x(k), u(k), k) from one initial state x(0) in every trial, with the same disturbance (it is part
of f) and no noise. The learned signal s(k+1) = F(x(k), u(k), k) is the output y(k+1), or its increment
y(k+1) - y(k). What s is to be is r(k+1), or r(k+1) - r(k); e_s is what is missing. The plan alone acts, and after a
trial that reached k + 1

    u(k) <- u(k) + l(k) e_s(k+1),        0 < l(k) <= l_max,

while samples that the trial did not reach keep their input. f and F are defined and continuous in x and u wherever
trials come, and F(x, ., k) rises with slopes between b_low > 0 and b_high.

**The target.** At a state x let uhat(x, k) be the input with F(x, uhat, k) equal to what is wanted. Where the slope
has these bounds for all u from minus to plus infinity there is one, because F(x, ., k) is then onto the reals; a set
that is shown to hold every trial (a funnel) is made so that there is one. There is only one, and it is continuous in x:
for two states, |uhat(x) - uhat(x')| <= |F(x', uhat(x)) - F(x, uhat(x))|/b_low. With B the mean slope of F(x, ., k)
between u and uhat, e_s(k+1) = B (uhat - u), so that

    uhat - u  becomes  (1 - l B) (uhat - u),        b_low <= B <= b_high.             (*)

**Claim.** If l_max b_high < 2, and every sample is reached by infinitely many trials, then for every k the inputs
u_i(k) converge as i grows, the states x_i(k) of the trials that reach k converge, and e_s(k+1) goes to zero along the
trials that reach k + 1. Trials whose lengths are drawn independently, with a probability p(k) > 0 to reach k, reach it
infinitely often with probability 1 (Borel and Cantelli), all N samples at once.

**Proof, by induction over k.** Suppose that the states x_i(k) of the trials that reach k converge, to x*(k). At k = 0
they are all the same. In this order:

1. *States are bounded*, since they converge; so are the targets uhat(x_i(k), k): they lie in m +- w for some m, w.
2. *Inputs are bounded, whatever l does.* With a = l B in (0, A], A = l_max b_high < 2, and R the larger of
   |u_1(k) - m| and w max(1, A/(2 - A)): |u - m| <= R gives |u_next - m| <= |1 - a| R + a w <= R. For a <= 1 because
   w <= R, for a > 1 because (a - 1) R + a w <= R where w <= R (2 - a)/a.
3. *The outputs s_i(k+1) are bounded*, F being continuous on what is closed and bounded.
4. *The estimate is bounded* (for a law whose gain is l = rho phi/(lambda + phi^2) in the unit of its inputs, its phi
   moving by (12) and (13)). With v = eta du^2/(mu + du^2), in [0, 1) because eta <= 1, a step gives
   (1 - v) phi + v dy/du, a mean of the last estimate and of the ratio met. It is kept only where |du| > eps and the
   result is above eps; in its place comes phi(k,1) > 0 otherwise. With Z what two outputs y(k+1) can differ by (3),
   min(eps, phi(k,1)) <= phi <= max(phi(k,1), Z/eps): from below by the reset, from above by induction over trials.
   On these estimates l has a least value l_min(k) > 0, since it is continuous in phi and never 0. A law that itself
   holds its gain above some l_min > 0 needs nothing of this.
5. *The input goes to its target.* Number the trials that reach k + 1 as n = 1, 2, ... and let d_n = uhat(x_n(k), k) -
   u_n(k). Between them u(k) is kept, so by (*) d_{n+1} = (1 - l B) d_n + (uhat(x_{n+1}(k), k) - uhat(x_n(k), k)). The
   last bracket goes to 0, for x_n(k) converges and uhat is continuous, and |1 - l B| <= q(k) =
   max(1 - l_min(k) b_low, l_max b_high - 1) < 1. So d_n goes to 0: |d_{n+1}| <= q |d_n| + o(1).
6. Hence u_i(k) goes to u*(k) = uhat(x*(k), k), e_s(k+1) = B d to 0, and the states x_i(k+1) of the trials that reach
   k + 1 to f(x*(k), u*(k), k), f being continuous: the hypothesis for k + 1.

Every step of 1 to 4 speaks of sample k alone and uses what was shown for it or before; 5 uses 4. No norm over samples,
no row sum and no ratio of differences between trials is bounded beforehand.

**What it does not say.** Nothing of how fast, and nothing of the way there: q(k) is useless as a rate, and errors may
first grow by any factor. For the increment s converges; where trials begin off the reference the output keeps that
offset. It is about real numbers: a run in doubles may end before.
"""

from __future__ import annotations

import numpy as np

from models.array import Array
from models.plant import Plant
from verification.checks.delayed import delayed_box, delayed_graph
from verification.checks.slope import slope
from verification.enclosure import outward
from verification.enclosure.box import Box
from verification.enclosure.everywhere import ends, over_the_reals
from verification.enclosure.interval import evaluate, reason, supported
from verification.enclosure.rewriting import rewritten
from verification.enclosure.smoothness import breaks_somewhere, continuous_on
from workbench.contracts.claim import Held
from workbench.contracts.finding import Finding, Grounds, undecided
from workbench.contracts.law import AnyLaw, LearningGain
from workbench.contracts.study import Study
from workbench.graph import Unreadable

ROUNDED = 2.0**-40
"""What a trial may round at its first sample, of the magnitudes met there: 4096 units in the last place."""
Slope = tuple[float, float]
"""b_low and b_high."""


def slope_everywhere(plant: Plant, horizon: int) -> Slope | str:
    """Return the ends of dy(k+1)/du(k) over all states, inputs and disturbances, k = 0..N-1, or why there are none.

    It is enclosed at every whole k, whatever states, inputs and disturbances are: sines, tables and switches have ends
    where their arguments have none.
    """
    if not outward.arithmetic_is_ieee():
        return "this process does not round to nearest or drops subnormals"
    try:
        graph = slope(delayed_graph(plant, 1), "y", "u")
    except Unreadable as error:
        return str(error)
    found = rewritten(graph)
    if isinstance(found, str):
        return found
    (node,) = found.targets()
    for k in found.ancestors((node,)):
        if not supported(found, k):
            return reason(found, {}, k)
    labels = graph.labels()
    needed = [label for label, used in zip(labels, found.coordinates((node,), len(labels)), strict=True) if used]
    points = np.zeros((len(labels), horizon))
    if "k" in labels:
        points[labels.index("k")] = np.arange(horizon)
    real = np.array([label != "k" for label in labels])
    wide, moved = over_the_reals(found, real)
    span, fault = evaluate(wide, *ends(points, points, real[:, None]), [node + moved])[node + moved]
    moving = [label for label in needed if label != "k"]
    if fault is not None and (fault >= 0).any():
        column = int(np.argmax(np.broadcast_to(fault, horizon) >= 0))
        of = f" for some {' and '.join(moving)}" if moving else ""
        return f"at sample {column} the slope of y(k+1) by u(k) has no value{of}"
    if moving and not (np.isfinite(span.lo) & np.isfinite(span.hi)).all():
        return (
            f"the slope of y(k+1) by u(k) depends on {' and '.join(moving)}, and no ends of it are known for all of "
            "them: a set that is shown to hold every trial would decide"
        )
    return float(np.min(span.lo)), float(np.max(span.hi))


def not_continuous(plant: Plant, horizon: int, *, increment: bool = False, over: Box | None = None) -> str | None:
    """Return why states and outputs are not shown to be defined and continuous at k = 0..N-1, or None.

    Everywhere, for all states and inputs: no operation has a pole or the end of a domain where it counts, and where
    there is a switch both sides agree; kinks do no harm. Or over a box that holds every trial.
    """
    try:
        graph = delayed_graph(plant, 1, increment=increment)
    except Unreadable as error:
        return str(error)
    broken = breaks_somewhere(graph, {"k": (0.0, float(horizon - 1))})
    if not broken:
        return None
    if over is not None:
        return continuous_on(graph, delayed_box(over, 1)).reason
    return (
        f"the equations are not shown to be continuous everywhere ({broken}), and nothing keeps trials from it: a set "
        "that is shown to hold every trial would decide"
    )


def contracting(gain: LearningGain, b_low: float, b_high: float) -> float | str:
    """Return 2 - l_max b_high, rounded down, or why an input does not come nearer to its target."""
    if not (np.isfinite(b_low) and np.isfinite(b_high) and b_low > 0):
        least = f", {b_low:.4g} at the least" if np.isfinite(b_low) else ""
        return f"the slope of what is learned on by the input is not shown to be positive and bounded{least}"
    if gain.low < 0 or gain.high <= 0:
        return f"the learning gain must be positive, and may be {gain.low:.4g} to {gain.high:.4g}"
    product = float(np.nextafter(gain.high * b_high, np.inf))
    room = float(np.nextafter(2 - product, -np.inf))
    if not room > 0:
        return (
            f"l_max b_high is {product:.4g} and must lie below 2, or an input may be moved further beyond its target "
            "than it was off: a smaller gain would decide (lambda above (rho b)^2/16)"
        )
    return room


def never_nearer(gain: LearningGain, bounds: Slope, errors: Array) -> Finding | None:
    """Return the refutation where the error of the first sample never falls in any trial, or None.

    All trials begin in one state, so each multiplies that error by 1 - l B. Its magnitude is 1 or more where l B is at
    most 0, or at least 2. ``errors`` are the recorded ones of the first sample, by trial.
    """
    low, high = bounds
    first = float(errors[0]) if errors.size else 0.0
    if not (np.isfinite(bounds).all() and np.isfinite(first) and first != 0):
        return None
    falling = high <= 0 and gain.low >= 0 and gain.high > 0
    least = float(np.nextafter(gain.low * low, -np.inf))
    if not falling and not least >= 2:
        return None
    margin = high if falling else 2 - least
    why = (
        f"the output does not rise with the input (slopes B of {low:.4g} to {high:.4g}), while l is positive"
        if falling
        else f"l B is at least {least:.4g}, so that each trial overshoots by no less than the error was"
    )
    return Finding(
        grounds=Grounds.INDUCTION,
        margin=margin,
        unit="1",
        witness={
            "sample": 1,
            "first_error": first,
            "b_low": low,
            "b_high": high,
            "l_min": gain.low,
            "l_max": gain.high,
        },
        method=f"each trial multiplies the error of sample 1 by 1 - l B, and {why}: it never falls from "
        f"the {first:.4g} of the first trial",
    )


def unreached(study: Study) -> Finding:
    """Look whether every sample 1..N is reached with a probability above 0, by trials whose lengths are independent."""
    law = study.scenario.trial_length
    if study.plant_that_runs.ends:
        return undecided(
            "trials end by an event of the plant, so whether a sample is reached again and again depends on what is "
            "learned: lengths that are drawn would decide"
        )
    if law.lengths:
        return undecided(
            "the lengths of the trials are given, which says nothing of trials to come: a distribution of lengths "
            "would decide"
        )
    reach = law.reach_probability(study.horizon)[1:]
    k = int(np.argmin(reach)) + 1
    return Finding(
        grounds=Grounds.SETTINGS,
        margin=float(reach[k - 1]),
        unit="1",
        witness={"sample": k, "probability": float(reach[k - 1])},
        method=f"sample {k} is reached most rarely, with probability {reach[k - 1]:.4g}, and lengths are drawn "
        "independently; the margin is that probability",
    )


def output_limit(study: Study, law: AnyLaw, bounds: Slope | str, fell: str, errors: Array) -> Finding:
    """Look at what the induction asks of slope and gain, for a law with an estimate that learns on the output.

    ``fell`` says where the recorded run was stopped; empty where it came to its end. ``errors`` are those of the first
    sample by trial, which refute it where they can be seen never to fall.
    """
    gain = law.learning_gain
    if gain is None:
        return undecided("the law does not say between which ends its learning gain lies")
    if isinstance(bounds, str):
        return undecided(bounds)
    if (refuted := never_nearer(gain, bounds, errors)) is not None:
        return refuted
    room = contracting(gain, *bounds)
    if isinstance(room, str):
        return undecided(room)
    why = (
        "the slope has these ends for all states and inputs, so that every target has one input, and the estimate is "
        "bounded by the same induction, so that l has a least value. That is another reason than that of the printed "
        "proof, whose assumptions it does without"
    )
    return _limit(gain, bounds, room, fell, why)


def increment_limit(study: Study, law: AnyLaw, b_low: float, b_high: float, *, fell: str = "") -> Finding:
    """Look at what the induction asks of slope and gain, for a law that learns on the output's increment.

    b_low and b_high bound the mean slope of the increment by the input, over a set that holds every trial and its
    targets. The law must itself keep its gain above a positive number. ``fell`` as for :func:`output_limit`.
    """
    gain = law.learning_gain
    if gain is None:
        return undecided("the law does not say between which ends its learning gain lies")
    if gain.low == 0:
        return undecided("the learning gain has no least value above 0: ends for the estimate (phi_range) would decide")
    room = contracting(gain, b_low, b_high)
    if isinstance(room, str):
        return undecided(room)
    begins = float(study.reference_samples[0, 0])
    why = (
        f"the slopes are those of a set that holds every trial, and l is at least {gain.low:.4g}. Where trials begin "
        f"off the reference, which begins at {begins:.4g} {study.plant.outputs[0].unit}, increments converge and the "
        "output keeps the offset"
    )
    return _limit(gain, (b_low, b_high), room, fell, why)


def _limit(gain: LearningGain, bounds: Slope, room: float, fell: str, why: str) -> Finding:
    if fell:
        return undecided(f"it is true of real numbers; {fell}, so there is no record to hold it against")
    product = float(np.nextafter(gain.high * bounds[1], np.inf))
    return Finding(
        grounds=Grounds.INDUCTION,
        margin=room,
        unit="1",
        bound=product,
        bound_unit="1",
        witness={"b_low": bounds[0], "b_high": bounds[1], "l_min": gain.low, "l_max": gain.high},
        method="by induction over samples: once the states at sample k converge, each trial that reaches k + 1 "
        f"multiplies the input's distance to its target by 1 - l B, with l B above 0 and at most {product:.4g} (slopes "
        f"B of {bounds[0]:.4g} to {bounds[1]:.4g}); {why}. The margin is 2 - l_max b_high. Nothing is said of how "
        "fast, or of the way there",
    )


def transient(mse: Array, last: int, unit: str) -> Finding:
    """Look whether the mean square error over samples 1..last ever rose above the first trial's; ``mse`` by trial."""
    if mse.size < 2 or not np.isfinite(mse).all():
        return undecided("samples are missing that every trial reached by its length, so errors cannot be compared")
    first, worst = float(mse[0]), int(np.argmax(mse[1:])) + 1
    largest, above = float(mse[worst]), int((mse[1:] > first).sum())
    return Finding(
        grounds=Grounds.RUN,
        tries=int(mse.size) - 1,
        margin=1 - largest / first if first else -largest,
        weak=True,
        unit="share of the first error" if first else unit,
        bound=largest,
        bound_unit=unit,
        witness={"trial": worst + 1, "mse": largest, "first_mse": first, "trials_above": above, "last_sample": last},
        method=f"over samples 1 to {last}, which every trial reached, the error of the first trial is {first:.4g} "
        f"{unit} and the largest later one {largest:.4g} {unit}, at trial {worst + 1}; {above} of {mse.size - 1} later "
        "trials lie above the first",
    )


def held_at_first_sample(
    errors: Array, gain: LearningGain, bounds: Slope, magnitude: float, plant_rounds: float = 0.0
) -> Held:
    """Hold the step of the proof against recorded trials where it can be seen in numbers: at the first sample.

    All trials begin in one state, so the target of u(0) never moves, and each trial multiplies the error of s(1) by a
    number between 1 - l_max b_high and 1 - l_min b_low. ``errors`` are those of s(1) by trial, in the order of trials,
    ``magnitude`` the largest of what is computed with there, which rounds, ``plant_rounds`` what the plant's own
    equations round of s(1).
    """
    lowest, highest = 1 - gain.high * bounds[1], 1 - gain.low * bounds[0]
    before, after = errors[:-1], errors[1:]
    ends = np.stack([lowest * before, highest * before])
    room = np.minimum(after - ends.min(axis=0), ends.max(axis=0) - after)
    room = room + ROUNDED * magnitude + 2 * plant_rounds
    if not room.size:
        return Held(0, 0.0, {})
    i = int(np.argmin(np.where(np.isnan(room), np.inf, room)))
    place = {"pair": [i + 1, i + 2], "sample": 1, "error": float(before[i]), "next": float(after[i])}
    return Held(int(room.size), float(room[i]), place)
