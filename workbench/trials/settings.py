"""Settings by path: reading, changing and listing the fields of nested declarations.

``plant.mass`` is the field ``mass`` of the field ``plant``; in a mapping of declarations the name stands in the
middle, as in ``controllers.icfdl.lam``.
"""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from models.quantity import InvalidValue, Quantity, is_declared, nested, quantities, rebuilt, walked


class Row(NamedTuple):
    """One setting: its path, value, unit, range and description."""

    path: str
    value: Any
    unit: str
    range: str
    doc: str


def rows(thing: Any, prefix: str = "") -> list[Row]:
    """Return every setting below a declaration, in order."""
    return [
        Row(path, _plain(value, spec), spec.unit, spec.range(), spec.doc)
        for path, spec, value in walked(thing, lambda spec, value: spec.kind == "part", prefix)
        if spec.kind not in ("part", "given")
    ]


def as_json(thing: Any) -> dict[str, Any]:
    """Return the settings of a declaration as nested dictionaries that JSON can hold."""
    result: dict[str, Any] = {}
    for name, spec, value in _settings(thing):
        if spec.kind == "part" and isinstance(value, Mapping):
            result[name] = {inner: as_json(part) for inner, part in value.items()}
        elif spec.kind == "part":
            if is_declared(value):
                result[name] = as_json(value)
        else:
            result[name] = _plain(value, spec)
    return result


def changed(thing: Any, changes: Mapping[str, Any]) -> Any:
    """Return a declaration with nested changes, as :func:`as_json` gives them.

    Raises InvalidValue, naming the full path, for unknown names and bad values. All changes of one declaration
    are made at once, so ranges that depend on each other are checked on the result.
    """
    _known(thing, changes, "")
    return rebuilt(thing, changes)


def assigned(thing: Any, assignments: Iterable[str]) -> Any:
    """Return a declaration with ``path=value`` assignments made, the value in JSON or a bare word."""
    values: dict[str, Any] = {}
    for text in assignments:
        path, equals, value = text.partition("=")
        if not equals or not path.strip():
            raise InvalidValue(f"--set takes key=value, got {text!r}")
        values[path.strip()] = _parsed(value.strip())
    return changed(thing, nested(values))


def _parsed(text: str) -> Any:
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        pass
    try:
        return float(text)
    except ValueError:
        return text


def _plain(value: Any, spec: Quantity) -> Any:
    if spec.kind == "choice":
        for name, option in spec.choices.items():
            if option is value or option == value:
                return name
        return as_json(value) if is_declared(value) else value
    return list(value) if isinstance(value, tuple) else value


def _known(thing: Any, changes: Mapping[str, Any], prefix: str) -> None:
    """Raise InvalidValue for a change of what a declaration, or a mapping of them, does not have."""
    mapping = isinstance(thing, Mapping)
    values = dict(thing) if mapping else {name: value for name, spec, value in _settings(thing)}
    groups = set(thing) if mapping else {name for name, spec, _ in _settings(thing) if spec.kind == "part"}
    for name, change in changes.items():
        path = f"{prefix}{name}"
        if name not in values:
            raise _unknown(path, [f"{prefix}{one}" for one in thing] if mapping else _paths(thing, prefix))
        if name in groups and not isinstance(change, Mapping):
            raise InvalidValue(f"{path} is a group of settings: set one of its fields, as in {path}.FIELD=value")
        if name in groups or (isinstance(change, Mapping) and is_declared(values[name])):
            _known(values[name], change, f"{path}.")


def _paths(thing: Any, prefix: str) -> list[str]:
    return [row.path for row in rows(thing, prefix)]


def _settings(thing: Any) -> list[tuple[str, Quantity, Any]]:
    return [(name, spec, value) for name, spec, value in quantities(thing) if spec.kind != "given"]


def _unknown(path: str, known: list[str]) -> InvalidValue:
    near = difflib.get_close_matches(path, known, n=3, cutoff=0.5)
    hint = f"did you mean {' or '.join(near)}?" if near else "workbench show STUDY lists the keys"
    return InvalidValue(f"there is no setting {path!r}; {hint}")
