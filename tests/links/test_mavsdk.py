"""A real MAVSDK client, unchanged, flies the mock through the router of the bench."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.worlds.bench_process import BenchProcess, free_port
from tests.worlds.patience import until


@contextmanager
def connected(out: Path, *settings: str) -> Iterator[tuple[BenchProcess, Any]]:
    """Yield a bench and its vehicle as MAVSDK finds it."""
    mavsdk = pytest.importorskip("mavsdk")
    port = free_port()
    client = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION))
    client.add_any_connection(f"udpin://127.0.0.1:{port}")
    try:
        with BenchProcess(out, "mission=null", f"router.sdk=udp:127.0.0.1:{port}", *settings) as bench:
            yield bench, until(lambda: client.first_autopilot(1.0), "an autopilot")
    finally:
        client.destroy()


def test_a_mission_is_uploaded_and_flown(tmp_path: Path) -> None:
    with connected(tmp_path, "pace=4", "duration_s=200") as (bench, vehicle):
        from mavsdk.plugins.action import Action
        from mavsdk.plugins.mission import Mission, MissionItem, MissionPlan
        from mavsdk.plugins.telemetry import Telemetry

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
                latitude, longitude, 3.0, 3.0, True, nan, nan, camera, nan, nan, 1.0, nan, nan, vehicle_action
            )

        mission.upload_mission(MissionPlan([item(5, 0), item(5, 5)]))
        assert len(mission.download_mission().mission_items) == 2
        action.arm()
        mission.start_mission()
        until(lambda: telemetry.in_air(), "take-off")
        until(lambda: mission.is_mission_finished(), "end of the mission")
        assert telemetry.position().relative_altitude_m == pytest.approx(3.0, abs=0.5)
        action.land()
        until(lambda: not telemetry.in_air(), "landing")
        until(lambda: not telemetry.armed(), "disarming")
        run = bench.finish()
    assert run["status"] == "PASS"
    assert run["deterministic"] is False  # somebody else had a say
    assert run["mission"]["landed"] is True


def test_offboard_much_faster_than_real_time_where_its_streams_are_held(tmp_path: Path) -> None:
    with connected(tmp_path, "duration_s=20000", "record.mcap=false") as (bench, vehicle):
        from mavsdk.plugins.action import Action
        from mavsdk.plugins.offboard import Offboard, PositionNedYaw
        from mavsdk.plugins.telemetry import Telemetry

        telemetry, action, offboard = Telemetry(vehicle), Action(vehicle), Offboard(vehicle)
        until(lambda: telemetry.health().is_armable, "armable")

        def at(north_m: float, east_m: float, down_m: float) -> bool:
            p = telemetry.position_velocity_ned().position
            return math.dist((p.north_m, p.east_m, p.down_m), (north_m, east_m, down_m)) < 0.6

        offboard.set_position_ned(PositionNedYaw(0.0, 0.0, -5.0, 0.0))
        offboard.start()
        action.arm()
        until(lambda: at(0, 0, -5), "height")
        for place in ((12.0, 0.0, -5.0), (12.0, 8.0, -6.0)):
            offboard.set_position_ned(PositionNedYaw(*place, 0.0))
            until(lambda place=place: at(*place), f"{place}")
        assert offboard.is_active()
        action.land()
        until(lambda: not telemetry.armed(), "landing")
        run = bench.finish()
    assert run["error"] is None
    assert run["router"]["repeated_setpoints"] > 0
    assert run["router"]["repeated_heartbeats"] > 0
