"""Draw a figure into files for print, their fonts inside as TrueType: PDF and SVG."""

from __future__ import annotations

import base64
import re
from collections.abc import Callable
from html import unescape
from io import BytesIO
from pathlib import Path

from fontTools import subset
from matplotlib import font_manager
from matplotlib.figure import Figure

from bmd_rths_core.plots.layout import Canvas
from bmd_rths_core.plots.style import DOUBLE_COLUMN, style
from bmd_rths_core.plots.svg import svg

#: Resolution of curves that are drawn as pixels: that of print [dots per inch].
_RESOLUTION = 600

#: The font of the figures, which matplotlib brings along.
_FONT = "DejaVu Sans"


def write_print_files(draw: Callable[[Canvas], None], height: float, stem: Path) -> list[Path]:
    """Write a figure two columns of a journal wide as PDF and as SVG.

    Parameters
    ----------
    draw : callable
        Draws on an empty figure.
    height : float
        Height of the figure [mm].
    stem : Path
        Path without ending.

    Returns
    -------
    list of Path
        The two files. The same drawing gives the same bytes.

    Raises
    ------
    OSError
        They cannot be written.
    """
    paths = [stem.with_name(f"{stem.name}.{ending}") for ending in ("pdf", "svg")]
    with style():
        figure = Figure(figsize=(DOUBLE_COLUMN / 25.4, height / 25.4))
        draw(figure)
        figure.savefig(paths[0], dpi=_RESOLUTION, metadata={"CreationDate": None, "Title": stem.name})
    paths[1].write_bytes(with_font(svg(draw, height)))
    return paths


def with_font(content: bytes) -> bytes:
    """Return an SVG file with its font inside, so that it looks the same everywhere.

    Parameters
    ----------
    content : bytes
        As `svg` has it: text is text.

    Returns
    -------
    bytes
        With a TrueType font of the characters it uses in its style; its text can still be searched and changed.
    """
    text = content.decode("utf-8")
    characters = unescape("".join(re.findall(r"<text[^>]*>([^<]*)</text>", text)))
    data = base64.b64encode(_subset(characters)).decode()
    face = f"@font-face {{ font-family: '{_FONT}'; src: url(data:font/ttf;base64,{data}) format('truetype'); }}"
    return text.replace("<defs>", f'<defs>\n  <style type="text/css">{face}</style>', 1).encode()


def _subset(characters: str) -> bytes:
    """Return a TrueType file with some characters of the font of the figures."""
    options = subset.Options(notdef_outline=True, drop_tables=[*subset.Options().drop_tables, "FFTM"])
    font = subset.load_font(font_manager.findfont(_FONT), options)
    subsetter = subset.Subsetter(options)
    subsetter.populate(text=characters)
    subsetter.subset(font)
    file = BytesIO()
    font.save(file)
    return file.getvalue()
