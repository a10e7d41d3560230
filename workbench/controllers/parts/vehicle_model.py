"""What a law may know of the vehicle that it moves: a model, which need not be the true plant."""

from __future__ import annotations

from models.quantity import InvalidValue
from models.vehicle import Vehicle
from workbench.contracts.law import Task


def believed(model: Vehicle | None, task: Task) -> Vehicle | None:
    """Return the model that a law was given, else the plant as the task believes it to be, where that is a vehicle."""
    if model is not None:
        return model
    return task.model if isinstance(task.model, Vehicle) else None


def lacking(law: object, model: Vehicle | None) -> str | None:
    """Return the refusal of a law that has no model, or None."""
    if model is not None:
        return None
    return f"{type(law).__name__} needs a model: the mass and running resistance of what it moves"


def needed(law: object, model: Vehicle | None) -> Vehicle:
    """Return the model that a law has; raise InvalidValue where it has none."""
    if model is None:
        raise InvalidValue(str(lacking(law, model)))
    return model
