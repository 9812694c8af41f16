"""Entry point of ``bmd-rths``: subcommands, exit status, one clear line for every error."""

from __future__ import annotations

import difflib
import importlib
import sys
from typing import Any

import click

from bmd_rths_core.errors import InputError
from bmd_rths_core.version import __version__
from bmd_rths_nodes.cli.options import log, printable

#: Commands in the order of the help; each is the function of its name in the module of its name.
COMMANDS = (
    *(
        "new-rig",
        "check",
        "commission",
        "run",
        "simulate",
        "campaign",
        "robustness",
        "benchmark",
        "stability",
        "identify",
    ),
    *("analyze", "export", "replay", "monitor", "layouts", "figures", "motions", "emulate", "doctor"),
)


class LazyGroup(click.Group):
    """Import a command when it is called, so that help and a mistyped word do not wait for scipy."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of all commands."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command."""
        if cmd_name not in COMMANDS:
            return None
        name = cmd_name.replace("-", "_")
        command: Any = getattr(importlib.import_module(f"bmd_rths_nodes.cli.{name}"), name)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find a command, or suggest one with a similar name."""
        name = args[0]
        similar = difflib.get_close_matches(name, COMMANDS, n=1)
        if name not in COMMANDS and similar and not name.startswith("-"):
            raise click.UsageError(f"No such command {name!r}. Did you mean {similar[0]!r}?", ctx)
        return super().resolve_command(ctx, args)


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__)
def cli() -> None:
    """Real-time hybrid simulation on a shake table.

    Exit status: 0 finished, 1 the run failed or was stopped, 2 wrong usage or input.
    """


def main() -> int:
    """Run the command line.

    Returns
    -------
    int
        Exit status.
    """
    try:
        status = cli.main(prog_name="bmd-rths", standalone_mode=False)
    except InputError as error:
        log(f"error: {printable(str(error))}")
        return 2
    except click.exceptions.NoArgsIsHelpError as error:
        log(error.format_message())
        return 2
    except click.ClickException as error:
        log(f"error: {' '.join(error.format_message().split())}")
        return 2
    except click.Abort:
        log("stopped")
        return 1
    except KeyboardInterrupt:
        log("stopped")
        return 1
    return status if isinstance(status, int) else 0


if __name__ == "__main__":
    sys.exit(main())
