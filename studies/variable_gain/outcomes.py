"""What runs of the variable-gain study show, and what is proved of its laws held against them."""

from __future__ import annotations

import dataclasses
from typing import cast

import numpy as np

from studies.variable_gain.direct_term import measured_term
from studies.variable_gain.law_equations import SPEED as SPEED_ROW
from studies.variable_gain.law_equations import LawEquations
from studies.variable_gain.published import VariableLaw, compared, noisy, variable_law
from studies.variable_gain.scores import peaks
from studies.variable_gain.study import MISMATCH, NOT_LEARNED
from verification.checks.initial_state import held_against
from verification.checks.polynomial import Identity
from workbench.contracts.claim import Held
from workbench.contracts.finding import Finding, Standing, undecided
from workbench.contracts.law import AnyLaw
from workbench.controllers.fixed_gain import FixedGain
from workbench.evidence.variants import Variants
from workbench.trials.record import OUTPUT

POSITION, SPEED = 0.01, 5e-4
"""What counts as converged after all trials, m and m/s."""
GAIN_ROUNDING = 1e-9
"""What a factor that was computed from compiled equations may be off by."""


def position_only(evidence: Variants) -> Finding:
    """Run a law that learns from the slope of the position error."""
    law = FixedGain(lam=1.0, learns="position")
    errors = peaks(evidence.variant("noise.sigma=0", laws=(("position", law),)).data, "position", "position")
    planned, errors = errors.size, errors[np.isfinite(errors)]
    if errors.size < 2:
        return undecided("one trial shows no learning: give more trials")
    falls = -np.diff(errors)
    worst = int(np.argmin(falls))
    method = f"{errors.size} of {planned} trials of the study with lambda = 1 on the slope of the position error"
    witness = {
        "trial": worst + 2,
        "max_position_error": errors[worst + 1],
        "of_the_trial_before": errors[worst],
        "largest": errors.max(),
        "at_trial": int(np.argmax(errors)) + 1,
        "last": errors[-1],
    }
    if errors.size < planned and falls[worst] > 0:
        return Finding(
            holds=errors.size == planned, method=f"{method}, then it was stopped as diverged", witness=witness
        )
    return Finding(method=method, tries=errors.size - 1, margin=float(falls[worst]), unit="m", witness=witness)


def initial_state_ratio(law: LawEquations, ratio: Identity) -> Finding:
    """Prove the ratio by the law's own equations, and say what it is."""
    found = ratio.finding()
    if found.standing is not Standing.PROVED:
        return found
    factor = 1 - law.lam0
    return dataclasses.replace(
        found,
        holds=abs(factor) < 1,
        bound=float(factor),
        bound_unit="of the initial error",
        witness={"1 - lambda_0": float(factor)},
    )


def held_ratio(evidence: Variants, name: str, finding: Finding) -> Held:
    """Hold the ratio against the initial position errors of all recorded trials."""
    data = evidence.campaign.data.sel({"controller": name, OUTPUT: "position"}).isel(sample=0)
    errors = data["error"].values
    sizes = np.abs(errors) + np.abs(data["output"].values) + abs(float(data["reference"])) + np.nanmax(np.abs(errors))
    return held_against(errors, sizes, finding.bound or 0.0)


def held_gains(evidence: Variants, name: str, law: LawEquations, finding: Finding) -> Held:
    """Hold the largest |1 - b lambda| against the gains of all recorded trials, and against b in many states."""
    b, bound = float(measured_term(law.study.true_plant, SPEED_ROW)), finding.bound or 0.0
    told = evidence.campaign.data["law_learning_gain"].sel(controller=name).values if law.tells_gain else np.empty(0)
    told = told[np.isfinite(told)]
    lam = np.array([float(law.gains.low), float(law.gains.high)]) if not told.size else told
    factors = np.abs(1 - b * lam)
    worst = int(np.argmax(factors))
    return Held(int(lam.size), bound + GAIN_ROUNDING - float(factors[worst]), {"b": b, "lambda": float(lam[worst])})


def initial_learning_needed(evidence: Variants) -> Finding:
    """Run the study without initial-state learning."""
    data = evidence.variant("noise.sigma=0", case=NOT_LEARNED).data
    last = {
        name: (float(peaks(data, name, "position")[-1]), float(peaks(data, name, "speed")[-1]))
        for name in evidence.study.controllers
    }
    shares = {name: max(position / POSITION, speed / SPEED) for name, (position, speed) in last.items()}
    method = f"the study run in the case {NOT_LEARNED}, without noise"
    stopped = [name for name, share in shares.items() if not np.isfinite(share)]
    start = evidence.study.scenario.initial.draw(evidence.study.plant, 1, np.random.default_rng(evidence.study.seed))
    if stopped:
        return Finding(
            holds=not stopped,
            method=f"{method}: {stopped[0]} was stopped as diverged",
            witness={"controller": stopped[0], "initial_state": start[0]},
        )
    worst = max(shares, key=lambda name: shares[name])
    return Finding(
        method=method,
        tries=len(shares),
        margin=1 - shares[worst],
        unit="share of the tolerance",
        witness={
            "controller": worst,
            "max_position_error_last": last[worst][0],
            "max_speed_error_last": last[worst][1],
            "initial_state": start[0],
        },
    )


def noise_claim(evidence: Variants) -> Finding:
    """Compare the last trial's true speed error under noise."""
    last = noisy(evidence)
    variable, fixed = last["variable"], last["fixed-lam_min"]
    method = (
        "one run of the study with noise.sigma = 0.02 m/s: largest true speed error of the last trial. The gain is "
        "computed from the same noisy sample that it multiplies, so noise is learned with the largest gains; "
        "smoothing |e_v| over 1 s helps"
    )
    if fixed is None:
        return undecided("the fixed gain was stopped as diverged: there is no last trial to compare with")
    if variable is None:
        return Finding(
            holds=variable is not None, method=f"{method}; the variable gain was stopped as diverged", witness=last
        )
    return Finding(method=method, margin=fixed - variable, unit="m/s", witness={"max_speed_error_last": last})


def faster_than_fixed(evidence: Variants) -> Finding:
    """Compare the trials to tolerance of the variable gain and of a fixed gain of 1."""
    law = variable_law(evidence)
    laws: tuple[tuple[str, AnyLaw], ...] = (
        ("variable", law),
        ("fixed", compared(cast(VariableLaw, law), 1.0)),
    )
    scores = evidence.variant(laws=laws).scores()
    trials = {name: scores[name]["trials_to_tolerance"] for name, _ in laws}
    variable, fixed = trials["variable"], trials["fixed"]
    method, witness = "the same study run with both laws", {"trials_to_tolerance": trials}
    if variable is None and fixed is None:
        return undecided("neither law reached the tolerance: give more trials")
    if variable is None or fixed is None:
        one = "variable" if variable is None else "fixed"
        said = f"{method}: the {one} gain did not reach the tolerance"
        return Finding(holds=variable is not None, method=said, witness=witness)
    return Finding(method=method, margin=fixed - variable, unit="trials", witness=witness)


def mismatch_limit(evidence: Variants) -> Finding:
    """Run a fixed gain of 1 on a train whose input gain is 2.1 times the assumed one."""
    campaign = evidence.variant("noise.sigma=0", case=MISMATCH, laws=(("fixed", FixedGain(lam=1.0)),))
    peaked = peaks(campaign.data, "fixed", "speed")
    diverged = campaign.scores()["fixed"]["diverged_at_trial"]
    done = peaked[np.isfinite(peaked)]
    method = "the study with an input gain of 2.1 times the assumed one, without noise"
    witness = {"max_speed_error_first": done[0], "max_speed_error_last": done[-1], "trials": done.size}
    if diverged is not None or done.size < peaked.size:
        return Finding(
            holds=diverged is None and done.size == peaked.size,
            method=f"{method}; a watch over the slope of the speed error stops it as diverged",
            witness={**witness, "diverged_at_trial": diverged},
        )
    return Finding(method=method, margin=float(SPEED - done[-1]), unit="m/s", witness=witness)
