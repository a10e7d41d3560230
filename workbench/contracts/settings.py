"""Settings by path: reading, changing and listing the fields of nested declarations.

``plant.mass`` is the field ``mass`` of the field ``plant``; in a mapping of declarations the name stands in the
middle, as in ``controllers.icfdl.lam``.
"""

from __future__ import annotations

import dataclasses
import difflib
import json
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from models.quantity import InvalidValue, Quantity, is_declared, quantities


class Row(NamedTuple):
    """One setting: its path, value, unit, range and description."""

    path: str
    value: Any
    unit: str
    range: str
    doc: str


def rows(thing: Any, prefix: str = "") -> list[Row]:
    """Return every setting below a declaration, in order."""
    found: list[Row] = []
    for name, spec, value in quantities(thing):
        path = f"{prefix}{name}"
        if spec.kind == "given":
            continue
        if spec.kind == "part":
            for inner, part in _parts(value):
                found += rows(part, f"{path}.{inner}." if inner else f"{path}.")
        else:
            found.append(Row(path, _plain(value, spec), spec.unit, spec.range(), spec.doc))
    return found


def as_json(thing: Any) -> dict[str, Any]:
    """Return the settings of a declaration as nested dictionaries that JSON can hold."""
    result: dict[str, Any] = {}
    for name, spec, value in quantities(thing):
        if spec.kind == "given":
            continue
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
    return _changed(thing, changes, "")


def assigned(thing: Any, assignments: Iterable[str]) -> Any:
    """Return a declaration with ``path=value`` assignments made, the value in JSON or a bare word."""
    changes: dict[str, Any] = {}
    for text in assignments:
        path, equals, value = text.partition("=")
        if not equals or not path.strip():
            raise InvalidValue(f"--set takes key=value, got {text!r}")
        node = changes
        *above, last = path.strip().split(".")
        for step in above:
            node = node.setdefault(step, {})
            if not isinstance(node, dict):
                raise InvalidValue(f"--set {path}: {step} was already given a value")
        node[last] = _parsed(value.strip())
    return changed(thing, changes)


def _parsed(text: str) -> Any:
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        pass
    try:
        return float(text)
    except ValueError:
        return text


def _parts(value: Any) -> list[tuple[str, Any]]:
    if isinstance(value, Mapping):
        return [(name, part) for name, part in value.items() if is_declared(part)]
    return [("", value)] if is_declared(value) else []


def _plain(value: Any, spec: Quantity) -> Any:
    if spec.kind == "choice":
        for name, option in spec.choices.items():
            if option is value or option == value:
                return name
        return as_json(value) if is_declared(value) else value
    return list(value) if isinstance(value, tuple) else value


def _changed(thing: Any, changes: Mapping[str, Any], prefix: str) -> Any:
    if isinstance(thing, Mapping):
        unknown = [name for name in changes if name not in thing]
        if unknown:
            raise _unknown(f"{prefix}{unknown[0]}", [f"{prefix}{name}" for name in thing])
        return {
            name: _changed(part, _nested(changes[name], f"{prefix}{name}"), f"{prefix}{name}.")
            if name in changes
            else part
            for name, part in thing.items()
        }
    specs = {name: (spec, value) for name, spec, value in quantities(thing) if spec.kind != "given"}
    replacements: dict[str, Any] = {}
    for name, change in changes.items():
        if name not in specs:
            raise _unknown(f"{prefix}{name}", [row.path for row in rows(thing, prefix)])
        spec, value = specs[name]
        nested = spec.kind == "part" or (isinstance(change, Mapping) and is_declared(value))
        if nested:
            replacements[name] = _changed(value, _nested(change, f"{prefix}{name}"), f"{prefix}{name}.")
        else:
            replacements[name] = change
    try:
        return dataclasses.replace(thing, **replacements) if replacements else thing
    except InvalidValue as error:
        text = str(error)
        raise InvalidValue(text if "." in text.split(" ", 1)[0] else f"{prefix}{text}") from None


def _nested(change: Any, path: str) -> Mapping[str, Any]:
    if not isinstance(change, Mapping):
        raise InvalidValue(f"{path} is a group of settings: set one of its fields, as in {path}.FIELD=value")
    return change


def _unknown(path: str, known: list[str]) -> InvalidValue:
    near = difflib.get_close_matches(path, known, n=3, cutoff=0.5)
    hint = f"did you mean {' or '.join(near)}?" if near else "workbench show STUDY lists the keys"
    return InvalidValue(f"there is no setting {path!r}; {hint}")
