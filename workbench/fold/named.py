"""What a law keeps, as a list and back: NamedTuples of expressions, which may hold further ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar, cast

import casadi as ca

from models.expression import Expression

T = TypeVar("T", bound=tuple[object, ...])


def fields_of(kept: tuple[object, ...]) -> tuple[str, ...] | None:
    """Return the names of a NamedTuple's fields, none for (); None for another tuple."""
    named = next((vars(cls)["_fields"] for cls in type(kept).__mro__ if "_fields" in vars(cls)), None)
    if named is None:
        return None if kept else ()
    return tuple(named)


def flat(kept: tuple[object, ...]) -> list[object]:
    """Return all that a NamedTuple holds, in order, what it holds in further ones in their place."""
    return [leaf for value in kept for leaf in (flat(value) if isinstance(value, tuple) else [value])]


def names(kept: tuple[object, ...], before: str = "") -> list[str]:
    """Return the names of what :func:`flat` returns: ``u``, and ``inner_u`` for what is held within ``inner``."""
    found: list[str] = []
    for name, value in zip(fields_of(kept) or (), kept, strict=True):
        found += names(value, f"{before}{name}_") if isinstance(value, tuple) else [f"{before}{name}"]
    return found


def expressions(kept: tuple[object, ...]) -> list[Expression]:
    """Return what :func:`flat` returns, which is known to stand for expressions."""
    return [cast(Expression, leaf) for leaf in flat(kept)]


def shapes_of(kept: tuple[object, ...]) -> list[tuple[int, int]]:
    """Return the shapes, (rows, columns), of what :func:`flat` returns."""
    return [as_matrix(leaf).shape for leaf in expressions(kept)]


def as_matrix(value: Expression) -> ca.MX:
    """Return an expression between trials, or a number, as the MX that it is there."""
    return ca.MX(cast(ca.MX, value))


def like(pattern: T, values: Sequence[object]) -> T:
    """Return values, in the order of :func:`flat`, in the types of a pattern."""
    rest = iter(values)
    made = _rebuilt(pattern, rest)
    if next(rest, pattern) is not pattern:
        raise ValueError(f"expected {len(flat(pattern))} values, got {len(values)}")
    return cast(T, made)


def _rebuilt(pattern: tuple[object, ...], rest: Iterator[object]) -> tuple[object, ...]:
    parts = [_rebuilt(value, rest) if isinstance(value, tuple) else next(rest) for value in pattern]
    make: Callable[..., tuple[object, ...]] = type(pattern)  # a NamedTuple takes its fields: which, only it knows
    return make(*parts) if parts else ()
