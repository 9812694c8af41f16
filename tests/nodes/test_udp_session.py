"""Session of a UDP table: who may command it, what stops it, and what is told when nobody answers."""

import socket

import pytest

from bmd_rths_core.table.controller import TableCommand
from bmd_rths_core.table.emulated.faults import parse_fault
from bmd_rths_core.table.wire import Interlock
from bmd_rths_nodes.hardware.controllers import make_table_controller as make_udp_table
from tests.nodes.conftest import wait_until
from tests.nodes.emulation import LOCKSTEP, emulator
from tests.nodes.scripted_controller import REAL_TIME


def test_silent_host_finds_an_interlock_that_only_a_reset_ends():
    config = REAL_TIME.changed(virtual_controller__return_frequency=50.0, virtual_controller__watchdog=0.05)
    with emulator(config) as (server, connected):
        table = make_udp_table(connected)
        table.connect()
        table.exchange(TableCommand(0, 1.0))
        wait_until(lambda: server.statistics()["state"] == "interlock")
        with pytest.raises(RuntimeError, match=r"is in an interlock \(watchdog\)"):
            table.exchange(TableCommand(1, 1.0))
        with pytest.raises(RuntimeError, match=r"\(watchdog\); look at the table, then reset the interlock"):
            table.connect()
        table.close()
        wait_until(lambda: can_connect(make_udp_table(connected.changed(table__reset_interlock=True))))


def can_connect(table):
    try:
        table.connect()
    except RuntimeError:
        return False
    finally:
        table.close()
    return True


def test_controller_of_a_host_that_died_tells_the_next_one_what_to_do():
    config = REAL_TIME.changed(virtual_controller__return_frequency=50.0, virtual_controller__watchdog=0.05)
    with emulator(config) as (_, connected):
        dead = make_udp_table(connected)
        dead.connect()
        dead.exchange(TableCommand(0, 1.0))
        dead._transport.close()
        following = make_udp_table(connected.changed(table__give_up_after=4.0))
        with pytest.raises(RuntimeError, match=r"\(watchdog\); .* or start with table\.reset_interlock=true"):
            following.connect()
        following.close()
        wait_until(lambda: can_connect(make_udp_table(connected.changed(table__reset_interlock=True))))


def test_emergency_stop_is_an_interlock_at_once():
    with emulator(REAL_TIME) as (server, connected):
        table = make_udp_table(connected)
        table.connect()
        table.exchange(TableCommand(0, 1.0))
        table.emergency_stop()
        assert server.statistics()["state"] == "interlock"
        assert server.statistics()["interlock"] == Interlock.EMERGENCY_STOP
        assert table.statistics()["udp_stop"] == "confirmed"
        with pytest.raises(RuntimeError, match="refused: the table is stopped"):
            table.exchange(TableCommand(1, 1.0))
        table.close()


def test_second_host_cannot_disturb_the_first():
    with emulator() as (server, connected):
        first, second = make_udp_table(connected), make_udp_table(connected.changed(table__give_up_after=0.1))
        first.connect()
        first.exchange(TableCommand(0, 0.0))
        with pytest.raises(RuntimeError, match="no answer"):
            second.connect()
        assert first.exchange(TableCommand(1, 0.0)).step == 1
        assert server.statistics()["wrong_session"] > 0
        first.close()
        second.connect()  # the table is free now
        second.close()


def test_nobody_there_and_unknown_host_are_told_in_one_line():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as nobody:
        nobody.bind(("127.0.0.1", 0))
        config = LOCKSTEP.changed(table__give_up_after=0.1)
        silent = make_udp_table(config.changed(table__address=f"udp://127.0.0.1:{nobody.getsockname()[1]}"))
        with pytest.raises(RuntimeError, match=r"no answer from udp://127\.0\.0\.1:\d+ within 0\.1 s"):
            silent.connect()
        silent.close()
    unusable = make_udp_table(LOCKSTEP.changed(table__local_address="udp://192.0.2.1:0"))
    with pytest.raises(OSError, match=r"udp://127\.0\.0\.1:50600 from udp://192\.0\.2\.1:0: Cannot assign"):
        unusable.connect()


def test_fault_at_run_time_through_the_controller_is_seen_by_the_host():
    with emulator() as (server, connected):
        table = make_udp_table(connected.changed(table__give_up_after=0.1))
        table.connect()
        table.exchange(TableCommand(0, 0.0))
        server._faults.set(parse_fault("loss=100"))
        with pytest.raises(RuntimeError, match="no answer"):
            table.exchange(TableCommand(1, 0.0))
        server._faults.clear("loss")
        table.close()
        assert table.statistics()["udp_stop"] == "confirmed"
