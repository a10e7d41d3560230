"""What the draws of an ato campaign show: gains, jerk, learning and the error integrals of every start."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import cast

import numpy as np
import xarray as xr

from models.actuator import delayed
from models.array import Array
from studies.ato.effects import CANCELS, effects
from studies.ato.evidence import Drawn, Evidence, Immune
from studies.ato.scores import FOUR, better_all_four, gains, jerks, slopes
from studies.ato.study import own
from verification.checks.linear_loop import critical_gain, incremental_pid
from verification.checks.shares import in_words
from workbench.contracts.finding import Finding, Grounds, undecided
from workbench.contracts.study import Study
from workbench.trials.campaign import run

JERK_LIMIT = 0.75
LEARNS = 0.01
Witness = Mapping[str, object]


def fell(evidence: Evidence, names: Sequence[str]) -> str:
    """Return in how many draws a law did not reach the end of its run, or nothing where all did."""
    for name in names:
        lost = int((~np.isfinite(evidence.metric(name, "ise"))).sum())
        if lost:
            of = evidence.drawn.sizes["draw"]
            return f"{name} did not reach the end of its run in {lost} of {of} draw(s), which so say nothing of it"
    return ""


def alone(study: Study, witness: Witness) -> xr.Dataset:
    """Return the record of the draw of a witness, run by itself from its seed."""
    one = dataclasses.replace(study, seed=int(str(witness["seed"])), draws=1)
    return run(one, show_progress=False).data


def _tries(values: Array) -> tuple[Grounds, int, str]:
    """Return the grounds of what was seen in draws, how many there are, and that in words."""
    if (values == values[0]).all():
        return Grounds.RUN, 1, "one run: nothing of it is drawn" if values.size > 1 else "one draw of the weights"
    return Grounds.TRIES, values.size, f"{values.size} draws of the weights"


def loop_gain(study: Study, law: Immune) -> float:
    """Return the least critical gain over the dead times of a test, infinity where there is none."""
    bare, found = own(study).plant, []
    for late in sorted(set(own(study).dead_times.tolist())):
        plant = delayed(bare, late * float(bare.sampling_time))
        linear = plant.linearised([0.0] * len(plant.states), [0.0] * len(plant.inputs))
        found.append(critical_gain(linear * incremental_pid(law.ki, law.kd, float(plant.sampling_time))))
    return min(found)


def below_critical(evidence: Evidence, name: str) -> Finding:
    """Check that the largest gain of all draws stays below the critical one."""
    if said := fell(evidence, [name]):
        return undecided(said)
    critical = loop_gain(evidence.study, cast(Immune, evidence.study.controllers[name]))
    largest = evidence.metric(name, "gain_max")
    worst = evidence.worst(largest)
    gain = float(largest[worst.at])
    grounds, tries, said = _tries(largest)
    method = (
        f"{said}; poles of the loop linearised from the symbolic plant, at its longest and its shortest dead time; the "
        "gain varies, so neither side of the limit decides stability by itself"
    )
    if np.isinf(critical):
        return Finding(
            grounds=Grounds.NUMERICS, holds=gain < critical, tries=tries, method=f"{method}; no gain is critical"
        )
    return Finding(
        grounds=Grounds.NUMERICS if grounds is Grounds.RUN else grounds,
        margin=critical - gain,
        unit="1",
        tries=tries,
        bound=gain,
        bound_unit="1, the largest p1 - p2 f",
        witness={
            **worst.witness,
            "sample": int(np.nanargmax(gains(evidence.signals(worst.at), name))),
            "p1 - p2 f": gain,
            "critical gain": critical,
            "draws above": int(np.sum(largest >= critical)),
        },
        method=method,
    )


def below_critical_margin(study: Study, name: str, witness: Witness) -> float:
    """Return the margin of :func:`below_critical` in the draw and at the sample of a witness."""
    gain = gains(alone(study, witness), name)[int(str(witness["sample"]))]
    return loop_gain(study, cast(Immune, study.controllers[name])) - float(gain)


def small_jerk(evidence: Evidence, name: str) -> Finding:
    """Check that the jerk of all draws stays below the limit."""
    if said := fell(evidence, [name]):
        return undecided(said)
    jerk = evidence.metric(name, "max_jerk")
    worst = evidence.worst(jerk)
    largest = float(jerk[worst.at])
    grounds, tries, said = _tries(jerk)
    beyond = int((jerk >= JERK_LIMIT).sum())
    share = f": {in_words(beyond, tries, 'draws beyond')}" if tries > 1 else ""
    return Finding(
        grounds=grounds,
        margin=JERK_LIMIT - largest,
        unit="m/s^3",
        tries=tries,
        bound=largest,
        bound_unit="m/s^3, the largest jerk",
        witness={
            **worst.witness,
            "sample": int(np.argmax(_jerks(evidence.study, evidence.signals(worst.at), name))) + 1,
            "jerk": largest,
        },
        method=f"second differences of the recorded speed, {said}{share}",
    )


def small_jerk_margin(study: Study, name: str, witness: Witness) -> float:
    """Return the margin of :func:`small_jerk` in the draw and at the sample of a witness."""
    return JERK_LIMIT - float(_jerks(study, alone(study, witness), name)[int(str(witness["sample"])) - 1])


def _jerks(study: Study, data: xr.Dataset, name: str) -> Array:
    y = data["output"].sel(controller=name).values[-1, :-1]
    return jerks(y, float(study.plant.sampling_time))


def right_sign(evidence: Evidence) -> Finding:
    """Check that the finite difference has the sign of dy/du(k), that of the output which u(k) reaches first."""
    if said := fell(evidence, ["bp-fipid"]):
        return undecided(said)
    found = effects(evidence.study)
    if not found.told:
        return undecided(CANCELS)
    if not found.least > 0:
        return undecided("the plant's derivative is not positive at every sample, which the recorded share assumes")
    shares = evidence.metric("bp-fipid", "wrong_sign_share")
    worst = evidence.worst(shares)
    dy, du = slopes(evidence.signals(worst.at), "bp-fipid")
    k = _clearest(evidence.study, dy, du)
    degree = int(found.degrees[k])
    grounds, tries, said = _tries(shares)
    return Finding(
        grounds=grounds,
        margin=0.0 - float(shares[worst.at]),
        unit="of the samples of a draw have the wrong sign",
        weak=True,
        tries=tries,
        bound=float(np.mean(shares)),
        bound_unit="of all samples have the wrong sign",
        witness={
            **worst.witness,
            "sample": k,
            "y(k) - y(k-1)": float(dy[k - 1]),
            "u(k) - u(k-1)": float(du[k - 1]),
            f"dy(k+{degree})/du(k)": found.slope(k),
        },
        method=f"finite differences of the record against the derivative of the output that u(k) reaches first, {said}",
    )


def right_sign_margin(study: Study, witness: Witness) -> float:
    """Return the margin of :func:`right_sign` in the draw of a witness: 0, or minus the share of wrong signs."""
    dy, du = slopes(alone(study, witness), "bp-fipid")
    return 0.0 - float(np.mean(np.sign(dy * du) < 0))


def _clearest(study: Study, dy: Array, du: Array) -> int:
    """Return the sample at which output and input change most in opposite directions, of those whose input arrives."""
    arrives = effects(study).degrees[1 : dy.size + 1] > 0
    return int(np.argmin(np.where(arrives, dy * du, np.inf))) + 1


def learns(evidence: Evidence) -> Finding:
    """Check that learning lowers the median ISE of the draws by more than a share."""
    if said := fell(evidence, ["bp-fipid", "bp-frozen"]):
        return undecided(said)
    learned, frozen = (evidence.metric(name, "ise") for name in ("bp-fipid", "bp-frozen"))
    a, b = float(np.median(learned)), float(np.median(frozen))
    gained = 1 - a / b
    worst = evidence.worst(learned / frozen)
    return Finding(
        grounds=Grounds.TRIES,
        margin=gained - LEARNS,
        unit="of the ISE of frozen weights",
        tries=learned.size,
        bound=gained,
        bound_unit="of the ISE of frozen weights",
        witness={
            "median ISE learned": a,
            "median ISE frozen": b,
            "gained": gained,
            "least favourable": worst.witness,
            "its ISE learned and frozen": [float(learned[worst.at]), float(frozen[worst.at])],
        },
        method=f"medians over {learned.size} draw(s), each learned and frozen from the same start",
    )


def better_in_all(evidence: Evidence, against: str) -> Finding:
    """Check that the four error integrals lie below those of another law in every draw that was run."""
    if said := fell(evidence, ["bp-fipid", against]):
        return undecided(said)
    ratios = _ratios(evidence, against)
    worst = evidence.worst(ratios.max(axis=1))
    largest = float(ratios[worst.at].max())
    return Finding(
        grounds=Grounds.TRIES,
        margin=1 - largest,
        unit=f"of the index of {against}",
        tries=ratios.shape[0],
        bound=better_all_four(evidence.drawn, "bp-fipid", against),
        bound_unit="of the draws are better on all four",
        witness={**worst.witness, "index": FOUR[int(np.argmax(ratios[worst.at]))], "ratio": largest},
        method=_counted(ratios),
    )


def better_in_all_margin(study: Study, against: str, witness: Witness) -> float:
    """Return the margin of :func:`better_in_all` in the draw of a witness."""
    data = alone(study, witness).isel(trial=-1)
    return 1 - max(float(data[i].sel(controller="bp-fipid") / data[i].sel(controller=against)) for i in FOUR)


def better_in_most(evidence: Evidence, against: str) -> Finding:
    """Check that the four error integrals lie below those of another law in more than half of the draws."""
    if said := fell(evidence, ["bp-fipid", against]):
        return undecided(said)
    ratios = _ratios(evidence, against)
    share = better_all_four(evidence.drawn, "bp-fipid", against)
    worst: Drawn = evidence.worst(ratios.max(axis=1))
    return Finding(
        grounds=Grounds.TRIES,
        margin=share - 0.5,
        unit="of the draws",
        tries=ratios.shape[0],
        bound=share,
        bound_unit="of the draws are better on all four",
        witness={
            "share of draws better on all four": share,
            **{f"median {i} relative to {against}": float(np.median(ratios[:, n])) for n, i in enumerate(FOUR)},
            "furthest off": worst.witness,
            "its largest ratio": float(ratios[worst.at].max()),
        },
        method=_counted(ratios),
    )


def _ratios(evidence: Evidence, against: str) -> Array:
    return np.stack([evidence.metric("bp-fipid", i) / evidence.metric(against, i) for i in FOUR], axis=1)


def _counted(ratios: Array) -> str:
    tries = ratios.shape[0]
    worse = int((ratios >= 1).any(axis=1).sum())
    return f"better on all four in {tries - worse} of {tries} draw(s); {in_words(worse, tries, 'are not')}"
