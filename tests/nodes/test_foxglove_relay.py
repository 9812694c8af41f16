"""Foxglove watches a test from its bag: every message arrives as it was recorded, and a client can do nothing."""

import asyncio
import json
import struct
import time

import pytest
from tornado.httpclient import HTTPRequest
from tornado.websocket import websocket_connect

from bmd_rths_core import load_config
from bmd_rths_core.errors import InputError
from bmd_rths_msgs_py.bag_description import end_metadata, start_metadata
from bmd_rths_msgs_py.bag_writer import BagWriter, message_definition
from bmd_rths_msgs_py.cdr import ScalarCodec
from bmd_rths_msgs_py.topics import COMMAND, DESIRED_ACCELERATION
from bmd_rths_nodes.monitor_page import foxglove_relay
from bmd_rths_nodes.monitor_page.foxglove_relay import FoxgloveRelay
from tests.nodes.conftest import CONFIG


def test_messages_arrive_as_they_were_recorded_and_a_client_can_do_nothing(tmp_path):
    configuration = load_config(CONFIG).as_mapping()
    writer = BagWriter(tmp_path / "bag", metadata=start_metadata(configuration, {"name": "a"}, {}))
    relay = FoxgloveRelay(0)
    relay.follow(tmp_path / "not there")
    relay.follow(tmp_path / "bag")
    pack = ScalarCodec("world").pack

    def record(topic, step, heard_ns):
        data = pack(5_000_000 * step, float(step))
        writer.write(topic.full_name, topic.type_name, data, heard_ns, heard_ns)
        writer.flush()
        relay.look()
        return data

    async def watch():
        record(COMMAND, 0, time.time_ns() - 60 * 10**9)  # history
        record(DESIRED_ACCELERATION, 0, time.time_ns())
        request = HTTPRequest(f"ws://127.0.0.1:{relay.port}/")
        connection = await websocket_connect(request, subprotocols=["foxglove.sdk.v1"])

        async def next_message():
            return await asyncio.wait_for(connection.read_message(), 10.0)

        info = json.loads(await next_message())
        assert (info["op"], info["name"], info["capabilities"]) == ("serverInfo", "bmd_rths", [])
        (channel,) = json.loads(await next_message())["channels"]
        assert (channel["topic"], channel["encoding"]) == ("/rths/desired_acceleration", "cdr")
        assert (channel["schemaName"], channel["schemaEncoding"]) == (DESIRED_ACCELERATION.type_name, "ros2msg")
        assert channel["schema"] == message_definition(DESIRED_ACCELERATION.type_name)[0]
        subscription = {"id": 7, "channelId": channel["id"]}
        await connection.write_message(json.dumps({"op": "subscribe", "subscriptions": [subscription]}))
        publication = {"id": 1, "topic": "/rths/command", "encoding": "cdr", "schemaName": COMMAND.type_name}
        await connection.write_message(json.dumps({"op": "advertise", "channels": [publication]}))
        refused = json.loads(await next_message())
        assert refused["op"] == "status"
        heard = time.time_ns()
        data = record(DESIRED_ACCELERATION, 1, heard)
        message = await next_message()
        assert struct.unpack("<BIQ", message[:13]) == (1, 7, heard)
        assert message[13:] == data
        connection.close()

    try:
        asyncio.run(watch())
    finally:
        relay.stop()
        writer.close(end_metadata("finished", "", None))


def test_port_in_use_is_one_line():
    relay = FoxgloveRelay(0)
    try:
        with pytest.raises(InputError, match=f"--foxglove {relay.port}: "):
            FoxgloveRelay(relay.port)
    finally:
        relay.stop()


def test_without_the_sdk_the_line_says_what_to_install(monkeypatch):
    def missing(name):
        raise ModuleNotFoundError(f"No module named {name!r}")

    monkeypatch.setattr(foxglove_relay, "import_module", missing)
    with pytest.raises(InputError, match=r"requires foxglove-sdk .*'bmd_rths_nodes\[foxglove\]'"):
        FoxgloveRelay(0)


def test_foxglove_belongs_to_the_page(run_main):
    status, _, errors = run_main("monitor", "--foxglove", "8765")
    assert (status, errors) == (2, "error: --foxglove belongs to --web\n")
