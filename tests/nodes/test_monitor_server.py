"""The server of the page, without a browser: what it shows is what was recorded."""

import numpy as np

from bmd_rths_core.analysis.supervised_peaks import largest_increment
from bmd_rths_msgs_py import bag_follower
from bmd_rths_nodes.monitor_page.recordings import Recordings
from tests.nodes.monitor_view import looked_at


def test_signals_are_those_of_the_record(campaign_folder, simulated):
    view = looked_at(campaign_folder, "&span=2&since=100")
    signals = view["signals"]
    assert (view["steps"], view["at"], signals["first"]) == (simulated.steps, simulated.steps, simulated.steps - 400)
    for name, column in simulated.signals().items():
        expected = column[-400:]
        found = np.array(signals[name], dtype=float)  # None becomes NaN
        assert np.array_equal(found.T if column.ndim == 2 else found, expected, equal_nan=True), name


def test_only_what_is_new_is_sent(campaign_folder, simulated):
    assert looked_at(campaign_folder, f"&since={simulated.steps - 3}")["signals"]["first"] == simulated.steps - 3
    assert looked_at(campaign_folder, "&since=99999")["signals"]["command"] == []


def test_a_step_in_the_past_is_shown_as_it_was(campaign_folder, simulated):
    view = looked_at(campaign_folder, "&at=300&span=1")
    assert (view["at"], view["time"], view["steps"]) == (300, 1.5, simulated.steps)
    assert view["signals"]["command"] == simulated.command[100:300].tolist()
    used = {limit["words"]: limit for limit in view["limits"]}
    assert used["displacement"]["peak"] == np.abs(simulated.table_displacement[:300]).max()
    assert used["actuator force"]["limit"] == 500e3
    assert view["tracking"]["end"] == []  # no window is complete
    assert view["banner"]["word"] == "LOOKING BACK"


def test_limits_outcome_and_reasons_at_the_end(campaign_folder, simulated):
    view = looked_at(campaign_folder, "&overview=1")
    used = {limit["words"]: limit for limit in view["limits"]}
    assert used["change of command"]["peak"] == largest_increment(simulated)
    assert used["stability indicator"] == {
        "words": "stability indicator",
        "unit": "",
        "limit": 0.7,
        "now": None,
        "peak": None,
        "watched": True,
    }
    assert view["banner"] == {"word": "FINISHED", "sentence": simulated.reason, "colour": "good"}
    assert view["closure"] == {"why": "the test was simulated in process, without a clock"}
    assert view["overview"][1] == simulated.ground_acceleration.tolist()
    assert view["story"]["scheme"] == "plc_fc"


def test_folder_of_a_campaign_lists_its_runs_and_which_of_them_can_be_shown(campaign_folder):
    recordings = Recordings(campaign_folder)
    (bag,) = recordings.listed()
    campaign = recordings.campaign()
    assert campaign["rows"][0][:5] == ["el_centro_1940_ns", "plc_fc", "=1+1", "finished", "12.5"]
    assert campaign["ids"][0] == bag["id"]
    assert campaign["ids"][1] not in {bag["id"]}
    assert Recordings(campaign_folder / "bags").campaign() is None


def test_one_bag_its_folder_and_a_bag_that_is_added_later(campaign_folder, tmp_path):
    (bag,) = (campaign_folder / "bags").iterdir()
    assert [found["name"] for found in Recordings(bag).listed()] == [bag.name]
    assert [found["name"] for found in Recordings(next(bag.glob("*.mcap"))).listed()] == [f"{bag.name}_0.mcap"]
    recordings = Recordings()
    assert recordings.listed() == []
    recordings.add(tmp_path / "not_there_yet")
    recordings.add(bag)
    newest, older = recordings.listed()
    assert newest["name"] == bag.name
    assert recordings.view(older["id"]) is None
    assert recordings.view("../../etc") is None
    assert recordings.view(newest["id"]) is not None


def test_a_recording_is_loading_until_all_of_it_was_read(campaign_folder, monkeypatch):
    """What was read so far is of the past: it says neither that there is no test, nor that it runs or was cut."""
    monkeypatch.setattr(bag_follower, "LARGEST_LOOK", 50_000)
    recordings = Recordings(campaign_folder)
    (bag,) = recordings.listed()
    view = recordings.view(bag["id"])
    expected = {"word": "LOADING", "sentence": f"the recording {bag['name']} is being read", "colour": "quiet"}
    assert view.look(None, 0, 10.0, 2e9) == {"banner": expected}
    steps = [0]
    while recordings.look():
        found = view.look(None, 0, 10.0, 2e9)
        assert found["banner"] == expected
        steps.append(found["steps"])
    assert len(set(steps)) > 3
    assert view.look(None, 0, 10.0, 2e9)["banner"]["word"] == "FINISHED"


def test_a_bag_that_cannot_be_read_says_why(tmp_path):
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "bag_0.mcap").write_bytes(b"\x89MCAP0\r\n" + b"\x0c" + (17).to_bytes(8, "little") + bytes(17))
    recordings = Recordings(tmp_path)
    (bag,) = recordings.listed()
    view = recordings.view(bag["id"])
    view.problem = "configuration: not JSON"
    assert view.look(None, 0, 10.0, 0.0)["banner"]["sentence"] == "configuration: not JSON"
