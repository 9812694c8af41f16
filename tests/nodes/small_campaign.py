"""A campaign of short made-up records: how it is asked for, and where its results are."""

import json
from pathlib import Path

from bmd_rths_nodes.campaign.results import CSV_NAME
from tests.nodes.conftest import CONFIG

#: The saw teeth of the records pass a limit when they come twice as fast.
AS_RECORDED = ("--set", "ground_motion.time_scale=1.0")


def campaign(*arguments):
    return ("campaign", CONFIG, *AS_RECORDED, "--jobs", 1, "--output", "out", *arguments)


def csv_text():
    return Path("out", CSV_NAME).read_text()


def runs_of(output):
    return json.loads(output)["runs"]
