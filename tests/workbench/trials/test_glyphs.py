"""Characters that a figure's font lacks, with fonts that come with Matplotlib."""

from __future__ import annotations

import logging
import unicodedata
import warnings
from functools import partial

import pytest
from matplotlib import pyplot
from matplotlib.text import Text

from workbench.trials import glyphs

NOWHERE = "\u901f\u5ea6"


def lacking_in_sans():
    """Return a sign that a font which comes with Matplotlib has and the default font lacks."""
    fonts = {font.name: font.fname for font in reversed(glyphs._fonts())}
    more = glyphs._characters(fonts["STIXGeneral"]) - glyphs._characters(fonts["DejaVu Sans"])
    return min(chr(code) for code in more if unicodedata.category(chr(code)) == "Sm")


def plotted():
    made, axes = pyplot.subplots()
    axes.plot([0, 1], [0, 1], label="plain")
    return made


@pytest.fixture
def figure():
    yield plotted()
    pyplot.close("all")


def save(figure, folder, name):
    glyphs.saved(figure, partial(figure.savefig, folder / f"{name}.png"))
    return (folder / f"{name}.png").read_bytes()


def test_a_font_that_has_it_is_put_beside(figure, tmp_path, caplog):
    character = lacking_in_sans()
    figure.axes[0].set_title(f"a {character}")
    boxes = plotted()
    boxes.axes[0].set_title(f"a {character}")
    with pytest.warns(UserWarning, match="Glyph"):
        boxes.savefig(tmp_path / "boxes.png")
    save(figure, tmp_path, "glyphs")  # a warning would be an error here
    assert (tmp_path / "boxes.png").read_bytes() != (tmp_path / "glyphs.png").read_bytes()
    plain = [text for text in figure.findobj(Text) if text.get_text() and character not in text.get_text()]
    assert plain and all(len(text.get_fontfamily()) == 1 for text in plain)
    assert caplog.records == []


def test_what_no_font_has_is_said_once(figure, tmp_path, caplog, monkeypatch):
    monkeypatch.setattr(glyphs, "_said", set())
    monkeypatch.setattr(glyphs, "_fonts", lambda: [])
    glyphs._having.cache_clear()
    figure.axes[0].set_title(NOWHERE)
    figure.axes[0].set_xlabel(NOWHERE[0] * 9)
    with caplog.at_level(logging.WARNING), glyphs.said_together():
        save(figure, tmp_path, "one")
        figure.axes[0].set_ylabel("\u529b")
        save(figure, tmp_path, "two")
    save(figure, tmp_path, "three")
    (said,) = caplog.records
    assert "no installed font has \u529b\u5ea6\u901f: " in said.getMessage() and "\n" not in said.getMessage()
    glyphs._having.cache_clear()


def test_a_figure_that_lacks_nothing_is_written_as_ever(figure, tmp_path):
    figure.savefig(tmp_path / "before.png")
    assert save(figure, tmp_path, "after") == (tmp_path / "before.png").read_bytes()


def test_other_warnings_pass(figure, tmp_path):
    def saving():
        warnings.warn("something else", UserWarning, stacklevel=1)

    with pytest.warns(UserWarning, match="something else"):
        glyphs.saved(figure, saving)
