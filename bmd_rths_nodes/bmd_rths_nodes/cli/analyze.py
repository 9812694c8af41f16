"""``bmd-rths analyze``: compute the errors and the report of tests from their bags alone."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.progress import BarColumn, TextColumn

from bmd_rths_core.errors import InputError
from bmd_rths_nodes.cli.analysed_bag import analysed_bag
from bmd_rths_nodes.cli.error_tables import result_with_event, show_bags, show_error_tables
from bmd_rths_nodes.cli.options import capture_option, check_writable, json_option, log, progress_bar
from bmd_rths_nodes.cli.results import result_of, show

if TYPE_CHECKING:
    from bmd_rths_core.analysis.run_analysis import RunAnalysis
    from bmd_rths_core.config import Config
    from bmd_rths_core.report.document import Document


@click.command(epilog="Example: bmd-rths analyze bags/el_centro_1940_ns_plc_fc_20260801_101500 --report report.html")
@click.argument("bags", metavar="BAG...", nargs=-1, required=True)
@click.option(
    "--report",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Write a report with all figures, too: one web page (.html) or the same for print (.pdf).",
)
@click.option(
    "--figures",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Write every figure of the report into a folder, too, as PDF and SVG for a paper.",
)
@click.option("--only", default="", metavar="NAMES", help="Of --figures these alone, such as response_of_the_floors.")
@click.option("--window", metavar="BEGIN,END", help="What report and figures show closely [s].")
@capture_option
@json_option
def analyze(
    bags: tuple[str, ...],
    report: Path | None,
    figures: Path | None,
    only: str,
    window: str | None,
    capture: bool | None,
    as_json: bool,
) -> int:
    """Compute the errors of recorded tests against the reference, from their bags alone.

    Of one bag everything is told; of several, which is which, in what they differ and their errors, beside Tables 2 and
    3 of the paper where they are tests of its system. The report of several bags compares them.
    """
    shown = _window(window)
    drawn = report is not None or figures is not None
    if not drawn and (only or shown):
        raise InputError(f"{'--only' if only else '--window'}: nothing is drawn; --report or --figures is required")
    if only and figures is None:
        raise InputError("--only: --figures is required")
    if drawn:
        # Imported here: it takes as long as everything else for a result without a report.
        from bmd_rths_nodes.cli.report_file import check_report_file, document_of, require_matplotlib, write_report

        if report is not None:
            check_report_file(report)
        if figures is not None:
            require_matplotlib("--figures")
            check_writable(figures, "--figures")
    results: list[dict[str, Any]] = []
    configs: list[Config] = []
    analyses: list[RunAnalysis] = []
    with progress_bar(TextColumn("{task.description}"), BarColumn()) as progress:
        task = progress.add_task("reading", total=len(bags) + drawn)
        for bag in bags:
            analysis = analysed_bag(bag, capture)
            results.append({**result_of(analysis), "bag": bag, "file": analysis.record.motion["source"]})
            configs.append(analysis.config)
            if drawn:  # otherwise many bags need no memory
                analyses.append(analysis)
            progress.advance(task)
        if drawn:
            progress.update(task, description="drawing")
            document = document_of(analyses, shown)
        if report is not None:
            write_report(document, report)
        paths = _write_figures(document, figures, only) if figures is not None else []
    for what, path in (("report", report), *(("figure", path) for path in paths)):
        if path is not None:
            log(f"{what}: {path}")
    if len(results) == 1:
        (result,) = results
        del result["file"]
        show(result, as_json)
        return 0
    from bmd_rths_core.analysis.differences import differences, of_the_result
    from bmd_rths_core.campaign.paper_tables import is_paper_system

    differing = differences([config.as_mapping() for config in configs])
    results = [
        {**result_with_event(result, result["file"], of_the_result(differs)), "differs": differs}
        for result, differs in zip(results, differing, strict=True)
    ]
    if as_json:
        click.echo(json.dumps({"runs": results}))
    else:
        assumed = dict.fromkeys(result["assumptions"] for result in results if result["assumptions"])
        show_bags(results)
        show_error_tables(results, all(is_paper_system(config) for config in configs), assumed)
    return 0


def _window(text: str | None) -> tuple[float, float] | None:
    """Return the window that is asked for."""
    if text is None:
        return None
    try:
        begin, end = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--window {text[:60]}: BEGIN,END in seconds is required") from None
    if not (math.isfinite(end) and 0.0 <= begin < end):
        raise InputError(f"--window {text}: 0 <= BEGIN < END is required")
    return begin, end


def _write_figures(document: Document, folder: Path, only: str) -> list[Path]:
    from bmd_rths_core.report.figure_files import write_figures

    names = [name.strip() for name in only.split(",") if name.strip()]
    return write_figures(document, folder, names)
