"""Every figure of a report in files of its own, for papers: PDF and SVG with their fonts inside."""

from __future__ import annotations

import re
from collections.abc import Collection
from pathlib import Path

from bmd_rths_core.errors import InputError
from bmd_rths_core.plots.print_files import write_print_files
from bmd_rths_core.report.document import Document, Drawing, Picture


def figures_of(document: Document) -> dict[str, Drawing]:
    """Return the figures of a report.

    Parameters
    ----------
    document : Document
        The report.

    Returns
    -------
    dict of str to Drawing
        By the title of their section, in lower case with underscores; further ones of a section are numbered.
    """
    figures: dict[str, Drawing] = {}
    for section in document.sections:
        slug = re.sub(r"\W+", "_", section.title.lower()).strip("_")
        for block in section.blocks:
            if isinstance(block, Picture):
                count = sum(name == slug or re.fullmatch(rf"{slug}_\d+", name) is not None for name in figures)
                figures[f"{slug}_{count + 1}" if count else slug] = block.drawing
    return figures


def write_figures(document: Document, folder: Path, only: Collection[str] = ()) -> list[Path]:
    """Write the figures of a report, each as PDF and as SVG.

    Parameters
    ----------
    document : Document
        The report.
    folder : Path
        Where; it has to exist.
    only : collection of str
        Names of those that are wanted, see `figures_of`; all of them by default.

    Returns
    -------
    list of Path
        The files, two columns of a journal wide. The same data give the same bytes.

    Raises
    ------
    InputError
        A figure has none of the names, or a file cannot be written.
    """
    figures = figures_of(document)
    unknown = [name for name in only if name not in figures]
    if unknown:
        raise InputError(f"--only {unknown[0]}: no figure of this report; some of {', '.join(figures)} are required")
    paths: list[Path] = []
    for name, drawing in figures.items():
        if only and name not in only:
            continue
        try:
            paths += write_print_files(drawing.draw, drawing.height, folder / name)
        except OSError as error:
            raise InputError(f"--figures {folder}: cannot be written: {error.strerror}") from error
    return paths
