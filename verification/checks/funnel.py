"""The funnel: what every trial of a law that learns on increments stays in, whatever its estimate does. Ours.

Let z(k+1) = y(k+1) - y(k) = F(x(k), u(k), k) with F continuous and rising in u, and let the *target* t(x, k) be the
input with F(x, t, k) = r(k+1) - r(k). A law that learns u(k) <- u(k) + l e_z(k+1) with 0 <= l <= l_max has at the
state that is there e_z(k+1) = B (t(x(k), k) - u(k)), B the mean slope of F by u between u(k) and t. Where l_max B <= 1
the next input lies between this one and its target. So with X(0) around every initial state,

    U(k) = hull(u_1(k), t(X(k), k)),    X(k+1) = f(X(k), U(k), k)

hold u_i(k) and x_i(k) of every trial i that reaches k: by induction over k, and within it over the trials. A sample
that a trial does not reach keeps its input. Nothing is asked of the estimate, of the trial lengths, or of slopes by the
state. Where l_max B lies between 1 and 2, inputs overshoot by less than they were off, and
U(k) = m +- max(|u_1 - m|, w a/(2 - a)) does, with m and w the middle and half the width of t(X(k), k) and
a = l_max B. From 2 on there is no funnel.

What changes from trial to trial enters as an interval: initial states, disturbances, quantities of the plant.
Measurement noise of up to nu widens what is wanted by 2 nu. A quantity that is not known but stays the same may be
split: each part has a funnel of its own, and the funnel of all is around them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from itertools import product

import casadi as ca
import numpy as np

from models.array import Array
from models.plant import Plant
from verification.enclosure import outward
from verification.enclosure.box import Box
from verification.enclosure.outward import Span
from verification.enclosure.recursion import Carried, Question, Recursion
from verification.enclosure.rounding import rounding
from workbench.contracts.claim import Range
from workbench.contracts.law import LearningGain
from workbench.contracts.number import after_number
from workbench.contracts.scope import Scope, symbolic_plant
from workbench.contracts.study import Study

WIDEST = 10.0
"""A band is of no use that is wider than so many times the range of the reference."""
SPLIT = 16
"""Parts that a quantity is split into which stays the same in all trials."""
MOST_PARTS = 256
PLACES = 8 * 2.0**-53
"""What the differences of error and output round, of the largest magnitudes."""


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Open:
    """Why there is no funnel, and at which sample; -1 where it is none of one sample."""

    reason: str
    sample: int = -1


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Funnel:
    """Sets that hold every trial, sample by sample, and what they were made with."""

    sets: Carried
    gain: LearningGain
    same: tuple[str, ...]
    """Quantities for which it holds only where they stay the same in all trials; those of the scope may else change."""
    parts: int
    """How many parts they were split into."""

    @property
    def slopes(self) -> tuple[float, float]:
        """The ends of the slope of the output's gain by the input, over all samples."""
        return float(self.sets.slope[:, 0].min()), float(self.sets.slope[:, 1].max())

    @property
    def reach(self) -> float:
        """The largest l_max B."""
        return self.gain.high * self.slopes[1]


class Maker:
    """Makes funnels of a study's law, within a scope, from a first plan (N,)."""

    def __init__(self, study: Study, gain: LearningGain, scope: Scope, plan: Array, samples: int | None = None) -> None:
        self.study, self.gain, self.scope = study, gain, scope
        self.plan, self.samples = plan, study.horizon if samples is None else samples
        self.reference = study.reference_samples[0][: self.samples + 1]
        plant, symbols = symbolic_plant(study, scope.parameters)
        self.plant: Plant = plant
        self.symbols = [_symbol(one) for one in symbols.values()]
        self.recursion = Recursion(plant, self.samples, self.symbols)

    def question(self, values: Mapping[str, Range] | None = None, carried: Carried | None = None) -> Question:
        """Return what a pass is asked; with the sets of another, what doubles round is carried besides."""
        n, scope = self.samples, self.scope
        low, high = (one[:, :n].T for one in scope.disturbance)
        parameters = scope.parameters if values is None else values
        ends = np.array([[one.low, one.high] for one in parameters.values()]).reshape(-1, 2)
        noise = 2 * float(scope.noise[0])
        jolt = np.zeros(len(self.plant.states))
        if carried is not None:
            jolt, more = self._rounded(carried, ends)
            noise += more
        return Question(
            start=scope.start,
            disturbance=np.stack([low, high], axis=-1),
            parameters=ends,
            wanted=wanted(self.reference, noise),
            plan=np.repeat(self.plan[:n, None], 2, axis=1),
            most_gain=self.gain.high,
            jolt=jolt,
        )

    def _rounded(self, carried: Carried, ends: Array) -> tuple[Array, float]:
        """Return what one sample rounds of the states, and what the law rounds of the increments of the error."""
        at = self.plant.symbols()
        p = ca.vertcat(*self.symbols) if self.symbols else ca.SX(0, 1)
        x_next, y = self.plant.next_state(**at), self.plant.measured(at["x"])
        y_next = ca.substitute(y, at["x"], x_next)
        step = ca.Function("step", [*at.values(), p], [x_next, y, y_next], [*at, "p"], ["x_next", "y", "y_next"])
        low, high = self.scope.disturbance
        within = {
            "x": _around(carried.x),
            "u": _around(carried.u[:, None]),
            "w": (low.min(axis=1, initial=np.inf), high.max(axis=1, initial=-np.inf))
            if low.size
            else (np.zeros(0), np.zeros(0)),
            "k": (0.0, float(max(self.samples - 1, 0))),
            "p": (ends[:, 0], ends[:, 1]),
        }
        off = rounding(step, Box(within, whole=("k",)))
        largest = float(np.abs(carried.y).max() + np.abs(self.reference).max() + self.scope.noise[0])
        return off["x_next"].ravel(), PLACES * largest + 4 * float(off["y"].max()) + float(off["y_next"].max())

    def carry(self, question: Question) -> Carried | Open:
        """Return the sets, or why they are not to be had."""
        if not np.isfinite(question.start).all() or not np.isfinite(question.disturbance).all():
            return Open(reason="what trials begin with, or are disturbed by, has no bound")
        if not np.isfinite(question.wanted).all():
            return Open(reason="measurement noise has no bound")
        found = self.recursion.carry(question)
        if found.ended != "fine":
            return Open(reason=self._why(found), sample=found.sample)
        return self.of_use(found)

    def of_use(self, found: Carried) -> Carried | Open:
        """Return sets that are narrow enough and lie where the equations mean something, or why not."""
        scale = scale_of(self.study)
        width = found.y[:, 1] - found.y[:, 0]
        wide = np.flatnonzero(width > WIDEST * scale)
        if wide.size:
            k, signal = int(wide[0]), self.plant.outputs[0]
            unit = after_number(signal.unit)
            return Open(
                reason=f"at sample {k} the band of the {signal.name} is {width[k]:.4g}{unit} wide, more than "
                f"{WIDEST:g} times the range of the reference ({scale:.4g}{unit}): of no use",
                sample=k,
            )
        for i, signal in enumerate(self.plant.states):
            if (left := _leaves(signal.domain, found.x[:, i])) is not None:
                return self._leaves(signal.name, signal.unit, left, found.x[left, i])
        for signal, ends in ((self.plant.outputs[0], found.y), (self.plant.inputs[0], found.u)):
            if (left := _leaves(signal.domain, ends)) is not None:
                return self._leaves(signal.name, signal.unit, left, ends[left])
        return found

    def _leaves(self, name: str, unit: str, k: int, ends: Array) -> Open:
        return Open(
            reason=f"at sample {k} the band of the {name}, {ends[0]:.4g} to {ends[1]:.4g}{after_number(unit)}, leaves "
            "the domain in which the equations mean something",
            sample=k,
        )

    def _why(self, found: Carried) -> str:
        """Say in a sentence why a pass ended."""
        k = found.sample
        ranges = [
            f"{signal.name} {low:.4g} to {high:.4g}{after_number(signal.unit)}"
            for signal, (low, high) in zip(self.plant.states, found.x[min(k, self.samples)], strict=True)
        ]
        where, force = f"at sample {k} ({', '.join(ranges)})", self.plant.inputs[0].name
        output = self.plant.outputs[0].name
        if found.ended == "unreached":
            return (
                f"{where} no {force} was found that gives the {output} the reference's increment from every state of "
                "the set: its limits, or a slope that vanishes, lie before"
            )
        if found.ended == "not rising":
            return f"{where} the increment of the {output} was not shown to rise with the {force}"
        if found.ended == "gain":
            b = float(found.slope[k, 1])
            return f"{where} l_max B must stay below 2, it is {self.gain.high * b:.4g}: lower the learning gain"
        if found.ended == "undefined":
            return f"{where} the equations, or their slope by the {force}, have no bound: something ends or jumps there"
        return f"{where} the band is beyond all numbers"


def scale_of(study: Study) -> float:
    """Return the range of the reference, or its size where it is constant; infinite where it is zero throughout."""
    reference = study.reference_samples[0]
    return float(np.ptp(reference)) or float(np.abs(reference).max()) or np.inf


def funnel(maker: Maker) -> Funnel | Open:
    """Return the funnel of a law within a scope, or why there is none.

    It is one for quantities that may change from trial to trial. Where there is none, and those that the scope names
    stay the same in the study, it is sought for each part of their ranges.
    """
    found = maker.carry(maker.question())
    if isinstance(found, Carried):
        return Funnel(sets=found, gain=maker.gain, same=(), parts=1)
    scope = maker.scope
    same = [name for name, one in scope.parameters.items() if name not in scope.moving and one.low < one.high]
    if not same:
        return found
    parts = parts_of(scope.parameters, same)
    made = []
    for values in parts:
        one = maker.carry(maker.question(values))
        if isinstance(one, Open):
            return one
        made.append(one)
    sets = maker.of_use(around(made))
    return sets if isinstance(sets, Open) else Funnel(sets=sets, gain=maker.gain, same=tuple(same), parts=len(parts))


def with_rounding(maker: Maker, found: Funnel) -> Carried | None:
    """Return the funnel with what doubles round carried as noise: what recorded trials stay in, exactly."""
    made = []
    for values in parts_of(maker.scope.parameters, found.same):
        question = maker.question(values, found.sets)
        if not np.isfinite(question.wanted).all() or question.jolt is None or not np.isfinite(question.jolt).all():
            return None
        made.append(maker.recursion.carry(question))
        if made[-1].ended != "fine":
            return None
    return around(made)


def around(sets: Sequence[Carried]) -> Carried:
    """Return the sets around several, sample by sample."""
    first = sets[0]
    if len(sets) == 1:
        return first
    return Carried(
        x=_hull([one.x for one in sets]),
        y=_hull([one.y for one in sets]),
        u=_hull([one.u for one in sets]),
        target=_hull([one.target for one in sets]),
        slope=_hull([one.slope for one in sets]),
        after=_hull([one.after for one in sets]),
        ended=first.ended,
        sample=first.sample,
    )


def _hull(ends: Sequence[Array]) -> Array:
    """Return what is around several ranges, whose last axis holds their ends."""
    return np.stack([np.min([one[..., 0] for one in ends], axis=0), np.max([one[..., 1] for one in ends], axis=0)], -1)


def wanted(reference: Array, noise: float) -> Array:
    """Enclose the reference's increments, (N, 2), widened by what noise may add to a measured one, if that is known."""
    if not np.isfinite(noise):
        return np.tile([-np.inf, np.inf], (len(reference) - 1, 1))
    gained = outward.sub(Span(reference[1:], reference[1:]), Span(reference[:-1], reference[:-1]))
    spread = np.full(len(reference) - 1, noise)
    return np.stack(outward.add(gained, Span(-spread, spread)), axis=-1)


def parts_of(parameters: Mapping[str, Range], same: Sequence[str]) -> list[Mapping[str, Range]]:
    """Return the parts of the ranges of quantities that stay the same in all trials, the others whole."""
    if not same:
        return [parameters]
    each = max(1, min(SPLIT, int(MOST_PARTS ** (1 / len(same)) + 1e-9)))
    cuts = {name: np.linspace(parameters[name].low, parameters[name].high, each + 1) for name in same}
    found: list[Mapping[str, Range]] = []
    for places in product(range(each), repeat=len(same)):
        values = dict(parameters)
        for name, i in zip(same, places, strict=True):
            values[name] = Range(float(cuts[name][i]), float(cuts[name][i + 1]), parameters[name].unit)
        found.append(values)
    return found


def _around(ends: Array) -> tuple[Array, Array]:
    """Return the least and the largest of ends by sample, (samples, signals, 2)."""
    return np.nanmin(ends[..., 0], axis=0), np.nanmax(ends[..., 1], axis=0)


def _leaves(domain: tuple[float | None, float | None] | None, ends: Array) -> int | None:
    """Return the first sample at which ends (samples, 2) leave a domain, or None."""
    low, high = domain or (None, None)
    out = np.zeros(len(ends), dtype=bool)
    if low is not None:
        out |= ends[:, 0] < low
    if high is not None:
        out |= ends[:, 1] > high
    return int(np.argmax(out)) if out.any() else None


def _symbol(symbol: object) -> ca.SX:
    assert isinstance(symbol, ca.SX)
    return symbol
