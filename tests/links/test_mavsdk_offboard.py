"""A real MAVSDK client flies OFFBOARD through the router, much faster than real time: its streams are held."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from tests.links.bench_process import BenchProcess, free_port, until


def test_mavsdk_flies_offboard_faster_than_real_time(tmp_path: Path) -> None:
    mavsdk = pytest.importorskip("mavsdk")
    from mavsdk.plugins.action import Action
    from mavsdk.plugins.offboard import Offboard, PositionNedYaw
    from mavsdk.plugins.telemetry import Telemetry

    port = free_port()
    settings = ["mission=null", "duration_s=20000", f"router.sdk=udp:127.0.0.1:{port}", "record.mcap=false"]
    client = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION))
    client.add_any_connection(f"udpin://127.0.0.1:{port}")
    try:
        with BenchProcess(tmp_path, *settings) as bench:
            vehicle = until(lambda: client.first_autopilot(1.0), "an autopilot")
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
    finally:
        client.destroy()
    assert run["error"] is None
    assert run["router"]["repeated_setpoints"] > 0
    assert run["router"]["repeated_heartbeats"] > 0
