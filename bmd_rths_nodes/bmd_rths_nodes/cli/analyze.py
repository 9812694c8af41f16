"""``bmd-rths analyze``: everything again from the bags alone."""

from __future__ import annotations

import json
from typing import Any

import click

from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_nodes.cli.error_tables import result_with_event, show_error_tables
from bmd_rths_nodes.cli.options import json_option, log
from bmd_rths_nodes.cli.results import result_of, show


@click.command(epilog="Example: bmd-rths analyze bags/el_centro_1940_ns_plc_fc_20260801_101500")
@click.argument("bags", metavar="BAG...", nargs=-1, required=True)
@json_option
def analyze(bags: tuple[str, ...], as_json: bool) -> int:
    """Compute the errors of recorded tests against the reference, from their bags alone.

    Of one bag everything is told; of several, Tables 2 and 3 of the paper beside the paper's numbers.
    """
    results = [_result(bag) for bag in bags]
    if len(results) == 1:
        (result,) = results
        show({name: value for name, value in result.items() if name not in _OF_MANY}, as_json)
    elif as_json:
        click.echo(json.dumps({"runs": results}))
    else:
        show_error_tables(results, varied=False)
    return 0


#: What is told of a bag only beside others.
_OF_MANY = ("event", "file", "variation")


def _result(bag: str) -> dict[str, Any]:
    record = read_bag(bag)
    if record.outcome == "cut":
        log(f"warning: {bag}: {record.reason}")
    return result_with_event({**result_of(record), "bag": bag}, record.motion["source"])
