"""Write the report of bags into a file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from bmd_rths_core.analysis.run_analysis import RunAnalysis
from bmd_rths_core.errors import InputError
from bmd_rths_msgs_py.bag_timing import read_timing_of_steps

if TYPE_CHECKING:
    from bmd_rths_core.report.document import Document

#: Formats by the ending of the file.
FORMATS = (".html", ".pdf")


def check_report_file(path: Path) -> None:
    """Check that a report can be written, before the work begins.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    InputError
        The ending is unknown, the folder is not there, or matplotlib is not installed.
    """
    if path.suffix.lower() not in FORMATS:
        raise InputError(f"--report {path}: unknown ending {path.suffix!r}; one of {', '.join(FORMATS)} is required")
    if path.is_dir() or not path.parent.is_dir():
        raise InputError(f"--report {path}: a file in a folder that exists is required")
    require_matplotlib("a report")


def require_matplotlib(what: str) -> None:
    """Refuse what needs figures where they cannot be drawn.

    Parameters
    ----------
    what : str
        What needs them.

    Raises
    ------
    InputError
        matplotlib is not installed.
    """
    try:
        import bmd_rths_core.plots.style  # noqa: F401
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] != "matplotlib":
            raise
        raise InputError(f"matplotlib: not installed; {what} requires it (pip install matplotlib)") from error


def document_of(analyses: Sequence[RunAnalysis], window: tuple[float, float] | None = None) -> Document:
    """Return the report of one run, or the comparison of several.

    Parameters
    ----------
    analyses : sequence of RunAnalysis
        The runs, read from bags.
    window : tuple of float, optional
        Begin and end of what is shown closely [s].

    Raises
    ------
    InputError
        The window is not in a run.
    """
    from bmd_rths_core.report.comparison_report import comparison_report
    from bmd_rths_core.report.reported_run import ReportedRun
    from bmd_rths_core.report.run_report import run_report

    for analysis in analyses:
        last = (analysis.record.steps - 1) * analysis.record.time_step
        if window is not None and window[1] > last:
            name = Path(analysis.record.source).name
            raise InputError(f"--window: {window[1]:g} s is behind the end of {name}; at most {last:g} s is required")
    runs = [ReportedRun(analysis, read_timing_of_steps(analysis.record), window) for analysis in analyses]
    return run_report(runs[0]) if len(runs) == 1 else comparison_report(runs)


def write_report(document: Document, path: Path) -> None:
    """Write a report.

    Parameters
    ----------
    document : Document
        The report.
    path : Path
        The file; its ending is the format.

    Raises
    ------
    InputError
        The file cannot be written.
    """
    try:
        if path.suffix.lower() == ".pdf":
            from bmd_rths_core.report.pdf import write_pdf

            write_pdf(document, path)
        else:
            from bmd_rths_core.report.html import page_of

            path.write_text(page_of(document), encoding="utf-8")
    except OSError as error:
        raise InputError(f"--report {path}: cannot be written: {error.strerror}") from error


def page_of_run(analysis: RunAnalysis) -> str:
    """Return the report of one run as a web page.

    Parameters
    ----------
    analysis : RunAnalysis
        The run, read from a bag.
    """
    from bmd_rths_core.report.html import page_of

    return page_of(document_of([analysis]))
