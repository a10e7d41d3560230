"""Values and slopes of a compiled plant at the point of a witness."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

from models.array import Array
from models.quantity import InvalidValue

Witness = Mapping[str, object]
"""A witness as it stands in a file, in JSON's types."""


def point_of(witness: Witness) -> dict[str, Array]:
    """Return the point of a witness. Raises InvalidValue for one without."""
    point = witness.get("point")
    if not isinstance(point, Mapping):
        raise InvalidValue("a witness is replayed with its point: verify again")
    return {str(name): np.asarray(value, dtype=float) for name, value in point.items()}


def filled(f: ca.Function, point: Mapping[str, Array]) -> dict[str, Array]:
    """Return the point as arguments of a Function by name, what it does not name being zero."""
    at = {name: point.get(name, np.zeros(f.size_in(name))) for name in f.name_in()}
    return {name: one.reshape(f.size_in(name), order="F") for name, one in at.items()}


def value_at(f: ca.Function, point: Mapping[str, Array]) -> float:
    """Return the first output of a Function at a point."""
    return float(f(*filled(f, point).values()) if f.n_out() == 1 else f(*filled(f, point).values())[0])


def derivative_at(f: ca.Function, point: Mapping[str, Array]) -> float:
    """Return the derivative of the first output by the first entry of ``u`` at a point, by CasADi's own rules."""
    columns = [ca.SX.sym(name, *f.size_in(name)) for name in f.name_in()]
    y = f(*columns) if f.n_out() == 1 else f(*columns)[0]
    slope = ca.Function("slope", columns, [ca.jacobian(y, columns[f.name_in().index("u")][0])])
    return float(slope(*filled(f, point).values()))
