"""Boxes: a range for every input of a Function."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from verification.enclosure.face import Enclosed, face

Array = NDArray[np.float64]
MOST = 2.0**53  # whole numbers beyond are not all doubles


def _matrix(name: str, value: ArrayLike) -> Array:
    """Return a value as a matrix of doubles, refusing what a double cannot hold."""
    given = np.asarray(value)
    matrix = np.array(given, dtype=np.float64)
    if not np.all(np.isfinite(matrix)):
        raise ValueError(f"{name}: the ends of a range must be finite, got {value!r}")
    if given.dtype.kind in "iuO" and any(int(a) != b for a, b in zip(matrix.flat, given.flat, strict=True) if a == a):
        raise ValueError(f"{name}: {value!r} is not a double; give the ends of a range that holds it")
    if matrix.ndim > 2:
        raise ValueError(f"{name}: expected a scalar, a vector or a matrix, got {matrix.ndim} dimensions")
    return matrix.reshape(-1, 1) if matrix.ndim < 2 else matrix


def _checked(whole: tuple[str, ...], ranges: Mapping[str, tuple[Array, Array]]) -> tuple[str, ...]:
    """Return the names of whole ranges, once each, refusing what is none."""
    if isinstance(whole, str):
        raise ValueError(f"whole must be a tuple of names, got {whole!r}: write ({whole!r},)")
    for name in whole:
        if name not in ranges:
            raise ValueError(f"whole must name ranges of the box, which has {list(ranges)}, got {name!r}")
        for end in ranges[name]:
            if np.any((end != np.rint(end)) | (np.abs(end) > MOST)):
                raise ValueError(
                    f"{name}: the ends of a whole range must be whole numbers below 2**53, got {end.tolist()}"
                )
    return tuple(dict.fromkeys(whole))


@dataclass(frozen=True, eq=False)
class Box(Mapping[str, tuple[Array, Array]]):
    """Closed ranges ``lower <= input <= upper``, elementwise, by input name.

    Parameters
    ----------
    ranges
        For every input either a pair ``(lower, upper)``, which must be a tuple, or one value that it is held at.
        Scalars, vectors (taken as columns) and matrices are welcome; where one end is a scalar it serves every
        element.
    whole
        Names of the inputs that hold whole numbers only, such as the index of a sample.

    Raises
    ------
    ValueError
        Where an end is not finite, the shapes disagree, or a lower end lies above its upper end; where a name in
        ``whole`` has no range, or one with an end that is no whole number.
    """

    ranges: Mapping[str, tuple[ArrayLike, ArrayLike] | ArrayLike]
    whole: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        checked: dict[str, tuple[Array, Array]] = {}
        for name, given in self.ranges.items():
            if isinstance(given, tuple) and len(given) != 2:
                raise ValueError(f"{name}: a range is a pair (lower, upper), got {len(given)} values; use a list")
            ends = given if isinstance(given, tuple) else (given, given)
            matrices = _matrix(name, ends[0]), _matrix(name, ends[1])
            if matrices[0].shape != matrices[1].shape and 1 not in (matrices[0].size, matrices[1].size):
                raise ValueError(f"{name}: lower is {matrices[0].shape}, upper is {matrices[1].shape}")
            lower, upper = (np.array(end) for end in np.broadcast_arrays(*matrices))
            if np.any(lower > upper):
                raise ValueError(f"{name}: expected lower <= upper, got {lower.tolist()} and {upper.tolist()}")
            for end in (lower, upper):
                end.setflags(write=False)
            checked[name] = lower, upper
        object.__setattr__(self, "ranges", MappingProxyType(checked))
        object.__setattr__(self, "whole", _checked(self.whole, checked))

    def __getitem__(self, name: str) -> tuple[Array, Array]:
        pair = self.ranges[name]
        return pair  # type: ignore[return-value]  # a pair of matrices since __post_init__

    def __iter__(self) -> Iterator[str]:
        return iter(self.ranges)

    def __len__(self) -> int:
        return len(self.ranges)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Box):
            return NotImplemented
        return (set(self), set(self.whole)) == (set(other), set(other.whole)) and all(
            np.array_equal(mine, theirs) for name in self for mine, theirs in zip(self[name], other[name], strict=True)
        )

    def __hash__(self) -> int:
        return hash(frozenset(self))

    def __repr__(self) -> str:
        return f"Box({self})"

    def __str__(self) -> str:
        """Return every element with its range, in digits that read back to the same doubles; ``a..b`` is whole."""
        parts = []
        for name, (lower, upper) in self.items():
            for (row, column), low in np.ndenumerate(lower):
                place = "" if lower.size == 1 else f"[{row}]" if lower.shape[1] == 1 else f"[{row}, {column}]"
                high = upper[row, column]
                between = f"{low:.0f}..{high:.0f}" if name in self.whole else f"[{float(low)!r}, {float(high)!r}]"
                value = f" = {float(low)!r}" if low == high else f" in {between}"
                parts.append(f"{name}{place}{value}")
        return ", ".join(parts)

    @property
    def is_point(self) -> bool:
        """Whether every range holds one value only."""
        return all(bool(np.all(lower == upper)) for lower, upper in self.values())

    def midpoint(self) -> dict[str, Array]:
        """Return a point in the middle, as values by input name; whole where the input is."""
        return {name: self._middle(name) for name in self}

    def _middle(self, name: str) -> Array:
        lower, upper = self[name]
        middle = np.clip(lower + (upper / 2 - lower / 2), lower, upper)
        return np.floor(middle) if name in self.whole else middle

    def width(self) -> float:
        """Return the largest width of any element."""
        return max((float(np.max(upper - lower, initial=0.0)) for lower, upper in self.values()), default=0.0)

    def split(self) -> tuple["Box", "Box"]:
        """Return the two halves along the element that is widest for its size.

        The size of an element is the larger magnitude of its ends. A point comes back twice. Halves of whole numbers
        share none.
        """
        best, share = None, 0.0
        for name, (lower, upper) in self.items():
            size = np.maximum(np.maximum(np.abs(lower), np.abs(upper)), np.finfo(np.float64).tiny)
            relative = upper / size - lower / size
            if relative.size and relative.max() > share:
                row, column = np.unravel_index(int(relative.argmax()), relative.shape)
                best, share = (name, (int(row), int(column))), float(relative.max())
        if best is None:
            return self, self
        name, place = best
        middle = self._middle(name)[place]
        lower, upper = (end.copy() for end in self[name])
        upper[place], lower[place] = middle, middle + (name in self.whole)
        halves = (self[name][0], upper), (lower, self[name][1])
        return Box({**self, name: halves[0]}, self.whole), Box({**self, name: halves[1]}, self.whole)

    def coordinates(self, function: Enclosed) -> tuple[Array, Array]:
        """Return the ends of all structural nonzeros of a Function's inputs, one after another.

        Raises
        ------
        ValueError
            Where the box does not name exactly the Function's inputs or a shape does not fit.
        """
        title, inputs, _ = face(function)
        names = [taken.name for taken in inputs]
        if set(names) != set(self):
            raise ValueError(f"{title} has inputs {names}, the box has {list(self)}")
        ends: list[list[Array]] = [[np.zeros(0)], [np.zeros(0)]]
        for name, shape, rows, columns in inputs:
            for collected, end in zip(ends, self[name], strict=True):
                if end.size != 1 and end.shape != shape:
                    raise ValueError(f"{name}: {title} expects {shape}, the box has {end.shape}")
                collected.append(np.broadcast_to(end, shape)[rows, columns] if rows else np.zeros(0))
        return np.concatenate(ends[0]), np.concatenate(ends[1])

    def whole_coordinates(self, function: Enclosed) -> NDArray[np.bool_]:
        """Say of each of the `coordinates` whether it holds whole numbers only."""
        parts = [np.full(len(rows), name in self.whole) for name, _, rows, _ in face(function).inputs]
        return np.concatenate([np.zeros(0, dtype=bool), *parts])

    @classmethod
    def from_coordinates(cls, function: Enclosed, lower: Array, upper: Array, whole: tuple[str, ...] = ()) -> "Box":
        """Return the box whose `coordinates` are given; structural zeros are zero."""
        ranges: dict[str, tuple[ArrayLike, ArrayLike] | ArrayLike] = {}
        start = 0
        for name, shape, rows, columns in face(function).inputs:
            ends = np.zeros(shape), np.zeros(shape)
            for end, values in zip(ends, (lower, upper), strict=True):
                end[rows, columns] = values[start : start + len(rows)]
            start += len(rows)
            ranges[name] = ends
        return cls(ranges, whole)
