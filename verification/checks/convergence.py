"""What decides whether an adaptive law converges, by its paper: lambda_min and contraction factors."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.array import Array
from models.plant import Plant
from verification.checks.assumption_replays import place_of, ratio_at
from verification.checks.domain import described
from verification.checks.points import Witness
from verification.checks.row_sums import GainBounds
from verification.enclosure.box import Box
from workbench.contracts.finding import Finding, Grounds, undecided
from workbench.contracts.law import Estimator
from workbench.evidence.ppd import Evidence


class Adaptation(NamedTuple):
    """What the estimator and the gain of a CFDL law did, (trials, m) each, in the law's own units."""

    factor: Array
    """1 - rho phi_c phi / (lam + phi^2) with phi_c the realised ratio."""
    share: Array
    """eta du^2 / (mu + du^2): the share by which the trial's data can move the estimate."""
    reset_small: NDArray[np.bool_]
    """Whether the reset (13) fires because |phi| <= eps or the sign of phi changes."""
    reset_idle: NDArray[np.bool_]
    """Whether it fires because |du| <= eps."""


def adaptation(evidence: Evidence) -> Adaptation:
    """Recompute from the record what the estimator of a CFDL law did and how the error contracted."""
    law, unit = evidence.estimator, evidence.estimator.force_unit
    phi = evidence.estimate * unit
    du = evidence.du / unit
    share = law.eta * du**2 / (law.mu + du**2)
    moved = phi + law.eta * du / (law.mu + du**2) * np.nan_to_num(evidence.ds - phi * du)
    first = phi[0]
    idle = np.abs(du) <= law.eps
    small = (np.abs(moved) <= law.eps) | (np.sign(moved) != np.sign(first))
    known = np.isfinite(du)
    return Adaptation(
        factor=1 - law.rho * phi / (law.lam + phi**2) * evidence.ratio * unit,
        share=share,
        reset_small=np.where(known, small & ~idle, False),
        reset_idle=np.where(known, idle, False),
    )


def lambda_min(law: Estimator, gain_bound: float, *, one_sided: bool = True) -> float:
    """Return (rho b)^2/4, above which the factor lies in (0, 1), or (rho b)^2/16 for (-1, 1).

    ``gain_bound`` is b in output units per input unit; the result is in the law's own units.
    """
    return float((law.rho * gain_bound * law.force_unit) ** 2 / (4 if one_sided else 16))


def lambda_unit(evidence: Evidence) -> str:
    """Return the unit of lambda, which is absolute: squared output per force unit of the law."""
    output, given = evidence.units
    return f"({output} per {evidence.estimator.force_unit:g} {given})^2"


def lambda_partial(plant: Plant, evidence: Evidence, slopes: GainBounds, box: Box) -> Finding:
    """The lambda used exceeds (rho b)^2/4 with b = sup ds(k+d)/du(k) over the box."""
    if slopes.gain_reason:
        return undecided(slopes.gain_reason)
    b = max(abs(slopes.gain_low), abs(slopes.gain_high))
    found = _compared(evidence, b, f"b by intervals for {described(plant, box)}{slopes.told}", Grounds.ENCLOSURE)
    if not found.fails or slopes.steepest is None:
        return found
    met = max(slopes.steepest.lower, -slopes.steepest.upper)
    at = {name: value[0].ravel().tolist() for name, value in slopes.steepest.point.items() if value[0].size}
    refuted = _compared(evidence, met, f"b at a point of {described(plant, box)}", Grounds.ENCLOSURE, {"point": at})
    if refuted.fails:
        return refuted
    least, most = lambda_min(evidence.estimator, met), lambda_min(evidence.estimator, b)
    return undecided(
        f"(rho b)^2/4 lies between {least:.4g}, which is met at a point, and {most:.4g}, which bounds it for "
        f"{described(plant, box)}; lambda = {evidence.estimator.lam:.4g} lies between"
    )


def lambda_realised(evidence: Evidence) -> Finding:
    """The lambda used exceeds (rho b)^2/4 with b the largest realised ratio."""
    magnitudes = np.where(np.isfinite(evidence.ratio), np.abs(evidence.ratio), -1.0)
    trial, sample = (int(i) for i in np.unravel_index(int(magnitudes.argmax()), magnitudes.shape))
    if magnitudes[trial, sample] < 0:
        return undecided("no two trials reached the same sample with different inputs")
    b = float(magnitudes[trial, sample])
    return _compared(evidence, b, "b the largest realised ratio", Grounds.RUN, evidence.witness(trial, sample))


def _compared(
    evidence: Evidence, b: float, how: str, grounds: Grounds, place: dict[str, object] | None = None
) -> Finding:
    law = evidence.estimator
    least = lambda_min(law, b)
    witness = {
        "b": b,
        "lambda_min": least,
        "lambda_min_both_signs": lambda_min(law, b, one_sided=False),
        "lambda": law.lam,
    }
    return Finding(
        grounds=grounds,
        margin=law.lam - least,
        unit=lambda_unit(evidence),
        bound=b,
        bound_unit=evidence.unit,
        witness={**(place or {}), **witness},
        method=f"lambda = {law.lam:.4g} against (rho b)^2/4 = {least:.4g}, {how}; the margin is their difference",
    )


def estimator_bounded(evidence: Evidence) -> Finding:
    """The estimate stays bounded and keeps the sign of phi(k,1): the largest one of the run, by trial and sample."""
    magnitudes = np.where(np.isfinite(evidence.estimate), np.abs(evidence.estimate), -1.0)
    trial, sample = (int(i) for i in np.unravel_index(int(magnitudes.argmax()), magnitudes.shape))
    sided = np.where(np.isfinite(evidence.estimate), evidence.estimate * np.sign(evidence.estimate[0]), np.inf)
    least = int(sided.argmin())
    found = adaptation(evidence)
    later = np.isfinite(evidence.du)
    idle, small = float(found.reset_idle[later].mean()), float(found.reset_small[later].mean())
    median = float(np.median(found.share[later]))
    du = float(np.median(np.abs(evidence.du[later]))) / evidence.estimator.force_unit
    witness = {
        **evidence.witness(trial, sample),
        "largest_estimate": float(magnitudes[trial, sample]),
        "reset_share_du_small": idle,
        "reset_share_phi_small_or_sign": small,
        "excitation_share_median": median,
        "mu_for_a_share_of_one_half": du**2,
    }
    turned = float(sided.ravel()[least])
    if turned < 0:
        place = np.unravel_index(least, sided.shape)
        witness |= {"trial": int(place[0]) + 1, "sample": int(place[1]), "turned_estimate": -turned}
    return Finding(
        grounds=Grounds.RUN,
        tries=int(np.isfinite(evidence.estimate).sum()),
        margin=turned,
        unit=evidence.unit,
        bound=float(magnitudes[trial, sample]),
        bound_unit=evidence.unit,
        witness=witness,
        method="the margin is the least recorded estimate, counted positive on the side of phi(k,1), the bound the "
        f"largest; the reset (13) fires at {100 * idle:.3g} % of "
        f"places for small du, at {100 * small:.3g} % for a small or turned phi; the median excitation share is "
        f"{median:.2g}" + (f", and would be one half with mu = {du**2:.2g}" if median < 0.5 else ""),
    )


def theorem_printed(evidence: Evidence, mse: Array) -> Finding:
    """Theorem 1's argument: |1 - rho phi_c phi/(lam + phi^2)| < 1 at every trial and sample that was reached.

    ``mse`` is the law's mean square error by trial, which the method quotes.
    """
    factor = adaptation(evidence).factor
    usable = np.isfinite(factor)
    if not usable.any():
        return undecided("no two trials reached the same sample with different inputs")
    inside = float((np.abs(factor[usable]) < 1).mean())
    negative, large = float((factor[usable] >= 1).mean()), float((factor[usable] <= -1).mean())
    magnitudes = np.where(usable, np.abs(factor), -1.0)
    trial, sample = (int(i) for i in np.unravel_index(int(magnitudes.argmax()), magnitudes.shape))
    first = f"from {mse[0]:.4g} to {mse[-1]:.4g}"
    refuted = magnitudes[trial, sample] >= 1
    return Finding(
        grounds=Grounds.RUN,
        tries=int(usable.sum()),
        margin=float(1 - magnitudes[trial, sample]),
        unit="1",
        witness={**evidence.witness(trial, sample), "factor": float(factor[trial, sample])},
        method=f"{100 * inside:.4g} % of {int(usable.sum())} factors lie in (-1, 1)"
        + (
            f"; the premise phi_c > 0 (A4) fails at {100 * negative:.3g} % (factor at or above 1), and lambda is too "
            f"small for the phi_c of a further {100 * large:.3g} % (factor at or below -1), so the theorem says "
            f"nothing here, while the MSE went {first}"
            if refuted
            else f"; the MSE went {first}"
        )
        + "; the margin is 1 minus the largest |factor|",
    )


def factor_margin(plant: Plant, evidence: Evidence, witness: Witness) -> float:
    """Return 1 minus the contraction factor's magnitude at a witness, its two trials being run again."""
    law = evidence.estimator
    ratio = ratio_at(plant, evidence, witness) * law.force_unit
    trial, sample = place_of(witness)
    phi = float(evidence.estimate[trial, sample]) * law.force_unit
    return 1 - abs(1 - law.rho * phi / (law.lam + phi**2) * ratio)
