"""What an adversary chooses in a campaign: gains, lengths, starts, parameters, disturbances and noise, trial by trial.

Chance alone stays in the middle of what is possible: many free choices average out. So an adversary has habits: it
learns only where that moves the input one way, only from some sample on, keeps a parameter at an end, cuts trials
short for a while. What has reached far is kept and changed a little.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.array import Array
from models.errors import InvalidValue
from workbench.contracts.law import LearnedSignal

GAINS = ("full", "least", "random", "blocks", "rising", "falling", "rising, falling", "falling, rising")
COURSES = ("low", "high", "alternating", "blocks", "random")
FIXABLE = ("parameters", "start", "disturbance")
RENEWED = 0.3  # share of trials whose choices are changed in a campaign that takes after another


@dataclasses.dataclass(frozen=True, kw_only=True, eq=False)
class Possible:
    """What can come in a campaign over N samples of a plant with one input and one measured output.

    Intervals are pairs (low, high). Raises InvalidValue where they are none, or of another shape.
    """

    reference: Array
    """The output that is wanted, (N + 1,)."""
    first_plan: Array
    """The input of trial 1, (N,)."""
    gain: tuple[Array | float, Array | float]
    """l in u + l e, of input over output units, each end a number or (N,); any value, at any sample of any trial."""
    start: tuple[Array, Array]
    """x(0), each end (nx,)."""
    learns_on: LearnedSignal = "increment"
    """``increment``: e = r(k+1) - r(k) - (y(k+1) - y(k)); ``output``: e = r(k+1) - y(k+1); of the measured output."""
    shortest: int = 1
    """Samples that every trial has at least; at most N."""
    parameters: tuple[Array, Array] = (np.zeros(0), np.zeros(0))
    """Each end (np,)."""
    disturbance: tuple[Array, Array] = (np.zeros(0), np.zeros(0))
    """Each end (nw,) or (nw, N)."""
    noise: float = 0.0
    """Bound of what is added to the measured output."""
    fixed: Sequence[str] = ()
    """Which of parameters, start and disturbance stay what they are in all trials of a campaign."""
    scored: int | None = None
    """Samples over which the mean square error is taken, of trials that reach as far; None: N."""

    def __post_init__(self) -> None:
        n = self.samples
        if n < 1 or np.shape(self.reference) != (n + 1,):
            raise InvalidValue(
                f"the reference must hold one value more than the first plan ({n + 1}), got {np.size(self.reference)}"
            )
        if not (np.isfinite(self.reference).all() and np.isfinite(self.first_plan).all()):
            raise InvalidValue("the reference and the first plan must be finite numbers, got one that is not")
        for name, (low, high) in (("gain", self.gain), ("start", self.start), *self._others()):
            fine = np.shape(low) == np.shape(high) and np.all(np.isfinite(low) & np.isfinite(high))
            if not fine or not np.all(np.asarray(low) <= high):
                raise InvalidValue(
                    f"{name} must lie between two ends of finite numbers, the smaller first, got {low} and {high}"
                )
        if np.min(self.gain[0]) < 0 or np.shape(self.gain[0]) not in ((), (n,)):
            raise InvalidValue(f"the gain must be at least 0, a number or {n} of them, got {self.gain[0]}")
        if self.learns_on not in ("increment", "output"):
            raise InvalidValue(f"a law learns on the increment or the output, got {self.learns_on!r}")
        for name, count in (("shortest", self.shortest), ("scored", n if self.scored is None else self.scored)):
            if not 1 <= count <= n:
                raise InvalidValue(f"{name} must be a number of samples from 1 to {n}, got {count}")
        if not 0 <= self.noise < np.inf:
            raise InvalidValue(f"the bound of the noise must be a number of at least 0, got {self.noise}")
        if unknown := set(self.fixed) - set(FIXABLE):
            raise InvalidValue(f"fixed may name {', '.join(FIXABLE)}; got {', '.join(sorted(unknown))}")

    def _others(self) -> tuple[tuple[str, tuple[Array, Array]], ...]:
        return (("parameters", self.parameters), ("disturbance", self.disturbance))

    @property
    def samples(self) -> int:
        """N."""
        return int(np.size(self.first_plan))

    @property
    def scored_samples(self) -> int:
        """Samples over which the mean square error is taken."""
        return self.samples if self.scored is None else self.scored


class Choices(NamedTuple):
    """All that was chosen for one trial, as plain numbers and words: with them it can be run again."""

    length: int
    gain: str
    first: int
    """The sample from which on it learns; before it the gain is the least one."""
    last: int
    """The sample up to which it learns, not included."""
    turn: int
    """The sample at which it turns from rising to falling or back."""
    start: tuple[float, ...]
    parameters: tuple[float, ...]
    disturbance: str
    disturbance_seed: int
    noise: str
    seed: int
    """Of gains and noise, where they are random."""


def impossible(possible: Possible, chosen: Sequence[Choices]) -> str | None:
    """Return what of a campaign's choices cannot come, or None."""
    for one in chosen:
        if not possible.shortest <= one.length <= possible.samples:
            return f"a trial must have {possible.shortest} to {possible.samples} samples, got {one.length}"
        for name, values, (low, high) in (
            ("start", one.start, possible.start),
            ("parameters", one.parameters, possible.parameters),
        ):
            if len(values) != np.size(low) or not np.all((np.asarray(values) >= low) & (np.asarray(values) <= high)):
                return f"{name} must lie between {low} and {high}, got {list(values)}"
    if chosen and _fixed(possible, chosen) != tuple(chosen):
        return f"{', '.join(possible.fixed)} must stay what they are throughout a campaign, got others"
    return None


def fresh(possible: Possible, trials: int, rng: np.random.Generator, gain: str | None = None) -> tuple[Choices, ...]:
    """Return the choices of a campaign by an adversary whose habits are drawn.

    With a kind of gain, all trials are whole and learn in this way from their first sample to their last.
    """
    steady = rng.random() < 0.7  # one way of learning in all trials: only so does an input come to an end
    drawn = [_drawn(possible, rng)]
    drawn += [drawn[0] if steady else _drawn(possible, rng) for _ in range(trials - 1)]
    starts = _values(possible.start, trials, rng)
    parameters = _values(possible.parameters, trials, rng)
    lengths = _lengths(possible, trials, rng)
    if gain is not None:
        drawn = [one._replace(gain=gain, first=0, last=possible.samples) for one in drawn]
        lengths = [possible.samples] * trials
    seeds = rng.integers(2**32, size=(trials, 2))
    made = [
        one._replace(
            length=lengths[i],
            start=starts[i],
            parameters=parameters[i],
            disturbance_seed=int(seeds[i, 0]),
            seed=int(seeds[i, 1]),
        )
        for i, one in enumerate(drawn)
    ]
    return _fixed(possible, made)


def after(possible: Possible, parent: Sequence[Choices], rng: np.random.Generator) -> tuple[Choices, ...]:
    """Return a campaign's choices with some changed: those of some trials, or one kind of choice in all of them."""
    other = fresh(possible, len(parent), rng)
    changed = [name for name in Choices._fields if rng.random() < RENEWED]
    everywhere = rng.random() < 0.5
    children = []
    for one, new in zip(parent, other, strict=True):
        taken = {name: value for name, value in new._asdict().items() if name in changed}
        children.append(one._replace(**taken) if everywhere or rng.random() < RENEWED else one)
    return _fixed(possible, children)


def _fixed(possible: Possible, chosen: Sequence[Choices]) -> tuple[Choices, ...]:
    """Return choices of which those that stay the same throughout a campaign are those of its first trial."""
    kept = {name: value for name, value in chosen[0]._asdict().items() if name.split("_")[0] in possible.fixed}
    return tuple(one._replace(**kept) for one in chosen)


def _drawn(possible: Possible, rng: np.random.Generator) -> Choices:
    """Return one way of learning, with courses of disturbance and noise; values are put in later."""
    n = possible.samples
    first, last = 0, n
    if rng.random() < 0.6:
        cut = int(rng.integers(n))
        first, last = ((cut, n), (0, cut + 1), tuple(sorted((cut, int(rng.integers(n)) + 1))))[int(rng.integers(3))]
    return Choices(
        length=n,
        gain=str(rng.choice(GAINS)),
        first=first,
        last=last,
        turn=int(rng.integers(n)),
        start=(),
        parameters=(),
        disturbance=str(rng.choice(COURSES)),
        disturbance_seed=0,
        noise=str(rng.choice(COURSES)),
        seed=0,
    )


def _lengths(possible: Possible, trials: int, rng: np.random.Generator) -> list[int]:
    """Return how long trials are: all of them whole, short ones first, short and whole in turn, or as it comes."""
    n, habit = possible.samples, int(rng.integers(4))
    short = int(rng.integers(possible.shortest, n + 1))
    if habit == 0:
        return [n] * trials
    if habit == 1:
        return [short if i < trials // 2 else n for i in range(trials)]
    if habit == 2:
        return [n if i % 2 else short for i in range(trials)]
    return [int(one) for one in rng.integers(possible.shortest, n + 1, trials)]


def _values(ends: tuple[Array, Array], trials: int, rng: np.random.Generator) -> list[tuple[float, ...]]:
    """Return numbers of an interval by trial: always at one end, at both in turn, at either, or anywhere."""
    low, high = (np.asarray(end, dtype=float) for end in ends)
    side = rng.integers(0, 2, low.size)
    shares = (
        np.tile(side, (trials, 1)),
        (side + np.arange(trials)[:, None]) % 2,
        rng.integers(0, 2, (trials, low.size)),
        rng.random((trials, low.size)),
    )[int(rng.integers(4))]
    values = np.where(shares == 1, high, np.clip(low + shares * (high - low), low, high))  # rounding keeps its place
    return [tuple(row) for row in values.tolist()]


def gains(possible: Possible, chosen: Choices, error: Array, rng: np.random.Generator) -> Array:
    """Return l at the samples of the error that is learned from, same shape."""
    n = error.size
    low, high = (np.broadcast_to(np.asarray(end, dtype=float), possible.samples)[:n] for end in possible.gain)
    k = np.arange(n)
    match chosen.gain:
        case "least":
            wanted = low
        case "random":
            wanted = low + rng.random(n) * (high - low)
        case "blocks":
            wanted = np.where(_blocks(n, rng), high, low)
        case "rising":
            wanted = np.where(error > 0, high, low)
        case "falling":
            wanted = np.where(error < 0, high, low)
        case "rising, falling":
            wanted = np.where(np.where(k < chosen.turn, error, -error) > 0, high, low)
        case "falling, rising":
            wanted = np.where(np.where(k < chosen.turn, -error, error) > 0, high, low)
        case "full":
            wanted = high
        case _:
            raise InvalidValue(f"a gain is chosen as one of {', '.join(map(repr, GAINS))}; got {chosen.gain!r}")
    return np.where((k >= chosen.first) & (k < chosen.last), np.clip(wanted, low, high), low)


def course(kind: str, ends: tuple[Array | float, Array | float], samples: int, rng: np.random.Generator) -> Array:
    """Return a course of one value between two ends, numbers or (samples,): shape (samples,)."""
    low, high = (np.broadcast_to(np.asarray(end, dtype=float), samples) for end in ends)
    match kind:
        case "low":
            return low.copy()
        case "high":
            return high.copy()
        case "alternating":
            return np.where((np.arange(samples) + int(rng.integers(2))) % 2 == 0, low, high)
        case "blocks":
            return np.where(_blocks(samples, rng), high, low)
        case "random":
            within: Array = np.clip(low + rng.random(samples) * (high - low), low, high)
            return within
        case _:
            raise InvalidValue(f"a course is chosen as one of {', '.join(map(repr, COURSES))}; got {kind!r}")


def _blocks(samples: int, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Return which samples are at the high end where ends change in blocks of one length, (samples,)."""
    period = 1 + int(samples ** rng.random())
    sides: NDArray[np.bool_] = rng.random(samples // period + 1) < 0.5
    return sides.repeat(period)[:samples]
