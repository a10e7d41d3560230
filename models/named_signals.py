"""Signals by name: what a plant's states, inputs, outputs and disturbances are called, and their values at a sample."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Literal, cast, get_args

import casadi as ca

from models.errors import InvalidValue
from models.expression import Column, Expression

Role = Literal[
    "acceleration",
    "angle",
    "angular acceleration",
    "angular rate",
    "charge",
    "concentration",
    "current",
    "energy",
    "flow",
    "force",
    "force per mass",
    "heat flow",
    "humidity",
    "level",
    "mass",
    "position",
    "power",
    "pressure",
    "speed",
    "temperature",
    "torque",
    "voltage",
    "volume",
]
ROLES: tuple[str, ...] = get_args(Role)
"""What a signal can be, in the physics of any plant."""

Domain = tuple[float | None, float | None]


@dataclasses.dataclass(frozen=True, slots=True)
class Signal:
    """A named signal with its unit and what it is.

    Raises InvalidValue for a domain that is no interval and a role that is none of ``ROLES``.
    """

    name: str
    unit: str
    doc: str = ""
    recorded: bool = True
    """Whether a run records it, as a state."""
    domain: Domain | None = None
    """(low, high): where the equations mean something, in the signal's unit; None is an open end."""
    role: Role | None = None
    """What it is in physics, so that what is physics of a kind can be computed from it."""

    def __post_init__(self) -> None:
        if self.role is not None and self.role not in ROLES:
            raise InvalidValue(f"the role of {self.name!r} must be one of {', '.join(ROLES)}; got {self.role!r}")
        if self.domain is not None:
            object.__setattr__(self, "domain", _interval(self.name, self.domain))


def _interval(name: str, domain: Domain) -> Domain:
    wrong = InvalidValue(
        f"the domain of {name!r} must be (low, high) with low below high, numbers or None for an open end; "
        f"got {domain!r}"
    )
    try:
        low, high = (None if end is None else float(end) for end in domain)
    except (TypeError, ValueError):
        raise wrong from None
    if not (-math.inf if low is None else low) < (math.inf if high is None else high):
        raise wrong
    return (None if low == -math.inf else low), (None if high == math.inf else high)


def signal(unit: str, doc: str = "", *, domain: Domain | None = None, role: Role | None = None) -> Signal:
    """Describe a signal that :func:`signals` names: ``signals(level=signal("m", "level", domain=(0, 2)))``."""
    return Signal("", unit, doc, domain=domain, role=role)


def signals(*whole: Signal, **described: str | tuple[str, str] | Signal) -> tuple[Signal, ...]:
    """Name signals with their units: ``signals(speed="m/s", position=("m", "front of the vehicle"))``.

    A signal may also be given as a whole, or described by :func:`signal`, which takes a domain and a role.
    """
    return (*whole, *(_named(name, one) for name, one in described.items()))


def _named(name: str, described: str | tuple[str, str] | Signal) -> Signal:
    if isinstance(described, str):
        return Signal(name, described)
    if isinstance(described, Signal):
        if described.name not in ("", name):
            raise InvalidValue(f"a signal has one name, got {name!r} for the signal {described.name!r}: leave one out")
        return dataclasses.replace(described, name=name)
    try:
        unit, doc = described
    except (TypeError, ValueError):
        raise InvalidValue(
            f"the signal {name!r} must be a unit, (unit, description) or signal(unit, ...), got {described!r}"
        ) from None
    return Signal(name, unit, doc)


def by_role(named: Iterable[Signal], role: Role) -> tuple[Signal, ...]:
    """Return the signals that have a role, in their order; raises InvalidValue for a role that there is not."""
    if role not in ROLES:
        raise InvalidValue(f"a role must be one of {', '.join(ROLES)}; got {role!r}")
    return tuple(one for one in named if one.role == role)


class Values:
    """The values of some signals at one sample: by name, by position, or unpacked.

    ``x.speed``, ``x[0]`` and ``speed, position = x`` read the same CasADi vector, which is ``x.vector``.
    """

    __slots__ = ("_names", "vector")

    def __init__(self, named: Sequence[Signal], vector: Expression) -> None:
        self._names = tuple(signal.name for signal in named)
        self.vector = vector
        taken = [name for name in self._names if name in self.__slots__]
        if taken:
            raise InvalidValue(f"a signal may have any name but vector and _names, got {taken[0]!r}: choose another")

    def __getattr__(self, name: str) -> Expression:
        if name == "_names":  # not there yet, as in a copy that is being made
            raise AttributeError(name)
        if name in self._names:
            return self.vector[self._names.index(name)]
        for index, own in enumerate(self._names):
            if own.startswith("__") and name.endswith(own) and name[0] == "_":  # what a class makes of x.__name
                return self.vector[index]
        if name.startswith("__"):
            raise AttributeError(name)
        known = ", ".join(self._names) or "none"
        raise InvalidValue(f"there is no signal {name!r} here; the signals are: {known}")

    def __getitem__(self, index: int) -> Expression:
        return self.vector[range(len(self._names))[index]]

    def __iter__(self) -> Iterator[Expression]:
        return (self.vector[index] for index in range(len(self._names)))

    def __len__(self) -> int:
        return len(self._names)


def stacked(values: Column | Values, named: Sequence[Signal], what: str) -> Expression:
    """Return what an equation gave as one column, or raise when it has the wrong size."""
    given = values.vector if isinstance(values, Values) else values
    try:
        if isinstance(given, (ca.SX, ca.MX, ca.DM)):
            column = given
        elif isinstance(given, (tuple, list)):
            pieces: Sequence[Expression] = given
            column = ca.vertcat(*pieces)
        else:  # an array, or what is refused here
            column = cast(Expression, ca.DM(given))  # type: ignore[arg-type]
    except (NotImplementedError, TypeError, ValueError):
        names = ", ".join(signal.name for signal in named)
        raise InvalidValue(f"{what} must give {len(named)} value(s) ({names}), got {given!r}") from None
    if tuple(column.shape) != (len(named), 1):
        names = ", ".join(signal.name for signal in named)
        raise InvalidValue(f"{what} must give {len(named)} value(s) ({names}), got shape {tuple(column.shape)}")
    return column
