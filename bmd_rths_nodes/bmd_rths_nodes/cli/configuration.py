"""The configuration of a command: CONFIG and every option that changes it, as one argument."""

from __future__ import annotations

import functools
import os
import site
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bmd_rths_core.errors import InputError
from bmd_rths_nodes.cli.options import log

if TYPE_CHECKING:
    from bmd_rths_core.config import Config

Command = Callable[..., Any]


@dataclass(frozen=True)
class ConfigChoice:
    """The part of the command line that makes the configuration.

    Parameters
    ----------
    config : str
        Path of a configuration file, or the name of one that is installed.
    scheme, motion, component, unit, columns, table : str, optional
        Options of the command line. A table is the name of a controller, or the address of the udp controller.
    models : tuple of str
        Files whose parameters replace those of the configuration file, a later one those of an earlier one.
    identified : str, optional
        File of which only the section `identified_model` counts.
    settings : tuple of str
        ``section.key=value``.
    dt : float, optional
        Time step of a record that does not state it [s].
    """

    config: str
    scheme: str | None = None
    motion: str | None = None
    component: str | None = None
    unit: str | None = None
    columns: str | None = None
    dt: float | None = None
    table: str | None = None
    models: tuple[str, ...] = ()
    identified: str | None = None
    settings: tuple[str, ...] = ()

    def resolve(self, **changes: object) -> Config:
        """Return the configuration: the file, then the models, then the options; the later one counts.

        Parameters
        ----------
        **changes : object
            Further changes as `Config.changed` takes them; those of the command line override them.

        Returns
        -------
        Config
            With an absolute path of the ground motion, because nodes may run elsewhere.

        Raises
        ------
        InputError
            Anything is wrong with it.
        """
        from bmd_rths_core.config import load_config
        from bmd_rths_core.ground_motion.library import shipped_records

        changes |= parsed_settings(self.settings)
        options = {
            "run__scheme": self.scheme,
            "ground_motion__record": self.motion,
            "ground_motion__component": self.component,
            "ground_motion__unit": self.unit,
            "ground_motion__columns": self.columns,
            "ground_motion__record_time_step": self.dt,
            "table__controller": self.table,
        }
        if self.table is not None and "://" in self.table:
            options |= {"table__controller": "udp", "table__address": self.table}
        changes |= {name: value for name, value in options.items() if value is not None}
        resolved = load_config(_config_path(self.config))
        for model in self.models:
            resolved = resolved.merged(model)
        if self.identified is not None:
            resolved = resolved.merged(self.identified, ("identified_model",))
        resolved = resolved.changed(**changes)
        record = resolved.ground_motion.record
        if record not in shipped_records():
            resolved = resolved.changed(ground_motion__record=os.path.abspath(record))
        return fitted(resolved)


def fitted(config: Config) -> Config:
    """Return a configuration whose table is fitted to its measured frequency response; tell how well it does.

    Parameters
    ----------
    config : Config
        The whole configuration.

    Raises
    ------
    InputError
        See `bmd_rths_core.identification.measured_table.with_fitted_table`.
    """
    if config.simulated_table.dynamics != "measured" or config.simulated_table.sections:
        return config
    from bmd_rths_core.identification.measured_table import with_fitted_table

    known = with_fitted_table(config)
    table = known.simulated_table
    log(f"table: {len(table.sections) // 6} sections fitted to {table.frequency_response}, error {table.fit_error:.2%}")
    return known


def parsed_settings(settings: Iterable[str]) -> dict[str, object]:
    """Return what ``--set`` says.

    Parameters
    ----------
    settings : iterable of str
        ``section.key=value``.

    Returns
    -------
    dict of str to object
        Changes as `Config.changed` takes them.

    Raises
    ------
    InputError
        One of them is malformed.
    """
    from bmd_rths_core.bounded_yaml import parse_yaml

    changes: dict[str, object] = {}
    for setting in settings:
        name, equals, value = setting.partition("=")
        section, dot, key = name.partition(".")
        if not (equals and dot and key):
            raise InputError(f"--set {setting}: SECTION.KEY=VALUE is required")
        try:
            changes[f"{section}__{key}"] = parse_yaml(value, "value")
        except InputError as error:
            raise InputError(f"--set {setting}: {value!r} is not a YAML value") from error
    return changes


#: Options that only some commands have.
_OPTIONS = {
    "scheme": click.option(
        "--scheme", metavar="NAME", help="Compensator: uc, fc, plc, plc_fc, mpic, or one that is installed."
    ),
    "motion": click.option("--motion", metavar="FILE", help="Ground-motion record, or the name of a shipped one."),
    "table": click.option(
        "--table", metavar="NAME", help="Table controller: simulated, udp://HOST:PORT, or the name of an installed one."
    ),
    "component": click.option("--component", metavar="NAME", help="Component of a record with several."),
    "dt": click.option(
        "--dt", type=float, metavar="SECONDS", help="Time step of a record that does not state it (record_time_step)."
    ),
    "unit": click.option(
        "--unit", metavar="UNIT", help="Unit of a record that does not state it: g, m/s2, cm/s2, gal."
    ),
    "columns": click.option(
        "--columns", metavar="NAMES", help="What the columns of a file of numbers are, as time,acceleration; or series."
    ),
}

#: Options for what the file of a record does not state.
RECORD_OPTIONS = ("component", "dt", "unit", "columns")


def record_options(command: Command) -> Command:
    """Add ``--dt``, ``--unit`` and ``--columns`` to a command, under these names.

    Parameters
    ----------
    command : callable
        A command without CONFIG.
    """
    for name in reversed(RECORD_OPTIONS[1:]):
        command = _OPTIONS[name](command)
    return command


model_option = click.option(
    "--model",
    "models",
    multiple=True,
    metavar="FILE",
    help="Parameters over those of the configuration, as `bmd-rths identify` writes them; may be repeated.",
)
identified_option = click.option(
    "--identified",
    metavar="FILE",
    help="Only what compensators know of such a file (identified_model); table and specimen stay what they are.",
)
set_option = click.option(
    "--set", "settings", multiple=True, metavar="SECTION.KEY=VALUE", help="Any other parameter; repeatable."
)


def configured(*names: str, default: str | None = None) -> Callable[[Command], Command]:
    """Add CONFIG, ``--model``, ``--identified``, ``--set`` and given options to a command, as a `ConfigChoice`.

    Parameters
    ----------
    *names : str
        Some of ``scheme``, ``motion``, `RECORD_OPTIONS` and ``table``.
    default : str, optional
        CONFIG when it is left out; without, it is required.

    Returns
    -------
    callable
        Decorator; it stands between those of click.
    """

    def decorate(command: Command) -> Command:
        @functools.wraps(command)
        def with_choice(config: str, models: tuple[str, ...], settings: tuple[str, ...], **options: Any) -> Any:
            chosen = {name: options.pop(name) for name in (*names, "identified")}
            return command(ConfigChoice(config, models=models, settings=settings, **chosen), **options)

        decorators = (
            click.argument("config", metavar="CONFIG" if default is None else "[CONFIG]", default=default),
            *(_OPTIONS[name] for name in names),
            model_option,
            identified_option,
            set_option,
        )
        for decorator in reversed(decorators):
            with_choice = decorator(with_choice)
        return with_choice

    return decorate


def installed_configs() -> dict[str, Path]:
    """Return the configurations that are installed with the package, by name."""
    sourced = [Path(prefix) for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix]
    prefixes = (*sourced, Path(sys.prefix), Path(site.getuserbase()))  # colcon, pip, pip --user
    folders = (prefix / "share" / "bmd_rths_nodes" / "config" for prefix in prefixes)
    folder = next((folder for folder in folders if folder.is_dir()), None)
    return {} if folder is None else {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def _config_path(config: str) -> Path:
    path = Path(config)
    if path.suffix or path.exists():
        return path
    installed = installed_configs()
    if config not in installed:
        names = ", ".join(installed) or "none"
        raise InputError(f"CONFIG {config}: no such file and no installed configuration; installed: {names}")
    return installed[config]
