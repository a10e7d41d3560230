"""A figure as a page shows it: an image that is part of the page."""

from __future__ import annotations

import base64
import io
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import NamedTuple

from markupsafe import Markup

from workbench.trials.campaign import figure_file

SMALL_SVG = 60_000
"""Bytes up to which a figure stands in the page as SVG; a larger one stands there as PNG."""


class Drawn(NamedTuple):
    """A figure as the page shows it: where it stands as a file, its size in CSS pixels, its content in the page."""

    name: str
    caption: str
    width: int
    height: int
    data: Markup | None
    failure: str = ""


def embedded(name: str, caption: str, folder: Path) -> Drawn:
    """Return what a page shows of a figure whose files lie in a folder."""
    file = folder / figure_file(name)
    svg = file.with_name(f"{file.name}.svg").read_bytes()
    box = [float(number) for number in ET.fromstring(svg).attrib["viewBox"].split()]
    if len(svg) <= SMALL_SVG:
        small, kind = svg, "svg+xml"
    else:
        small, kind = _in_few_colours(file.with_name(f"{file.name}.png")), "png"
    data = Markup(f"data:image/{kind};base64,{base64.b64encode(small).decode('ascii')}")
    return Drawn(name, caption, round(box[2] * 96 / 72), round(box[3] * 96 / 72), data)


def _in_few_colours(file: Path) -> bytes:
    """Return a PNG with a palette, about a third of the size."""
    from PIL import Image

    written = io.BytesIO()
    with Image.open(file) as image:
        image.convert("RGB").quantize(128, dither=Image.Dither.NONE).save(written, "PNG", optimize=True)
    return written.getvalue()


def titled(name: str) -> str:
    """Return a figure's name as a caption."""
    words = [word.upper() if word in ("mse", "ppd", "rms") else word for word in name.split("_")]
    text = " ".join(words)
    return f"{text[:1].upper()}{text[1:]}."
