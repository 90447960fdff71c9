"""A real MAVSDK client, unchanged, flies the mock through the bench: telemetry, mission, arm, fly, land."""

from __future__ import annotations

import json
import math
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def until(condition: Callable[[], bool], what: str, limit_s: float = 60.0) -> None:
    deadline = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < deadline, f"{what} did not come within {limit_s} s"
        time.sleep(0.02)


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_mavsdk_flies_the_mock(tmp_path: Path) -> None:
    mavsdk = pytest.importorskip("mavsdk")
    from mavsdk.plugins.action import Action
    from mavsdk.plugins.mission import Mission, MissionItem, MissionPlan
    from mavsdk.plugins.telemetry import Telemetry

    port = free_port()
    settings = ["mission=null", "pace=4", "duration_s=200", f"router.sdk=udp:127.0.0.1:{port}"]
    command = [sys.executable, "-m", "hil.cli", "run", "--quiet", "--out", str(tmp_path)]
    command += [x for s in settings for x in ("--set", s)]
    bench = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    client = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION))
    try:
        client.add_any_connection(f"udpin://127.0.0.1:{port}")
        vehicle = client.first_autopilot(30.0)
        assert vehicle is not None, "MAVSDK found no autopilot"
        telemetry, action, mission = Telemetry(vehicle), Action(vehicle), Mission(vehicle)
        until(lambda: telemetry.health().is_armable, "armable")
        until(lambda: telemetry.health().is_global_position_ok, "global position")
        until(lambda: telemetry.health().is_home_position_ok, "home position")
        start = telemetry.position()
        assert start.latitude_deg == pytest.approx(47.397742, abs=1e-5)
        nan = math.nan

        def item(north_m: float, east_m: float) -> MissionItem:
            latitude = start.latitude_deg + north_m / 111_190
            longitude = start.longitude_deg + east_m / 75_350
            camera, vehicle_action = MissionItem.CameraAction.NONE, MissionItem.VehicleAction.NONE
            return MissionItem(
                latitude, longitude, 8.0, 3.0, True, nan, nan, camera, nan, nan, 1.0, nan, nan, vehicle_action
            )

        mission.upload_mission(MissionPlan([item(10, 0), item(10, 10)]))
        assert len(mission.download_mission().mission_items) == 2
        action.arm()
        mission.start_mission()
        until(lambda: telemetry.in_air(), "take-off")
        until(lambda: mission.is_mission_finished(), "end of the mission")
        assert telemetry.position().relative_altitude_m == pytest.approx(8.0, abs=0.5)
        action.land()
        until(lambda: not telemetry.in_air(), "landing")
        until(lambda: not telemetry.armed(), "disarming")
        assert bench.wait(60) == 0, bench.stderr.read() if bench.stderr else ""
    finally:
        client.destroy()
        bench.kill()
        bench.wait()
    run = json.loads((tmp_path / "run.json").read_text())
    assert run["status"] == "PASS"
    assert run["deterministic"] is False  # somebody else had a say
    assert run["mission"]["landed"] is True
