"""Settings by path: reading, changing and listing the fields of nested declarations.

``plant.mass`` is the field ``mass`` of the field ``plant``; in a mapping of declarations the name stands in the
middle, as in ``controllers.icfdl.lam``. The fields of a study's own settings are named as if they were the study's.
"""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple, TypeVar

import numpy as np

from models.quantity import InvalidValue, Quantity, is_declared, nested, parts, quantities, rebuilt
from workbench.contracts.plainly import as_departure
from workbench.contracts.scenario import Departure, Disturbance, Initial, Noise
from workbench.contracts.study import Study

T = TypeVar("T")
TRUTH = "truth."


class Row(NamedTuple):
    """One setting: its path, value, unit, range and description."""

    path: str
    value: object
    unit: str
    range: str
    doc: str


def rows(thing: object, prefix: str = "") -> list[Row]:
    """Return every setting below a declaration, in order."""
    return list(_rows(thing, prefix))


def _rows(thing: object, prefix: str) -> Iterator[Row]:
    for name, spec, value in _settings(thing):
        if spec.kind != "part":
            yield Row(f"{prefix}{name}", _plain(value, spec), spec.unit, spec.range(), spec.doc)
        for inner, within in parts(value) if spec.kind == "part" else ():
            yield from _rows(within, f"{prefix}{name}.{inner}." if inner else f"{prefix}{name}.")


def as_json(thing: object) -> dict[str, object]:
    """Return the settings of a declaration as nested dictionaries that JSON can hold."""
    result: dict[str, object] = {}
    for name, spec, value in _settings(thing):
        if spec.kind == "part" and isinstance(value, Mapping):
            result[name] = {inner: as_json(part) for inner, part in value.items() if is_declared(part)}
        elif spec.kind == "part":
            if is_declared(value):
                result[name] = as_json(value)
        else:
            result[name] = _plain(value, spec)
    return result


def changed(thing: T, changes: Mapping[str, object]) -> T:
    """Return a declaration with nested changes, as :func:`as_json` gives them.

    Where a group of settings stands, a declaration may be given to take its place as a whole. Raises InvalidValue,
    naming the full path, for unknown names and bad values. All changes of one declaration are made at once, so ranges
    that depend on each other are checked on the result.
    """
    if isinstance(thing, Study):
        changes = _as_named_now(thing, changes)
    _known(thing, changes, "")
    result: T = rebuilt(thing, _routed(thing, changes))
    return result


def assigned(thing: T, assignments: Iterable[str]) -> T:
    """Return a declaration with ``path=value`` assignments made, the value in JSON or a bare word."""
    values: dict[str, object] = {}
    for text in assignments:
        path, equals, value = text.partition("=")
        if not equals or not path.strip():
            raise InvalidValue(f"--set takes key=value, got {text!r}")
        values[path.strip()] = _parsed(value.strip())
    return changed(thing, nested(values))


def in_case(study: Study, name: str) -> Study:
    """Return a study in one of its cases; "" and the case that it is in give the study itself, "default" as declared.

    Raises InvalidValue for an unknown case, and for "default" of a study that is in a case: its changes are made.
    """
    if name == "default" and study.case:
        raise InvalidValue(f"{study.name} is in its case {study.case!r}: give the study as it is declared")
    if name in ("", "default", study.case):
        return study
    if name not in study.cases:
        known = ", ".join(["default", *study.cases])
        raise InvalidValue(f"there is no case {name!r} of {study.name}; its cases are: {known}")
    named: Study = rebuilt(study, {"case": name})
    return changed(named, nested(study.cases[name]))


def _as_named_now(study: Study, changes: Mapping[str, object]) -> dict[str, object]:
    """Return changes under the names that settings have now; raise with what replaced one that is no more."""
    whole = _wholes(study)
    whole |= {old for old, path in study.renamed.items() if path in whole}
    given = dict(_leaves(changes, whole))
    for old, sentence in study.gone.items():
        if found := [path for path in given if path == old or path.startswith(f"{old}.")]:
            raise InvalidValue(f"there is no setting {found[0]!r} any more: {sentence}")
    moved = {study.renamed.get(path, path): value for path, value in given.items()}
    return nested(_with_truth(study, moved))


def _with_truth(study: Study, given: dict[str, object]) -> dict[str, object]:
    """Return changes with plain factors of the true plant's quantities in their own kind, beside those that it has."""
    plain = {
        path.removeprefix(TRUTH): value
        for path, value in given.items()
        if path.startswith(TRUTH) and not is_declared(value)
        if path.removeprefix(TRUTH).rpartition(".")[0] not in study.truth
    }
    if not plain:
        return given
    made = {name: as_departure(name, value) for name, value in plain.items()}
    within = {path.removeprefix(TRUTH): value for path, value in given.items() if path.startswith(TRUTH)}
    deeper = nested({path: value for path, value in within.items() if path not in plain})
    kept = {path: value for path, value in given.items() if not path.startswith(TRUTH)}
    return {**kept, TRUTH.removesuffix("."): {**rebuilt(study.truth, deeper, TRUTH), **made}}


def _wholes(thing: object, prefix: str = "") -> set[str]:
    """Return the paths of the settings that are mappings themselves, and are replaced as a whole."""
    found: set[str] = set()
    for name, spec, value in _settings(thing):
        if spec.kind == "ranges":
            found.add(f"{prefix}{name}")
        for inner, within in parts(value) if spec.kind == "part" else ():
            found |= _wholes(within, f"{prefix}{name}.{inner}." if inner else f"{prefix}{name}.")
    return found


def _leaves(changes: Mapping[str, object], whole: set[str], prefix: str = "") -> Iterator[tuple[str, object]]:
    """Yield changes by their full path, one that is a mapping itself as it is."""
    for name, change in changes.items():
        path = f"{prefix}{name}"
        group = isinstance(change, Mapping) and change and not any(is_declared(one) for one in change.values())
        if group and isinstance(change, Mapping) and path not in whole:
            yield from _leaves(change, whole, f"{path}.")
        else:
            yield path, change


def numbers(thing: object, prefix: str = "") -> dict[str, float | tuple[float, ...]]:
    """Return the settings that are numbers and could have any near value instead, by path.

    Those that shape the equations (structural ones, counts) are not among them, nor tables that do not belong to what a
    campaign meets.
    """
    return dict(_numbers(thing, prefix))


def _numbers(thing: object, prefix: str) -> Iterator[tuple[str, float | tuple[float, ...]]]:
    met = isinstance(thing, (Noise, Disturbance, Initial, Departure))
    for name, spec, value in _settings(thing):
        path = f"{prefix}{name}"
        if spec.kind == "part":
            for inner, within in parts(value):
                yield from _numbers(within, f"{path}.{inner}." if inner else f"{path}.")
        elif (spec.kind == "number" and not spec.structural) or (spec.kind == "table" and met):
            if isinstance(value, (float, tuple)) and np.any(value):
                yield path, value


def _parsed(text: str) -> object:
    try:
        return json.loads(text)
    except ValueError:  # no JSON, or a whole number of too many digits
        pass
    try:
        return float(text)
    except ValueError:
        return text


def _plain(value: object, spec: Quantity) -> object:
    if spec.kind == "choice":
        for name, option in spec.choices.items():
            if option is value or option == value:
                return name
        return as_json(value) if is_declared(value) else value
    if isinstance(value, Mapping):
        return {name: list(ends) for name, ends in value.items()}
    return list(value) if isinstance(value, tuple) else value


def _known(thing: object, changes: Mapping[str, object], prefix: str) -> None:
    """Raise InvalidValue for a change of what a declaration, or a mapping of them, does not have."""
    if isinstance(thing, Mapping):
        values, groups, known = dict(thing), set(thing), [f"{prefix}{one}" for one in thing]
    else:
        settings = _settings(thing)
        values = {name: value for name, _, value in settings}
        groups = {name for name, spec, _ in settings if spec.kind == "part"}
        known = [row.path for row in rows(thing, prefix)]
    for name, change in changes.items():
        path = f"{prefix}{name}"
        if name not in values:
            raise _unknown(path, known)
        within = change.values() if isinstance(change, Mapping) else ()
        whole = is_declared(change) or any(is_declared(one) for one in within)
        if name in groups and whole:
            continue
        if name in groups and not isinstance(change, Mapping):
            raise InvalidValue(f"{path} is a group of settings: set one of its fields, as in {path}.FIELD=value")
        if isinstance(change, Mapping) and (name in groups or is_declared(values[name])):
            _known(values[name], change, f"{path}.")


def _settings(thing: object) -> list[tuple[str, Quantity, object]]:
    """Return the fields of a declaration that are settings, those of an inline part in the place of its own."""
    made = thing.composed if isinstance(thing, Study) else frozenset()
    found: list[tuple[str, Quantity, object]] = []
    for name, spec, value in quantities(thing):
        if spec.inline and is_declared(value):
            found += _settings(value)
        elif spec.kind != "given" and not spec.inline and name not in made:
            found.append((name, spec, value))
    return found


def _routed(thing: object, changes: Mapping[str, object]) -> dict[str, object]:
    """Return changes with those of an inline part's fields where that part stands."""
    routed = dict(changes)
    for name, spec, value in quantities(thing):
        if spec.inline and is_declared(value):
            own = {one for one, _, _ in quantities(value)}
            within = {one: routed.pop(one) for one in [*routed] if one in own}
            if within:
                routed[name] = within
    return routed


def _unknown(path: str, known: list[str]) -> InvalidValue:
    near = difflib.get_close_matches(path, known, n=3, cutoff=0.5)
    hint = f"did you mean {' or '.join(near)}?" if near else "workbench show STUDY lists the keys"
    return InvalidValue(f"there is no setting {path!r}; {hint}")
