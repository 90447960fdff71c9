"""What run.json says about a run: the keys fixed by the command-line contract first, then the rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

from firmware_bridge.links.autopilot_link import AutopilotLink
from firmware_bridge.links.external_ahrs import ExternalAhrsLink
from firmware_bridge.links.free_running import FreeRunningLink
from hil.config import BenchConfig
from hil.scheduler import PHASES, Scheduler
from hil.signals.latency import LatencyHistogram
from hil.signals.time import NS_PER_S
from hil.verdict import Verdict
from sim.sensors.radar import Radar

if TYPE_CHECKING:
    from hil.bench import BenchRun
    from hil.report.page import Timing

_OF_THE_MISSION = (
    "completed", "waypoints", "reached", "max_cross_track_m", "final_error_m", "altitude_error_m", "landing_speed_mps",
    "landed_tilt_deg", "landed",
)  # fmt: skip
_OF_THE_LINK = ("tx_bytes", "rx_bytes", "bad_crc", "garbage_bytes", "lost_frames", "bad_controls")
# The links to autopilots that wait for nobody, which keep statistics of punctuality.
FREE_RUNNING = (FreeRunningLink, ExternalAhrsLink)


def timing_of(scheduler: Scheduler | None, link: AutopilotLink | None) -> Timing:
    """What the report draws of wall-clock times; empty of a run that never flew."""
    from hil.report.page import Timing

    if scheduler is None or link is None:
        return Timing()
    timing = Timing(
        rtt_bins_ns=link.stats.rtt.bins(),
        phase_us={name: scheduler.phase_ns[name].mean_ns / 1000 for name in PHASES},
    )
    sent = link.send_stats() if isinstance(link, FREE_RUNNING) else None
    if isinstance(link, FREE_RUNNING) and sent is not None:
        return replace(timing, lateness_bins_ns=sent.lateness.bins(), age_bins_ns=link.age.age.bins())
    return timing


def summarise(run: BenchRun, verdict: Verdict, status: str) -> dict[str, Any]:
    """The content of run.json. Of a run that failed on its way some parts were never built."""
    config, m, failure = run.config, verdict.measurements, run.failure
    scheduler, link, router, live = run.scheduler, run.link, run.commanders.router, run.live
    ticks = scheduler.tick if scheduler else 0
    sim_s = ticks * config.tick_ns / NS_PER_S
    wall_s = run.timing_s.get("flight", 0.0)
    stats = link.stats if link else None
    rtt = stats.rtt if stats else None
    slots = {slot.port: slot for slot in run.sensors.slots} if run.sensors is not None else {}
    radars = run.sensors.radars if run.sensors is not None else {}
    wire = run.injector.wire if run.injector is not None else None
    hits = wire.hits() if wire is not None else {}
    outside_input = (
        run.commanders.from_outside
        or (live is not None and live.altered)
        or run.drawn_elsewhere
        or config.companion.times_count
    )
    return {
        "schema": 1,
        "status": status,
        "error": None
        if failure.error is None
        else dict(zip(("type", "message"), failure.error, strict=True))
        | ({"cause": failure.cause} if failure.cause else {}),
        "digest": run.recorder.digest if run.recorder else "0" * 32,
        "deterministic": bool(link is not None and link.caps.deterministic and not outside_input),
        "seed": config.seed,
        "rig": config.rig,
        "scene": run.bench.scene.name,
        "randomize": run.bench.drawn(),
        "sim_s": sim_s,
        "wall_s": wall_s,
        "realtime_factor": sim_s / wall_s if wall_s > 0 else 0.0,
        "mission": {name: getattr(m, name) for name in _OF_THE_MISSION} | {"file": config.mission},
        "autopilot": {
            "kind": config.autopilot.kind,
            "steps": stats.steps if stats else 0,
            "late": stats.late if stats else 0,
            "rtt_us": {
                "p50": rtt.quantile_ns(0.5) / 1000 if rtt else None,
                "p99": rtt.quantile_ns(0.99) / 1000 if rtt else None,
                "max": rtt.max_ns / 1000 if rtt else None,
            },
            "link": {name: getattr(stats, name) for name in _OF_THE_LINK} if stats else {},
            **({"realtime": _realtime(link)} if isinstance(link, FREE_RUNNING) else {}),
        },
        "faults": {
            "links": [
                {"kind": fault.kind, "hits": hits.get(index, 0)}
                for index, fault in enumerate(wire.faults if wire is not None else config.faults.links)
            ],
        },
        "sensors": {
            name: {
                "samples": slots[name].samples if name in slots else 0,
                "skipped": 0 if name in slots else _samples_due(config, name, ticks),
                "ms": {
                    "p50": slots[name].timing.quantile_ns(0.5) * 1e-6 if name in slots else 0.0,
                    "p99": slots[name].timing.quantile_ns(0.99) * 1e-6 if name in slots else 0.0,
                },
                **({"radar": radar_counts(radars[name])} if name in radars else {}),
            }
            for name in config.sensors
        },
        "skipped": skipped_rows(run, ticks) + radar_rows(radars),
        "verdict": {"reasons": list(verdict.reasons), "rows": [asdict(row) for row in verdict.rows]},
        "actions": [
            {
                "name": record.name,
                "t_s": None if record.t_ns is None else record.t_ns / NS_PER_S,
                "outcome": record.outcome,
                "required": record.required,
            }
            for record in run.commanders.records
        ],
        "timing": {
            "setup_s": run.timing_s.get("setup", 0.0),
            "total_s": run.timing_s.get("total", 0.0),
            "paced_ticks_late": scheduler.late if scheduler else 0,
            "own_us": _quantiles(scheduler.own_ns) if scheduler else None,
            "step_us": _quantiles(scheduler.step_ns) if scheduler else None,
            "phase_us": {name: _quantiles(scheduler.phase_ns[name]) for name in PHASES} if scheduler else None,
        },
        **({} if router is None else {"router": router.report()}),
        **({} if run.companion is None else {"companion": run.companion.report()}),
        **({} if live is None or not live.commands else {"by_hand": live.commands}),
        **run.judging.run_keys(),
    }


def skipped_rows(run: BenchRun, ticks: int) -> list[dict[str, Any]]:
    """What was left out because nobody needed it, and what that saved."""
    rows: list[dict[str, Any]] = [
        {"what": s.stage, "why": s.reason, "saved": f"{_samples_due(run.config, s.stage, ticks)} samples"}
        for s in run.skipped
    ]
    if run.physics is not None:
        skips = run.physics.skips
        rows.append(
            {
                "what": "contact",
                "why": "nothing within reach",
                "saved": f"{skips.skipped} of {skips.skipped + skips.queried + skips.touching} collision queries",
                "ticks_skipped": skips.skipped,
                "ticks_queried": skips.queried,
                "ticks_touching": skips.touching,
            }
        )
        posed, poses = run.physics.actor_poses
        if poses:
            saved = f"{poses - posed} of {poses} poses for contact"
            rows.append({"what": "actors", "why": "out of the vehicle's reach", "saved": saved})
    posed, unposed = (run.frames.posed, run.frames.unposed) if run.frames is not None else (0, 0)
    if posed or unposed:
        saved = f"{unposed} of {posed + unposed} posings"
        rows.append({"what": "posing of people and vehicles", "why": "out of every sensor's sight", "saved": saved})
    return rows


def _realtime(link: FreeRunningLink | ExternalAhrsLink) -> dict[str, Any]:
    """How well a free-running autopilot was served, and how well it served us."""
    sent, clock = link.send_stats(), link.timesync
    best = clock.best()
    return (
        {
            "send_lateness_us": _quantiles(sent.lateness) | {"p999": sent.lateness.quantile_ns(0.999) / 1000},
            "late_2ms": sent.late_2ms,
            "late_20ms": sent.late_20ms,
            "sent": sent.sent,
            "dropped": sent.dropped + sent.refused,
            "longest_gap_ms": sent.longest_gap_ns / 1e6,
            "scheduling": sent.scheduling,
            "slips": link.schedule.slip_count,
            "slipped_ms": link.schedule.slipped_ns / 1e6,
            "actuator_age_us": _quantiles(link.age.age),
            "actuator_interval_us": _quantiles(link.age.interval),
            "actuator_gaps": link.age.gap_count,
            "clock_offset_us": best.offset_ns / 1000 if best else None,
            "clock_drift_ppm": clock.drift_ppm,
            "clock_resets": clock.resets,
            "reconnects": link.reconnects,
            "findings": [{"level": f.level, "text": f.text} for f in link.findings()],
        }
        if sent is not None
        else {}
    )


def _quantiles(histogram: LatencyHistogram) -> dict[str, float]:
    return {
        "mean": histogram.mean_ns / 1000,
        "p50": histogram.quantile_ns(0.5) / 1000,
        "p99": histogram.quantile_ns(0.99) / 1000,
        "max": histogram.max_ns / 1000,
    }


def _samples_due(config: BenchConfig, name: str, ticks: int) -> int:
    """How often a sensor that was left out would have been sampled."""
    sensor, _, _ = name.partition("/")  # a channel of a camera is sampled with its camera
    mhz = round(config.sensors[sensor].rate_hz * 1000)
    return (ticks - 1) * mhz // (config.tick_hz * 1000) + 1 if ticks else 0


def radar_counts(radar: Radar) -> dict[str, Any]:
    """The section `radar` of a sensor."""
    counts = radar.counts
    return {
        "pixels": counts.pixels,
        "pixels_dropped": dict(counts.pixels_dropped),
        "echoes": counts.echoes,
        "echoes_dropped": counts.echoes_dropped,
        "dropped_bound": counts.dropped_bound,
        "terms": counts.terms,
        "shared_pictures": counts.shared,
    }


def radar_rows(radars: Mapping[str, Radar]) -> list[dict[str, Any]]:
    """Rows for the list of what was skipped."""
    rows: list[dict[str, Any]] = []
    for name, radar in radars.items():
        counts = radar.counts
        for reason, dropped in counts.pixels_dropped.items():
            if dropped:
                rows.append({"what": f"{name}: pixels", "why": reason, "saved": f"{dropped} of {counts.pixels} pixels"})
        if counts.echoes_dropped:
            why = f"too weak to matter: at most {counts.dropped_bound:.1e} of a frame"
            saved = f"{counts.echoes_dropped} of {counts.echoes} echoes"
            rows.append({"what": f"{name}: echoes", "why": why, "saved": saved})
        if counts.shared:
            saved = f"{counts.shared} of {counts.frames} drawings"
            rows.append({"what": f"{name}: drawing", "why": "its camera has just drawn the same", "saved": saved})
    return rows
