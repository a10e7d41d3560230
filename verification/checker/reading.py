"""Reading certificates: every part in its form, or rejected with a sentence."""

from __future__ import annotations

import hashlib
import json
import math
import re
from pathlib import Path
from typing import Any, TypeAlias

from flint import fmpq

Json: TypeAlias = Any
"""What a file held: whoever takes it looks at what it is."""
FORMAT = "workbench-certificate 1"
LARGEST = 32 * 2**20
"""Bytes of a file that is read."""
_EXACT = re.compile(r"-?\d{1,4000}(/[1-9]\d{0,4000})?")


class Rejected(Exception):
    """A certificate proves nothing."""


class Unknown(Rejected):
    """It may be true, but this program has no rule to tell."""


class Unusable(Exception):
    """What was given is no folder of certificates."""


def need(condition: object, why: str) -> None:
    """Raise Rejected unless a condition holds."""
    if not condition:
        raise Rejected(why)


def number(text: object) -> float:
    """Return a double that is written in hexadecimal, and finite."""
    if not isinstance(text, str) or "0x" not in text:
        raise Rejected(f"a double must be written in hexadecimal, got {text!r:.40}")
    try:
        value = float.fromhex(text)
    except (ValueError, OverflowError):
        raise Rejected(f"a double must be written in hexadecimal, got {text!r:.40}") from None
    need(math.isfinite(value) and value.hex() == text, f"a double must be finite and in full, got {text!r:.40}")
    return value


def exact(text: object) -> fmpq:
    """Return a rational: ``p``, ``p/q``, or a double in hexadecimal, which is a rational too."""
    if isinstance(text, str) and _EXACT.fullmatch(text):
        top, _, below = text.partition("/")
        return fmpq(int(top), int(below or 1))
    return fmpq(*number(text).as_integer_ratio())


def whole(value: object, least: int, most: int) -> int:
    """Return a whole number between two others."""
    if type(value) is not int or not least <= value <= most:
        raise Rejected(f"a whole number from {least} to {most} must stand here, got {value!r:.40}")
    return value


def text(value: object) -> str:
    """Return a name of one line."""
    if not isinstance(value, str) or len(value) > 400 or not value.isprintable():
        raise Rejected(f"a name of one line must stand here, got {value!r:.40}")
    return value


def word(value: object) -> str:
    """Return a name that stands within a sentence, and makes none of its own."""
    need(len(text(value)) <= 200 and not set(text(value)) & set(":;"), f"a name must be short, got {value!r:.40}")
    return text(value)


def rows(value: object, count: int | None = None) -> list[Json]:
    """Return a list, of so many entries where that is known."""
    if not isinstance(value, list) or count not in (None, len(value)):
        raise Rejected(f"a list{'' if count is None else f' of {count}'} must stand here, got {value!r:.40}")
    return value


def record(value: object, *names: str) -> list[Json]:
    """Return the entries of a record that has just these names, in this order."""
    if not isinstance(value, dict) or set(value) != set(names):
        raise Rejected(f"a record of {', '.join(names)} must stand here, got {value!r:.60}")
    return [value[name] for name in names]


def hashed(content: object) -> str:
    """Return the hash of data, however its records are ordered and spaced."""
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def _no_number(text: str) -> None:
    raise ValueError(f"numbers must be finite, got {text}")


def loaded(path: Path) -> object:
    """Return the data of a JSON file. Raises Unusable where there is none, or too much."""

    def once(pairs: list[tuple[str, object]]) -> dict[str, object]:
        found = dict(pairs)
        if len(found) < len(pairs):
            raise Unusable(f"{path.name} must name every entry of a record once")
        return found

    try:
        if not path.is_file():
            raise Unusable(f"{path.name} must be a file")
        if path.stat().st_size > LARGEST:
            raise Unusable(f"{path.name} must hold at most {LARGEST >> 20} MB, it has {path.stat().st_size >> 20}")
        return json.loads(path.read_bytes(), object_pairs_hook=once, parse_constant=_no_number)
    except OSError as error:
        raise Unusable(f"{path.name} must be a file that can be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise Unusable(f"{path.name} must hold JSON: {str(error)[:80]}") from None
