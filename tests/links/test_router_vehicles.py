"""Several mocks of one bench at one port: each obeys its own commands only, and a MAVSDK program flies all."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import all as mavlink

from tests.worlds.bench_process import BenchProcess, free_port
from tests.worlds.patience import until

IDS = [1, 2, 3]


@contextmanager
def three_mocks(out: Path, port: int) -> Iterator[BenchProcess]:
    bench = out / "three.yaml"
    bench.write_text(
        f"rig: mock\nduration_s: 3000\npace: 4\nautopilot: {{transport: loopback}}\nrecord: {{mcap: false}}\n"
        f"router: {{gcs: 'udp:127.0.0.1:{port}'}}\ncount: 3\nvehicles:\n  'drone{{n}}': {{}}\n"
        "formation: {shape: line, spacing_m: 6, max_error_m: null}\n"
    )
    with BenchProcess(out, bench=bench) as process:
        yield process


def test_pymavlink_sees_all_on_one_port_and_only_the_addressed_one_answers(tmp_path: Path) -> None:
    port = free_port()
    link: Any = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", source_system=245, dialect="all")
    answers: dict[int, set[int]] = {number: set() for number in IDS}
    seen: set[int] = set()

    def all_seen() -> bool:
        message = link.recv_match(type="HEARTBEAT", blocking=True, timeout=2)
        if message is not None and message.autopilot == mavlink.MAV_AUTOPILOT_PX4:
            seen.add(message.get_srcSystem())
        return len(seen) == len(IDS)

    def accepted(target: int, arm: int) -> bool:
        link.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4)
        link.mav.command_long_send(target, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, arm, *[0] * 6)
        results = []
        while (ack := link.recv_match(type="COMMAND_ACK", blocking=True, timeout=0.3)) is not None:
            answers[target].add(ack.get_srcSystem())
            results.append(ack.result)
        return mavlink.MAV_RESULT_ACCEPTED in results

    try:
        with three_mocks(tmp_path, port) as bench:
            until(all_seen, "three vehicles")
            for target in IDS:
                until(lambda target=target: accepted(target, 1), f"arming of {target}")
            for target in IDS:
                until(lambda target=target: accepted(target, 0), f"disarming of {target}")
            run = bench.finish()
    finally:
        link.close()
    assert sorted(seen) == IDS
    assert answers == {number: {number} for number in IDS}
    assert run["error"] is None
    assert run["deterministic"] is False


@pytest.mark.slow
def test_one_mavsdk_program_flies_three_vehicles(tmp_path: Path) -> None:
    mavsdk = pytest.importorskip("mavsdk")
    from mavsdk.plugins.action import Action
    from mavsdk.plugins.telemetry import Telemetry

    port = free_port()
    client = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION))
    client.add_any_connection(f"udpin://127.0.0.1:{port}")

    def systems() -> list[Any]:
        return [system for system in client.get_systems() if system.has_autopilot()]

    def fly(system: Any) -> float:
        """Take off, go 10 m north, land, and return how far north the vehicle stands [m]."""
        telemetry, action, number = Telemetry(system), Action(system), system.get_system_id()
        until(lambda: telemetry.health().is_armable, f"armable {number}")
        until(lambda: telemetry.health().is_home_position_ok, f"home of {number}")
        start = telemetry.position()

        def north_m() -> float:
            return (telemetry.position().latitude_deg - start.latitude_deg) * 111_190

        action.set_takeoff_altitude(5.0)
        action.arm()
        action.takeoff()
        until(lambda: telemetry.position().relative_altitude_m > 4.5, f"height of {number}")
        goal_deg = start.latitude_deg + 10 / 111_190
        action.goto_location(goal_deg, start.longitude_deg, start.absolute_altitude_m + 5.0, 0.0)
        until(lambda: north_m() > 9.5, f"goal of {number}")
        action.land()
        until(lambda: not telemetry.armed(), f"landing of {number}")
        return north_m()

    try:
        with three_mocks(tmp_path, port) as bench:
            until(lambda: len(systems()) == len(IDS), "three vehicles")
            found = systems()
            assert sorted(system.get_system_id() for system in found) == IDS
            with ThreadPoolExecutor(len(found)) as pool:
                assert list(pool.map(fly, found)) == pytest.approx([10.0] * 3, abs=1.0)
            run = bench.finish()
    finally:
        client.destroy()
    assert run["status"] == "PASS"
    assert run["contacts"] == []
    assert all(vehicle["mission"]["landed"] for vehicle in run["vehicles"].values())
