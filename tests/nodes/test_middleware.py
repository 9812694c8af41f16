"""The middleware as this project sets it: no shared memory, and nobody who comes or goes costs a test."""

import json
import os
import socket
import time
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from bmd_rths_core.errors import InputError
from bmd_rths_nodes.ros.middleware import PROFILES, PROFILES_IN_FOLDER, RANGE, TRANSPORTS, prepare_middleware
from tests.nodes.conftest import CONFIG, wait_until

_OTHERS = ("ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "RMW_IMPLEMENTATION", "SKIP_DEFAULT_XML_FILE")


@pytest.fixture
def environment(monkeypatch, tmp_path):
    """Return an environment of a person who has chosen nothing, in a folder of their own."""
    chosen = {key: value for key, value in os.environ.items() if key not in (RANGE, PROFILES, TRANSPORTS, *_OTHERS)}
    monkeypatch.setattr(os, "environ", chosen)
    monkeypatch.chdir(tmp_path)
    return chosen


@pytest.fixture
def as_a_person(monkeypatch):
    """Let child processes begin with a discovery range only, as in a terminal."""
    monkeypatch.delenv(PROFILES, raising=False)
    monkeypatch.delenv(TRANSPORTS, raising=False)
    return lambda scope: monkeypatch.setenv(RANGE, scope)


def profile(environment):
    root = ElementTree.parse(environment[PROFILES]).getroot()
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    return root


@pytest.mark.parametrize("given", [{}, {RANGE: "SUBNET"}, {RANGE: "SYSTEM_DEFAULT"}])
def test_udp_only_is_a_variable_where_the_range_adds_nothing(environment, capsys, given):
    environment.update(given)
    before = dict(environment)
    prepare_middleware()
    assert environment == {**before, TRANSPORTS: "UDPv4", PROFILES: environment[PROFILES]}
    assert [element.tag for element in profile(environment)] == ["data_writer"]
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("given", [{RANGE: "LOCALHOST"}, {"ROS_LOCALHOST_ONLY": "1", "ROS_STATIC_PEERS": "127.0.0.9"}])
def test_localhost_becomes_a_profile_with_udp_only(environment, capsys, given):
    environment.update(given)
    prepare_middleware()
    assert environment[RANGE] == "SYSTEM_DEFAULT"
    assert "ROS_LOCALHOST_ONLY" not in environment
    root = profile(environment)
    assert [element.text for element in root.iter("type")] == ["UDPv4"]
    assert root.findtext(".//useBuiltinTransports") == "false"
    assert [element.text for element in root.iter("address")] == ["127.0.0.1"]
    assert capsys.readouterr().err == ""


def test_a_process_that_is_started_keeps_what_its_parent_has_set(environment, capsys):
    environment[RANGE] = "LOCALHOST"
    prepare_middleware()
    before = dict(environment)
    prepare_middleware()
    assert environment == before
    assert capsys.readouterr().err == ""


def test_static_peers_are_looked_for_with_localhost_too(environment):
    environment.update({RANGE: "LOCALHOST", "ROS_STATIC_PEERS": "127.0.0.7;127.0.0.8"})
    prepare_middleware()
    assert [e.text for e in profile(environment).iter("address")] == ["127.0.0.1", "127.0.0.7", "127.0.0.8"]


def test_a_static_peer_that_is_not_known_is_refused(environment, monkeypatch):
    def unknown(name):
        raise socket.gaierror(-2, "Name or service not known")

    monkeypatch.setattr(socket, "gethostbyname", unknown)
    environment.update({RANGE: "LOCALHOST", "ROS_STATIC_PEERS": "controler"})
    with pytest.raises(InputError, match="ROS_STATIC_PEERS: 'controler' is not a computer that is known: Name or"):
        prepare_middleware()


@pytest.mark.parametrize("scope", ["OFF", "LOCAL", "localhost"])
def test_a_range_in_which_no_test_is_possible_is_refused(environment, scope):
    environment[RANGE] = scope
    with pytest.raises(InputError, match=f"{RANGE}: {scope}, .*; allowed are SUBNET, LOCALHOST, SYSTEM_DEFAULT"):
        prepare_middleware()


@pytest.mark.slow
def test_a_node_refuses_such_a_range_in_one_line(start, as_a_person):
    as_a_person("OFF")
    result = start("-m", "bmd_rths_nodes.nodes.command_shaper").wait()
    assert result.status == 2
    assert result.errors.startswith(
        "error: ROS_AUTOMATIC_DISCOVERY_RANGE: OFF, with which nodes do not find each other"
    )
    assert len(result.errors.splitlines()) == 1


@pytest.mark.parametrize("in_folder", [False, True])
@pytest.mark.parametrize("scope", ["LOCALHOST", "SUBNET"])
def test_a_profile_of_a_persons_own_is_left_as_it_is_and_told(environment, tmp_path, capsys, scope, in_folder):
    own = tmp_path / (PROFILES_IN_FOLDER if in_folder else "own.xml")
    own.write_text("<profiles/>")
    environment[RANGE] = scope
    if not in_folder:
        environment[PROFILES] = str(own)
    before = dict(environment)
    prepare_middleware()
    assert environment == {**before, TRANSPORTS: "UDPv4"}
    told = capsys.readouterr().err
    assert f"the profile {own} is used as it is" in told
    assert ("LOCALHOST adds shared memory" in told) == (scope == "LOCALHOST")


def test_a_profile_in_the_folder_that_fast_dds_skips_is_none(environment, tmp_path, capsys):
    (tmp_path / PROFILES_IN_FOLDER).write_text("<profiles/>")
    environment.update({RANGE: "LOCALHOST", "SKIP_DEFAULT_XML_FILE": "1"})
    prepare_middleware()
    assert environment[RANGE] == "SYSTEM_DEFAULT"
    assert capsys.readouterr().err == ""


def test_another_middleware_is_left_as_it_is_and_told(environment, capsys):
    environment.update({RANGE: "LOCALHOST", "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"})
    before = dict(environment)
    prepare_middleware()
    assert environment == before
    assert "RMW_IMPLEMENTATION is rmw_cyclonedds_cpp" in capsys.readouterr().err


def test_shared_memory_that_a_person_has_asked_for_is_told(environment, capsys):
    environment[TRANSPORTS] = "DEFAULT"
    prepare_middleware()
    assert environment[TRANSPORTS] == "DEFAULT"
    assert "FASTDDS_BUILTIN_TRANSPORTS is DEFAULT, which has shared memory" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("scope", ["LOCALHOST", "SUBNET", "SYSTEM_DEFAULT"])
def test_a_node_has_no_shared_memory(start, as_a_person, domain, scope):
    as_a_person(scope)
    node = start("-m", "bmd_rths_nodes.nodes.command_shaper", "--ros-args", "-p", "run.record:=false")

    def files():
        return {line.split()[-1] for line in Path(f"/proc/{node.process.pid}/maps").read_text().splitlines()}

    wait_until(lambda: any("libfastrtps" in name for name in files()))
    wait_until(lambda: len(list(Path(f"/proc/{node.process.pid}/task").iterdir())) > 5)  # the participant is there
    time.sleep(0.5)
    assert not [name for name in files() if name.startswith("/dev/shm/fastrtps")]


@pytest.mark.slow
@pytest.mark.parametrize("scope", ["LOCALHOST", "SUBNET"])
def test_a_status_is_acknowledged_before_the_middleware_would_ask_for_it(start, as_a_person, scope):
    """By itself it asks every 3 s, and the process of a node would end before what was lost is sent again."""
    as_a_person(scope)
    script = Path(__file__).with_name("last_words.py")
    start(script, "hears")
    result = start(script).wait()
    assert result.output.split() == ["True"] * 5, result.errors


@pytest.mark.slow
def test_readers_that_come_and_go_do_not_cost_a_test(start, as_a_person):
    # A port of shared memory that is opened may hold a publisher up for 333 ms. The limits are below that, but wider
    # than the default, because a busy machine that computes the tests of others takes its time too.
    as_a_person("LOCALHOST")
    patience = ("safety.stale_shear_time=0.275", "run.longest_miss_time=0.275")
    endless = ("ground_motion.free_vibration=600.0", "run.preflight=skip")
    options = [word for setting in (*endless, *patience) for word in ("--set", setting)]
    test = start("-m", "bmd_rths_nodes.cli.main", "run", CONFIG, "--composed", "--json", "--output", "bags", *options)
    bags = test.output.parent / "bags"
    wait_until(lambda: any(file.stat().st_size > 200_000 for file in bags.glob("*/*.mcap")) or test.process.poll())
    visitors = []
    for kind in ("reader", "idle") * 5:
        visitors.append(start(Path(__file__).with_name("visitor.py"), kind))
        time.sleep(0.7)
    assert [visitor.wait().errors for visitor in visitors] == [""] * len(visitors)
    assert test.process.poll() is None, test.errors.read_text()
    test.interrupt()
    result = test.wait()
    told = json.loads(result.output)
    assert (told["outcome"], told["reason"]) == ("stopped", "table_driver: stopped by the operator"), result.errors
