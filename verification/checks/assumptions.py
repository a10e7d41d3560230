"""The assumptions of model-free adaptive ILC, checked on the symbolic plant and on what a campaign left.

Numbered as in doi 10.7641/CTA.2024.30465: A1 (df/du exists and is continuous), A2 (generalised Lipschitz condition
along trials), A3 (trial lengths), A4 (sign of the PPD), Lemma 1 (the data model). Each check returns a Finding.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import casadi as ca
import numpy as np

from models.array import Array
from models.plant import Plant
from verification.checks import continuity
from verification.checks.across_jump import Across, across_jump
from verification.checks.delayed import delayed_box, delayed_graph, delayed_output, delayed_slope
from verification.checks.domain import described
from verification.checks.row_sums import SlopeBounds, off_diagonal
from verification.enclosure.bounds import bound, prove_positive
from verification.enclosure.box import Box
from verification.enclosure.smoothness import continuous_on
from verification.enclosure.tables import told
from workbench.contracts.finding import Finding, Grounds, undecided
from workbench.contracts.study import Study
from workbench.evidence.lifted import Lifted
from workbench.evidence.ppd import Evidence, gain_unit, learned_signal, units_of
from workbench.evidence.trajectory import Lineariser, rollout

LOOSE = 1e3  # times the row sum along the run: a bound above that is called loose
SIGNIFICANCE = 1e-3  # of the sampler's test, over all lengths together


def lipschitz_printed(plant: Plant, evidence: Evidence, box: Box) -> Finding:
    """A2 as printed: one p with |ds(k+d)| <= p |du(k)| wherever du(k) != 0.

    A plant without memory is proved to have it, or refuted where the output jumps with the input. For one with memory a
    pair of input sequences is built whose ratio grows without bound: an earlier difference du(j) is kept while du(k)
    goes to 0.
    """
    if not remembers(plant, evidence):
        f = delayed_graph(plant, evidence.degree, increment=evidence.increment).only("y")
        inner = delayed_box(box, evidence.degree)
        found = bound(delayed_slope(f), inner)
        ends = [found.lower, found.upper]
        if np.isfinite(ends).all() and continuous_on(f, inner).proved:
            return Finding(
                grounds=Grounds.ENCLOSURE,
                holds=bool(np.isfinite(ends).all()),
                bound=max(abs(found.lower), abs(found.upper)),
                bound_unit=gain_unit(*units_of(plant)),
                method=f"the output depends on no earlier input; p is the largest |df/du| for {described(plant, box)}"
                + told(f),
            )
        jump = continuity.continuous_slope(plant, box, evidence.degree)
        if continuity.jumps_with_input(jump.witness or {}) and jump.fails:
            return dataclasses.replace(
                jump,
                method="the output depends on no earlier input, and jumps with this one: two inputs, however close, "
                "give outputs that are apart by the margin, so no p bounds their ratio",
            )
    built = vanishing_difference(plant, evidence)
    largest = _largest_ratio(evidence)
    growth = [float(np.nanmax(np.abs(row))) for row in evidence.ratio[1:] if np.isfinite(row).any()]
    if built is None:
        return Finding(
            grounds=Grounds.SEARCH,
            holds=built is None,
            bound=max(growth, default=None),
            bound_unit=gain_unit(*units_of(plant)),
            witness=largest,
            method="no pair of inputs with an unbounded ratio was found by letting one difference vanish; p is the "
            "largest ratio of the run",
        )
    return Finding(
        grounds=Grounds.RUN,
        margin=-built.ratios[-1],
        unit=gain_unit(*units_of(plant)),
        witness={
            "controller": evidence.controller,
            "trial": evidence.trajectories.u.shape[0],
            "earlier_sample": built.earlier_sample,
            "kept": built.kept,
            "sample": built.sample,
            "du": built.du,
            "ratios": built.ratios,
            "largest_of_campaign": largest,
            "largest_by_trial": growth,
        },
        method=f"two plans are built that differ by {built.kept:.3g} {plant.inputs[0].unit} at sample "
        f"{built.earlier_sample} and by du at sample {built.sample}: as du goes to 0 the ratio grows as "
        "1/du, so no p exists; the margin is minus the largest ratio that was built",
    )


def remembers(plant: Plant, evidence: Evidence) -> bool:
    """Tell whether the learned signal at k + d depends on inputs before u(k)."""
    at = plant.symbols()
    before = ca.SX.sym("before", *at["u"].shape)
    x = plant.next_state(at["x"], before, at["w"], at["k"] - 1)
    signal = delayed_output(plant, evidence.degree, increment=evidence.increment)
    later = [ca.SX.sym(name, at[of].shape[0], evidence.degree - 1) for name, of in (("v", "u"), ("d", "w"))]
    value = signal(x, at["u"], at["w"], at["k"], *later)[0]
    return bool(ca.depends_on(value, before[0]))


class Vanishing(NamedTuple):
    """Two plans whose outputs differ ever more for a difference of theirs that vanishes."""

    kept: float
    """What they differ by at the earlier sample, in input units."""
    earlier_sample: int
    sample: int
    du: list[float]
    """The differences at the sample, falling."""
    ratios: list[float]
    """Differences of the learned signal over them."""


def vanishing_difference(plant: Plant, evidence: Evidence, steps: int = 12) -> Vanishing | None:
    """Return input pairs whose ratio |ds(k+d)|/|du(k)| ends up growing as 1/|du(k)|, or None.

    The last trial's plan is the one sequence; the other adds ``kept`` at sample j and ``du`` at sample k > j. A plant
    may remember an input for a sample only, so j is half way to k, and then the sample before k.
    """
    taken, degree = evidence.trajectories, evidence.degree
    trial = taken.u.shape[0] - 1
    plan, x0 = taken.u[trial], taken.x[trial, :, 0]
    if not np.isfinite(plan).all():
        return None
    k = int(taken.lengths[trial]) - degree
    kept = 0.1 * float(np.ptp(plan) or np.abs(plan).max() or 1.0)
    outputs = rollout(plant, x0, plan, taken.w[trial])[1]
    base = learned_signal(outputs, evidence.increment)[k + degree]
    rounding = 1e3 * float(np.finfo(float).eps * np.abs(outputs).max())
    for j in dict.fromkeys((max(0, k - max(1, k // 2)), max(0, k - 1))):
        sizes, ratios = list[float](), list[float]()
        for step in range(steps):
            other = plan.copy()
            other[j] += kept
            other[k] += kept * 10.0**-step
            difference = float(other[k] - plan[k])
            _, moved = rollout(plant, x0, other, taken.w[trial])
            change = abs(float(learned_signal(moved, evidence.increment)[k + degree]) - float(base))
            if not np.isfinite(change) or difference == 0 or (sizes and change < rounding):
                break
            if change < rounding:  # both differences cancel
                continue
            sizes.append(difference)
            ratios.append(change / abs(difference))
        if len(ratios) > 2 and ratios[-1] >= 8 * ratios[-2] and ratios[-2] >= 8 * ratios[-3]:
            return Vanishing(kept, j, k, sizes, ratios)
    return None


def _largest_ratio(evidence: Evidence) -> dict[str, object]:
    magnitudes = np.where(np.isfinite(evidence.ratio), np.abs(evidence.ratio), -1.0)
    trial, sample = np.unravel_index(int(magnitudes.argmax()), magnitudes.shape)
    return evidence.witness(int(trial), int(sample))


def lipschitz_lifted(plant: Plant, evidence: Evidence, slopes: SlopeBounds, box: Box) -> Finding:
    """A2 repaired: |ds(k+d)| <= p max over j <= k of |du(j)|, p the largest row sum of |G|.

    PROVED over the box where intervals bound it. REFUTED by two plans whose trials stay in the box and pass a jump on
    different sides. Else SUPPORTED along the last trial's trajectory, unless something is seen to jump inside the box.
    """
    along = lifted_along(plant, evidence)
    off, own = along.row_sums()
    p = float((off + own).max())
    at = int((off + own).argmax())
    witness = {"trial": evidence.trajectories.u.shape[0], "sample": at, "row_sum": p, "diagonal": float(own[at])}
    rows = off_diagonal(slopes, evidence.trajectories.u.shape[1])
    total = float(rows.max()) + max(abs(slopes.gain_low), abs(slopes.gain_high))
    unit = gain_unit(*units_of(plant))
    if np.isfinite(total):
        return Finding(
            grounds=Grounds.ENCLOSURE,
            holds=bool(np.isfinite(total)),
            bound=float(np.nextafter(total, np.inf)),
            bound_unit=unit,
            witness=witness,
            method=f"row sums of |G| by intervals for {described(plant, box)}; {_beside(total, p)}{slopes.told}",
        )
    if (met := across_jump(plant, evidence, box)) is not None:
        return _unbounded(evidence, met, p, unit)
    if not np.isfinite(p):
        return undecided("the row sums along the last trial's plan are not finite")
    if jump := continuity.jump_reached(plant, box, evidence.degree):
        return undecided(
            f"the output is not continuous in the scope ({jump}), so row sums along one trial bound no difference of "
            "two trials to either side of the jump",
            beside=witness,
        )
    return Finding(
        grounds=Grounds.NUMERICS,
        holds=bool(np.isfinite(p)),
        bound=p,
        bound_unit=unit,
        witness=witness,
        method="row sums of |G| along the trajectory of the last trial's plan, run to the horizon; over the box they "
        f"were not bounded: {slopes.reason or 'the bounds are not finite'}",
    )


def _unbounded(evidence: Evidence, met: Across, along: float, unit: str) -> Finding:
    """Return the refutation by two plans next to each other whose outputs are apart by a jump."""
    return Finding(
        grounds=Grounds.RUN,
        margin=(along if np.isfinite(along) else 0.0) - met.ratios[-1],
        unit=unit,
        witness={
            "controller": evidence.controller,
            "trial": met.trial,
            "sample": met.sample,
            "plans": [plan.tolist() for plan in met.plans],
            "du": met.du,
            "ratios": met.ratios,
            "apart": met.apart,
            "jumps_along": met.broken.across,
            "jump": met.broken.gap,
            "switch": met.switch,
        },
        method=f"two plans that differ by {met.du[-1]:.3g} at the most pass {met.switch} on different sides, where the "
        f"equations jump by {met.broken.gap:.4g} along {met.broken.across}: at sample {met.sample} what is learned on "
        f"is apart by {met.apart:.4g}, however near the plans come to each other, so no p exists; the margin is the "
        "largest row sum along the last trial less the ratio of the two",
    )


def _beside(total: float, along: float) -> str:
    """Return how a bound over the box stands beside that along the last trial's plan, and whether it says little."""
    if not along > 0:
        return f"along the last trial's plan p is {along:.4g}, for no input moves anything there"
    loose = ": true, but too loose to be of use over so many samples" if total > LOOSE * along else ""
    return f"p over the box is {total / along:.3g} times that along the last trial's plan, {along:.4g}{loose}"


def lifted_along(plant: Plant, evidence: Evidence, trial: int = -1) -> Lifted:
    """Return the lifted plant along the plan of a trial, run to the horizon."""
    taken = evidence.trajectories
    plan = np.where(np.isfinite(taken.u[trial]), taken.u[trial], 0.0)
    x, _ = rollout(plant, taken.x[trial, :, 0], plan, taken.w[trial])
    line = Lineariser(plant, plan.size).at(x, plan, taken.w[trial])
    return Lifted(line, evidence.degree, increment=evidence.increment)


def trial_lengths(study: Study, lengths: Array) -> Finding:
    """A3: the lengths have the declared distribution, and p(k) follows from it.

    The table and p(k) are checked by algebra, the drawn lengths by exact binomial tests of every length (Bonferroni).
    """
    from scipy import stats  # it takes longer to load than most of what is here

    horizon, law = study.horizon, study.scenario.trial_length
    possible, probabilities = law.distribution(horizon)
    if abs(float(np.sum(probabilities)) - 1) > 1e-12 or (probabilities < 0).any():
        witness = {"sum": float(np.sum(probabilities)), "least": float(np.min(probabilities))}
        return Finding(
            grounds=Grounds.SETTINGS,
            margin=min(-abs(witness["sum"] - 1), witness["least"]),
            unit="probability",
            witness=witness,
            method="the table is no distribution",
        )
    reach = law.reach_probability(horizon)
    direct = np.array([probabilities[possible >= k].sum() for k in range(horizon + 1)])
    if np.abs(reach - direct).max() > 1e-12:
        k = int(np.abs(reach - direct).argmax())
        witness = {"sample": k, "p": float(reach[k]), "sum_of_p_l": float(direct[k])}
        return Finding(
            grounds=Grounds.SETTINGS,
            margin=-float(np.abs(reach - direct).max()),
            unit="probability",
            witness=witness,
            method="p(k) is not the sum of the p_l that reach k",
        )
    drawn = np.asarray(lengths, dtype=int)
    outside = np.flatnonzero(~np.isin(drawn, possible))
    if outside.size:
        witness = {"trial": int(outside[0]) + 1, "length": int(drawn[outside[0]])}
        return Finding(
            grounds=Grounds.RUN,
            margin=-float(outside.size),
            unit="trials",
            tries=int(drawn.size),
            witness=witness,
            method="a trial has a length of probability 0",
        )
    counts = np.array([(drawn == length).sum() for length in possible])
    values = [
        stats.binomtest(int(c), drawn.size, min(float(p), 1.0)).pvalue
        for c, p in zip(counts, probabilities, strict=True)
    ]
    worst = int(np.argmin(values))
    witness = {"length": int(possible[worst]), "count": int(counts[worst]), "trials": int(drawn.size)}
    adjusted = min(1.0, float(values[worst]) * len(values))
    return Finding(
        grounds=Grounds.TRIES,
        tries=int(drawn.size),
        weak=True,
        margin=adjusted - SIGNIFICANCE,
        unit="probability",
        witness=witness,
        method=f"algebra for the table and p(k); exact binomial tests of {len(values)} lengths; the margin is "
        f"the least p-value, corrected for their number, above the level {SIGNIFICANCE}",
    )


def sign_printed(plant: Plant, evidence: Evidence, box: Box) -> Finding:
    """A4 as printed: the realised PPD is positive at every trial and sample that was reached."""
    usable = np.isfinite(evidence.ratio)
    if not usable.any():
        return undecided("no two trials reached the same sample with different inputs")
    if not remembers(plant, evidence):
        return sign_partial(plant, evidence, box)
    share = float((evidence.ratio[usable] <= 0).mean())
    if share > 0:
        weight = np.where(usable & (evidence.ratio <= 0), np.abs(np.nan_to_num(evidence.du)), -1.0)
        trial, sample = (int(i) for i in np.unravel_index(int(weight.argmax()), weight.shape))
        return Finding(
            grounds=Grounds.RUN,
            tries=int(usable.sum()),
            margin=-share,
            unit="share of trials and samples",
            witness=evidence.witness(trial, sample),
            method=f"ratios of consecutive trials: {100 * share:.3g} % of {int(usable.sum())} are not positive; the "
            "margin is minus that share, the witness the one with the largest input difference",
        )
    lowest = np.where(usable, evidence.ratio, np.inf)
    trial, sample = (int(i) for i in np.unravel_index(int(lowest.argmin()), lowest.shape))
    return Finding(
        grounds=Grounds.RUN,
        tries=int(usable.sum()),
        margin=float(lowest[trial, sample]),
        unit=gain_unit(*units_of(plant)),
        witness=evidence.witness(trial, sample),
        method=f"all {int(usable.sum())} realised ratios of consecutive trials are positive; the margin is the least",
    )


def sign_partial(plant: Plant, evidence: Evidence, box: Box) -> Finding:
    """A4 for the partial derivative: inf dy(k+d)/du(k) > 0 over the box.

    It speaks of one input while the state and all else are held, so the output has to be continuous along u alone.
    """
    f = delayed_graph(plant, evidence.degree, increment=evidence.increment).only("y")
    inner = delayed_box(box, evidence.degree)
    found = prove_positive(delayed_slope(f), inner)
    place = f"dy(k+{evidence.degree})/du(k) by intervals for {described(plant, box)}"
    if found.standing == "proved":
        continuous = continuous_on(f, inner, along=("u",))
        if not continuous.proved:
            return undecided(
                "the output is not shown to be continuous along u, so a positive slope says little: "
                f"{continuous.reason}"
            )
        return Finding(
            grounds=Grounds.ENCLOSURE,
            margin=found.lower,
            unit=gain_unit(*units_of(plant)),
            method=f"{place}; the margin is its lower bound{told(f)}",
        )
    if found.standing == "refuted" and found.witness is not None:
        point = {name: value[0].ravel().tolist() for name, value in found.witness.point.items() if value[0].size}
        return Finding(
            grounds=Grounds.ENCLOSURE,
            margin=found.witness.upper,
            unit=gain_unit(*units_of(plant)),
            witness={"point": point, "slope": found.witness.upper},
            method=place,
        )
    return undecided(f"{place}: {found.reason}")


def data_model(plant: Plant, evidence: Evidence, box: Box) -> Finding:
    """Lemma 1: ds(k+d) = phi_c du(k) with a bounded phi_c, at every trial and sample that was reached."""
    alone = (evidence.du == 0) & np.isfinite(evidence.ds)
    left = np.where(alone, np.abs(np.nan_to_num(evidence.ds)), 0.0)
    scale = float(np.nanmax(np.abs(evidence.trajectories.y)))
    if left.max() > 1e-9 * scale:
        trial, sample = (int(i) for i in np.unravel_index(int(left.argmax()), left.shape))
        return Finding(
            grounds=Grounds.RUN,
            tries=int(alone.sum()),
            margin=-float(left[trial, sample]),
            unit=plant.outputs[0].unit,
            witness=evidence.witness(trial, sample),
            method=f"du(k) = 0 but ds(k+{evidence.degree}) is not, at {int(alone.sum())} places: no phi_c exists there",
        )
    found = lipschitz_printed(plant, evidence, box)
    return (
        found
        if found.reason
        else dataclasses.replace(found, method=f"phi_c is the ratio that A2 bounds: {found.method}")
    )
