"""Measurement noise, disturbances and initial states of trials, from an explicit random generator."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from models.plant import Plant
from models.quantity import declared, given, quantity


class Noise(Protocol):
    """What is added to the outputs that a controller sees."""

    def draw(self, outputs: int, samples: int, rng: np.random.Generator) -> Any:
        """Return one trial's noise, shape (outputs, samples)."""


@declared
class SpeedNoise:
    """White Gaussian noise on the measured speed (the study's first output unless ``row`` says otherwise)."""

    speed_sigma: float = quantity(
        default=0.0, unit="output units", doc="standard deviation of the speed noise", least=0
    )
    row: int = given(default=0, doc="which of the outputs is the speed")

    def draw(self, outputs: int, samples: int, rng: np.random.Generator) -> Any:
        """Return one trial's noise, shape (outputs, samples); zero on all outputs but the speed."""
        noise = np.zeros((outputs, samples))
        if self.speed_sigma > 0:
            noise[self.row] = rng.normal(0.0, self.speed_sigma, samples)
        return noise


class Disturbance(Protocol):
    """What disturbs the plant at every sample."""

    def draw(self, plant: Plant, samples: int, rng: np.random.Generator) -> Any:
        """Return one trial's disturbances, shape (disturbances, samples)."""


@declared
class Undisturbed:
    """All disturbances are zero."""

    def draw(self, plant: Plant, samples: int, rng: np.random.Generator) -> Any:
        """Return zeros, shape (disturbances, samples)."""
        return np.zeros((len(plant.disturbances), samples))


class Initial(Protocol):
    """Where trials begin."""

    def draw(self, plant: Plant, trials: int, rng: np.random.Generator) -> Any:
        """Return the initial states, shape (trials, states)."""


@declared
class AtRest:
    """Every trial begins with all states zero."""

    def draw(self, plant: Plant, trials: int, rng: np.random.Generator) -> Any:
        """Return zeros, shape (trials, states)."""
        return np.zeros((trials, len(plant.states)))
