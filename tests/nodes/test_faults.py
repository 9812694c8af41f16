"""Faults of real processes, one of a kind; benchmarks/faults.py has the other kinds, and more of each at random.

A killed command shaper, a second run on the same domain and a controller that freezes have tests of their own in
test_run.py and test_emulate.py.
"""

import pytest

from tests.faults.processes import outcome_of

#: Kind and seed, which decides whether the loop has one process: here that of `disk_full` and `foreign_command` has.
CHOSEN = {
    **dict.fromkeys(("kill_table_driver", "kill_recorder", "stop_recorder", "foreign_command"), 0),
    **dict.fromkeys(("kill_command_line", "disk_full"), 2),
}


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize(("kind", "seed"), CHOSEN.items(), ids=CHOSEN)
def test_table_is_at_rest_the_reason_is_told_the_bag_opens_and_no_process_is_left(kind, seed, tmp_path):
    assert outcome_of(kind, seed, tmp_path).wrong == ()
