"""Text that can be printed, typeset and written to any file: without control characters."""

from __future__ import annotations

import unicodedata

from models.errors import InvalidValue

_NEVER = frozenset({"Cc", "Cs"})  # control characters and halves of characters: no XML, no netCDF, no terminal


def check_plain(what: str, text: str, *, lines: bool = False) -> None:
    """Raise InvalidValue, naming ``what`` it is, where text holds a control character; ``lines`` admits line ends."""
    admitted = "\n\t" if lines else ""
    if not isinstance(text, str):
        raise InvalidValue(f"{what} must be text, got {text!r}")
    if any(unicodedata.category(character) in _NEVER and character not in admitted for character in text):
        raise InvalidValue(f"{what} must be text without control characters, got {text!r}: leave them out")
