"""What runs of the maglev study show: periodicity, the fall of V, growth from period to period, windup, noise."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import cast

import casadi as ca
import numpy as np

from models.array import Array
from models.expression import as_expression
from studies.maglev import lyapunov, period_contraction
from studies.maglev.evidence import Evidence, Shuttling
from studies.maglev.published import PUBLISHED_GAIN, PUBLISHED_STEP
from studies.maglev.study import NOISY
from verification.certificates.numbers import numbers
from workbench.contracts.certificate import Certificate
from workbench.contracts.finding import Finding, Grounds, undecided
from workbench.controllers.parts.shuttle_force import errors
from workbench.trials.campaign import Campaign

SLACK = 0.01
"""Growth a period that ``period_contraction`` lets pass: holding the force over a sample costs some 0.1 %."""
SAMPLED = 0.1
"""Share by which V may fall otherwise under a held force than under one that follows the errors at every instant."""
POSITIVE = "alpha, lambda and k are positive."
GROWING = 10
"""Periods at the end over which ``saturation_windup`` looks for growth."""


def sliding(campaign: Campaign, name: str) -> Array:
    """Return S of every whole period that a controller ran, shape (periods, N + 1), m/s."""
    data = campaign.data.sel(controller=name)
    lam = cast(Shuttling, campaign.study.controllers[name]).lam
    r = as_expression(ca.DM(data["reference"].values))
    rows = []
    for y in data["output"].values:
        if np.isfinite(y).all():
            s = errors(r, as_expression(ca.DM(y)), as_expression(ca.DM(lam))).s
            rows.append(ca.DM(s).full()[0])
    return np.array(rows)


def periodicity(evidence: Evidence, name: str) -> Finding:
    """Compare the true line resistance of every period with the one before."""
    d = evidence.campaign.data["line_resistance"].sel(controller=name).values
    d, planned = d[np.isfinite(d).all(axis=1)], evidence.study.trials
    if d.shape[0] < 2:
        return undecided("fewer than two whole periods were run: give more")
    changes = np.abs(np.diff(d, axis=0)).max(axis=1)
    limit = 0.01 * float(np.abs(d).max())
    if d.shape[0] < planned:
        return Finding(
            holds=d.shape[0] == planned,
            method=f"the law was stopped as diverged after {d.shape[0]} of {planned} periods",
            witness={"last": changes[-1], "limit": limit, "whole_periods": d.shape[0], "periods": planned},
        )
    at = int(np.argmax(np.abs(d[-1] - d[-2])))
    return Finding(
        tries=changes.size,
        method="largest |d(t + P) - d(t)| along the run, by period; a whole position is never repeated exactly",
        margin=limit - float(changes[-1]),
        weak=True,
        unit="N",
        bound=float(changes[-1]),
        bound_unit="N",
        witness={"first": changes[0], "last": changes[-1], "limit": limit, "periods": d.shape[0], "at_sample": at},
    )


def fall_of_V(evidence: Evidence, name: str) -> lyapunov.Fall:
    """Measure V at the end of every period."""
    law = evidence.learner(name)
    data = evidence.campaign.data.sel(controller=name)
    S = sliding(evidence.campaign, name)
    if S.shape[0] < 2:
        return lyapunov.Fall(np.empty(0), np.empty(0), S.shape[0], evidence.study.trials)
    d, d_hat = (data[key].values[: S.shape[0], :-1] for key in ("line_resistance", "law_line_resistance"))
    step, mass = float(evidence.train.sampling_time), float(evidence.train.mass)
    fell = lyapunov.decrease(S, d, d_hat, step, law.alpha, law.gamma, mass)
    return lyapunov.Fall(*fell, S.shape[0], evidence.study.trials)


def positivity(evidence: Evidence, name: str) -> Finding:
    """Compare the gains with zero."""
    law = evidence.learner(name)
    k = Fraction(law.gamma) * Fraction(evidence.train.mass)
    gains = {"alpha": Fraction(law.alpha), "lambda": Fraction(law.lam), "k": k}
    least = min(gains, key=lambda gain: gains[gain])
    return Finding(
        grounds=Grounds.SETTINGS,
        method="comparison of the numbers; sufficient only without lag, dead time and sampling",
        margin=float(gains[least]),
        unit={"k": "kg/s"}.get(least, "1/s"),
        witness={gain: float(value) for gain, value in gains.items()},
    )


def positive(evidence: Evidence, name: str) -> Certificate:
    """Return the certificate that the gains are positive."""
    law = evidence.learner(name)
    gamma, mass = Fraction(law.gamma), Fraction(evidence.train.mass)
    return numbers(
        POSITIVE,
        {
            "alpha": (Fraction(law.alpha), "1/s"),
            "lambda": (Fraction(law.lam), "1/s"),
            "k": (gamma * mass, "kg/s"),
            "k over M": (gamma, "1/s"),
            "M": (mass, "kg"),
        },
        ("=", "k", ("*", "k over M", "M")),
        *((">", gain, 0) for gain in ("alpha", "lambda", "k")),
    )


def contraction(evidence: Evidence, name: str, case: str) -> Finding:
    """Predict the factor of every harmonic, and compare the largest with its growth in the run."""
    loop, period = evidence.loop(name, case), evidence.run.period
    w, factor = period_contraction.worst(period, loop)
    campaign = evidence.variant(case=case)
    S = sliding(campaign, name)
    grown = period_contraction.observed(S[:, :-1], period, w) if S.shape[0] > 2 else float("nan")
    if not np.isfinite(grown):
        return undecided("fewer than three whole periods were run, or S never changed: no growth to observe")
    larger = max(factor, grown)
    if S.shape[0] < campaign.study.trials and larger <= 1 + SLACK:
        return undecided(f"the law was stopped as diverged after {S.shape[0]} of {campaign.study.trials} periods")
    return Finding(
        tries=S.shape[0] - 1,
        method="factor of S from one period to the next at the harmonics up to 5 Hz, from the loop's transfer function "
        "with the force held over a sample; observed: mean growth around the worst one over the last five periods",
        margin=1 + SLACK - larger,
        weak=True,
        unit="1",
        bound=larger,
        bound_unit="1",
        witness={"frequency_rad_per_s": w, "predicted": factor, "observed": grown},
    )


def saturation_windup(evidence: Evidence, name: str) -> Finding:
    """Limit the force below what is needed and watch the learned resistance."""
    free = evidence.study.actuator.lower is None and evidence.study.actuator.upper is None
    unlimited = () if free else ("actuator.lower=null", "actuator.upper=null")
    first = evidence.variant(*unlimited).data["input"].sel(controller=name).values[0]
    limit = 0.9 * float(np.nanmax(np.abs(first)))
    campaign = evidence.variant(
        f"actuator.lower={-limit!r}", f"actuator.upper={limit!r}", f"trials={max(25, evidence.study.trials)}"
    )
    sizes = np.abs(campaign.data["law_line_resistance"].sel(controller=name).values[:, :-1]).max(axis=1)
    whole = sizes[np.isfinite(sizes)]
    if whole.size < sizes.size:
        return Finding(
            holds=whole.size == sizes.size,
            method=f"the law was stopped as diverged after {whole.size} of {sizes.size} periods with the force "
            f"limited to {limit:.0f} N either way",
            witness={"force_limit": limit, "whole_periods": whole.size, "periods": sizes.size},
        )
    growth = float(whole[-1] - whole[-1 - GROWING]) / GROWING
    return Finding(
        tries=sizes.size,
        method=f"{sizes.size} periods with the force limited to {limit:.0f} N either way, 90 % of the largest force of "
        f"period 1: growth of the largest learned resistance over the last {GROWING} periods",
        margin=0.01 * limit - growth,
        unit="N a period",
        witness={"force_limit": limit, "largest_learned": whole[-1], "growth": growth},
    )


def gain_as_published(evidence: Evidence) -> Finding:
    """Look at the published gain and step with the study's gains and mass."""
    law = evidence.learner(evidence.learners[0])
    mass = float(evidence.train.mass)
    return period_contraction.sampled_gain(law.alpha, law.lam, PUBLISHED_GAIN, mass, PUBLISHED_STEP)


def replayed_gain(witness: Mapping[str, object]) -> float:
    """Return the margin of ``gain_as_published`` at a witness, s."""
    alpha, lam, k, mass, step = (float(str(witness[name])) for name in ("alpha", "lambda", "k", "mass", "step"))
    return float(-period_contraction.least_excess(alpha, lam, k, mass, step))


def noise_claim(evidence: Evidence) -> Finding:
    """Compare PALC's last period with and without noise on the force."""
    name = evidence.learners[0]
    key = "max_position_error_last"
    silent = () if evidence.force_psd == 0 else ("disturbance.force_psd=0",)
    quiet = evidence.variant(*silent).scores()[name][key]
    noisy = evidence.variant(case=NOISY).scores()[name][key]
    if quiet is None:
        return undecided("the law diverged without noise: there is no last period to compare with")
    witness = {"controller": name, "without_noise": quiet, "with_noise": noisy}
    method = "the study run with and without noise; noise is not periodic, so learning stores it for the next period"
    if noisy is None:
        return Finding(holds=noisy is not None, method=f"{method}; with noise the law diverged", witness=witness)
    return Finding(method=method, margin=quiet - noisy, weak=True, unit="m", witness=witness)
