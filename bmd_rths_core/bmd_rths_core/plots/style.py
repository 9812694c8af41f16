"""Style of every figure: widths of a journal column, 8 pt, colours that survive greyscale and colour blindness."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import AbstractContextManager
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib.style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

#: Width of two columns of a journal [mm].
DOUBLE_COLUMN = 180.0

#: Resolution of the format that has pixels [dots per inch].
RESOLUTION = 300

#: Colours of Okabe and Ito (2008).
BLACK, BLUE, VERMILION, ORANGE, GREEN = "#000000", "#0072B2", "#D55E00", "#E69F00", "#009E73"

#: Curves, told apart by their dashes where there is no colour; then marked points.
LINES: tuple[dict[str, Any], ...] = (
    {"color": BLACK, "linestyle": "-"},
    {"color": VERMILION, "linestyle": (0, (5, 2))},
    {"color": BLUE, "linestyle": (0, (5, 1.5, 1, 1.5))},
)
MARKERS = ("s", "o", "^")

#: Curves with points, as many as there may be schemes: told apart by marker and dashes where there is no colour.
CURVES: tuple[dict[str, Any], ...] = (
    {"color": BLACK, "marker": "s", "linestyle": "-"},
    {"color": VERMILION, "marker": "o", "linestyle": (0, (5, 2))},
    {"color": BLUE, "marker": "^", "linestyle": (0, (5, 1.5, 1, 1.5))},
    {"color": GREEN, "marker": "D", "linestyle": (0, (1, 1))},
    {"color": ORANGE, "marker": "v", "linestyle": (0, (8, 2))},
    {"color": "#CC79A7", "marker": "P", "linestyle": "-"},
    {"color": "#56B4E9", "marker": "X", "linestyle": (0, (3, 1))},
)

_STYLE = {
    **dict.fromkeys(("font.size", "axes.titlesize", "axes.labelsize", "figure.titlesize", "legend.fontsize"), 8.0),
    **dict.fromkeys(("xtick.labelsize", "ytick.labelsize"), 8.0),
    **dict.fromkeys(("xtick.direction", "ytick.direction"), "in"),
    "axes.linewidth": 0.6,
    "lines.linewidth": 1.1,
    "lines.markersize": 5.0,
    "legend.frameon": False,
    "legend.handlelength": 3.0,
    "text.parse_math": False,  # a $ in the name of a file is a $
    "svg.fonttype": "none",  # text stays text
    "pdf.fonttype": 42,  # TrueType: journals refuse Type 3
    "ps.fonttype": 42,
    "svg.hashsalt": "bmd_rths",  # the same figure is the same file
}


def style() -> AbstractContextManager[None]:
    """Return the context in which figures are drawn and written; what a user has set for matplotlib does not matter."""
    return matplotlib.style.context(["default", _STYLE])


def new_figure(height: float, title: str) -> Figure:
    """Return an empty figure, two columns wide.

    Parameters
    ----------
    height : float
        [mm].
    title : str
        Number and content; further lines say what a reader has to know besides.

    Returns
    -------
    Figure
        It belongs to nobody but the caller: there is no list of open figures.
    """
    figure = Figure(figsize=(DOUBLE_COLUMN / 25.4, height / 25.4))
    figure.suptitle(title)
    return figure


def legend_below(figure: Figure, axes: Axes, columns: int, between: float = 0.02) -> None:
    """Put one legend below all axes, where it covers nothing."""
    legend = figure.legend(*axes.get_legend_handles_labels(), loc="lower center", ncols=columns)
    # loc="outside lower center" does this too, but Ubuntu 24.04 has matplotlib 3.6, which does not know it yet.
    top = legend.get_window_extent().y1 / figure.bbox.height
    figure.set_layout_engine("constrained", rect=(0.0, top, 1.0, 1.0 - top), wspace=between)


def svg_of(figure: Figure, resolution: int) -> bytes:
    """Write a figure as SVG, its parts numbered in the order they come.

    matplotlib names a clip path by a hash of its place. Its last bit depends on where numpy found its memory.

    Parameters
    ----------
    figure : Figure
        The figure.
    resolution : int
        Of curves that are drawn as pixels [dots per inch].

    Returns
    -------
    bytes
        The file; the same figure is the same file.
    """
    file = BytesIO()
    figure.savefig(file, format="svg", dpi=resolution, metadata={"Date": None})
    content = file.getvalue()
    names = dict.fromkeys(re.findall(rb'id="([a-z][0-9a-f]{10})"', content))
    numbers = {name: b"part_%d" % i for i, name in enumerate(names)}
    return re.sub(rb'(?<=["#])[a-z][0-9a-f]{10}(?=[")])', lambda found: numbers.get(found[0], found[0]), content)


def write(figure: Figure, stem: Path, formats: Sequence[str]) -> list[Path]:
    """Write a figure into files.

    Parameters
    ----------
    figure : Figure
        The figure.
    stem : Path
        Path without extension.
    formats : sequence of str
        Some of `bmd_rths_core.plots.FORMATS`.

    Returns
    -------
    list of Path
        The files.
    """
    paths = [stem.with_name(f"{stem.name}.{name}") for name in formats]  # the stem may have a dot
    for path in paths:
        if path.suffix == ".svg":
            path.write_bytes(svg_of(figure, RESOLUTION))
        else:
            undated = {"CreationDate": None} if path.suffix == ".pdf" else {}
            figure.savefig(path, dpi=RESOLUTION, metadata=undated)
    return paths
