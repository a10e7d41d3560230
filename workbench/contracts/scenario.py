"""What a campaign meets: measurement noise, disturbances, where trials begin, and how the true plant differs.

Everything random comes from an explicit generator. A study takes a plain number or array in place of each.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import numpy as np

from models.array import Array
from models.plant import Plant
from models.quantity import Declaration, InvalidValue, declared, given, quantity, table


class Noise(Declaration, ABC):
    """What is added to the outputs that a controller sees."""

    @abstractmethod
    def draw(self, plant: Plant, samples: int, rng: np.random.Generator) -> Array:
        """Return one trial's noise, shape (outputs, samples), in the outputs' units."""

    @abstractmethod
    def bound(self, plant: Plant) -> Array:
        """Return the largest magnitude by output, shape (outputs,): 0 where there is none, infinite if unbounded."""

    def beyond(self, plant: Plant, sizes: Array) -> Array:
        """Return the share of samples with a magnitude above ``sizes``, both (outputs,); NaN where it is not known."""
        return np.where(self.bound(plant) <= sizes, 0.0, math.nan)


def _noisy(plant: Plant, output: str | None) -> list[int]:
    """Return the rows of the outputs that are noisy: all, or the one that is named."""
    names = [signal.name for signal in plant.outputs]
    if output is None:
        return list(range(len(names)))
    if output not in names:
        raise InvalidValue(f"noise.output must be one of: {', '.join(names)}; got {output!r}")
    return [names.index(output)]


def _tails(deviations: float) -> float:
    """Return the share of normal numbers that lie more than some standard deviations from their mean."""
    return math.erfc(deviations / math.sqrt(2.0))


@declared
class NormalNoise(Noise):
    """White Gaussian noise; one that is cut at ``limit`` is drawn again until it lies within."""

    sigma: float = quantity(default=0.0, unit="output units", doc="standard deviation of the noise", least=0)
    limit: float | None = quantity(
        default=None, unit="output units", doc="largest magnitude; null: none", above=0, optional=True
    )
    output: str | None = given(default=None, doc="name of the output that is noisy; None: every one")

    def draw(self, plant: Plant, samples: int, rng: np.random.Generator) -> Array:
        """Return one trial's noise, shape (outputs, samples); zero on outputs that are not noisy."""
        noise = np.zeros((len(plant.outputs), samples))
        if self.sigma > 0:
            for row in _noisy(plant, self.output):
                noise[row] = rng.normal(0.0, self.sigma, samples)
                while self.limit is not None and (beyond := np.abs(noise[row]) > self.limit).any():
                    noise[row, beyond] = rng.normal(0.0, self.sigma, int(beyond.sum()))
        return noise

    def bound(self, plant: Plant) -> Array:
        """Return the largest magnitude by output: infinite without a limit."""
        bounds = np.zeros(len(plant.outputs))
        if self.sigma > 0:
            bounds[_noisy(plant, self.output)] = math.inf if self.limit is None else self.limit
        return bounds

    def beyond(self, plant: Plant, sizes: Array) -> Array:
        """Return the share of samples with a magnitude above ``sizes``: what the tails hold, up to the limit."""
        cut = 0.0 if self.limit is None or self.sigma == 0 else _tails(self.limit / self.sigma)
        shares = np.zeros(len(plant.outputs))
        for row in _noisy(plant, self.output) if self.sigma > 0 else ():
            shares[row] = max(0.0, _tails(sizes[row] / self.sigma) - cut) / (1.0 - cut)
        return shares


@declared
class UniformNoise(Noise):
    """White noise that is uniform between -``largest`` and ``largest``."""

    largest: float = quantity(default=0.0, unit="output units", doc="largest magnitude of the noise", least=0)
    output: str | None = given(default=None, doc="name of the output that is noisy; None: every one")

    def draw(self, plant: Plant, samples: int, rng: np.random.Generator) -> Array:
        """Return one trial's noise, shape (outputs, samples); zero on outputs that are not noisy."""
        noise = np.zeros((len(plant.outputs), samples))
        if self.largest > 0:
            for row in _noisy(plant, self.output):
                noise[row] = rng.uniform(-self.largest, self.largest, samples)
        return noise

    def bound(self, plant: Plant) -> Array:
        """Return the largest magnitude by output."""
        bounds = np.zeros(len(plant.outputs))
        bounds[_noisy(plant, self.output)] = self.largest
        return bounds

    def beyond(self, plant: Plant, sizes: Array) -> Array:
        """Return the share of samples with a magnitude above ``sizes``."""
        bounds = self.bound(plant)
        return np.where(bounds > sizes, 1.0 - sizes / np.where(bounds > 0, bounds, 1.0), 0.0)


@declared
class GaussianByOutput(Noise):
    """White Gaussian noise with a standard deviation of its own for every output."""

    sigmas: tuple[float, ...] = table(unit="output units", doc="standard deviations, one an output")

    def check(self) -> None:
        """Raise InvalidValue for a negative standard deviation."""
        if any(sigma < 0 for sigma in self.sigmas):
            raise InvalidValue(f"sigmas must be 0 or more, got {min(self.sigmas):g}")

    def draw(self, plant: Plant, samples: int, rng: np.random.Generator) -> Array:
        """Return one trial's noise, shape (outputs, samples)."""
        sigmas = np.array(self.sigmas)[:, None]
        drawn: Array = rng.normal(0.0, 1.0, (len(self.sigmas), samples)) * sigmas
        return drawn

    def bound(self, plant: Plant) -> Array:
        """Return the largest magnitude by output: infinite where there is noise."""
        return np.where(np.array(self.sigmas) > 0, math.inf, 0.0)

    def beyond(self, plant: Plant, sizes: Array) -> Array:
        """Return the share of samples with a magnitude above ``sizes``: what the tails hold."""
        pairs = zip(sizes, self.sigmas, strict=True)
        return np.array([_tails(size / sigma) if sigma > 0 else 0.0 for size, sigma in pairs])


@declared
class GivenNoise(Noise):
    """Noise that is the same in every trial."""

    values: tuple[tuple[float, ...], ...] = given(doc="the noise, (outputs, N + 1)")

    def draw(self, plant: Plant, samples: int, rng: np.random.Generator) -> Array:
        """Return the noise, shape (outputs, samples)."""
        return np.array(self.values, dtype=float)

    def bound(self, plant: Plant) -> Array:
        """Return the largest magnitude by output."""
        bounds: Array = np.abs(np.array(self.values, dtype=float)).max(axis=1)
        return bounds

    def beyond(self, plant: Plant, sizes: Array) -> Array:
        """Return the share of samples with a magnitude above ``sizes``."""
        shares: Array = np.mean(np.abs(np.array(self.values, dtype=float)) > sizes[:, None], axis=1)
        return shares


class Disturbance(Declaration, ABC):
    """What disturbs the plant at every sample."""

    @abstractmethod
    def draw(self, plant: Plant, samples: int, rng: np.random.Generator) -> Array:
        """Return one trial's disturbances, shape (disturbances, samples), in their units."""

    @property
    @abstractmethod
    def repeats(self) -> bool:
        """Whether it is the same in every trial."""

    @abstractmethod
    def bound(self, plant: Plant) -> Array:
        """Return the least and the largest value of every disturbance, (disturbances, 2); infinite if unbounded."""


@declared
class Undisturbed(Disturbance):
    """All disturbances are zero."""

    def draw(self, plant: Plant, samples: int, rng: np.random.Generator) -> Array:
        """Return zeros, shape (disturbances, samples)."""
        return np.zeros((len(plant.disturbances), samples))

    @property
    def repeats(self) -> bool:
        """Nothing is the same in every trial."""
        return True

    def bound(self, plant: Plant) -> Array:
        """Return zeros."""
        return np.zeros((len(plant.disturbances), 2))


@declared
class GivenDisturbance(Disturbance):
    """Disturbances that are the same in every trial."""

    values: tuple[tuple[float, ...], ...] = given(doc="the disturbances, (disturbances, N)")

    def draw(self, plant: Plant, samples: int, rng: np.random.Generator) -> Array:
        """Return the disturbances, shape (disturbances, samples)."""
        return np.array(self.values, dtype=float)

    @property
    def repeats(self) -> bool:
        """They are the same in every trial."""
        return True

    def bound(self, plant: Plant) -> Array:
        """Return the least and the largest value of every disturbance."""
        values = np.array(self.values, dtype=float)
        return np.stack([values.min(axis=1), values.max(axis=1)], axis=1)


@declared
class NormalDisturbance(Disturbance):
    """White Gaussian disturbances, held over a sample, drawn anew for every trial."""

    sigmas: tuple[float, ...] = table(unit="disturbance units", doc="standard deviations, one a disturbance")

    def draw(self, plant: Plant, samples: int, rng: np.random.Generator) -> Array:
        """Return one trial's disturbances, shape (disturbances, samples)."""
        sigmas = np.array(self.sigmas)[:, None]
        drawn: Array = rng.normal(0.0, 1.0, (len(self.sigmas), samples)) * sigmas
        return drawn

    @property
    def repeats(self) -> bool:
        """Whether nothing is drawn."""
        return not any(self.sigmas)

    def bound(self, plant: Plant) -> Array:
        """Return infinite bounds where something is drawn."""
        widest = np.where(np.array(self.sigmas) > 0, math.inf, 0.0)
        return np.stack([-widest, widest], axis=1)


class Initial(Declaration, ABC):
    """Where trials begin."""

    @abstractmethod
    def draw(self, plant: Plant, trials: int, rng: np.random.Generator) -> Array:
        """Return the initial states of the plant, without those of an actuator before it, shape (trials, states)."""

    @property
    @abstractmethod
    def repeats(self) -> bool:
        """Whether every trial begins in the same state."""

    @abstractmethod
    def bound(self, plant: Plant) -> Array:
        """Return the least and the largest value of every state, (states, 2); infinite if unbounded."""


@declared
class AtRest(Initial):
    """Every trial begins with all states zero."""

    def draw(self, plant: Plant, trials: int, rng: np.random.Generator) -> Array:
        """Return zeros, shape (trials, states)."""
        return np.zeros((trials, len(plant.states)))

    @property
    def repeats(self) -> bool:
        """Every trial begins in the same state."""
        return True

    def bound(self, plant: Plant) -> Array:
        """Return zeros."""
        return np.zeros((len(plant.states), 2))


@declared
class From(Initial):
    """Trials begin in a state that is given, with a random part drawn anew for every trial."""

    state: tuple[float, ...] = table(unit="state units", doc="the initial state, one number a state")
    spread: tuple[float, ...] | None = table(
        default=None, unit="state units", doc="largest deviation from it, uniform, one number a state", optional=True
    )

    def draw(self, plant: Plant, trials: int, rng: np.random.Generator) -> Array:
        """Return the initial states, shape (trials, states)."""
        middle = np.tile(np.array(self.state), (trials, 1))
        if self.spread is None:
            return middle
        return middle + np.array(self.spread) * rng.uniform(-1.0, 1.0, middle.shape)

    @property
    def repeats(self) -> bool:
        """Whether every trial begins in the same state."""
        return self.spread is None or not any(self.spread)

    def bound(self, plant: Plant) -> Array:
        """Return the state less and plus what it may deviate."""
        middle = np.array(self.state)
        spread = np.zeros_like(middle) if self.spread is None else np.abs(self.spread)
        return np.stack([middle - spread, middle + spread], axis=1)


@declared
class GivenInitial(Initial):
    """Every trial begins in a state of its own that is given."""

    states: tuple[tuple[float, ...], ...] = given(doc="the initial states, (trials, states)")

    def draw(self, plant: Plant, trials: int, rng: np.random.Generator) -> Array:
        """Return the initial states, shape (trials, states)."""
        return np.array(self.states, dtype=float)

    @property
    def repeats(self) -> bool:
        """Whether every trial begins in the same state."""
        return len(set(self.states)) == 1

    def bound(self, plant: Plant) -> Array:
        """Return the least and the largest value of every state."""
        states = np.array(self.states, dtype=float)
        return np.stack([states.min(axis=0), states.max(axis=0)], axis=1)


class Departure(Declaration, ABC):
    """By what a quantity of the true plant differs from the one that the study declares, as a factor by trial."""

    @abstractmethod
    def draw(self, trials: int, rng: np.random.Generator) -> Array:
        """Return the factor in every trial, shape (trials,)."""

    @property
    @abstractmethod
    def range(self) -> tuple[float, float]:
        """The least and the largest factor that can come."""

    @property
    def repeats(self) -> bool:
        """Whether it is the same in every trial."""
        low, high = self.range
        return low == high


@declared
class Times(Departure):
    """The same factor in every trial: what is believed is wrong, but it stays so."""

    factor: float = quantity(default=1.0, unit="1", doc="true value over the declared one")

    def draw(self, trials: int, rng: np.random.Generator) -> Array:
        """Return the factor for every trial."""
        return np.full(trials, self.factor)

    @property
    def range(self) -> tuple[float, float]:
        """The factor, twice."""
        return self.factor, self.factor


@declared
class Between(Departure):
    """A factor drawn anew for every trial, uniform between two ends."""

    low: float = quantity(default=1.0, unit="1", doc="least true value over the declared one")
    high: float = quantity(default=1.0, unit="1", doc="largest true value over the declared one")

    def check(self) -> None:
        """Raise InvalidValue unless the ends are in order."""
        if self.low > self.high:
            raise InvalidValue(f"low must be at most high, got {self.low:g} and {self.high:g}")

    def draw(self, trials: int, rng: np.random.Generator) -> Array:
        """Return the factor for every trial."""
        return rng.uniform(self.low, self.high, trials)

    @property
    def range(self) -> tuple[float, float]:
        """The two ends."""
        return self.low, self.high


@declared
class ByTrial(Departure):
    """Factors that are given, one a trial."""

    factors: tuple[float, ...] = table(unit="1", doc="true value over the declared one, one number a trial")

    def draw(self, trials: int, rng: np.random.Generator) -> Array:
        """Return the factors."""
        if len(self.factors) != trials:
            raise InvalidValue(f"factors must be one a trial, {trials}, got {len(self.factors)}")
        return np.array(self.factors)

    @property
    def range(self) -> tuple[float, float]:
        """The least and the largest."""
        return min(self.factors), max(self.factors)
