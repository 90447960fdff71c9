"""Facts about a run for the dashboard: a description at its start, and slowly changing values during the flight."""

from __future__ import annotations

from typing import Any

from firmware_bridge.links.autopilot_link import AutopilotLink
from hil.run.feed.payloads import shown_channels
from hil.run.feed.streams import map_stream
from hil.run.part import RunContext
from sim.sensors.catalog import KINDS


def run_description(run: RunContext) -> dict[str, Any]:
    """Return what the page needs to know once, at the start of the run."""
    bench, plan = run.bench, run.plan
    config = bench.config
    sensors: dict[str, Any] = {}
    for name, sensor in config.sensors.items():
        kind = KINDS[sensor.kind]
        channels = () if kind.parts is None else getattr(sensor.parameters, kind.parts)
        planned = [channel for channel in channels if f"{name}/{channel}" in plan.order]
        computed = name in plan.order or bool(planned)
        sensors[name] = {
            "kind": sensor.kind,
            "rate_hz": sensor.rate_hz,
            "streams": [f"{name}/{channel}" for channel in shown_channels(kind.sample_type, planned)]
            if computed
            else [],
        }
    return {
        "out": str(run.out.resolve()),
        "rig": config.rig,
        "scene": bench.scene.name,
        "mission": config.mission,
        "seed": config.seed,
        "tick_ns": config.tick_ns,
        "lockstep": run.link.caps.lockstep,
        "home": run.physics.state[:3].tolist(),
        "path": [list(leg.end_W) for leg in run.legs],
        "sensors": sensors,
        "rotors": len(bench.vehicle.rotors),
        "rotor_positions": [list(rotor.position_m) for rotor in bench.vehicle.rotors],
    }


def slow_facts(run: RunContext) -> dict[str, Any]:
    """Return the values that the page shows twice a second: links, companions, battery, skipped work."""
    part = run.part("companion")
    companion = None if part is None else part.link
    links = [autopilot_health(run.link)]
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
    router, battery = run.part("router"), run.physics.battery
    sticks = (run.part("manual"), run.part("dashboard").sticks)
    return {
        "links": links,
        "companions": [] if companion is None else companion.connected,
        "maps": [] if companion is None else [map_stream(name) for name in sorted(companion.views.newest)],
        "told": {name: dict(client["report"]) for name, client in clients.items() if client.get("report")},
        "router": None if router is None else router.run_keys()["router"],
        "battery": None if battery is None else list(battery),
        "skipped": [row for part in run.parts for row in part.skipped(run.ticks)],
        "late_ticks": run.scheduler.late,
        "own_us": run.scheduler.own_ns.mean_ns / 1000,
        "flying_by_hand": any(source is not None and source.flying for source in sticks),
    }


def autopilot_health(link: AutopilotLink) -> dict[str, Any]:
    """Return the counters and round trips [us] of the link to the autopilot."""
    stats, caps = link.stats, link.caps
    return {
        "name": caps.kind,
        "lockstep": caps.lockstep,
        "steps": stats.steps,
        "late": stats.late,
        "lost": stats.lost_frames,
        "bad": stats.bad_crc,
        "rtt_p50_us": stats.rtt.quantile_ns(0.5) / 1000,
        "rtt_p99_us": stats.rtt.quantile_ns(0.99) / 1000,
        "tx_bytes": stats.tx_bytes,
        "rx_bytes": stats.rx_bytes,
    }
