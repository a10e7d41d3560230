"""When learning on increments provably converges: a theorem of ours, and its check over a box.

Let z(k+1) = y(k+1) - y(k), u(k) <- u(k) + l(k) e_z(k+1) with l = rho phi/(lam + phi^2), and u* the input that
follows the reference. For d = u* - u, the mean value theorem gives e_z = H d with H lower triangular, so
d_next(k) = (1 - l(k) H_kk) d(k) - l(k) sum_{j<k} H_kj d(j). With 0 < b_low <= H_kk <= b_high and
sum_{j<k} |H_kj| <= r, and 0 < l <= l_max = rho/(2 sqrt(lam)),

    |d_next(k)| <= max(1 - l(k) (b_low - r), l(k) (b_high + r) - 1) max_{j<=k} |d(j)|,

which is less than max |d| if b_low > r and l_max (b_high + r) < 2, whatever positive phi(k, i) the estimator gives,
and however phi differs between samples. Samples that a trial did
not reach keep d. (The box must hold the trajectories of u, of u*, and of the inputs between them, all from the
same initial state; measurement noise is left out.) So max |d| never grows, and shrinks wherever trials reach:
monotone convergence. With weights, the same holds for max_k |d(k)| a^k when r is replaced by
r(a) = sum_{j<k} |H_kj| a^(k-j), which is small for small a; max |d| itself may then rise for a while, by the factor
a^-N at most.
"""

from __future__ import annotations

import numpy as np

from models.plant import Plant
from verification.checks.assumptions import lifted_along
from verification.checks.domain import described
from verification.checks.premises import (
    no_noise,
    nothing_between,
    one_channel,
    plan_alone,
    reference_within,
    same_but_for_the_input,
)
from verification.checks.row_sums import SlopeBounds, off_diagonal, slope_bounds
from verification.enclosure.box import Box
from workbench.contracts.law import Estimator
from workbench.contracts.verdict import Finding, Standing, undecided
from workbench.evidence.ppd import Evidence

LOOSE = 1e6  # a bound on the transient above that says nothing
SHARE = 0.5  # of b_low that the weighted row sum may take


def largest_gain(law: Estimator) -> float:
    """Return l_max = rho/(2 sqrt(lam)), the largest gain for any phi, in input units per output unit; rounded up."""
    return float(np.nextafter(law.rho / (2 * np.sqrt(law.lam)) * law.force_unit * (1 + 1e-15), np.inf))


def _outside(evidence: Evidence) -> str | None:
    """Return why the theorem does not speak of a law, or None."""
    first = evidence.estimator.first_estimate()
    if evidence.degree != 1:
        return f"the theorem is for relative degree 1, got {evidence.degree}"
    if evidence.law.filters_plan:
        return "the theorem is for the law without its filter (q_cutoff_hz null)"
    if first < 0:
        return f"the theorem is for a positive phi(k,1), got {first:g}"
    return None


def _first_gain(law: Estimator) -> float:
    phi = law.first_estimate()
    return float(law.rho * phi / (law.lam + phi**2) * law.force_unit)


def _factor(law: Estimator, slopes: SlopeBounds, r: float) -> float:
    """Return by how much the largest input error shrinks in a trial while phi stays at phi(k,1)."""
    gain = _first_gain(law)
    return max(1 - gain * (slopes.gain_low - r), gain * (slopes.gain_high + r) - 1)


def _slopes(plant: Plant, evidence: Evidence, box: Box) -> SlopeBounds | Finding:
    """Bound the increment's slopes over a box, or say why the theorem says nothing there."""
    study = evidence.study
    outside = (
        _outside(evidence)
        or one_channel(plant)
        or same_but_for_the_input(study, evidence.law)
        or no_noise(study)
        or nothing_between(study)
        or plan_alone(evidence.law, study)
    )
    if outside:
        return undecided(outside)
    slopes = slope_bounds(plant, box, increment=True)
    return undecided(slopes.reason) if slopes.reason else slopes


def monotone(plant: Plant, evidence: Evidence, box: Box) -> Finding:
    """The largest input error falls from trial to trial for every phi > 0: PROVED over the box where b_low > r.

    REFUTED where, along the last trial's plan, the row sum of |H| off the diagonal exceeds the diagonal: then an
    input error of size 1 with the signs of that row grows.
    """
    slopes = _slopes(plant, evidence, box)
    if isinstance(slopes, Finding):
        return slopes
    n = evidence.trajectories.u.shape[1]
    r = float(off_diagonal(slopes, n).max())
    gain = largest_gain(evidence.estimator)
    if slopes.gain_low > r and gain * (slopes.gain_high + r) < 2:
        left = reference_within(evidence.study, box)
        if left:
            return undecided(left)
        factor = _factor(evidence.estimator, slopes, r)
        return Finding(
            standing=Standing.PROVED,
            margin=(slopes.gain_low - r) / slopes.gain_low,
            unit="share of b",
            witness={"b_low": slopes.gain_low, "b_high": slopes.gain_high, "row_sum": r, "factor_at_phi0": factor},
            method=f"row sums by intervals: r = {r / slopes.gain_low:.3g} b < b and l_max (b + r) = "
            f"{gain * (slopes.gain_high + r):.3g} < 2 for {described(plant, box)}, and for every phi > 0; "
            f"the input error contracts by {factor:.4g} a trial at phi(k,1); the margin is (b - r)/b",
        )
    off, own = lifted_along(plant, evidence).row_sums()
    k = int((off - own).argmax())
    if off[k] > own[k] > 0:
        return Finding(
            standing=Standing.REFUTED,
            margin=float((own[k] - off[k]) / own[k]),
            unit="share of b",
            witness={
                "trial": evidence.trajectories.u.shape[0],
                "sample": k,
                "row_sum": float(off[k]),
                "b": float(own[k]),
            },
            method=f"along the last trial's plan the row sum off the diagonal is {off[k] / own[k]:.3g} b: an input "
            "error with the signs of that row grows in the sup norm, so the sup norm proves nothing here; the margin "
            "is b minus that row sum, over b",
        )
    if not slopes.gain_low > 0:
        return undecided(f"the gain must be positive over the box, its bound is {slopes.gain_low:.3g}")
    return undecided(
        f"over the box the row sum is bounded by {r / slopes.gain_low:.3g} b only (along the last trial's plan it is "
        f"{off[k] / own[k]:.3g} b), or l_max (b + r) reaches 2"
    )


def weighted(plant: Plant, evidence: Evidence, box: Box) -> Finding:
    """The weighted input error max_k |d(k)| a^k falls from trial to trial, with the largest such a that was found."""
    slopes = _slopes(plant, evidence, box)
    if isinstance(slopes, Finding):
        return slopes
    n = evidence.trajectories.u.shape[1]
    if not slopes.gain_low > 0:
        return undecided(f"the gain must be positive over the box, its bound is {slopes.gain_low:.3g}")
    gain = largest_gain(evidence.estimator)
    a = largest_weight(slopes, n, SHARE)
    if a is None:
        return undecided("no weight of at least 1e-6 makes the row sum small enough")
    r = float(off_diagonal(slopes, n, a).max())
    reach = gain * (slopes.gain_high + r)
    if reach >= 2:
        witness = {"l_max": gain, "b_high": slopes.gain_high, "row_sum": r, "l_max_times": reach}
        return Finding(
            standing=Standing.UNDECIDED, margin=2 - reach, unit="1", witness=witness, method="l_max (b + r) reaches 2"
        )
    left = reference_within(evidence.study, box)
    if left:
        return undecided(left)
    factor = _factor(evidence.estimator, slopes, r)
    edge = largest_weight(slopes, n, 1.0)
    return Finding(
        standing=Standing.PROVED,
        margin=a,
        unit="weight a a sample",
        witness={
            "a": a,
            "largest_a": edge,
            "row_sum": r,
            "b": slopes.gain_low,
            "transient": a**-n,
            "factor_at_phi0": factor,
        },
        method=f"max_k |d(k)| a^k with a = {a:.5f} contracts by {factor:.4g} a trial at phi(k,1), and never grows for "
        f"any phi > 0 (r(a) = {r / slopes.gain_low:.3g} b, by intervals for {described(plant, box)}); max |d(k)| may "
        f"rise by {a**-n:.3g} at most on the way"
        + (", a bound that is true but of no use" if a**-n > LOOSE else "")
        + f"; the margin is a, and a up to {edge:.5f} would do",
    )


def largest_weight(slopes: SlopeBounds, samples: int, share: float) -> float | None:
    """Return the largest a <= 1 with r(a) < share * b_low, to four digits of 1 - a, or None."""

    def holds(a: float) -> bool:
        return float(off_diagonal(slopes, samples, a).max()) < share * slopes.gain_low

    if holds(1.0):
        return 1.0
    low, high = 1e-6, 1.0
    if not holds(low):
        return None
    while high - low > max(1e-4 * (1 - low), 1e-9):
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
