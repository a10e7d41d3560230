"""What the map between trials says of the error: whether its norm falls, and whether it vanishes in the end.

The map, and what is meant by its two kinds, M = I and M != I, is that of :mod:`verification.checks.trial_map`.
"""

from __future__ import annotations

import numpy as np

from models.array import Array
from verification.checks.spectral_radius import Radius
from verification.checks.trial_map import ROUNDING, ErrorMap, rms
from workbench.contracts.finding import Finding, Grounds, undecided
from workbench.contracts.number import finite
from workbench.evidence.closed_loop import LARGEST, product

ZERO = 1e-6  # of the first error: a limit's error below this is none


def monotone(found: ErrorMap | str) -> Finding:
    """The 2-norm falls from every trial to the next: the map's largest singular value is below 1.

    Of the error where M = I, of the plan's distance to its limit else. REFUTED when the amplification of one computed
    vector exceeds 1, which needs no error bound: the witness holds the vector, and
    :func:`verification.checks.error_map_replay.replay_monotone` applies it to the compiled plant. SUPPORTED when the
    Lanczos value with its residual stays below 1 and the record does not speak against it (the map is taken along one
    trajectory, so never PROVED).
    """
    if isinstance(found, str):
        return undecided(found)
    value = found.singular
    sum_of_both = value.value + value.residual
    if value.value > 1 + 1e-9:
        margin = 1 - value.value
    elif sum_of_both >= 1:
        return undecided(f"largest singular value {value.value:.6g} with residual {value.residual:.2g} is too near 1")
    elif found.fell is not None:
        return undecided(f"the law diverged at trial {found.fell}: the map along the last trial before says too little")
    elif found.unchanged and found.rose is not None:
        trial, factor = found.rose
        return undecided(
            f"along the last trial's plan the norm falls, but in the record it grew {factor:.4g} times from trial "
            f"{trial} to the next"
        )
    else:
        margin = 1 - sum_of_both
    return Finding(
        grounds=Grounds.NUMERICS,
        margin=margin,
        unit="1",
        witness={
            "trial": found.step.ran.trial,
            "of": _named(found),
            "singular_value": value.value,
            "residual": value.residual,
            "largest_entry_at_sample": int(np.abs(value.vector).argmax())
            + (found.signal.first if found.unchanged else 0),
            "first_sample": found.signal.first,
            "vector": value.vector.tolist(),
        },
        method=f"2-norm of the {_named(found)}; Lanczos on products with the map along trial {found.step.ran.trial}, "
        f"residual {value.residual:.2g}; the margin is 1 minus the largest singular value"
        + (" and its residual" if margin > 0 else ""),
    )


ERROR, INCREMENT, PLAN = "error of the output", "error of the output's increments", "plan's distance to its limit"


def _named(found: ErrorMap) -> str:
    """Return of what the 2-norm is taken."""
    if not found.unchanged:
        return PLAN
    return INCREMENT if found.signal.increment else ERROR


def asymptotic(found: ErrorMap | str, reach: Array) -> Finding:
    """The error vanishes as trials go on: the map's spectral radius is below 1, and its limit has no error.

    Of a lower triangular map (a law that looks no farther ahead than the plant's delay) the radius is the largest
    |diagonal entry|, exactly; of another it is enclosed by powers of the matrix. ``reach`` (m,) is the probability
    that a trial reaches the sample: where the map is triangular and M = I the expected factor is 1 - p(k) (G L)_kk.
    A law that fell, or ended with a larger error than it began with, is never SUPPORTED.
    """
    if isinstance(found, str):
        return undecided(found)
    radius = found.radius
    if radius is None:
        if not found.singular.value + found.singular.residual < 1:
            return undecided(
                f"the map between trials is not triangular, and a matrix of {found.size} rows is too "
                f"large for its spectral radius (at most {LARGEST})"
            )
        radius = Radius(0.0, found.singular.value + found.singular.residual)
    witness: dict[str, object] = {"trial": found.step.ran.trial, "radius_from": radius.low, "radius_to": radius.high}
    how = (
        f"spectral radius of the map along trial {found.step.ran.trial}, between {radius.low:.6g} and {radius.high:.6g}"
    )
    if found.triangular:
        witness |= _slowest(found, reach)
        how = f"diagonal of the lower triangular map along trial {found.step.ran.trial}"
    elif found.never_changed is not None:
        witness |= {"never_changed": found.never_changed, "radius_from": max(1.0, radius.low)}
        radius = Radius(max(1.0, radius.low), max(1.0, radius.high))
        how = (
            f"no error changes the plan at a sample, so the map along trial {found.step.ran.trial} has the eigenvalue 1"
        )
    exact = found.triangular or found.never_changed is not None
    if radius.low >= 1 and (exact or radius.low > 1 + 1e-9):
        return Finding(
            grounds=Grounds.NUMERICS, margin=1 - radius.low, unit="1", witness=witness,
            method=f"{how}; the margin is 1 minus the radius",
        )  # fmt: skip
    if not radius.high < 1:
        return undecided(f"{how}: it is not settled on which side of 1 it lies")
    if (against := _against(found)) is not None:
        return undecided(f"the map along trial {found.step.ran.trial} contracts, but {against}")
    kept = 100 * radius.high
    return _at_the_limit(
        found, witness, 1 - radius.high,
        f"{how}; the margin is 1 minus the radius: what falls slowest keeps {kept:.6g} % from trial to trial",
    )  # fmt: skip


def _slowest(found: ErrorMap, reach: Array) -> dict[str, object]:
    worst = int(np.abs(found.diagonal).argmax())
    expected = 1 - reach[-found.diagonal.size :] * (1 - found.diagonal)
    slowest = int(np.abs(expected).argmax())
    return {
        "sample": worst,
        "factor": float(found.diagonal[worst]),
        "slowest_expected_at_sample": slowest,
        "expected_factor": float(expected[slowest]),
        "reach_probability": float(reach[-found.diagonal.size :][slowest]),
    }


def _against(found: ErrorMap) -> str | None:
    """Return what the run says against an error that vanishes."""
    if found.fell is not None:
        return f"the law diverged at trial {found.fell}"
    first, last = float(found.mse[0]), float(found.mse[-1])
    least = ROUNDING * float(np.square(found.step.loop.r).max())
    return f"the mean square error went from {first:.4g} up to {last:.4g}" if last > max(first, least) else None


def _at_the_limit(found: ErrorMap, witness: dict[str, object], margin: float, how: str) -> Finding:
    """Return what is found of the limit of a map that contracts."""
    limit = found.limit
    if limit is None:
        return undecided(f"{how}; whether the limit has an error could not be computed")
    left, first = rms(limit.error), rms(product(found.signal.of, found.first))
    witness |= {"limit_error_rms": left, "first_error_rms": first}
    if left <= ZERO * first:
        return Finding(grounds=Grounds.NUMERICS, margin=margin, unit="1", witness=witness, method=how)
    if left < limit.away:
        return undecided(
            f"{how}; the limit lies too far from trial {found.step.ran.trial} to tell whether its error ({left:.4g} "
            "rms by the linear map) is zero: run more trials"
        )
    return Finding(
        grounds=Grounds.NUMERICS,
        margin=(ZERO * first - left) / first if first else finite(-np.inf),
        unit="first error",
        witness=witness | {"largest_limit_error_at_sample": int(np.abs(limit.error).argmax()) + found.signal.first},
        method=f"{how}; but the law stands still at an error of {left:.4g} rms, where the first trial's is {first:.4g}",
    )
