"""What the dashboard is told of a run that the bench has built."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from firmware_bridge.links.autopilot_link import AutopilotLink
from firmware_bridge.manual.manual_control import Control
from hil.dashboard.client_views import stream_of
from hil.dashboard.snapshot import autopilot_health, channels_of
from hil.stages import StagePlan
from hil.summary import skipped_rows
from sim.sensors.catalog import KINDS

if TYPE_CHECKING:
    from hil.bench import BenchRun


def about(run: BenchRun, plan: StagePlan, link: AutopilotLink, home_W: Sequence[float]) -> dict[str, Any]:
    """Told once, at the start."""
    bench = run.bench
    config = bench.config
    sensors: dict[str, Any] = {}
    for name, sensor in config.sensors.items():
        kind = KINDS[sensor.kind]
        parts = () if kind.parts is None else getattr(sensor.parameters, kind.parts)
        run_has = [part for part in parts if f"{name}/{part}" in plan.order]
        drawn = name in plan.order or bool(run_has)
        sensors[name] = {
            "kind": sensor.kind,
            "rate_hz": sensor.rate_hz,
            "streams": [f"{name}/{part}" for part in channels_of(kind.sample_type, run_has)] if drawn else [],
        }
    return {
        "out": str(run.out.resolve()),
        "rig": config.rig,
        "scene": bench.scene.name,
        "mission": config.mission,
        "seed": config.seed,
        "tick_ns": config.tick_ns,
        "lockstep": link.caps.lockstep,
        "home": list(home_W),
        "path": [list(leg.end_W) for leg in run.legs],
        "sensors": sensors,
        "rotors": len(bench.vehicle.rotors),
        "rotor_positions": [list(rotor.position_m) for rotor in bench.vehicle.rotors],
    }


def slow_facts(run: BenchRun) -> dict[str, Any]:
    """Asked twice a second, while somebody looks."""
    scheduler, link, physics, companion = run.scheduler, run.link, run.physics, run.companion
    assert scheduler is not None
    assert link is not None
    assert physics is not None
    router, sticks = run.commanders.router, (run.commanders.manual, run.commanders.page_manual)
    links = [autopilot_health(link)]
    clients = {} if companion is None else companion.report()["clients"]
    for name, client in clients.items():
        reply = client.get("reply_ms") or {}
        links.append(
            {
                "name": f"companion {name}",
                "steps": client.get("frames", 0),
                "lost": client.get("dropped", 0),
                "bad": client.get("malformed", 0),
                "rtt_p50_us": 1000 * (reply.get("p50") or 0.0),
                "rtt_p99_us": 1000 * (reply.get("p99") or 0.0),
                "tx_bytes": client.get("bytes", 0),
            }
        )
    battery = physics.battery
    return {
        "links": links,
        "companions": [] if companion is None else companion.here,
        "maps": [] if companion is None else [stream_of(name) for name in sorted(companion.views.newest)],
        "told": {name: dict(one["report"]) for name, one in clients.items() if one.get("report")},
        "router": None if router is None else router.report(),
        "battery": None if battery is None else list(battery),
        "skipped": skipped_rows(run, scheduler.tick),
        "late_ticks": scheduler.late,
        "own_us": scheduler.own_ns.mean_ns / 1000,
        "flying_by_hand": any(source is not None and source.control is Control.FLYING for source in sticks),
    }
