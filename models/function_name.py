"""Names that CasADi takes for its Functions and their ports, made of names that Python takes for anything."""

from __future__ import annotations

import hashlib
import re

_PLAIN = re.compile(r"[A-Za-z][A-Za-z0-9]*(?:_[A-Za-z0-9]+)*")
_DIGEST = 16
_DIGESTED = re.compile(rf".*_[0-9a-f]{{{_DIGEST}}}")
_RESERVED = frozenset({"hess", "jac", "null"})
_LONGEST = 80  # with what stands before and behind, a library of that name is still the name of a file


def function_name(text: str) -> str:
    """Return a name for a CasADi Function or port, which stays one with ``a_`` before or ``_b`` behind it.

    What CasADi takes is returned as it is. Anything else (letters of other scripts, underscores at an end or in a row,
    reserved and very long names) becomes its ASCII letters and digits and a digest of the whole, so that two names
    never become one.
    """
    plain = _PLAIN.fullmatch(text) and text not in _RESERVED and len(text) <= _LONGEST
    if plain and not _DIGESTED.fullmatch(text):
        return text
    kept = "_".join(re.findall("[A-Za-z0-9]+", text))[: _LONGEST // 2].strip("_")
    digest = hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:_DIGEST]
    return f"{kept if kept[:1].isalpha() else f'n{kept}'}_{digest}"
