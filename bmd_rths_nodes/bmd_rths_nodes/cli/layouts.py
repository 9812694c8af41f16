"""``bmd-rths layouts``: write layouts for Foxglove, Lichtblick and PlotJuggler."""

from __future__ import annotations

import json
from pathlib import Path

import click

from bmd_rths_core.errors import InputError
from bmd_rths_nodes.cli.configuration import ConfigChoice, configured
from bmd_rths_nodes.cli.options import json_option, log, namespace_option, output_folder


@click.command(epilog="Example: bmd-rths layouts config/eight_story_bmd.yaml --output layouts")
@configured(default="simplified_bmd")
@click.option(
    "--output", type=click.Path(path_type=Path), default=Path("."), show_default=True, help="Folder of the files."
)
@namespace_option
@json_option
def layouts(choice: ConfigChoice, output: Path, namespace: str, as_json: bool) -> int:
    """Write layouts that show every signal of a test in Foxglove, Lichtblick and PlotJuggler.

    CONFIG is that of the test: its specimen says how many floors are measured.
    """
    from bmd_rths_msgs_py.layouts import foxglove_layout, plotjuggler_layout

    floors = len(choice.resolve().specimen.masses)
    contents = {
        "bmd_rths_foxglove.json": foxglove_layout(floors, namespace),
        "bmd_rths_plotjuggler.xml": plotjuggler_layout(floors, namespace),
    }
    with output_folder(output):
        for name, content in contents.items():
            try:
                (output / name).write_text(content, encoding="utf-8")
            except OSError as error:
                raise InputError(f"{output / name}: cannot be written: {error.strerror}") from error
    files = [str(output / name) for name in contents]
    if as_json:
        click.echo(json.dumps({"floors": floors, "files": files}))
    else:
        log("\n".join(files))
    return 0
