"""A disk that is full when a bag is opened: one line, no file left open."""

import resource
import warnings
from contextlib import contextmanager

import pytest

from bmd_rths_core.errors import InputError
from bmd_rths_msgs_py.bag_writer import BagWriter


@contextmanager
def largest_file(size):
    """Let no file of this process become larger [bytes], as on a disk without room."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.parametrize("size", [0, 100, 20_000])
def test_disk_without_room_for_the_beginning_of_a_bag_is_told_in_one_line(tmp_path, size):
    """20 kB have room for the first record of the bag, and not for its metadata.yaml."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", ResourceWarning)
        with largest_file(size), pytest.raises(InputError, match="cannot be written: File too large") as refused:
            BagWriter(tmp_path / "bag", metadata={"configuration": 15_000 * "é"})
    assert "\n" not in str(refused.value)
