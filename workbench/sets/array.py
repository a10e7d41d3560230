"""Arrays that are checked once, when an object is made, and read-only afterwards."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from models.array import Array as Array
from models.quantity import InvalidValue


def checked(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> Array:
    """A read-only float64 copy of `value`.

    Parameters
    ----------
    name
        What to call the value in an error.
    value
        Anything numpy can turn into numbers.
    shape
        The shape expected; None stands for any length on that axis.

    Raises
    ------
    InvalidValue
        If the shape differs or an entry is not finite.
    """
    array = np.array(value, dtype=np.float64)
    fits = array.ndim == len(shape) and all(want in (None, got) for want, got in zip(shape, array.shape, strict=True))
    if not fits:
        expected = "(" + ", ".join("any" if length is None else str(length) for length in shape) + ")"
        raise InvalidValue(f"{name} must have shape {expected}, got {array.shape}")
    finite = np.isfinite(array)
    if not finite.all():
        where = tuple(int(i) for i in np.argwhere(~finite)[0])
        raise InvalidValue(f"{name} must be finite, got {array[where]} at index {where}")
    array.setflags(write=False)
    return array
