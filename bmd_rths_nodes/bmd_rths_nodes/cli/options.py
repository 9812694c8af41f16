"""Arguments and output that several commands share."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bmd_rths_core.errors import InputError
from bmd_rths_msgs_py.topics import NAMESPACE, checked_namespace

if TYPE_CHECKING:
    from rich.progress import Progress, ProgressColumn

json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object on standard output.")

capture_option = click.option(
    "--capture/--no-capture",
    default=None,
    help="Compute the capture of a simulated table, by two more runs. [default: where the loop is linear]",
)


def _namespace(context: click.Context, parameter: click.Parameter, text: str) -> str:
    return checked_namespace(text)


namespace_option = click.option(
    "--namespace",
    metavar="NAME",
    default=NAMESPACE,
    show_default=True,
    callback=_namespace,
    help="Namespace of the nodes and topics of the test: each rig on a ROS domain has one of its own.",
)


def check_writable(folder: Path, option: str = "--output") -> None:
    """Make a folder and check that it can be written.

    Parameters
    ----------
    folder : Path
        Where output shall go.
    option : str
        What named it.

    Raises
    ------
    InputError
        It cannot.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:  # the latter of a name with a NUL in it
        problem = getattr(error, "strerror", None) or error
        raise InputError(f"{option} {str(folder)[:100]}: cannot be written: {problem}") from error
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"{option} {folder}: cannot be written: Permission denied")


@contextmanager
def output_folder(folder: Path) -> Iterator[None]:
    """Make a folder that can be written; at the end, remove those that were made and are still empty.

    Parameters
    ----------
    folder : Path
        Where output shall go.

    Raises
    ------
    InputError
        It cannot be written.
    """
    made = [path for path in (folder, *folder.parents) if not os.path.exists(path)]  # which never fails
    check_writable(folder)
    try:
        yield
    finally:
        with suppress(OSError):  # of a folder that is not empty
            for path in made:
                path.rmdir()


def progress_bar(*columns: ProgressColumn) -> Progress:
    """Return a progress bar on standard error that vanishes at the end; without a terminal it prints nothing."""
    from rich.console import Console  # a help text does not wait for it
    from rich.progress import Progress

    console = Console(stderr=True)
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)


def printable(text: str) -> str:
    """Return text from a file on one line, with its control characters as escapes, safe for a terminal.

    Parameters
    ----------
    text : str
        A file name, say.
    """
    return "".join(c if c.isprintable() else c.encode("unicode_escape", "surrogatepass").decode() for c in text)


def log(text: str) -> None:
    """Print a line on standard error."""
    print(text, file=sys.stderr, flush=True)
