"""``bmd-rths export``: the data of tests in files for other programs, and a folder for an archive."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.progress import BarColumn, TextColumn

from bmd_rths_core.errors import InputError
from bmd_rths_nodes.cli.analysed_bag import analysed_bag
from bmd_rths_nodes.cli.options import json_option, log, progress_bar

if TYPE_CHECKING:
    from bmd_rths_core.export.channels import ExportedRun

#: Formats by the ending of the file, and what each needs besides.
ENDINGS = {".csv": "", ".mat": "", ".h5": "h5py", ".hdf5": "h5py", ".parquet": "pyarrow"}


@click.command(epilog="Example: bmd-rths export bags/el_centro_1940_ns_plc_fc_20260801_101500 --output test.mat")
@click.argument("bags", metavar="BAG...", nargs=-1, required=True)
@click.option(
    "--output",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help=f"Write the signals of all bags into one file: {', '.join(ENDINGS)}.",
)
@click.option(
    "--mat-version",
    type=click.Choice(("7", "7.3")),
    default="7",
    show_default=True,
    help="Version of a MAT file; 7.3 is HDF5, and takes signals of more than 2 GB.",
)
@click.option(
    "--bundle",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Write a folder for an archive, too: configuration, records, sensors, results, report, versions.",
)
@json_option
def export(bags: tuple[str, ...], output: Path | None, mat_version: str, bundle: Path | None, as_json: bool) -> int:
    """Write recorded tests into files for other programs, with names and units.

    Commanded, measured and computed signals, the reference, and the way to rest; each row is a step.
    """
    write = None if output is None else _writer(output, mat_version)
    if write is None and bundle is None:
        raise InputError("export: nothing to write; --output FILE or --bundle DIR is required")
    if bundle is not None:
        _check_bundle(bundle)
    told: dict[str, Any] = {"runs": [], "file": None, "bundles": []}
    with progress_bar(TextColumn("{task.description}"), BarColumn()) as progress:
        task = progress.add_task("reading", total=len(bags) + 1)
        runs = []
        for bag, name in zip(bags, _names(bags), strict=True):
            runs.append(run := _exported(bag, name, None if bundle is not None else False))
            told["runs"].append({**run.about(), "steps": run.record.steps, "left_out": list(run.left_out)})
            for reason in run.left_out:
                log(f"warning: {bag}: left out: {reason}")
            if bundle is not None:
                told["bundles"].append(str(_bundled(run, Path(bag), bundle if len(bags) == 1 else bundle / name)))
            progress.advance(task)
        if output is not None and write is not None:
            progress.update(task, description="writing")
            _write(runs, output, write)
            told["file"] = str(output)
    if as_json:
        click.echo(json.dumps(told))
    else:
        for path in (told["file"], *told["bundles"]):
            if path is not None:
                click.echo(path)
    return 0


def _writer(path: Path, mat_version: str) -> Callable[[list[ExportedRun], Path], None]:
    """Return what writes a file, or refuse it before the work begins."""
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise InputError(f"--output {path}: unknown ending {path.suffix!r}; one of {', '.join(ENDINGS)} is required")
    if mat_version == "7.3" and ending != ".mat":
        raise InputError(f"--mat-version 7.3: the file ends with {ending}; .mat is required")
    if path.is_dir() or not path.parent.is_dir():
        raise InputError(f"--output {path}: a file in a folder that exists is required")
    needed = "h5py" if mat_version == "7.3" else ENDINGS[ending]
    try:
        if needed == "h5py":
            import h5py  # noqa: F401
        elif needed == "pyarrow":
            import pyarrow.parquet  # noqa: F401
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] != needed:
            raise
        what = f"a {ending} file{' of version 7.3' if ending == '.mat' else ''} requires it (pip install {needed})"
        raise InputError(f"{needed}: not installed; {what}") from error
    from bmd_rths_core.export.files import to_csv, to_hdf5, to_mat, to_parquet
    from bmd_rths_core.export.mat73_file import to_mat73

    if ending == ".mat":
        return to_mat73 if mat_version == "7.3" else to_mat
    return {".csv": to_csv, ".parquet": to_parquet}.get(ending, to_hdf5)


def _write(runs: list[ExportedRun], path: Path, write: Callable[[list[ExportedRun], Path], None]) -> None:
    """Write a file in one go: what was there before stays until the new one is whole."""
    temporary = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        write(runs, temporary)
        os.replace(temporary, path)
    except OSError as error:
        raise InputError(f"--output {path}: cannot be written: {error.strerror or error}") from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def _names(bags: tuple[str, ...]) -> list[str]:
    """Return a name for each bag; of two with the same one, the second is numbered."""
    names: list[str] = []
    for bag in bags:
        name = Path(bag).resolve().name
        same = sum(other == name or other.startswith(f"{name} (") for other in names)
        names.append(f"{name} ({same + 1})" if same else name)
    return names


def _exported(bag: str, name: str, capture: bool | None) -> ExportedRun:
    from bmd_rths_core.export.channels import exported_run

    return exported_run(analysed_bag(bag, capture), name)


def _check_bundle(folder: Path) -> None:
    from bmd_rths_nodes.cli.options import check_writable

    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"--bundle {folder}: not an empty folder; a new or an empty one is required")
    check_writable(folder.parent, "--bundle")


def _bundled(run: ExportedRun, bag: Path, folder: Path) -> Path:
    from bmd_rths_core.export.bundle import write_bundle
    from bmd_rths_nodes.cli.report_file import page_of_run
    from bmd_rths_nodes.cli.results import result_of

    write_bundle(run, bag, result_of(run.analysis), page_of_run(run.analysis), folder)
    return folder
