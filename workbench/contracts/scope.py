"""The scope of a proof: what trials may meet for which it is stated, and where the study may meet something else."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from models.array import Array
from models.expression import Expression
from models.plant import Plant, Signal
from models.quantity import InvalidValue, is_declared, symbolised, walked
from models.users_code import asking
from workbench.contracts import drawn
from workbench.contracts.claim import Range
from workbench.contracts.study import Study
from workbench.contracts.verifying import DISTURBANCE, INITIAL, NOISE, PLANT

ROUNDING = 4 * np.finfo(float).eps
"""By how much, relatively, an end that was named may miss what the study meets, and is moved there instead."""
LEAST_SHARE = 1e-12


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Scope:
    """What the trials that a proof speaks of may meet."""

    parameters: Mapping[str, Range]
    """Values of the true plant's quantities, by path within the plant: those that are an interval, or were named."""
    moving: frozenset[str]
    """The quantities that the study itself changes from trial to trial."""
    start: Array
    """Where trials begin, (states of the plant that runs, 2)."""
    disturbance: tuple[Array, Array]
    """Low and high, each (disturbances, N): sample by sample where it repeats, else its bounds."""
    noise: Array
    """The largest magnitude, (outputs,)."""
    open: tuple[str, ...]
    """What the study may meet beyond the scope, or without a bound, in words; empty: the scope contains the study."""
    plant: Plant
    """The plant that runs."""
    named: frozenset[str]
    """The names that the study gives a range itself."""

    def shown(self) -> Mapping[str, Range]:
        """Return what is an interval or was named, by its name in words (``plant mass``, ``noise speed``)."""
        low, high = self.disturbance
        rows = [
            *((f"{PLANT}{name}", one) for name, one in self.parameters.items()),
            *_rows(INITIAL, self.plant.states, self.start[:, 0], self.start[:, 1]),
            *_rows(NOISE, self.plant.outputs, -self.noise, self.noise),
        ]
        anew = [at for at, (a, b) in enumerate(zip(low, high, strict=True)) if (a != b).any()]
        rows += [
            (f"{DISTURBANCE}{one.name}", Range(float(low[at].min()), float(high[at].max()), one.unit))
            for at, one in enumerate(self.plant.disturbances)
            if at in anew or f"{DISTURBANCE}{one.name}" in self.named
        ]
        return {name.replace(".", " ", 1): one for name, one in rows if one.low != one.high or name in self.named}


def scope_of(study: Study) -> Scope:
    """Return the scope of proofs: what the study may meet, and for what ``verify.scope`` names, what that says.

    Raises InvalidValue where a kind of a user's own gives bounds that are none.
    """
    told: list[str] = []
    parameters, moving = _parameters(study, told)
    return Scope(
        parameters=parameters,
        moving=moving,
        start=_start(study, told),
        disturbance=_disturbance(study, told),
        noise=_noise(study, told),
        open=tuple(told),
        plant=study.plant_that_runs,
        named=frozenset(study.verify.scope),
    )


def symbolic_plant(study: Study, paths: Iterable[str]) -> tuple[Plant, dict[str, Expression]]:
    """Return the plant that runs with quantities of the plant as symbols, and these symbols by path, in that order.

    Whatever the plant computes from a quantity follows its symbol. Raises InvalidValue for what is no quantity of it.
    """
    at = {drawn.path_that_runs(study, path): path for path in paths}
    made = symbolised(study.plant_that_runs, only=frozenset(at))
    symbols = dict(zip(made.names, made.symbols, strict=True))
    for there, path in at.items():
        if there not in symbols:
            known = ", ".join(symbolised(study.plant).names)
            raise InvalidValue(f"a symbol may stand for one of: {known}; got {path!r}")
    return made.thing, {path: symbols[there] for there, path in at.items()}


def _parameters(study: Study, told: list[str]) -> tuple[dict[str, Range], frozenset[str]]:
    plant, departures, named = study.plant, study.scenario.truth, study.verify.within(PLANT)
    values = dict(zip(*symbolised(plant)[1::2], strict=True))
    units = {path: spec.unit for path, spec, _ in walked(plant, lambda spec, value: is_declared(value))}
    true = dict(zip(*symbolised(study.true_plant)[1::2], strict=True))
    moving = frozenset(name for name, one in departures.items() if not one.repeats)
    found: dict[str, Range] = {}
    for name in dict.fromkeys([*moving, *named]):
        met = _Ends(true[name], true[name])
        if name in moving:
            met = _Ends(*sorted(values[name] * factor if values[name] else 0.0 for factor in departures[name].range))
        held = _held(f"{PLANT}{name}", units[name], named.get(name), met, told)
        found[name] = Range(*held, units[name])
    return {name: found[name] for name in values if name in found}, moving


def _start(study: Study, told: list[str]) -> Array:
    initial, plant, runs = study.scenario.initial, study.plant, study.plant_that_runs
    named, goes_on = study.verify.within(INITIAL), study.continues and study.trials > 1
    if initial.repeats:
        met = np.repeat(drawn.starts(study)[0][:, None], 2, axis=1)
    else:
        met = _bounds(initial.bound, plant, (len(plant.states), 2))
    # an actuator's own states begin at zero
    start = np.vstack([met, np.zeros((len(runs.states) - len(met), 2))])
    if goes_on:
        told.append("a trial begins where the last one ended, so nothing bounds where trials begin")
        start[:] = -math.inf, math.inf
    for at, signal in enumerate(plant.states):
        ends = _Ends(float(start[at, 0]), float(start[at, 1]))
        # of trials that go on from one another it was said once
        start[at] = _held(f"{INITIAL}{signal.name}", signal.unit, named.get(signal.name), ends, [] if goes_on else told)
    return start


def _disturbance(study: Study, told: list[str]) -> tuple[Array, Array]:
    kind, plant, named = study.scenario.disturbance, study.plant, study.verify.within(DISTURBANCE)
    if kind.repeats:
        samples = drawn.disturbances_that_repeat(study)
        low, high = samples.copy(), samples.copy()
    else:
        bounds = _bounds(kind.bound, plant, (len(plant.disturbances), 2))
        low, high = (np.repeat(bounds[:, end, None], study.horizon, axis=1) for end in (0, 1))
    for at, signal in enumerate(plant.disturbances):
        ends = _Ends(float(low[at].min()), float(high[at].max()))
        name = f"{DISTURBANCE}{signal.name}"
        held = _held(name, signal.unit, named.get(signal.name), ends, told)
        if signal.name in named:
            low[at], high[at] = held
    return low, high


def _noise(study: Study, told: list[str]) -> Array:
    kind, plant, named = study.scenario.noise, study.plant, study.verify.within(NOISE)
    noise = _bounds(kind.bound, plant, (len(plant.outputs),))
    sizes = np.array(
        [named[one.name][1] if one.name in named else size for one, size in zip(plant.outputs, noise, strict=True)]
    )
    with asking("what the study draws", type(kind).beyond):
        beyond = np.asarray(kind.beyond(plant, sizes), dtype=float)
    for at, signal in enumerate(plant.outputs):
        ends, said = _Ends(-float(noise[at]), float(noise[at])), list[str]()
        noise[at] = _held(f"{NOISE}{signal.name}", signal.unit, named.get(signal.name), ends, said)[1]
        share = f"; {_share(float(beyond[at]))} of its samples lie beyond" if signal.name in named else ""
        told += [f"{sentence}{share}" for sentence in said]
    return noise


class _Ends(NamedTuple):
    """The least and the largest of something."""

    low: float
    high: float


def _held(name: str, unit: str, named: tuple[float, float] | None, met: _Ends, told: list[str]) -> _Ends:
    """Return what the scope holds of something, and tell what the study may meet beyond that, or without a bound."""
    endless = not (math.isfinite(met.low) and math.isfinite(met.high))
    if named is None:
        if endless:
            told.append(f"what the study meets of {name} has no bound: name a range for it in verify.scope")
        return met
    low, high = _met_but_for_rounding(named[0], met.low, min), _met_but_for_rounding(named[1], met.high, max)
    if not low <= met.low <= met.high <= high:
        if endless:
            meets = "what the study meets has no bound"
        elif met.low == met.high:
            meets = f"the study runs with {_number(met.low)}"
        else:
            meets = f"the study meets {_number(met.low)} to {_number(met.high)}"
        of = "" if unit in ("", "1") else f" {unit}"
        told.append(f"the scope holds {name} {_number(named[0])} to {_number(named[1])}{of}, and {meets}")
    return _Ends(low, high)


def _met_but_for_rounding(named: float, met: float, outer: Callable[[float, float], float]) -> float:
    """Return an end that was named, moved outwards to what is met where only rounding lies between the two."""
    return outer(named, met) if abs(named - met) <= ROUNDING * abs(named) else named


def _bounds(asked: Callable[[Plant], Array], plant: Plant, shape: tuple[int, ...]) -> Array:
    """Return what a part of a scenario gives as its bounds, or raise where these are none."""
    with asking("what bounds the study", asked):
        found = np.array(asked(plant), dtype=float)
        if found.shape != shape or np.isnan(found).any() or _low_above_high(found):
            raise InvalidValue(
                f"{asked.__qualname__} must give numbers of shape {shape}, low at most high; got {found.tolist()}"
            )
    return found


def _low_above_high(found: Array) -> bool:
    low, high = (-found, found) if found.ndim == 1 else (found[:, 0], found[:, 1])
    return bool((low > high).any())


def _rows(group: str, signals: Sequence[Signal], low: Array, high: Array) -> list[tuple[str, Range]]:
    ends = zip(signals, low.tolist(), high.tolist(), strict=True)
    return [(f"{group}{signal.name}", Range(a, b, signal.unit)) for signal, a, b in ends]


def _number(value: float) -> str:
    return repr(float(value)).removesuffix(".0")


def _share(share: float) -> str:
    if math.isnan(share):
        return "an unknown share"
    return f"less than {100 * LEAST_SHARE:g} %" if share < LEAST_SHARE else f"{100 * share:.3g} %"
