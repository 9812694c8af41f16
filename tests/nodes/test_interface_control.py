"""A compensator that owns the interface, on the ROS graph: equal to the loop in process, bit for bit."""

import json

import pytest
from rosbags.highlevel import AnyReader

from bmd_rths_core.config import load_config
from bmd_rths_core.ground_motion.config import select_ground_motion
from bmd_rths_core.loop.rths_loop import RthsLoop
from bmd_rths_msgs_py.bag_reader import read_bag
from bmd_rths_msgs_py.record_bag import write_record
from tests.nodes.conftest import CONFIG, EIGHT_STORY

SHORT = 4.0
SETTINGS = {"ground_motion.duration": SHORT, "shear_estimator.source": "load_cell", "run.preflight": "skip"}
SET = [argument for key, value in SETTINGS.items() for argument in ("--set", f"{key}={value}")]


def in_process(path):
    changes = {key.replace(".", "__"): value for key, value in SETTINGS.items()}
    config = load_config(path).changed(run__scheme="mpic", **changes)
    return RthsLoop(config, select_ground_motion(config.ground_motion, config.run.time_step)).run()


def recorded(ended):
    status, output, errors = ended
    assert status == 0, errors
    return json.loads(output)["bag"]


def demands(bag):
    """Return the pairs of desired acceleration and command as another tool reads them."""
    with AnyReader([bag]) as reader:
        wanted = [c for c in reader.connections if c.topic == "/rths/desired_acceleration"]
        messages = (reader.deserialize(data, c.msgtype) for c, _, data in reader.messages(wanted))
        return [(m.accel.linear.x, m.accel.linear.y) for m in messages]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "options"), [(CONFIG, ["--composed"]), (EIGHT_STORY, [])], ids=["simplified-composed", "eight-story-five"]
)
def test_lockstep_equals_the_loop_in_process_bit_for_bit(run_main, tmp_path, path, options):
    bag = recorded(
        run_main("run", path, "--scheme", "mpic", "--lockstep", *options, *SET, "--output", tmp_path, "--json")
    )
    record, expected = read_bag(bag), in_process(path)
    assert record.outcome == "finished"
    assert record.steps == expected.steps == int(SHORT / 0.005) + 1
    assert record.same_signals(expected)


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["ats", "ff_lqg"])
def test_shaper_learns_from_the_measurements_as_in_process(run_main, tmp_path, scheme):
    options = ("--lockstep", "--composed", "--set", "ground_motion.duration=2.0", "--output", tmp_path, "--json")
    skip = ("--set", "run.preflight=skip")
    record = read_bag(recorded(run_main("run", CONFIG, "--scheme", scheme, *skip, *options)))
    config = load_config(CONFIG).changed(run__scheme=scheme, ground_motion__duration=2.0)
    expected = RthsLoop(config, select_ground_motion(config.ground_motion, config.run.time_step)).run()
    assert record.same_signals(expected)


@pytest.mark.slow
def test_real_time_equals_the_loop_in_process_up_to_the_first_missed_deadline_and_is_replayed(run_main, tmp_path):
    patient = ("--set", "run.longest_miss_time=1.0", "--set", "safety.stale_shear_time=1.0")
    for _ in range(3):  # a busy machine may miss the very first deadline: then there is nothing to compare
        bag = recorded(
            run_main("run", CONFIG, "--scheme", "mpic", "--composed", *SET, *patient, "--output", tmp_path, "--json")
        )
        record, expected = read_bag(bag), in_process(CONFIG)
        first_miss = min(record.timing.missed_steps, default=record.steps)
        if first_miss > 0:
            break
    assert first_miss > 0
    for name, signal in record.signals().items():
        assert (signal[:first_miss] == expected.signals()[name][:first_miss]).all(), name
    _, replayed, _ = run_main("replay", bag, "--json")
    assert json.loads(replayed)["reproduced"] is True


def test_command_travels_with_the_desired_acceleration_also_in_a_bag_of_the_loop_in_process(tmp_path):
    record = in_process(CONFIG)
    bag = write_record(record, tmp_path / "bag")
    pairs = list(zip(record.desired_acceleration.tolist(), record.command.tolist(), strict=True))
    assert demands(bag) == pairs
    assert read_bag(bag).same_signals(record)
