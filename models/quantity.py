"""Fields that carry their unit, description and range, and the frozen declarations made of them.

A plant, a law, a study: each is a frozen, keyword-only dataclass made with :func:`declared`. Its fields are
numbers with a unit (:func:`quantity`), choices (:func:`choice`) or further declarations (:func:`part`). An
object that exists is valid: every range is checked when it is made. A float quantity may also be a CasADi
symbol, which is how the sensitivity to it is found (:func:`symbolised`).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, TypeVar, dataclass_transform

import casadi as ca

from models.errors import InvalidValue as InvalidValue
from models.plain_text import check_plain

T = TypeVar("T")
Symbolic = (ca.SX, ca.MX, ca.DM)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Quantity:
    """What is known about a field besides its value: unit, description, range.

    ``unit`` is "1" for a pure number and "" for what is not a number. ``structural`` fields shape the
    equations (a choice, a count, a switch) and are never replaced by a symbol.
    """

    unit: str
    doc: str
    kind: Literal["number", "count", "switch", "choice", "table", "part", "given"]
    above: float = -math.inf
    least: float = -math.inf
    below: float = math.inf
    most: float = math.inf
    optional: bool = False
    structural: bool = False
    choices: Mapping[str, Any] = dataclasses.field(default_factory=dict)

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
        low, opening = (self.above, "(") if self.above >= self.least else (self.least, "[")
        high, closing = (self.below, ")") if self.below <= self.most else (self.most, "]")
        opening = "(" if low == -math.inf else opening
        closing = ")" if high == math.inf else closing
        text = f"{opening}{low:g}, {high:g}{closing}".replace("inf", "∞")
        return f"{text} or null" if self.optional else text

    def admits(self, value: float) -> bool:
        """Tell whether a number lies in the range."""
        return self.above < value < self.below and self.least <= value <= self.most


def _field(spec: Quantity, default: Any) -> Any:
    metadata = {"quantity": spec}
    if default is dataclasses.MISSING:
        return dataclasses.field(metadata=metadata)
    if isinstance(default, Mapping):
        frozen = MappingProxyType(dict(default))
        return dataclasses.field(default_factory=lambda: frozen, metadata=metadata)
    return dataclasses.field(default=default, metadata=metadata)


def quantity(
    *,
    default: Any = dataclasses.MISSING,
    unit: str,
    doc: str,
    above: float = -math.inf,
    least: float = -math.inf,
    below: float = math.inf,
    most: float = math.inf,
    optional: bool = False,
    structural: bool = False,
) -> Any:
    """Declare a number with its unit ("1" if pure), description and range.

    ``above``/``below`` exclude their end, ``least``/``most`` include it. ``optional`` admits None.
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
    )
    return _field(spec, default)


def count(
    *,
    default: Any = dataclasses.MISSING,
    doc: str,
    unit: str = "1",
    least: float = 0,
    most: float = math.inf,
    optional: bool = False,
) -> Any:
    """Declare a whole number: it shapes the equations and is never replaced by a symbol."""
    spec = Quantity(unit=unit, doc=doc, kind="count", least=least, most=most, optional=optional, structural=True)
    return _field(spec, default)


def switch(*, default: bool, doc: str) -> Any:
    """Declare a yes or no."""
    return _field(Quantity(unit="", doc=doc, kind="switch", structural=True), default)


def choice(*, default: Any, options: Mapping[str, Any] | tuple[str, ...], doc: str) -> Any:
    """Declare one of several named values; the name may be given in place of the value."""
    named = options if isinstance(options, Mapping) else {name: name for name in options}
    value = named[default] if isinstance(default, str) and default in named else default
    return _field(Quantity(unit="", doc=doc, kind="choice", choices=named, structural=True), value)


def table(*, default: Any = dataclasses.MISSING, unit: str, doc: str, optional: bool = False) -> Any:
    """Declare a row of numbers (a tuple or a NumPy array) that share one unit."""
    return _field(Quantity(unit=unit, doc=doc, kind="table", structural=True, optional=optional), default)


def part(*, default: Any = dataclasses.MISSING, doc: str) -> Any:
    """Declare a field that is itself a declaration, or a mapping from names to declarations."""
    return _field(Quantity(unit="", doc=doc, kind="part", structural=True), default)


def given(*, default: Any = dataclasses.MISSING, doc: str) -> Any:
    """Declare what is not a setting: a name, a function, data that the declaration is made with."""
    return _field(Quantity(unit="", doc=doc, kind="given", structural=True), default)


@dataclass_transform(
    frozen_default=True, kw_only_default=True, field_specifiers=(quantity, count, switch, choice, table, part, given)
)
def declared(cls: type[T]) -> type[T]:
    """Make a frozen, keyword-only dataclass whose ranges are checked when an object is made.

    A method ``check(self) -> None`` of the class, if there is one, is called after the ranges were found good;
    it raises :class:`InvalidValue` for what no single range can say.
    """

    def validate(self: Any) -> None:
        for field in dataclasses.fields(self):
            if "quantity" not in field.metadata:
                raise TypeError(f"{cls.__name__}.{field.name} has no unit: declare it with quantity(...)")
            value = _admitted(field.name, getattr(self, field.name), field.metadata["quantity"])
            object.__setattr__(self, field.name, value)
        if hasattr(self, "check"):
            self.check()

    cls.__post_init__ = validate  # type: ignore[attr-defined]  # the hook that dataclass calls
    return dataclasses.dataclass(frozen=True, kw_only=True)(cls)


def _admitted(name: str, value: Any, spec: Quantity) -> Any:
    """Return the value in its declared form, or raise with what was expected and what came."""
    if value is None and spec.optional:
        return None
    if spec.kind == "choice":
        return _chosen(name, value, spec)
    if spec.kind == "switch":
        if not isinstance(value, bool):
            raise InvalidValue(f"{name} must be true or false, got {value!r}")
        return value
    if spec.kind in ("part", "given"):
        return MappingProxyType(dict(value)) if isinstance(value, Mapping) else value
    if spec.kind == "table":
        return _row(name, value, spec)
    if isinstance(value, Symbolic):
        if spec.structural:
            raise InvalidValue(f"{name} shapes the equations: give a number, not a symbol")
        return value
    if isinstance(value, bool) or (not isinstance(value, (int, float)) and not hasattr(value, "__float__")):
        raise InvalidValue(f"{name} must be a number in {spec.range()}, got {value!r}")
    number = float(value)
    if not math.isfinite(number):
        raise InvalidValue(f"{name} must be a finite number in {spec.range()}, got {value!r}")
    if not spec.admits(number):
        unit = f" {spec.unit}" if spec.unit not in ("", "1") else ""
        raise InvalidValue(f"{name} must lie in {spec.range()}{unit}, got {value!r}")
    if spec.kind == "count":
        if number != int(number):
            raise InvalidValue(f"{name} must be a whole number in {spec.range()}, got {value!r}")
        return int(number)
    return number


def _chosen(name: str, value: Any, spec: Quantity) -> Any:
    if isinstance(value, str) and value in spec.choices:
        return spec.choices[value]
    if isinstance(value, str) or not isinstance(value, tuple(type(option) for option in spec.choices.values())):
        raise InvalidValue(f"{name} must be one of {spec.range()}, got {value!r}")
    return value


def _row(name: str, value: Any, spec: Quantity) -> tuple[float, ...]:
    try:
        numbers = tuple(float(entry) for entry in value)
    except (TypeError, ValueError):
        raise InvalidValue(f"{name} must be a row of numbers, got {value!r}") from None
    if not all(math.isfinite(entry) for entry in numbers):
        raise InvalidValue(f"{name} must hold finite numbers only, got one that is not")
    return numbers


def quantities(thing: Any) -> Iterator[tuple[str, Quantity, Any]]:
    """Yield (name, quantity, value) for every declared field of an object, in order."""
    for field in dataclasses.fields(thing):
        if "quantity" in field.metadata:
            yield field.name, field.metadata["quantity"], getattr(thing, field.name)


def is_declared(thing: Any) -> bool:
    """Tell whether an object was made from a class with declared fields."""
    return dataclasses.is_dataclass(thing) and not isinstance(thing, type)


def parts(value: Any) -> list[tuple[str, Any]]:
    """Return the declarations that a field's value is (named "") or holds by name."""
    if isinstance(value, Mapping):
        return [(name, part) for name, part in value.items() if is_declared(part)]
    return [("", value)] if is_declared(value) else []


def walked(thing: Any, into: Callable[[Quantity, Any], bool], prefix: str = "") -> Iterator[tuple[str, Quantity, Any]]:
    """Yield (path, quantity, value) for every field of a declaration and of those within it, outer ones first.

    A path is dotted; of a mapping's declarations it has the name (``controllers.icfdl.lam``). ``into`` tells,
    given a field's quantity and value, whether the declarations that the value is or holds are looked into.
    """
    for name, spec, value in quantities(thing):
        yield f"{prefix}{name}", spec, value
        if into(spec, value):
            for inner, within in parts(value):
                yield from walked(within, into, f"{prefix}{name}.{inner}." if inner else f"{prefix}{name}.")


def nested(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return values by dotted path as nested dictionaries.

    A value that is a dictionary itself is joined with what lies below its path. Raises InvalidValue where one path
    leads through a value of another.
    """
    result: dict[str, Any] = {}
    for path, value in values.items():
        node = result
        *above, last = path.split(".")
        for step in above:
            node = node.setdefault(step, {})
            if not isinstance(node, dict):
                raise InvalidValue(f"{path} lies within {step}, which is given a value too: leave one of them out")
        node[last] = value
    return result


def rebuilt(thing: Any, changes: Mapping[str, Any], prefix: str = "") -> Any:
    """Return a declaration, or a mapping of them, with nested changes of fields that it has.

    All changes of one declaration are made at once, so ranges that depend on each other are checked on the result.
    Raises InvalidValue with the full path for a bad value.
    """
    if isinstance(thing, Mapping):
        within = {name: rebuilt(thing[name], change, f"{prefix}{name}.") for name, change in changes.items()}
        return {**thing, **within}
    made = {
        name: rebuilt(value, changes[name], f"{prefix}{name}.")
        if isinstance(changes[name], Mapping) and (is_declared(value) or isinstance(value, Mapping))
        else changes[name]
        for name, _, value in quantities(thing)
        if name in changes
    }
    try:
        return dataclasses.replace(thing, **made) if made else thing
    except InvalidValue as error:
        text = str(error)
        raise InvalidValue(text if "." in text.split(" ", 1)[0] else f"{prefix}{text}") from None


class Symbolised(NamedTuple):
    """A declaration whose float quantities are symbols, and the numbers that they stand for."""

    thing: Any
    names: tuple[str, ...]
    symbols: tuple[Any, ...]
    values: tuple[float, ...]


def symbolised(thing: Any, symbol: Callable[[str], Any] = ca.SX.sym, only: frozenset[str] | None = None) -> Symbolised:
    """Replace float quantities, nested ones included, by symbols named after their path.

    ``only`` restricts it to the paths named. Structural fields and fields that are None stay as they are.
    """
    found = {
        path: value
        for path, spec, value in walked(thing, lambda spec, value: is_declared(value))
        if spec.kind == "number" and not spec.structural and isinstance(value, float)
        if only is None or path in only
    }
    symbols = {path: symbol(path.replace(".", "_")) for path in found}
    return Symbolised(rebuilt(thing, nested(symbols)), tuple(found), tuple(symbols.values()), tuple(found.values()))
