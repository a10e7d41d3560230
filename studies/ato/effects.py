"""When each input reaches the output, sample by sample: every k of the horizon is looked at, on the plant that runs."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from models.array import Array
from models.plant import Plant
from studies.ato.study import own
from verification.certificates.identity import Side, constant, identity
from verification.certificates.theorem import theorem
from verification.enclosure.interval import evaluate
from verification.enclosure.rewriting import rewritten
from workbench.contracts.certificate import Certificate
from workbench.contracts.claim import Held, NotCertified
from workbench.contracts.finding import Finding, Grounds, undecided
from workbench.contracts.study import Study

LIMIT = 100
"""Samples that an input is followed for."""
CANCELS = "u(k) stands in an output that it was not shown to change; a plant with constant derivatives would tell"
SYMBOLIC = "the symbolic plant composed step by step, for every k from 0 to {last}, derivatives rounded outward"


class Effects(NamedTuple):
    """Which output each input reaches first."""

    degrees: NDArray[np.int64]
    """Samples until u(k) first reaches y, by k; 0 where it never does."""
    low: Array
    """A lower bound of dy(k + j)/du(k), in row j - 1, by k."""
    high: Array
    """An upper bound of it."""
    told: bool
    """Whether every derivative before is zero and the one of the first output is not, for every state and input."""

    def slope(self, k: int) -> float:
        """Return the derivative of the output that u(k) reaches first, 0 where it reaches none."""
        degree = int(self.degrees[k])
        return float((self.low[degree - 1, k] + self.high[degree - 1, k]) / 2) if degree else 0.0

    @property
    def least(self) -> float:
        """A lower bound of all derivatives of the outputs that are reached first."""
        reached = np.flatnonzero(self.degrees)
        return float(self.low[self.degrees[reached] - 1, reached].min()) if reached.size else 0.0


def effects(study: Study) -> Effects:
    """Return what every input of a study's horizon reaches first."""
    return _effects(study.plant_that_runs, study.horizon)


@lru_cache(maxsize=8)
def _effects(plant: Plant, samples: int) -> Effects:
    degrees = plant.relative_degrees(samples, limit=LIMIT)
    longest = max(int(degrees.max()), 1)
    at = plant.symbols()
    x, first, inputs, disturbances, rows = at["x"], at["u"], [at["u"]], [at["w"]], []
    for after in range(longest):
        x = plant.next_state(x, inputs[-1], disturbances[-1], at["k"] + after)
        rows.append(ca.jacobian(plant.measured(x)[0], first[0]))
        inputs.append(ca.SX.sym("u", len(plant.inputs)))
        disturbances.append(ca.SX.sym("w", len(plant.disturbances)))
    derivatives = ca.vertcat(*rows)
    low, high = np.zeros((2, longest, samples))
    constant = not ca.depends_on(derivatives, ca.vertcat(at["x"], *inputs, *disturbances))
    graph = rewritten(ca.Function("effects", [at["k"]], [derivatives], ["k"], ["dy_du"])) if constant else ""
    if isinstance(graph, str):
        return Effects(degrees, low, high, False)
    k = np.arange(samples, dtype=float)[None, :]
    values = evaluate(graph, k, k, graph.targets())
    for entry in graph.outputs["dy_du"]:
        low[entry.row], high[entry.row] = values[entry.node].span
    row = np.arange(longest)[:, None]
    before = row < np.where(degrees == 0, longest, degrees - 1)
    hit = (row == degrees - 1) & (degrees > 0)
    told = bool(((low == 0) & (high == 0))[before].all() and ((low > 0) | (high < 0))[hit].all())
    return Effects(degrees, low, high, told)


def _later(plant: Plant, samples: int) -> ca.Function:
    """Return y(k+1), ..., y(k+j-1) as ``before`` and y(k+j) as ``effect`` of x(k), u(k), later inputs, all w and k."""
    at = plant.symbols()
    u = ca.SX.sym("u")
    later, w = ca.SX.sym("later", samples - 1), ca.SX.sym("w", len(plant.disturbances), samples)
    x, seen = at["x"], []
    for after in range(samples):
        x = plant.next_state(x, later[after - 1] if after else u, w[:, after], at["k"] + after)
        seen.append(plant.measured(x)[0])
    given, outputs = [at["x"], u, later, w, at["k"]], [ca.vertcat(*seen[:-1]), seen[-1]]
    return ca.Function("later", given, outputs, ["x", "u", "later", "w", "k"], ["before", "effect"])


def nothing_next_certificate(says: str, study: Study) -> Certificate:
    """Return the certificate that u(k) does not stand in y(k+1), for every state, input and k."""
    return identity(says, _later(study.plant_that_runs, 1), [(("effect", 0, 0, "u"), Fraction(0))])


def dead_time_certificate(says: str, study: Study) -> Certificate:
    """Return the certificate that u(k) stands in y(k+1+d) by a factor that is not 0, and in no output before.

    Raises NotCertified where dead times differ.
    """
    late = np.unique(own(study).dead_times)
    if late.size > 1:
        raise NotCertified(f"the dead time must be one for all samples, got {', '.join(map(str, late))} samples")
    of, first = _later(study.plant_that_runs, int(late[0]) + 1), ("effect", 0, 0, "u")
    nothing: list[tuple[Side, Side]] = [(("before", i, 0, "u"), Fraction(0)) for i in range(int(late[0]))]
    return theorem("effect", slopes=identity(says, of, [*nothing, (first, constant(of, first))]))


def seen_after(plant: Plant, k: int, limit: int = LIMIT) -> tuple[int, float]:
    """Return after how many samples a pulse of u at sample k is first seen in y, and its size; (0, 0) for never.

    The compiled plant runs from rest with the pulse and without.
    """
    step, output = _compiled(plant)
    rest = np.zeros(len(plant.states))
    pulsed, silent = rest, rest
    for after in range(1, limit + 1):
        push = 1.0 if after == 1 else 0.0
        pulsed = step(pulsed, push, k + after - 1).full().ravel()
        silent = step(silent, 0.0, k + after - 1).full().ravel()
        change = float(output(pulsed)) - float(output(silent))
        if change != 0:
            return after, change
    return 0, 0.0


@lru_cache(maxsize=8)
def _compiled(plant: Plant) -> tuple[ca.Function, ca.Function]:
    at = plant.symbols()
    calm = plant.next_state(at["x"], at["u"], ca.SX.zeros(*at["w"].shape), at["k"])
    return (
        ca.Function("step", [at["x"], at["u"], at["k"]], [calm]),
        ca.Function("output", [at["x"]], [plant.measured(at["x"])[0]]),
    )


def changes(degrees: NDArray[np.int64]) -> list[list[int]]:
    """Return from which k on which degree stands, pairs [k, degree]."""
    at = np.r_[0, np.flatnonzero(np.diff(degrees)) + 1]
    return [[int(k), int(degrees[k])] for k in at]


def nothing_next(study: Study) -> Finding:
    """Check that dy(k+1)/du(k) is zero at every k of the horizon."""
    found = effects(study)
    reached = found.degrees[found.degrees > 0]
    at_once = np.flatnonzero(found.degrees == 1)
    if at_once.size and not found.told:
        return undecided(CANCELS)
    if not reached.size:
        return undecided(f"no input reaches the output within {LIMIT} samples")
    k = int(at_once[0]) if at_once.size else int(np.argmax(found.degrees == reached.min()))
    return Finding(
        grounds=Grounds.ENUMERATION,
        margin=float(reached.min() - 1),
        unit="samples",
        bound=float(reached.min()),
        bound_unit="samples until an input first reaches the output, the fewest",
        witness={
            "k": k,
            "first reached": f"y(k+{found.degrees[k]})",
            "from k on, samples until u(k) is seen": changes(found.degrees),
            "never seen, k": np.flatnonzero(found.degrees == 0),
        },
        method=SYMBOLIC.format(last=study.horizon - 1),
    )


def nothing_next_margin(study: Study, witness: Mapping[str, object]) -> float:
    """Return the margin of :func:`nothing_next` at a witness: samples until its pulse is seen, less one."""
    return float(seen_after(study.plant_that_runs, int(str(witness["k"])))[0] - 1)


def held_by_pulses(study: Study, finding: Finding) -> Held:
    """Hold the fewest samples until an input is seen against pulses through the compiled plant.

    They are sent at some 300 samples spread over the horizon and about every k at which something changes.
    """
    found, plant = effects(study), study.plant_that_runs
    spread = range(0, study.horizon, max(study.horizon // 300, 1))
    switches = [k + near for k, _ in changes(found.degrees) for near in (-1, 0, 1)]
    at = sorted({k for k in (*spread, *switches) if 0 <= k < study.horizon})
    limit = int(found.degrees.max()) + 1
    seen = np.array([seen_after(plant, k, limit)[0] or np.inf for k in at])
    worst = int(np.argmin(seen))
    return Held(len(at), float(seen[worst] - (finding.bound or 0.0)), {"k": at[worst], "seen after": seen[worst]})


def held_by_dead_times(study: Study, _: Finding) -> Held:
    """Hold it against pulses through the compiled plant, at every sample whose pulse is seen within the horizon."""
    late, plant = own(study).dead_times, study.plant_that_runs
    inside = [k for k in range(study.horizon) if k + 1 + late[k] <= study.horizon]
    apart = [abs(seen_after(plant, k, int(late[k]) + 2)[0] - int(late[k]) - 1) for k in inside]
    worst = int(np.argmax(apart))
    return Held(len(inside), 0.0 - apart[worst], {"k": inside[worst]})


def by_dead_time(study: Study) -> Finding:
    """Check that u(k) first reaches y(k+1+d) at every k, d being the dead time that stands at sample k."""
    found, late = effects(study), own(study).dead_times
    inside = np.flatnonzero(np.arange(study.horizon) + 1 + late <= study.horizon)
    wrong = [int(k) for k in inside if found.degrees[k] != late[k] + 1]
    if not found.told:
        return undecided(CANCELS)
    witness: dict[str, object] = {"from k on, samples until u(k) is seen": changes(found.degrees)}
    if wrong:
        witness |= {
            "k": wrong,
            "dead time at k": late[wrong],
            "samples until u(k) is seen": found.degrees[wrong],
        }
    said = f"; otherwise at {len(wrong)} samples, k = {_few(wrong)}" if wrong else ""
    if never := [k for k in wrong if found.degrees[k] == 0]:
        said += f"; u(k) is never seen for k = {_few(never)}"
    return Finding(
        grounds=Grounds.ENUMERATION,
        margin=0.0 - len(wrong),
        unit="samples at which it is otherwise",
        weak=True,
        bound=found.least,
        bound_unit="dy/du of the outputs reached first, at least",
        witness=witness,
        method=f"{SYMBOLIC.format(last=study.horizon - 1)}; {inside.size} of them are seen within the horizon" + said,
    )


def _few(numbers: list[int], most: int = 8) -> str:
    return ", ".join(map(str, numbers[:most])) + (" ..." if len(numbers) > most else "")


def by_dead_time_margin(study: Study, witness: Mapping[str, object]) -> float:
    """Return the margin of :func:`by_dead_time` at a witness: at how many of its k a pulse is seen at another time."""
    at = np.asarray(witness["k"], dtype=int)
    late = np.asarray(witness["dead time at k"], dtype=int)
    seen = [seen_after(study.plant_that_runs, int(k))[0] for k in at]
    return 0.0 - float(sum(one != d + 1 for one, d in zip(seen, late, strict=True)))


def something_next(study: Study) -> Finding:
    """Check what is printed: that dy(k+1)/du(k) is not zero, at any k."""
    found = effects(study)
    if not found.told:
        return undecided(CANCELS)
    sizes = np.maximum(np.maximum(found.low[0], -found.high[0]), 0.0)
    k = int(np.argmin(sizes))
    return Finding(
        grounds=Grounds.ENUMERATION,
        margin=float(sizes[k]),
        unit="m/s a unit of the command",
        witness={
            "k": k,
            "dy(k+1)/du(k)": found.high[0, k],
            "u(k) is first seen in": f"y(k+{found.degrees[k]})" if found.degrees[k] else "no output",
            "k at which it is zero": int((found.degrees != 1).sum()),
        },
        method=SYMBOLIC.format(last=study.horizon - 1),
    )


def something_next_margin(study: Study, witness: Mapping[str, object]) -> float:
    """Return the margin of :func:`something_next` at a witness: how much a pulse at its k changes y(k+1)."""
    return abs(seen_after(study.plant_that_runs, int(str(witness["k"])), limit=1)[1])
