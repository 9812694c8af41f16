"""``bmd-rths analyze``: everything again from the bag alone."""

from __future__ import annotations

import click

from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_nodes.cli.options import json_option, log
from bmd_rths_nodes.cli.results import result_of, show


@click.command(epilog="Example: bmd-rths analyze bags/el_centro_1940_ns_plc_fc_20260801_101500")
@click.argument("bag", metavar="BAG")
@json_option
def analyze(bag: str, as_json: bool) -> int:
    """Compute the errors of a recorded test against the reference, from its bag alone."""
    record = read_bag(bag)
    if record.outcome == "cut":
        log(f"warning: {bag}: {record.reason}")
    show({**result_of(record), "bag": bag}, as_json)
    return 0
