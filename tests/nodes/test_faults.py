"""Faults of real processes, one of a kind; benchmarks/faults.py has the other kinds, and more of each at random.

A killed command shaper, a second run on the same domain and a controller that freezes have tests of their own in
test_run.py and test_emulate.py.
"""

import pytest

from tests.faults.processes import outcome_of

CHOSEN = (
    *("kill_table_driver", "kill_recorder", "kill_command_line"),
    *("stop_recorder", "disk_full", "foreign_command"),
)


@pytest.mark.slow
@pytest.mark.parametrize("kind", CHOSEN)
def test_table_is_at_rest_the_reason_is_told_the_bag_opens_and_no_process_is_left(kind, tmp_path):
    assert outcome_of(kind, 0, tmp_path).wrong == ()
