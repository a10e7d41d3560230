"""The assumptions of model-free adaptive ILC, checked on the symbolic plant and on what a campaign left.

Numbered as in doi 10.7641/CTA.2024.30465: A1 (df/du exists and is continuous), A2 (generalised Lipschitz condition
along trials), A3 (trial lengths), A4 (sign of the PPD), Lemma 1 (the data model). Each check returns a Finding.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import casadi as ca
import numpy as np
from scipy import stats

from models.array import Array
from models.plant import Plant
from verification.checks.domain import described
from verification.checks.premises import one_channel, same_but_for_the_input
from verification.checks.row_sums import off_diagonal, slope_bounds
from verification.checks.slope import slope
from verification.enclosure.bounds import bound, prove_positive
from verification.enclosure.box import Box
from verification.enclosure.reach import Reach
from verification.enclosure.smoothness import continuous_on
from workbench.contracts.number import finite
from workbench.contracts.study import Study
from workbench.contracts.verdict import Finding, Standing, undecided
from workbench.evidence.lifted import Lifted
from workbench.evidence.ppd import Evidence, gain_unit, learned_signal, units_of
from workbench.evidence.trajectory import Lineariser, rollout
from workbench.graph import Graph, call, read

LOOSE = 1e3  # times the row sum along the run: a bound above that is called loose
SIGNIFICANCE = 1e-3  # of the sampler's test, over all lengths together


def delayed_output(plant: Plant, degree: int) -> ca.Function:
    """Return y(k+d) of the first output as a Function of x, u (now), later inputs held at ``later``, w and k."""
    at = plant.symbols()
    x, u = at["x"], at["u"]
    later = ca.SX.sym("later", u.shape[0], degree - 1)
    for step in range(degree):
        x = plant.next_state(x, u if step == 0 else later[:, step - 1], at["w"], at["k"] + step)
    y = plant.measured(x)[0]
    return ca.Function("delayed_output", [*at.values(), later], [y], [*at, "later"], ["y"])


def _delayed_box(box: Box, degree: int) -> Box:
    low, high = box["u"]
    later = (np.tile(low, (1, degree - 1)), np.tile(high, (1, degree - 1)))
    return Box({**dict(box), "later": later if degree > 1 else (np.zeros((low.size, 0)), np.zeros((low.size, 0)))})


def _slope(function: ca.Function) -> Graph:
    """Return the exact derivative of the output ``y`` by the first entry of ``u``, as a graph."""
    return slope(read(function), "y", "u")


def continuous_slope(plant: Plant, box: Box, degree: int = 1) -> Finding:
    """A1: the derivative of y(k+d) by u(k) exists and is continuous on the box.

    PROVED where no operation that jumps, has a pole or leaves its domain can be reached in f or df/du; REFUTED where
    df/du has different values on the two sides of a point.
    """
    f = delayed_output(plant, degree)
    inner = _delayed_box(box, degree)
    for what, function in (("f", f), ("df/du", _slope(f))):
        found = continuous_on(function, inner)
        if found.proved:
            continue
        for reach in found.reaches:
            broken = _broken(f, reach)
            if broken:
                return Finding(
                    standing=Standing.REFUTED,
                    margin=-broken[0],
                    unit=gain_unit(*units_of(plant)),
                    witness={**broken[1], "operation": f"{reach.operation.name} in {reach.operation.expression}"},
                    method=f"a {reach.operation.kind} of {what} is reached; f or df/du differs on its two sides",
                )
        return undecided(f"continuity of {what} on the box could not be shown: {found.reason}")
    return Finding(
        standing=Standing.PROVED,
        method=f"no jump, pole or end of a domain of f and df/du is reached, by intervals, for {described(plant, box)}",
    )


def _broken(f: ca.Function, reach: Reach) -> tuple[float, dict[str, object]] | None:
    """Return how far df/du breaks off, and where, by looking at both sides of a critical point along u, or None."""
    if reach.reachable != "yes" or reach.point is None:
        return None
    at = {name: value[0] for name, value in reach.point.items()}
    u = float(at["u"][0, 0])
    step = 1e-6 * max(1.0, abs(u))
    values: dict[str, float] = {}
    heights: dict[str, float] = {}
    slopes = _slope(f)
    for side, shift in (("left", -step), ("right", step)):
        moved = {**at, "u": at["u"] + shift * np.eye(at["u"].size, 1)}
        values[side] = float(call(slopes, moved)["slope"][0, 0])
        heights[side] = float(f.call(moved)["y"])
    scale = max(abs(values["left"]), abs(values["right"]))
    across = (heights["right"] - heights["left"]) / (2 * step)
    jumps = np.isfinite(across) and abs(across) > 1e3 * max(scale, 1e-12)
    if np.isfinite(scale) and abs(values["right"] - values["left"]) <= 1e-3 * scale and not jumps:
        return None
    point = {name: value.ravel().tolist() for name, value in at.items() if value.size}
    found = {"point": point, "step": step, "slope_left": values["left"], "slope_right": values["right"]}
    place = {**found, "value_left": heights["left"], "value_right": heights["right"]}
    return abs(values["right"] - values["left"]), place


def lipschitz_printed(plant: Plant, evidence: Evidence, box: Box) -> Finding:
    """A2 as printed: one p with |ds(k+d)| <= p |du(k)| wherever du(k) != 0.

    A plant without memory is proved to have it. For one with memory a pair of input sequences is built whose ratio
    grows without bound: an earlier difference du(j) is kept while du(k) goes to 0.
    """
    if not _remembers(plant, evidence):
        f, inner = delayed_output(plant, evidence.degree), _delayed_box(box, evidence.degree)
        found = bound(_slope(f), inner)
        if np.isfinite([found.lower, found.upper]).all() and continuous_on(f, inner).proved:
            return Finding(
                standing=Standing.PROVED,
                margin=max(abs(found.lower), abs(found.upper)),
                unit=gain_unit(*units_of(plant)),
                method="the output depends on no earlier input; p, the margin, is the largest |df/du| for "
                f"{described(plant, box)}",
            )
    built = vanishing_difference(plant, evidence)
    largest = _largest_ratio(evidence)
    growth = [float(np.nanmax(np.abs(row))) for row in evidence.ratio[1:] if np.isfinite(row).any()]
    if built is None:
        return Finding(
            standing=Standing.SUPPORTED,
            margin=max(growth, default=None),
            unit=gain_unit(*units_of(plant)),
            witness=largest,
            method="no pair of inputs with an unbounded ratio was found; p, the margin, is the largest of the run",
        )
    return Finding(
        standing=Standing.REFUTED,
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


def _remembers(plant: Plant, evidence: Evidence) -> bool:
    """Tell whether the learned signal at k + d depends on inputs before u(k)."""
    at = plant.symbols()
    before = ca.SX.sym("before", *at["u"].shape)
    x = plant.next_state(at["x"], before, at["w"], at["k"] - 1)
    signal = delayed_output(plant, evidence.degree)
    later = ca.SX.sym("later", at["u"].shape[0], evidence.degree - 1)
    value = signal(x, at["u"], at["w"], at["k"], later)
    if evidence.increment:
        value = value - plant.measured(x)[0]
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

    The last trial's plan is the one sequence; the other adds ``kept`` at sample j and ``du`` at sample k > j.
    """
    taken, degree = evidence.trajectories, evidence.degree
    trial = taken.u.shape[0] - 1
    plan, x0 = taken.u[trial], taken.x[trial, :, 0]
    if not np.isfinite(plan).all():
        return None
    k = int(taken.lengths[trial]) - degree
    j = max(0, k - max(1, k // 2))
    kept = 0.1 * float(np.ptp(plan) or np.abs(plan).max() or 1.0)
    outputs = rollout(plant, x0, plan, taken.w[trial])[1]
    base = learned_signal(outputs, evidence.increment)[k + degree]
    rounding = 1e3 * float(np.finfo(float).eps * np.abs(outputs).max())
    sizes, ratios = [], []
    for step in range(steps):
        other = plan.copy()
        other[j] += kept
        other[k] += kept * 10.0**-step
        difference = float(other[k] - plan[k])
        _, moved = rollout(plant, x0, other, taken.w[trial])
        change = abs(float(learned_signal(moved, evidence.increment)[k + degree]) - float(base))
        if not np.isfinite(change) or change < rounding or difference == 0:
            break
        sizes.append(difference)
        ratios.append(change / abs(difference))
    if len(ratios) < 3 or ratios[-1] < 8 * ratios[-2] or ratios[-2] < 8 * ratios[-3]:
        return None
    return Vanishing(kept, j, k, sizes, ratios)


def _largest_ratio(evidence: Evidence) -> dict[str, object]:
    magnitudes = np.where(np.isfinite(evidence.ratio), np.abs(evidence.ratio), -1.0)
    trial, sample = np.unravel_index(int(magnitudes.argmax()), magnitudes.shape)
    return evidence.witness(int(trial), int(sample))


def lipschitz_lifted(plant: Plant, evidence: Evidence, box: Box) -> Finding:
    """A2 repaired: |ds(k+d)| <= p max over j <= k of |du(j)|, p the largest row sum of |G|.

    PROVED over the box where intervals bound it; else SUPPORTED along the last trial's trajectory.
    """
    unmet = one_channel(plant) or same_but_for_the_input(evidence.study, evidence.law)
    if unmet:
        return undecided(unmet)
    along = lifted_along(plant, evidence)
    off, own = along.row_sums()
    p = float((off + own).max())
    at = int((off + own).argmax())
    witness = {"trial": evidence.trajectories.u.shape[0], "sample": at, "row_sum": p, "diagonal": float(own[at])}
    if evidence.degree == 1:
        slopes = slope_bounds(plant, box, increment=evidence.increment)
        rows = off_diagonal(slopes, evidence.trajectories.u.shape[1])
        total = float(rows.max()) + max(abs(slopes.gain_low), abs(slopes.gain_high))
        if np.isfinite(total):
            return Finding(
                standing=Standing.PROVED,
                margin=float(np.nextafter(total, np.inf)),
                unit=gain_unit(*units_of(plant)),
                witness=witness,
                method=f"row sums of |G| by intervals for {described(plant, box)}; the margin is p over the box, "
                f"{total / p:.3g} times that along the last trial's plan, {p:.4g}" + _loose(total, p),
            )
    return Finding(
        standing=Standing.SUPPORTED if np.isfinite(p) else Standing.UNDECIDED,
        margin=finite(p),
        unit=gain_unit(*units_of(plant)),
        witness=witness,
        method="row sums of |G| along the trajectory of the last trial's plan, run to the horizon; the margin is p",
    )


def _loose(total: float, along: float) -> str:
    """Return a warning where a bound over the box is true but says little."""
    return ": true, but too loose to be of use over so many samples" if total > LOOSE * along else ""


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
    horizon, law = study.horizon, study.scenario.trial_length
    if study.plant_that_runs.ends:
        return undecided("trials end by an event of the plant's own, which has no distribution that is known")
    if law.lengths:
        return undecided("the lengths are given, not drawn: give a distribution")
    possible, probabilities = law.distribution(horizon)
    if abs(float(np.sum(probabilities)) - 1) > 1e-12 or (probabilities < 0).any():
        witness = {"sum": float(np.sum(probabilities)), "least": float(np.min(probabilities))}
        return Finding(standing=Standing.REFUTED, witness=witness, method="the table is no distribution")
    reach = law.reach_probability(horizon)
    direct = np.array([probabilities[possible >= k].sum() for k in range(horizon + 1)])
    if np.abs(reach - direct).max() > 1e-12:
        k = int(np.abs(reach - direct).argmax())
        witness = {"sample": k, "p": float(reach[k]), "sum_of_p_l": float(direct[k])}
        return Finding(standing=Standing.REFUTED, witness=witness, method="p(k) is not the sum of the p_l that reach k")
    drawn = np.asarray(lengths, dtype=int)
    outside = np.flatnonzero(~np.isin(drawn, possible))
    if outside.size:
        witness = {"trial": int(outside[0]) + 1, "length": int(drawn[outside[0]])}
        return Finding(standing=Standing.REFUTED, witness=witness, method="a trial has a length of probability 0")
    counts = np.array([(drawn == length).sum() for length in possible])
    values = [
        stats.binomtest(int(c), drawn.size, min(float(p), 1.0)).pvalue
        for c, p in zip(counts, probabilities, strict=True)
    ]
    worst = int(np.argmin(values))
    witness = {"length": int(possible[worst]), "count": int(counts[worst]), "trials": int(drawn.size)}
    adjusted = min(1.0, float(values[worst]) * len(values))
    return Finding(
        standing=Standing.REFUTED if adjusted < SIGNIFICANCE else Standing.SUPPORTED,
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
    if not _remembers(plant, evidence):
        return sign_partial(plant, evidence, box)
    if (unlike := same_but_for_the_input(evidence.study, evidence.law)) is not None:
        return undecided(unlike)
    share = float((evidence.ratio[usable] <= 0).mean())
    if share > 0:
        weight = np.where(usable & (evidence.ratio <= 0), np.abs(np.nan_to_num(evidence.du)), -1.0)
        trial, sample = (int(i) for i in np.unravel_index(int(weight.argmax()), weight.shape))
        return Finding(
            standing=Standing.REFUTED,
            margin=-share,
            unit="share of trials and samples",
            witness=evidence.witness(trial, sample),
            method=f"ratios of consecutive trials: {100 * share:.3g} % of {int(usable.sum())} are not positive; the "
            "margin is minus that share, the witness the one with the largest input difference",
        )
    lowest = np.where(usable, evidence.ratio, np.inf)
    trial, sample = (int(i) for i in np.unravel_index(int(lowest.argmin()), lowest.shape))
    return Finding(
        standing=Standing.SUPPORTED,
        margin=float(lowest[trial, sample]),
        unit=gain_unit(*units_of(plant)),
        witness=evidence.witness(trial, sample),
        method=f"all {int(usable.sum())} realised ratios of consecutive trials are positive; the margin is the least",
    )


def sign_partial(plant: Plant, evidence: Evidence, box: Box) -> Finding:
    """A4 for the partial derivative: inf dy(k+d)/du(k) > 0 over the box."""
    f, inner = delayed_output(plant, evidence.degree), _delayed_box(box, evidence.degree)
    found = prove_positive(_slope(f), inner)
    place = f"dy(k+{evidence.degree})/du(k) by intervals for {described(plant, box)}"
    if found.standing == "proved":
        continuous = continuous_on(f, inner)
        if not continuous.proved:
            return undecided(
                f"the output is not shown to be continuous, so a positive slope says little: {continuous.reason}"
            )
        return Finding(
            standing=Standing.PROVED,
            margin=found.lower,
            unit=gain_unit(*units_of(plant)),
            method=f"{place}; the margin is its lower bound",
        )
    if found.standing == "refuted" and found.witness is not None:
        point = {name: value[0].ravel().tolist() for name, value in found.witness.point.items() if value[0].size}
        return Finding(
            standing=Standing.REFUTED,
            margin=found.witness.upper,
            unit=gain_unit(*units_of(plant)),
            witness={"point": point, "slope": found.witness.upper},
            method=place,
        )
    return undecided(f"{place}: {found.reason}")


def data_model(plant: Plant, evidence: Evidence, box: Box) -> Finding:
    """Lemma 1: ds(k+d) = phi_c du(k) with a bounded phi_c, at every trial and sample that was reached."""
    if _remembers(plant, evidence) and (unlike := same_but_for_the_input(evidence.study, evidence.law)) is not None:
        return undecided(unlike)
    alone = (evidence.du == 0) & np.isfinite(evidence.ds)
    left = np.where(alone, np.abs(np.nan_to_num(evidence.ds)), 0.0)
    scale = float(np.nanmax(np.abs(evidence.trajectories.y)))
    if left.max() > 1e-9 * scale:
        trial, sample = (int(i) for i in np.unravel_index(int(left.argmax()), left.shape))
        return Finding(
            standing=Standing.REFUTED,
            margin=-float(left[trial, sample]),
            unit=plant.outputs[0].unit,
            witness=evidence.witness(trial, sample),
            method=f"du(k) = 0 but ds(k+{evidence.degree}) is not, at {int(alone.sum())} places: no phi_c exists there",
        )
    found = lipschitz_printed(plant, evidence, box)
    return dataclasses.replace(found, method=f"phi_c is the ratio that A2 bounds: {found.method}")
