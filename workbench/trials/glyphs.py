"""Characters that a figure's font lacks: another installed font that has them is put beside it, or it is said once."""

from __future__ import annotations

import logging
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache

from matplotlib import font_manager
from matplotlib.figure import Figure
from matplotlib.ft2font import FT2Font
from matplotlib.text import Text

MISSING = re.compile(r"Glyph (\d+) \(.*\) missing from font\(s\)")
log = logging.getLogger("workbench")
_said: set[str] = set()
_open: list[set[str]] = []


def saved(figure: Figure, save: Callable[[], None]) -> None:
    """Save a figure; again, with fonts beside its own, where they are found to lack characters.

    ``save`` writes the figure. Characters that no installed font has are named once in a process, in one line.
    """
    lacking = _lacking(save)
    fonts = _having(frozenset(lacking))
    if fonts:
        for text in figure.findobj(Text):
            if lacking & set(text.get_text()):
                text.set_fontfamily([*text.get_fontfamily(), *fonts])
        lacking = _lacking(save)
    with said_together() as boxes:
        boxes |= lacking


@contextmanager
def said_together() -> Iterator[set[str]]:
    """Collect what has no font while figures are saved within, and say it in one line at the end."""
    if _open:
        yield _open[-1]
        return
    _open.append(set())
    try:
        yield _open[-1]
    finally:
        unsaid = _open.pop() - _said
        if unsaid:
            _said.update(unsaid)
            log.warning(
                "no installed font has %s: figures show boxes there; install one that does, such as Noto Sans CJK",
                "".join(sorted(unsaid)),
            )


def _lacking(save: Callable[[], None]) -> set[str]:
    """Save, and return the characters that the fonts in use lack; all other warnings are passed on."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.filterwarnings("always", MISSING.pattern)
        save()
    lacking = set()
    for one in caught:
        found = MISSING.match(str(one.message))
        if found:
            lacking.add(chr(int(found[1])))
        else:
            warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)
    return lacking


@cache
def _having(wanted: frozenset[str]) -> tuple[str, ...]:
    """Return the families of installed fonts that have characters, as few as do; none for what no font has."""
    left, families = {ord(character) for character in wanted}, []
    while left:
        font = max(_fonts(), key=lambda font: len(left & _characters(font.fname)), default=None)
        if font is None or not left & _characters(font.fname):
            break
        left -= _characters(font.fname)
        families.append(str(font.name))
    return tuple(families)


def _fonts() -> Sequence[font_manager.FontEntry]:
    """Return the installed fonts, regular and upright ones first, without those that have every character as a box."""
    listed = [font for font in font_manager.fontManager.ttflist if not font.name.startswith("Last Resort")]
    return sorted(listed, key=lambda font: (font.style != "normal", font.weight != 400, font.name))


@cache
def _characters(file: str) -> frozenset[int]:
    try:
        return frozenset(FT2Font(file).get_charmap())
    except (OSError, RuntimeError):  # listed, but gone or broken
        return frozenset()
