"""The buttons of `run --monitor` are presses of Ctrl-C."""

import pytest

from bmd_rths_nodes.cli.monitor_web import RunPage


@pytest.fixture
def buttons(monkeypatch):
    """Return the page of a run without its process."""
    monkeypatch.setattr("bmd_rths_nodes.cli.monitor_web.PageProcess", lambda *_: Silent())
    return RunPage(0)


class Silent:
    url = "http://127.0.0.1:1/"


@pytest.mark.parametrize(
    ("asked", "presses"),
    [
        (["stop"], 1),
        (["stop", "stop", "stop"], 1),  # never more: a second Ctrl-C is an emergency stop
        (["emergency_stop"], 2),
        (["stop", "emergency_stop"], 2),
        (["emergency_stop", "emergency_stop", "stop"], 2),  # never three: that would leave at once
    ],
    ids=str,
)
def test_buttons_are_as_many_presses_of_ctrl_c(buttons, asked, presses):
    interrupts = []
    assert buttons._on_ask("stop") == "no test is running"
    buttons.follow(interrupts)
    for what in asked:
        buttons._on_ask(what)
    assert len(interrupts) == presses
    buttons.leave()
    assert buttons._on_ask("emergency_stop") == "no test is running"
    assert len(interrupts) == presses


def test_ctrl_c_and_buttons_together(buttons):
    interrupts = [2]
    buttons.follow(interrupts)
    buttons._on_ask("stop")
    assert len(interrupts) == 1
    buttons._on_ask("emergency_stop")
    assert len(interrupts) == 2


def test_at_the_end_the_table_is_on_its_way_to_rest_and_only_an_emergency_stop_is_more(buttons):
    """`Supervisor.stop` has asked every process once; a further interrupt is an emergency stop."""
    for before in ([], [2], [2, 2]):
        interrupts = list(before)
        buttons._ending = False
        buttons.follow(interrupts)
        buttons.end()
        buttons._on_ask("stop")
        assert interrupts == before
        buttons._on_ask("emergency_stop")
        buttons._on_ask("emergency_stop")
        assert len(interrupts) == len(before) + 1
