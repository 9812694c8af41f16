"""Arguments that several commands share."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import click
import yaml
from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from rich.console import Console
from rich.progress import Progress, ProgressColumn

from bmd_rths_core.config import Config, load_config
from bmd_rths_core.errors import InputError
from bmd_rths_core.ground_motion.library import shipped_records
from bmd_rths_core.schemes import SCHEME_NAMES

config_argument = click.argument("config", metavar="CONFIG")
scheme_option = click.option("--scheme", type=click.Choice(SCHEME_NAMES), help="Compensation scheme.")
motion_option = click.option("--motion", metavar="FILE", help="Ground-motion record, or the name of a shipped one.")
component_option = click.option("--component", metavar="NAME", help="Component of a record with several.")
set_option = click.option(
    "--set", "settings", multiple=True, metavar="SECTION.KEY=VALUE", help="Any other parameter; may be repeated."
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object on standard output.")


def resolve_config(
    config: str,
    scheme: str | None,
    motion: str | None,
    settings: tuple[str, ...],
    component: str | None = None,
    **changes: object,
) -> Config:
    """Return the configuration of a command: the file, changed by the command line.

    Parameters
    ----------
    config : str
        Path of a configuration file, or the name of one that is installed.
    scheme, motion : str, optional
        Options of the command line.
    settings : tuple of str
        ``section.key=value``.
    component : str, optional
        Option of the command line.
    **changes : object
        Further changes as `Config.changed` takes them.

    Returns
    -------
    Config
        With an absolute path of the ground motion, because nodes may run elsewhere.

    Raises
    ------
    InputError
        Anything is wrong with it.
    """
    for setting in settings:
        name, equals, value = setting.partition("=")
        section, dot, key = name.partition(".")
        if not (equals and dot and key):
            raise InputError(f"--set {setting}: SECTION.KEY=VALUE is required")
        try:
            changes[f"{section}__{key}"] = yaml.safe_load(value)
        except yaml.YAMLError as error:
            raise InputError(f"--set {setting}: {value!r} is not a YAML value") from error
    if scheme is not None:
        changes["run__scheme"] = scheme
    if motion is not None:
        changes["ground_motion__record"] = motion
    if component is not None:
        changes["ground_motion__component"] = component
    resolved = load_config(_config_path(config)).changed(**changes)
    record = resolved.ground_motion.record
    if record in shipped_records():
        return resolved
    return resolved.changed(ground_motion__record=os.path.abspath(record))


def check_writable(folder: Path) -> None:
    """Make a folder and check that it can be written.

    Parameters
    ----------
    folder : Path
        Where output shall go.

    Raises
    ------
    InputError
        It cannot.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--output {folder}: cannot be written: {error.strerror}") from error
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InputError(f"--output {folder}: cannot be written: Permission denied")


def progress_bar(*columns: ProgressColumn) -> Progress:
    """Return a progress display on standard error that leaves nothing behind, and is silent where nobody watches."""
    console = Console(stderr=True)
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)


def log(text: str) -> None:
    """Tell a person something, on standard error."""
    print(text, file=sys.stderr, flush=True)


def _config_path(config: str) -> Path:
    path = Path(config)
    if path.suffix or path.exists():
        return path
    installed = installed_configs()
    if config not in installed:
        names = ", ".join(installed) or "none"
        raise InputError(f"CONFIG {config}: no such file and no installed configuration; installed: {names}")
    return installed[config]


def installed_configs() -> dict[str, Path]:
    """Return the configurations that are installed with the package, by name."""
    try:
        share = Path(get_package_share_directory("bmd_rths_nodes"))
    except (PackageNotFoundError, OSError):  # the latter when no ROS environment is sourced
        share = Path(sys.prefix) / "share" / "bmd_rths_nodes"
    return {path.stem: path for path in sorted((share / "config").glob("*.yaml"))}
