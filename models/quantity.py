"""Fields that carry their unit, description and range, and the frozen declarations made of them.

A plant, a law, a study: each is a frozen, keyword-only dataclass made with :func:`declared`. Its fields are
numbers with a unit (:func:`quantity`), choices (:func:`choice`), ranges by name (:func:`ranges`) or further
declarations (:func:`part`). An
object that exists is valid: every range is checked when it is made. A float quantity may also be a CasADi
symbol, which is how the sensitivity to it is found (:func:`symbolised`).
"""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import Generic, Literal, NamedTuple, SupportsFloat, TypeVar, cast, dataclass_transform

import casadi as ca
import numpy as np

from models.errors import InvalidValue as InvalidValue
from models.expression import Expression
from models.plain_text import check_plain
from models.tables import ranges_of, row_of, said

T = TypeVar("T")
Symbolic = (ca.SX, ca.MX, ca.DM)


class _Required(enum.Enum):
    """What stands for the default of a field that has none."""

    VALUE = "a value must be given"


@dataclasses.dataclass(frozen=True, kw_only=True)
class Quantity:
    """What is known about a field besides its value: unit, description, range.

    ``unit`` is "1" for a pure number and "" for what is not a number. ``structural`` fields shape the
    equations (a choice, a count, a switch) and are never replaced by a symbol. Settings of an ``inline`` part are
    named as if they were fields of what it is a part of.
    """

    unit: str
    doc: str
    kind: Literal["number", "count", "switch", "choice", "table", "ranges", "part", "given"]
    above: float = -math.inf
    least: float = -math.inf
    below: float = math.inf
    most: float = math.inf
    optional: bool = False
    structural: bool = False
    inline: bool = False
    rows: bool = False
    """Whether a number may be given as one for each of several, too."""
    open_ends: bool = False
    """Whether one end of a range may be None."""
    choices: Mapping[str, object] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        """Raise InvalidValue for a unit or a description that cannot be printed."""
        check_plain("a unit", self.unit)
        check_plain("a description", self.doc, lines=True)

    def range(self) -> str:
        """Return the admissible range in words, e.g. ``(0, 1]`` or ``hilly | flat``."""
        if self.kind == "switch":
            return "true | false"
        if self.kind == "choice":
            return " | ".join(self.choices)
        if self.kind in ("part", "given"):
            return ""
        if self.kind == "table":
            return "a row of numbers" + (" or null" if self.optional else "")
        if self.kind == "ranges":
            return "pairs [low, high] by name" + (", an end may be null" if self.open_ends else "")
        low, opening = (self.above, "(") if self.above >= self.least else (self.least, "[")
        high, closing = (self.below, ")") if self.below <= self.most else (self.most, "]")
        opening = "(" if low == -math.inf else opening
        closing = ")" if high == math.inf else closing
        text = f"{opening}{low:g}, {high:g}{closing}".replace("inf", "∞")
        text = f"{text} or a row of such" if self.rows else text
        return f"{text} or null" if self.optional else text

    def admits(self, value: float) -> bool:
        """Tell whether a number lies in the range."""
        return self.above < value < self.below and self.least <= value <= self.most


def _field(spec: Quantity, default: T | _Required) -> T:
    """Return dataclass's description of a field, which a type checker is told to be the field's value."""
    metadata = {"quantity": spec}
    if default is _Required.VALUE:
        field: T = dataclasses.field(metadata=metadata)
    elif isinstance(default, Mapping):
        frozen = MappingProxyType(dict(default))
        field = dataclasses.field(default_factory=lambda: frozen, metadata=metadata)  # type: ignore[assignment]  # T
    else:
        field = dataclasses.field(default=default, metadata=metadata)
    return field


def quantity(
    *,
    default: T | _Required = _Required.VALUE,
    unit: str,
    doc: str,
    above: float = -math.inf,
    least: float = -math.inf,
    below: float = math.inf,
    most: float = math.inf,
    optional: bool = False,
    structural: bool = False,
    rows: bool = False,
) -> T:
    """Declare a number with its unit ("1" if pure), description and range.

    ``above``/``below`` exclude their end, ``least``/``most`` include it. ``optional`` admits None, ``rows`` a row of
    such values too, which is kept as a tuple.
    """
    spec = Quantity(
        unit=unit,
        doc=doc,
        kind="number",
        above=above,
        least=least,
        below=below,
        most=most,
        optional=optional,
        structural=structural,
        rows=rows,
    )
    return _field(spec, default)


def count(
    *,
    default: T | _Required = _Required.VALUE,
    doc: str,
    unit: str = "1",
    least: float = 0,
    most: float = math.inf,
    optional: bool = False,
) -> T:
    """Declare a whole number: it shapes the equations and is never replaced by a symbol."""
    spec = Quantity(unit=unit, doc=doc, kind="count", least=least, most=most, optional=optional, structural=True)
    return _field(spec, default)


def switch(*, default: bool, doc: str) -> bool:
    """Declare a yes or no."""
    return _field(Quantity(unit="", doc=doc, kind="switch", structural=True), default)


def choice(*, default: T | str, options: Mapping[str, T] | tuple[str, ...], doc: str) -> T:
    """Declare one of several named values; the name may be given in place of the value."""
    named: Mapping[str, object] = options if isinstance(options, Mapping) else {name: name for name in options}
    value = named[default] if isinstance(default, str) and default in named else default
    spec = Quantity(unit="", doc=doc, kind="choice", choices=named, structural=True)
    return _field(spec, cast(T, value))


def table(*, default: T | _Required = _Required.VALUE, unit: str, doc: str, optional: bool = False) -> T:
    """Declare a row of numbers (a tuple or a NumPy array) that share one unit."""
    return _field(Quantity(unit=unit, doc=doc, kind="table", structural=True, optional=optional), default)


def ranges(*, default: T | _Required = _Required.VALUE, doc: str, open_ends: bool = False) -> T:
    """Declare a mapping from names to pairs (low, high), which is set as a whole; ``open_ends`` admits None for one."""
    return _field(Quantity(unit="", doc=doc, kind="ranges", structural=True, open_ends=open_ends), default)


def part(*, default: T | _Required = _Required.VALUE, doc: str, inline: bool = False) -> T:
    """Declare a field that is itself a declaration, or a mapping from names to declarations.

    The settings of an ``inline`` part are set without its name in front.
    """
    return _field(Quantity(unit="", doc=doc, kind="part", structural=True, inline=inline), default)


def given(*, default: T | _Required = _Required.VALUE, doc: str) -> T:
    """Declare what is not a setting: a name, a function, data that the declaration is made with."""
    return _field(Quantity(unit="", doc=doc, kind="given", structural=True), default)


class Declaration:
    """What a declaration is made of: an object of a class that nobody declared cannot be made."""

    def __init__(self, *values: object, **fields: object) -> None:
        """Raise InvalidValue: a class that is declared has a constructor of its own."""
        name = type(self).__name__
        raise InvalidValue(f"{name} is not declared: put @declared above its class, as in @declared class {name}(...)")


@dataclass_transform(
    frozen_default=True,
    kw_only_default=True,
    field_specifiers=(quantity, count, switch, choice, table, ranges, part, given),
)
def declared(cls: type[T]) -> type[T]:
    """Make a frozen, keyword-only dataclass whose ranges are checked when an object is made.

    A method ``check(self) -> None`` of the class, if there is one, is called after the ranges were found good;
    it raises :class:`InvalidValue` for what no single range can say.
    """

    def validate(self: object) -> None:
        values = vars(self)
        for name, spec in _specs(self).items():
            if spec is None:
                raise TypeError(f"{cls.__name__}.{name} has no unit: declare it with quantity(...)")
            object.__setattr__(self, name, _admitted(name, values[name], spec))
        _own_check(type(self))(self)

    cls.__post_init__ = validate  # type: ignore[attr-defined]  # the hook that dataclass calls
    return dataclasses.dataclass(frozen=True, kw_only=True)(cls)


def _specs(thing: object) -> dict[str, Quantity | None]:
    """Return what is known about every field of a dataclass or its object; None for one that says nothing."""
    if not dataclasses.is_dataclass(thing):
        return {}
    return {field.name: field.metadata.get("quantity") for field in dataclasses.fields(thing)}


def _own_check(cls: type) -> Callable[[object], None]:
    """Return the ``check`` that a class gives or inherits, one that finds nothing where there is none."""
    return next((vars(one)["check"] for one in cls.__mro__ if "check" in vars(one)), lambda thing: None)


def _admitted(name: str, value: object, spec: Quantity) -> object:
    """Return the value in its declared form, or raise with what was expected and what came."""
    if value is None and spec.optional:
        return None
    if spec.kind == "choice":
        return _chosen(name, value, spec)
    if spec.kind == "switch":
        if not isinstance(value, bool):
            raise InvalidValue(f"{name} must be true or false, got {said(value)}")
        return value
    if spec.kind in ("part", "given"):
        return MappingProxyType(dict(value)) if isinstance(value, Mapping) else value
    if spec.kind == "table":
        return row_of(name, value)
    if spec.kind == "ranges":
        return ranges_of(name, value, open_ends=spec.open_ends)
    if spec.rows and (isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.ndim == 1)):
        if not len(value):
            raise InvalidValue(f"{name} must be a number in {spec.range()}, got an empty row")
        one = dataclasses.replace(spec, rows=False)
        return tuple(_admitted(f"{name}[{index}]", entry, one) for index, entry in enumerate(value))
    if isinstance(value, Symbolic):
        if spec.structural:
            raise InvalidValue(f"{name} shapes the equations: give a number, not a symbol")
        return value
    if isinstance(value, bool) or not isinstance(value, SupportsFloat):
        raise InvalidValue(f"{name} must be a number in {spec.range()}, got {said(value)}")
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):  # an array, or a whole number beyond all doubles
        raise InvalidValue(f"{name} must be a number in {spec.range()}, got {said(value)}") from None
    if not math.isfinite(number):
        raise InvalidValue(f"{name} must be a finite number in {spec.range()}, got {said(value)}")
    if not spec.admits(number):
        unit = f" {spec.unit}" if spec.unit not in ("", "1") else ""
        raise InvalidValue(f"{name} must lie in {spec.range()}{unit}, got {said(value)}")
    if spec.kind == "count":
        if number != int(number):
            raise InvalidValue(f"{name} must be a whole number in {spec.range()}, got {said(value)}")
        return int(number)
    return number


def _chosen(name: str, value: object, spec: Quantity) -> object:
    if isinstance(value, str) and value in spec.choices:
        return spec.choices[value]
    if isinstance(value, str) or not isinstance(value, tuple(type(option) for option in spec.choices.values())):
        raise InvalidValue(f"{name} must be one of {spec.range()}, got {said(value)}")
    return value


def quantities(thing: object) -> Iterator[tuple[str, Quantity, object]]:
    """Yield (name, quantity, value) for every declared field of an object, in order."""
    values = vars(thing)
    for name, spec in _specs(thing).items():
        if spec is not None:
            yield name, spec, values[name]


def is_declared(thing: object) -> bool:
    """Tell whether an object was made from a class with declared fields."""
    return dataclasses.is_dataclass(thing) and not isinstance(thing, type) and None not in _specs(thing).values()


def parts(value: object) -> list[tuple[str, object]]:
    """Return the declarations that a field's value is (named "") or holds by name."""
    if isinstance(value, Mapping):
        return [(name, part) for name, part in value.items() if is_declared(part)]
    return [("", value)] if is_declared(value) else []


def walked(
    thing: object, into: Callable[[Quantity, object], bool], prefix: str = ""
) -> Iterator[tuple[str, Quantity, object]]:
    """Yield (path, quantity, value) for every field of a declaration and of those within it, outer ones first.

    A path is dotted; of a mapping's declarations it has the name (``controllers.icfdl.lam``). ``into`` tells,
    given a field's quantity and value, whether the declarations that the value is or holds are looked into.
    """
    for name, spec, value in quantities(thing):
        yield f"{prefix}{name}", spec, value
        if into(spec, value):
            for inner, within in parts(value):
                yield from walked(within, into, f"{prefix}{name}.{inner}." if inner else f"{prefix}{name}.")


def nested(values: Mapping[str, object]) -> dict[str, object]:
    """Return values by dotted path as nested dictionaries.

    A value that is a dictionary itself is joined with what lies below its path. Raises InvalidValue where one path
    leads through a value of another.
    """
    result: dict[str, object] = {}
    for path, value in values.items():
        node = result
        *above, last = path.split(".")
        for step in above:
            within = node.setdefault(step, {})
            if not isinstance(within, dict):
                raise InvalidValue(f"{path} lies within {step}, which is given a value too: leave one of them out")
            node = within
        node[last] = value
    return result


def rebuilt(thing: T, changes: Mapping[str, object], prefix: str = "") -> T:
    """Return a declaration, or a mapping of them, with nested changes of fields that it has.

    All changes of one declaration are made at once, so ranges that depend on each other are checked on the result.
    A declaration, or a mapping of them, among the changes takes the place of what was there as a whole.
    Raises InvalidValue with the full path for a bad value.
    """
    if isinstance(thing, Mapping):
        within = {name: _changed(thing.get(name), change, f"{prefix}{name}.") for name, change in changes.items()}
        return cast(T, {**thing, **within})
    made = {
        name: changes[name]
        if spec.kind == "ranges"
        else _changed(value, changes[name], prefix if spec.inline else f"{prefix}{name}.")
        for name, spec, value in quantities(thing)
        if name in changes
    }
    if not made or not dataclasses.is_dataclass(thing) or isinstance(thing, type):
        return thing
    try:
        return dataclasses.replace(thing, **made)
    except InvalidValue as error:
        text = str(error)
        raise InvalidValue(text if "." in text.split(" ", 1)[0] else f"{prefix}{text}") from None


def _changed(value: object, change: object, prefix: str) -> object:
    """Return a field's value with nested changes made, or what takes its place as a whole."""
    if not isinstance(change, Mapping) or any(is_declared(one) for one in change.values()):
        return change
    return rebuilt(value, change, prefix) if is_declared(value) or isinstance(value, Mapping) else change


class Symbolised(NamedTuple, Generic[T]):
    """A declaration whose float quantities are symbols, and the numbers that they stand for."""

    thing: T
    names: tuple[str, ...]
    symbols: tuple[Expression, ...]
    values: tuple[float, ...]


def values_of(thing: object, only: frozenset[str] | None = None) -> dict[str, float]:
    """Return the float quantities that :func:`symbolised` makes symbols of, by path."""
    return {
        path: value
        for path, spec, value in walked(thing, lambda spec, value: is_declared(value))
        if spec.kind == "number" and not spec.structural and isinstance(value, float)
        if only is None or path in only
    }


def symbolised(
    thing: T, symbol: Callable[[str], Expression | ca.MX] = ca.SX.sym, only: frozenset[str] | None = None
) -> Symbolised[T]:
    """Replace float quantities, nested ones included, by symbols named after their path.

    ``only`` restricts it to the paths named. Structural fields and fields that are None stay as they are.
    """
    found = values_of(thing, only)
    symbols = {path: cast(Expression, symbol(path.replace(".", "_"))) for path in found}
    return Symbolised(rebuilt(thing, nested(symbols)), tuple(found), tuple(symbols.values()), tuple(found.values()))
