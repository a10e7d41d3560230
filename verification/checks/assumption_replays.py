"""Witnesses of refuted assumptions, once more: recorded trials run again, and slopes of the compiled plant."""

from __future__ import annotations

import numpy as np

from models.plant import Plant
from models.quantity import InvalidValue
from verification.checks import assumptions, continuity
from verification.checks.delayed import delayed_output
from verification.checks.points import Witness, derivative_at, point_of
from workbench.evidence.ppd import Evidence, learned_signal
from workbench.evidence.trajectory import rollout


def place_of(witness: Witness) -> tuple[int, int]:
    """Return trial (from 0) and sample of a witness. Raises InvalidValue for one without."""
    trial, sample = witness.get("trial"), witness.get("sample")
    if not isinstance(trial, int) or not isinstance(sample, int):
        raise InvalidValue("a witness is replayed with its trial and sample: verify again")
    return trial - 1, sample


def _differences(plant: Plant, evidence: Evidence, witness: Witness) -> tuple[float, float]:
    """Return du(k) and ds(k+d) of a trial and the one before, both run again over their recorded inputs."""
    trial, sample = place_of(witness)
    taken = evidence.trajectories
    if not 0 < trial < taken.u.shape[0]:
        raise InvalidValue(f"the witness must be of trials 2 to {taken.u.shape[0]}, got {trial + 1}")
    signals = [
        learned_signal(rollout(plant, taken.x[i, :, 0], np.nan_to_num(taken.u[i]), taken.w[i])[1], evidence.increment)
        for i in (trial - 1, trial)
    ]
    du = float(taken.u[trial, sample] - taken.u[trial - 1, sample])
    return du, float((signals[1] - signals[0])[sample + evidence.degree])


def ratio_at(plant: Plant, evidence: Evidence, witness: Witness) -> float:
    """Return the realised ratio at a witness's trial and sample, both trials being run again."""
    du, ds = _differences(plant, evidence, witness)
    if du == 0:
        raise InvalidValue("the inputs of the witness do not differ at its sample")
    return ds / du


def replay_sign(plant: Plant, evidence: Evidence, witness: Witness) -> float:
    """Return the ratio of a witness of A4, or the slope where the witness is a point."""
    return slope_at(plant, evidence, witness) if "point" in witness else ratio_at(plant, evidence, witness)


def replay_lemma(plant: Plant, evidence: Evidence, witness: Witness) -> float:
    """Return minus how far the signal moved where its input did not, or as :func:`replay_vanishing`."""
    if "ratios" in witness or "across" in witness:
        return replay_vanishing(plant, evidence, witness)
    du, ds = _differences(plant, evidence, witness)
    return -abs(ds) if du == 0 else abs(ds)


def replay_vanishing(plant: Plant, evidence: Evidence, witness: Witness) -> float:
    """Return minus the last ratio of two plans that a witness of A2 says how to make, both run; or minus a jump."""
    if "across" in witness:
        return continuity.replay(plant, evidence.degree, witness)
    trial, k = place_of(witness)
    j, kept, du = (witness.get(name) for name in ("earlier_sample", "kept", "du"))
    if not isinstance(j, int) or not isinstance(kept, float) or not isinstance(du, list) or not du:
        raise InvalidValue("a witness is replayed with earlier_sample, kept and du: verify again")
    taken = evidence.trajectories
    plan, x0, w = taken.u[trial], taken.x[trial, :, 0], taken.w[trial]
    other = plan.copy()
    other[j] += kept
    other[k] += float(du[-1])
    ends = [
        learned_signal(rollout(plant, x0, one, w)[1], evidence.increment)[k + evidence.degree] for one in (plan, other)
    ]
    return -abs(float(ends[1] - ends[0]) / float(du[-1]))


def replay_across(plant: Plant, evidence: Evidence, witness: Witness) -> float:
    """Return the largest row sum along the last trial less the ratio of a witness's two plans, both run."""
    trial, m = place_of(witness)
    taken, plans = evidence.trajectories, witness.get("plans")
    samples = taken.u.shape[1]
    made = np.asarray(plans if isinstance(plans, list) else [], dtype=float)
    if made.shape != (2, samples) or not 0 <= trial < taken.u.shape[0] or not evidence.degree <= m <= samples:
        raise InvalidValue(f"a witness is replayed with two plans of {samples} samples: verify again")
    ends = [
        learned_signal(rollout(plant, taken.x[trial, :, 0], plan, taken.w[trial])[1], evidence.increment)[m]
        for plan in made
    ]
    du = float(np.abs(made[1] - made[0])[: m - evidence.degree + 1].max())
    if not du > 0:
        raise InvalidValue("the plans of a witness must differ before its sample, and are the same")
    off, own = assumptions.lifted_along(plant, evidence).row_sums()
    along = float((off + own).max())
    return (along if np.isfinite(along) else 0.0) - float(abs(ends[1] - ends[0])) / du


def slope_at(plant: Plant, evidence: Evidence, witness: Witness) -> float:
    """Return ds(k+d)/du(k) at a witness's point, by differentiating the compiled plant."""
    f = delayed_output(plant, evidence.degree, increment=evidence.increment)
    return derivative_at(f, point_of(witness))
