"""Entry point of ``bmd-rths``: subcommands, exit status, one clear line for every error."""

from __future__ import annotations

import sys

import click

from bmd_rths_core.errors import InputError
from bmd_rths_core.version import __version__
from bmd_rths_nodes.cli.analyze import analyze
from bmd_rths_nodes.cli.emulate import emulate
from bmd_rths_nodes.cli.figures import figures
from bmd_rths_nodes.cli.identify import identify
from bmd_rths_nodes.cli.motions import motions
from bmd_rths_nodes.cli.options import log
from bmd_rths_nodes.cli.run import run
from bmd_rths_nodes.cli.simulate import simulate
from bmd_rths_nodes.cli.stability import stability


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__)
def cli() -> None:
    """Real-time hybrid simulation on a shake table.

    Exit status: 0 finished, 1 the run failed or was stopped, 2 wrong usage or input.
    """


cli.add_command(run)
cli.add_command(simulate)
cli.add_command(stability)
cli.add_command(analyze)
cli.add_command(figures)
cli.add_command(motions)
cli.add_command(identify)
cli.add_command(emulate)


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
        log(f"error: {error}")
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
