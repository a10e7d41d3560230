"""Plants as symbolic equations, with units."""

from models.plant import Plant, Signal, signals
from models.point_mass import PointMass
from models.quantity import InvalidValue, choice, count, declared, part, quantity

__all__ = ["InvalidValue", "Plant", "PointMass", "Signal", "choice", "count", "declared", "part", "quantity", "signals"]
