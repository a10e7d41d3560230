"""Plants that are vehicles: with a mass and a running resistance, in the same units whatever those of the plant.

A law, or a check, that makes use of both asks for a :class:`Vehicle`.
"""

from __future__ import annotations

from abc import abstractmethod

from models.expression import Expression
from models.plant import Plant


class Vehicle(Plant, abstract=True):
    """A plant with a mass in kg and a running resistance."""

    mass: float

    @abstractmethod
    def resistance_at(self, speed: Expression) -> Expression:
        """Return the running resistance in N at a speed in m/s, as at the first sample of a trial; same shape."""
