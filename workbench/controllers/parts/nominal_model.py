"""What a law may know of the vehicle that it moves: a nominal model, which need not be the true plant."""

from __future__ import annotations

from typing import Any, Protocol

from models.quantity import InvalidValue


class NominalModel(Protocol):
    """A mass in kg, the sampling time in s, and the running resistance in N as a function of the speed in m/s."""

    @property
    def mass(self) -> Any:
        """The mass in kg."""

    @property
    def sampling_time(self) -> Any:
        """The sampling time in s."""

    def running_resistance(self, v: Any) -> Any:
        """Return the resistance in N at the speed v in m/s; same shape as v."""


def lacking(law: object, model: NominalModel | None) -> str | None:
    """Return the refusal of a law that was given no model, or None."""
    if model is not None:
        return None
    return f"{type(law).__name__} needs a model: the mass and running resistance of what it moves"


def needed(law: object, model: NominalModel | None) -> NominalModel:
    """Return the model that a law was given; raise InvalidValue where it was given none."""
    if model is None:
        raise InvalidValue(str(lacking(law, model)))
    return model
