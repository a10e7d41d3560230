"""When learning on increments provably converges: a theorem of ours, and its check over a box.

Let z(k+1) = y(k+1) - y(k), u(k) <- u(k) + l(k) e_z(k+1) with l = rho phi/(lam + phi^2), and u* the input that
follows the reference. For d = u* - u, the mean value theorem gives e_z = H d with H lower triangular, so
d_next(k) = (1 - l(k) H_kk) d(k) - l(k) sum_{j<k} H_kj d(j). With 0 < b_low <= H_kk <= b_high and
sum_{j<k} |H_kj| <= r, and 0 < l <= l_max = rho/(2 sqrt(lam)),

    |d_next(k)| <= max(1 - l(k) (b_low - r), l(k) (b_high + r) - 1) max_{j<=k} |d(j)|,

which is less than max |d| if b_low > r and l_max (b_high + r) < 2, whatever positive phi(k, i) the estimator gives,
and however phi differs between samples. Samples that a trial did not reach keep d. So max |d| never grows, and shrinks
wherever trials reach: monotone convergence. With weights, the same holds for max_k |d(k)| a^k when r is replaced by
r(a) = sum_{j<k} |H_kj| a^(k-j), which is small for small a; max |d| itself may then rise for a while, by the factor
a^-N at most.

It speaks of trials that stay in the box, and rests on premises that are claims of their own
(:mod:`verification.theorems.premises`): relative degree 1, trials that differ by their input alone, no noise, no
actuator, a plan that is neither filtered nor corrected within the trial, a positive estimate at first, and an input
that follows the reference inside the box.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from models.array import Array
from models.plant import Plant
from models.quantity import InvalidValue
from verification.checks.domain import described
from verification.checks.row_sums import SlopeBounds, off_diagonal
from verification.checks.wanted import Wanted
from verification.enclosure.box import Box
from workbench.contracts.finding import Finding, Grounds, undecided
from workbench.contracts.law import Estimator
from workbench.evidence.lifted import Lifted
from workbench.evidence.trajectory import Lineariser, rollout

LOOSE = 1e6  # a bound on the transient above that says nothing
SHARE = 0.5  # of b_low that the weighted row sum may take
SMALL = 1e-6  # of the wanted inputs' range: the input error of a replay


def gain_range(law: Estimator, estimates: Array) -> Array:
    """Return the gain l of estimates, in input units per output unit."""
    phi = estimates * law.force_unit
    gain: Array = law.rho * phi / (law.lam + phi**2) * law.force_unit
    return gain


def largest_gain(law: Estimator) -> float:
    """Return l_max = rho/(2 sqrt(lam)), the largest gain for any phi, in input units per output unit; rounded up."""
    return float(np.nextafter(law.rho / (2 * np.sqrt(law.lam)) * law.force_unit * (1 + 1e-15), np.inf))


def _first_gain(law: Estimator) -> float:
    phi = law.first_estimate()
    return float(law.rho * phi / (law.lam + phi**2) * law.force_unit)


def factor(slopes: SlopeBounds, r: float, gain: Array | float) -> Array:
    """Return by how much the largest input error is multiplied at most, for gains l; never less than 0."""
    found: Array = np.maximum(
        1 - np.asarray(gain) * (slopes.gain_low - r), np.asarray(gain) * (slopes.gain_high + r) - 1
    )
    return found


def monotone(law: Estimator, slopes: SlopeBounds, wanted: Wanted, plant: Plant, box: Box) -> Finding:
    """The largest input error falls from trial to trial for every phi > 0: PROVED over the box where b_low > r.

    REFUTED where, along the trajectory that follows the reference, the row sum of |H| off the diagonal exceeds the
    diagonal: then an input error of size 1 with the signs of that row grows, as :func:`replay` shows.
    """
    if slopes.reason:
        return undecided(slopes.reason)
    n = wanted.study.horizon
    r = float(off_diagonal(slopes, n).max())
    gain = largest_gain(law)
    reach = gain * (slopes.gain_high + r)
    if slopes.gain_low > r and reach < 2:
        shrunk = float(factor(slopes, r, _first_gain(law)))
        return Finding(
            grounds=Grounds.ENCLOSURE,
            margin=min((slopes.gain_low - r) / slopes.gain_low, 2 - reach),
            unit="1",
            bound=shrunk,
            bound_unit="a trial",
            witness={"b_low": slopes.gain_low, "b_high": slopes.gain_high, "row_sum": r, "factor_at_phi0": shrunk},
            method=f"row sums by intervals: r = {r / slopes.gain_low:.3g} b < b and l_max (b + r) = {reach:.3g} < 2 "
            f"for {described(plant, box)}, and for every phi > 0; the input error contracts by {shrunk:.4g} a trial at "
            f"phi(k,1); the margin is the lesser of (b - r)/b and 2 - l_max (b + r){slopes.told}",
        )
    if not slopes.gain_low > 0:
        return undecided(f"the gain must be positive over the box, its bound is {slopes.gain_low:.3g}")
    if wanted.missing is not None:
        return undecided(f"no input was found that follows the reference at sample {wanted.missing}")
    off, own = along_reference(wanted).row_sums()
    k = int((off - own).argmax())
    if off[k] > own[k] > 0:
        return Finding(
            grounds=Grounds.NUMERICS,
            margin=float((own[k] - off[k]) / own[k]),
            unit="1",
            witness={
                "sample": k,
                "row_sum": float(off[k]),
                "b": float(own[k]),
                "signs": np.sign(row_of(wanted, k)).astype(int).tolist(),
            },
            method="along the trajectory that follows the reference the row sum off the diagonal is "
            f"{off[k] / own[k]:.3g} b at sample {k}: an input error with the signs of that row grows in the sup norm, "
            "so the sup norm proves nothing here; the margin is b minus that row sum, over b",
        )
    return undecided(
        f"over the box the row sum is bounded by {r / slopes.gain_low:.3g} b only (along the reference it is "
        f"{off[k] / own[k]:.3g} b), or l_max (b + r) reaches 2"
    )


def along_reference(wanted: Wanted) -> Lifted:
    """Return the lifted plant of increments along the trajectory that follows the reference."""
    line = Lineariser(wanted.study.plant_that_runs, wanted.u.size).at(wanted.x, wanted.u, wanted.w)
    return Lifted(line, 1, increment=True)


def row_of(wanted: Wanted, k: int) -> Array:
    """Return row k of H along the trajectory that follows the reference, (N,)."""
    one = np.zeros(wanted.u.size)
    one[k] = 1.0
    return along_reference(wanted).adjoint(one)


def replay(law: Estimator, wanted: Wanted, witness: Mapping[str, object]) -> float:
    """Return the margin of :func:`monotone` at a witness: a trial is run whose input error has the witness's signs.

    Negative where the error at the witness's sample grows in the next trial. Raises InvalidValue for a witness without
    its signs, or of another length.
    """
    signs, k = witness.get("signs"), witness.get("sample")
    if not isinstance(signs, list) or not isinstance(k, int) or len(signs) != wanted.u.size:
        raise InvalidValue(f"a witness is replayed with its sample and {wanted.u.size} signs: verify again")
    study = wanted.study
    d = -np.array(signs, dtype=float)
    d[k] = -d[k]
    size = SMALL * float(np.ptp(wanted.u) or np.abs(wanted.u).max() or 1.0)
    gained = [
        np.diff(rollout(study.plant_that_runs, wanted.x[:, 0], plan, wanted.w)[1])[k]
        for plan in (wanted.u + size * d, wanted.u - size * d)
    ]
    mean_slope = float(gained[0] - gained[1]) / (2 * size)  # H d at the sample; grows where its sign is not that of d
    own = float(along_reference(wanted).diagonal()[k])
    return float(mean_slope * d[k] / own)


def weighted(law: Estimator, slopes: SlopeBounds, plant: Plant, box: Box, samples: int) -> Finding:
    """The weighted input error max_k |d(k)| a^k falls from trial to trial, with the largest such a that was found."""
    if slopes.reason:
        return undecided(slopes.reason)
    if not slopes.gain_low > 0:
        return undecided(f"the gain must be positive over the box, its bound is {slopes.gain_low:.3g}")
    gain = largest_gain(law)
    a = largest_weight(slopes, samples, SHARE)
    if a is None:
        return undecided("no weight of at least 1e-6 makes the row sum small enough")
    r = float(off_diagonal(slopes, samples, a).max())
    reach = gain * (slopes.gain_high + r)
    if reach >= 2:
        return undecided(
            f"l_max (b + r) is {reach:.4g} and must stay below 2: lower rho, or raise lambda",
            margin=2 - reach,
            unit="1",
            l_max=gain,
            b_high=slopes.gain_high,
            row_sum=r,
            l_max_times=reach,
        )
    shrunk = float(factor(slopes, r, _first_gain(law)))
    edge = largest_weight(slopes, samples, 1.0)
    transient = float(np.exp(min(-samples * np.log(a), 700.0)))
    return Finding(
        grounds=Grounds.ENCLOSURE,
        margin=min((slopes.gain_low - r) / slopes.gain_low, 2 - reach),
        unit="1",
        bound=a,
        bound_unit="weight a a sample",
        witness={
            "a": a,
            "largest_a": edge,
            "row_sum": r,
            "b": slopes.gain_low,
            "transient": transient,
            "factor_at_phi0": shrunk,
        },
        method=f"max_k |d(k)| a^k with a = {a:.5f} contracts by {shrunk:.4g} a trial at phi(k,1), and never grows for "
        f"any phi > 0 (r(a) = {r / slopes.gain_low:.3g} b, by intervals for {described(plant, box)}); max |d(k)| may "
        f"rise by {transient:.3g} at most on the way"
        + (", a bound that is true but of no use" if transient > LOOSE else "")
        + f"; the margin is the lesser of (b - r)/b and 2 - l_max (b + r), and a up to {edge:.5f} would do"
        + slopes.told,
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
