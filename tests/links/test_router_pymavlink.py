"""Real pymavlink clients, unchanged, on every kind of endpoint at once: parameters, mission, mode, arming."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import all as mavlink

from hil.run_files import TLOG_NAME
from tests.worlds.bench_process import BenchProcess, free_port
from tests.worlds.patience import PATIENCE_S, until

LATITUDE, LONGITUDE = 473977420, 85455940


class Peer:
    """A pymavlink connection and its answers."""

    def __init__(self, address: str, system: int) -> None:
        self.link: Any = until(lambda: self._connect(address, system), f"{address}")

    @staticmethod
    def _connect(address: str, system: int) -> Any:
        try:
            return mavutil.mavlink_connection(address, source_system=system, dialect="all", retries=1)
        except OSError:
            return None  # the bench does not listen yet

    def say_hello(self) -> None:
        self.link.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4)

    def ask(self, question: Callable[[], None], *kinds: str) -> Any:
        """Repeat the request until an answer of one of these kinds arrives, as clients do."""

        def answered() -> Any:
            question()
            return self.link.recv_match(type=list(kinds), blocking=True, timeout=2.0)

        return until(answered, " or ".join(kinds))

    def command(self, number: int, *params: float) -> int:
        """Send a command and return the result in its acknowledgement."""
        values = [*params, *[0.0] * (7 - len(params))]
        ack = self.ask(lambda: self.link.mav.command_long_send(1, 1, number, 0, *values), "COMMAND_ACK")
        assert ack.command == number
        return int(ack.result)


@pytest.fixture
def closing() -> Any:
    peers: list[Peer] = []
    yield peers
    for peer in peers:
        peer.link.close()


def upload(peer: Peer, items: list[Any]) -> None:
    mav = peer.link.mav
    request = peer.ask(lambda: mav.mission_count_send(1, 1, len(items), 0), "MISSION_REQUEST_INT", "MISSION_REQUEST")
    while request.get_type() != "MISSION_ACK":
        item = items[request.seq]
        request = peer.ask(lambda item=item: mav.send(item), "MISSION_REQUEST_INT", "MISSION_REQUEST", "MISSION_ACK")
    assert request.type == mavlink.MAV_MISSION_ACCEPTED


def test_pymavlink_clients_work_unchanged(tmp_path: Path, closing: list[Peer]) -> None:
    listens, comes, connects = free_port(), free_port(), free_port()
    settings = ["mission=null", "duration_s=3000", "pace=5", f"router.sdk=udp:127.0.0.1:{listens}"]
    settings += [f"router.companion=udpin:127.0.0.1:{comes}", f"router.more=[tcp:127.0.0.1:{connects}]"]
    first = Peer(f"udpin:127.0.0.1:{listens}", 245)
    closing.append(first)
    with BenchProcess(tmp_path, *settings) as bench:
        heartbeat = first.link.wait_heartbeat(timeout=PATIENCE_S)
        assert heartbeat is not None
        assert heartbeat.autopilot == mavlink.MAV_AUTOPILOT_PX4
        second, third = Peer(f"udpout:127.0.0.1:{comes}", 246), Peer(f"tcp:127.0.0.1:{connects}", 247)
        closing += [second, third]
        for peer in closing:
            # Each client sees the vehicle and the other clients.
            peer.ask(peer.say_hello, "ATTITUDE")
        first.say_hello()
        for peer in (second, third):
            until(lambda peer=peer: peer.link.recv_match(type="HEARTBEAT", blocking=True).get_srcSystem() == 245, "245")

        # Parameters: all of them, then one set and read back.
        value = first.ask(first.link.param_fetch_all, "PARAM_VALUE")
        names = {value.param_id}

        def all_named() -> bool:
            message = first.link.recv_match(type="PARAM_VALUE", blocking=True, timeout=PATIENCE_S)
            if message is None:
                first.link.param_fetch_all()  # something was lost
            else:
                names.add(message.param_id)
            return len(names) == value.param_count

        until(all_named, "every parameter")
        # The second client also received the first one's list and has not read it.
        while second.link.recv_match() is not None:
            pass

        def changed() -> bool:
            value = second.ask(lambda: second.link.param_set_send("MPC_XY_CRUISE", 3.5), "PARAM_VALUE")
            return (value.param_id, value.param_value) == ("MPC_XY_CRUISE", 3.5)

        until(changed, "the changed parameter")

        # A mission by one client, read by another.
        frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
        items = [
            mavlink.MAVLink_mission_item_int_message(
                1, 1, seq, frame, command, 0, 1, 0, 0, 0, float("nan"), LATITUDE + 900 * seq, LONGITUDE, 10.0
            )
            for seq, command in enumerate((22, 16, 16, 21))
        ]
        upload(third, items)
        count = second.ask(lambda: second.link.mav.mission_request_list_send(1, 1), "MISSION_COUNT")
        assert count.count == 4
        for seq, item in enumerate(items):
            read = second.ask(lambda seq=seq: second.link.mav.mission_request_int_send(1, 1, seq), "MISSION_ITEM_INT")
            assert (read.seq, read.command, read.x) == (seq, item.command, item.x)
        second.link.mav.mission_ack_send(1, 1, 0)

        # Mode and arming by pymavlink's own helpers.
        def mode() -> str:
            first.link.set_mode("LOITER")
            first.link.recv_match(type="HEARTBEAT", condition="HEARTBEAT.get_srcSystem()==1", blocking=True, timeout=2)
            return str(first.link.flightmode)

        until(lambda: mode() == "LOITER", "the mode")
        until(lambda: third.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == 0, "arming")
        second.link.motors_armed_wait()
        first.link.arducopter_disarm()
        second.link.motors_disarmed_wait()
        run = bench.finish()
    assert run["error"] is None
    assert run["deterministic"] is False
    assert run["router"]["clients"] == 3
    assert run["router"]["looped"] == run["router"]["damaged_bytes"] == run["router"]["dropped"] == 0
    log = mavutil.mavlink_connection(str(tmp_path / TLOG_NAME), dialect="all")
    senders = set()
    while (message := log.recv_match(type=["HEARTBEAT", "PARAM_REQUEST_LIST", "MISSION_ITEM_INT"])) is not None:
        senders.add((message.get_type(), message.get_srcSystem()))
    assert senders >= {("HEARTBEAT", 245), ("HEARTBEAT", 246), ("HEARTBEAT", 247), ("HEARTBEAT", 1)}
    assert senders >= {("PARAM_REQUEST_LIST", 245), ("MISSION_ITEM_INT", 247), ("MISSION_ITEM_INT", 1)}
