"""What decides whether a learning law converges: lambda_min, contraction factors, the lifted conditions."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from models.array import Array
from models.plant import Plant
from verification.checks.assumptions import lifted_along
from verification.checks.domain import described
from verification.checks.premises import plan_alone, same_but_for_the_input
from verification.checks.row_sums import slope_bounds
from verification.enclosure.box import Box
from workbench.contracts.law import Estimator
from workbench.contracts.number import finite
from workbench.contracts.record import TrialRecord
from workbench.contracts.verdict import Finding, Standing, undecided
from workbench.evidence.learning_operator import gain, memories
from workbench.evidence.lifted import Lifted, SingularValue, largest_singular_value
from workbench.evidence.ppd import Evidence
from workbench.evidence.trajectory import rollout
from workbench.trials.campaign import Campaign


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


def lambda_partial(plant: Plant, evidence: Evidence, box: Box) -> Finding:
    """The lambda used exceeds (rho b)^2/4 with b = sup ds(k+1)/du(k) over the box."""
    if evidence.degree != 1:
        along = float(np.nanmax(np.abs(evidence.partial)))
        return _compared(evidence, along, "b along the run (relative degree above 1)", Standing.SUPPORTED)
    slopes = slope_bounds(plant, box, increment=evidence.increment)
    if slopes.reason:
        return undecided(slopes.reason)
    b = max(abs(slopes.gain_low), abs(slopes.gain_high))
    found = _compared(evidence, b, f"b by intervals for {described(plant, box)}", Standing.PROVED)
    if found.standing is Standing.PROVED or slopes.steepest is None:
        return found
    met = max(slopes.steepest.lower, -slopes.steepest.upper)
    at = {name: value[0].ravel().tolist() for name, value in slopes.steepest.point.items() if value[0].size}
    refuted = _compared(evidence, met, f"b at a point of {described(plant, box)}", Standing.PROVED, {"point": at})
    if refuted.standing is Standing.REFUTED:
        return refuted
    least, most = lambda_min(evidence.estimator, met), lambda_min(evidence.estimator, b)
    return undecided(
        f"(rho b)^2/4 lies between {least:.4g}, which is met at a point, and {most:.4g}, which bounds it for "
        f"{described(plant, box)}; lambda = {evidence.estimator.lam:.4g} lies between"
    )


def lambda_realised(evidence: Evidence) -> Finding:
    """The lambda used exceeds (rho b)^2/4 with b the largest realised ratio.

    Where trials differ by more than their inputs a ratio is no answer to an input, and says nothing of b.
    """
    if (unlike := same_but_for_the_input(evidence.study, evidence.law)) is not None:
        return undecided(unlike)
    magnitudes = np.where(np.isfinite(evidence.ratio), np.abs(evidence.ratio), -1.0)
    trial, sample = (int(i) for i in np.unravel_index(int(magnitudes.argmax()), magnitudes.shape))
    if magnitudes[trial, sample] < 0:
        return undecided("no two trials reached the same sample with different inputs")
    b = float(magnitudes[trial, sample])
    return _compared(evidence, b, "b the largest realised ratio", Standing.SUPPORTED, evidence.witness(trial, sample))


def _compared(
    evidence: Evidence, b: float, how: str, holds: Standing, place: dict[str, object] | None = None
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
        standing=holds if law.lam > least else Standing.REFUTED,
        margin=law.lam - least,
        unit=lambda_unit(evidence),
        witness={**(place or {}), **witness},
        method=f"lambda = {law.lam:.4g} against (rho b)^2/4 = {least:.4g}, {how}; the margin is their difference",
    )


def estimator_bounded(evidence: Evidence) -> Finding:
    """The estimate stays bounded and keeps the sign of phi(k,1): the largest one of the run, by trial and sample."""
    magnitudes = np.where(np.isfinite(evidence.estimate), np.abs(evidence.estimate), -1.0)
    trial, sample = (int(i) for i in np.unravel_index(int(magnitudes.argmax()), magnitudes.shape))
    turned = np.argwhere(np.sign(evidence.estimate) * np.sign(evidence.estimate[0]) < 0)
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
    if turned.size:
        place = {"trial": int(turned[0, 0]) + 1, "sample": int(turned[0, 1])}
        return Finding(standing=Standing.REFUTED, witness={**witness, **place}, method="an estimate has the other sign")
    return Finding(
        standing=Standing.SUPPORTED,
        margin=float(magnitudes[trial, sample]),
        unit=evidence.unit,
        witness=witness,
        method=f"the margin is the largest of all recorded estimates; the reset (13) fires at {100 * idle:.3g} % of "
        f"places for small du, at {100 * small:.3g} % for a small or turned phi; the median excitation share is "
        f"{median:.2g}" + (f", and would be one half with mu = {du**2:.2g}" if median < 0.5 else ""),
    )


def theorem_printed(evidence: Evidence, mse: Array) -> Finding:
    """Theorem 1's argument: |1 - rho phi_c phi/(lam + phi^2)| < 1 at every trial and sample that was reached.

    ``mse`` is the law's mean square error by trial, which the method quotes. Where trials differ by more than their
    inputs the ratio phi_c is no answer to an input, and neither side can be told from it.
    """
    if (unlike := same_but_for_the_input(evidence.study, evidence.law)) is not None:
        return undecided(unlike)
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
        standing=Standing.REFUTED if refuted else Standing.SUPPORTED,
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


class Monotone(NamedTuple):
    """The error's map between trials, I - G L, at the last trial."""

    lifted: Lifted
    gain: sparse.csr_matrix[np.float64]
    singular: SingularValue
    diagonal: Array
    """Diagonal of I - G L, (m,): the asymptotic factors."""


def error_map(campaign: Campaign, evidence: Evidence) -> Monotone | str:
    """Return I - G L with its largest singular value, or why it cannot be had.

    G is taken along the last trial's plan, L from the law after the last trial as if it had reached the horizon.
    """
    law = evidence.law
    if law.learns_on is None:
        return "the law does not learn between trials"
    if (acts := plan_alone(law, campaign.study)) is not None:
        return f"{acts}, so the error's map between trials is not I - G L"
    if law.places:
        return "the law also moves the state in which a trial begins, so the error's map between trials is not I - G L"
    study, plant = campaign.study, campaign.study.plant_that_runs
    memory, left = deque(memories(campaign, evidence.controller), maxlen=1).pop()
    plant_map = lifted_along(plant, evidence)
    full = left._replace(y=rerun_output(plant, left, evidence.trajectories.w[-1]))
    operator = gain(campaign, evidence.controller, memory, full, study.horizon)
    m, degree = plant_map.size, evidence.degree
    if operator is None:
        return "the law filters its whole plan, so the next error is not (I - G L) e of the last one"
    onto = _on_signal(operator, evidence.increment)[:m, degree:]
    whole = Lifted(plant_map.line, degree, increment=evidence.increment)
    square = onto.tocsr()

    def apply(e: Array) -> Array:
        return np.asarray(e - whole.apply(np.asarray(square @ e)))

    def adjoint(e: Array) -> Array:
        return np.asarray(e - square.T @ whole.adjoint(e))

    off, own = whole.row_sums()
    gains = abs(square).sum(axis=1)
    largest = float(np.max(np.ravel(gains)))
    upper = 1 + float((off + own).max()) * largest * np.sqrt(m)
    singular = largest_singular_value(apply, adjoint, m, upper)
    return Monotone(whole, square, singular, 1 - whole.diagonal() * square.diagonal())


def rerun_output(plant: Plant, left: TrialRecord, w: Array) -> Array:
    """Return the output of a recorded plan run to the horizon, (1, N + 1), under the trial's disturbances."""
    _, y = rollout(plant, left.x[:, 0], np.nan_to_num(left.u[0]), w)
    full = np.array(left.y)
    full[0] = y
    return full


def _on_signal(operator: sparse.csc_matrix[np.float64], increment: bool) -> sparse.csr_matrix[np.float64]:
    """Return the gain on the learned signal, (N, N + 1): for increments, errors are running sums of its errors.

    Column j of the result is then the sum of the gain's columns from j on, which a law on increments leaves banded.
    """
    result = sparse.csr_matrix(operator)
    if not increment:
        return result
    result.sort_indices()
    running = np.concatenate([[0.0], np.cumsum(result.data)])
    ends = np.repeat(running[result.indptr[1:]], np.diff(result.indptr))
    result.data = ends - running[:-1]
    result.data[np.abs(result.data) < 1e-9 * np.abs(result.data).max()] = 0
    result.eliminate_zeros()
    return result


def monotone(found: Monotone | str) -> Finding:
    """The 2-norm of the error falls from every trial to the next: the largest singular value of I - G L is below 1.

    REFUTED when the amplification of one computed error exceeds 1, which needs no error bound; SUPPORTED when the
    Lanczos value with its residual stays below 1 (G along one trajectory, so never PROVED).
    """
    if isinstance(found, str):
        return undecided(found)
    value = found.singular
    peak = int(np.abs(value.vector).argmax())
    witness = {"singular_value": value.value, "residual": value.residual, "largest_entry_at_sample": peak}
    if value.value > 1 + 1e-9:
        standing = Standing.REFUTED
    elif value.value + value.residual < 1:
        standing = Standing.SUPPORTED
    else:
        return undecided(f"largest singular value {value.value:.6g} with residual {value.residual:.2g} is too near 1")
    return Finding(
        standing=standing,
        margin=1 - value.value,
        unit="1",
        witness=witness,
        method=f"Lanczos on O(N) products, residual {value.residual:.2g}, G along the last trial's plan; the margin is "
        "1 minus the largest singular value",
    )


def asymptotic(found: Monotone | str, reach: Array) -> Finding:
    """The error vanishes as trials go on: every diagonal entry of I - G L lies in (-1, 1).

    ``reach`` (m,) is the probability that a trial reaches the sample: the expected factor is 1 - p(k) (G L)_kk.
    """
    if isinstance(found, str):
        return undecided(found)
    worst = int(np.abs(found.diagonal).argmax())
    expected = 1 - reach * (1 - found.diagonal)
    slowest = int(np.abs(expected).argmax())
    margin = float(1 - np.abs(found.diagonal).max())
    return Finding(
        standing=Standing.SUPPORTED if margin > 0 else Standing.REFUTED,
        margin=margin,
        unit="1",
        witness={
            "sample": worst,
            "factor": float(found.diagonal[worst]),
            "slowest_expected_at_sample": slowest,
            "expected_factor": float(expected[slowest]),
            "reach_probability": float(reach[slowest]),
        },
        method="diagonal of the lower triangular I - G L along the last trial's plan, and with the probability that a "
        f"trial reaches the sample; the margin is 1 minus the largest |entry|: the slowest sample keeps "
        f"{100 * (1 - margin):.6g} % of its error from trial to trial",
    )


def peak(observed: Array, predicted: Array) -> Finding:
    """The frozen map I - G L predicts the largest MSE of the campaign within a factor of 3."""
    if not np.size(predicted):
        return undecided("there is no map I - G L to predict with")
    usable = np.isfinite(observed)
    seen = float(np.max(observed[usable]))
    said = float(np.nanmax(predicted))
    witness = {
        "observed_peak": seen,
        "observed_at_trial": int(np.where(usable, observed, -1).argmax()) + 1,
        "predicted_peak": said,
        "predicted_at_trial": int(np.nan_to_num(predicted, nan=-1.0).argmax()) + 1,
    }
    ratio = max(seen / said, said / seen) if said > 0 and seen > 0 and np.isfinite(said) else np.inf
    return Finding(
        standing=Standing.SUPPORTED if ratio <= 3 else Standing.REFUTED,
        margin=finite(3 - ratio),
        unit="factor",
        witness=witness,
        method="I - G L frozen at the last trial, run from the first trial's error with the recorded trial lengths; "
        f"the peaks differ by a factor of {ratio:.3g}, the margin is 3 minus that",
    )


def predicted_mse(found: Monotone, e0: Array, lengths: NDArray[np.int64], signal_sum: bool) -> Array:
    """Return the MSE by trial that the frozen map predicts from a first error e0 (m,) and the trial lengths."""
    u = np.zeros_like(e0)
    result = np.full(len(lengths), np.nan)
    for i, length in enumerate(lengths):
        e = e0 - found.lifted.apply(u)
        shown = np.cumsum(e) if signal_sum else e
        result[i] = np.mean(shown[:length] ** 2)
        if not np.isfinite(result[i]) or result[i] > 1e30:
            break
        known = np.where(np.arange(e.size) < length, e, 0.0)
        u = u + found.gain @ known
    return result
