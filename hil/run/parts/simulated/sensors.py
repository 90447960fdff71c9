"""The simulated sensors of a run: only those with a consumer, and the geometry for cameras, LiDARs and radars."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hil.config import Bench, BenchConfig
from hil.config.missions.script import SensorFault
from hil.run.loop.stages import Skipped
from hil.run.part import Part, RunContext
from hil.run.report.page import Report
from hil.run.sensors.frame_stages import is_wanted, make_frames, needs_frames, uses_other_renderer
from hil.run.sensors.sensor_slots import SensorSlots
from signals.classes import Classes
from sim.frame.source import SharedFrames
from sim.sensors.radar import Radar


class SensorsPart(Part):
    name = "sensors"

    def __init__(self, config: BenchConfig) -> None:
        self._config = config
        self._run: RunContext | None = None
        self._frames: SharedFrames | None = None
        self._scene: SharedFrames | None = None
        self._slots: SensorSlots | None = None
        self._skipped: tuple[Skipped, ...] = ()
        self._repeatable = True

    def _geometry(self, run: RunContext) -> SharedFrames:
        """Return the geometry that cameras, LiDARs and radars see, made at the first call."""
        if self._frames is None:
            self._frames = run.make_frames()
        return self._frames

    def scene(self, run: RunContext) -> SharedFrames:
        """Return the geometry without the other vehicles, whose places are known for the last second only."""
        if not run.bench.config.name:
            return self._geometry(run)
        if self._scene is None:
            self._scene = make_frames(run.bench)
        return self._scene

    def build(self, run: RunContext) -> None:
        self._run = run
        config, plan = self._config, run.plan
        self._skipped = plan.skipped
        self._repeatable = not uses_other_renderer(config, plan)
        frames = self._geometry(run) if needs_frames(config, plan) else None
        wanted = {name: sensor for name, sensor in config.sensors.items() if is_wanted(name, sensor, plan)}
        physics = run.physics
        self._slots = run.sensors = SensorSlots(
            run.bench, wanted, plan, frames, run.recorder, run.out, wind_at=lambda: physics.wind_W_mps
        )

    def inject(self, fault: Any, *, declared: bool) -> bool:
        if self._slots is None or not isinstance(fault, SensorFault):
            return False
        if not declared:
            self._slots.allow_faults(fault.sensor)
        self._slots.inject(fault)
        return True

    def close(self) -> None:
        for frames in (self._frames, self._scene):
            if frames is not None:
                frames.close()

    def repeatable(self) -> bool:
        return self._repeatable

    def run_keys(self) -> dict[str, Any]:
        slots = {} if self._slots is None else {slot.port: slot for slot in self._slots.slots}
        radars = self._radars()
        ticks = 0 if self._run is None else self._run.ticks
        sensors: dict[str, Any] = {}
        for name in self._config.sensors:
            slot = slots.get(name)
            sensors[name] = {
                "samples": 0 if slot is None else slot.samples,
                "skipped": self.samples_due(name, ticks) if slot is None else 0,
                "ms": {
                    "p50": 0.0 if slot is None else slot.timing.quantile_ns(0.5) * 1e-6,
                    "p99": 0.0 if slot is None else slot.timing.quantile_ns(0.99) * 1e-6,
                },
            }
            if name in radars:
                sensors[name]["radar"] = radar_counts(radars[name])
        return {"sensors": sensors}

    def skipped(self, ticks: int) -> list[dict[str, Any]]:
        rows: list[dict[str, Any]] = [
            {"what": s.stage, "why": s.reason, "saved": f"{self.samples_due(s.stage, ticks)} samples"}
            for s in self._skipped
        ]
        computed, skipped = (0, 0) if self._frames is None else (self._frames.posed, self._frames.unposed)
        if computed or skipped:
            saved = f"{skipped} of {computed + skipped} poses"
            rows.append({"what": "poses of people and vehicles", "why": "not visible to any sensor", "saved": saved})
        return rows + radar_rows(self._radars())

    def samples_due(self, name: str, ticks: int) -> int:
        """Return how many samples a sensor, or a channel of a camera, has in the first `ticks` ticks."""
        sensor, _, _ = name.partition("/")
        rate_millihz = round(self._config.sensors[sensor].rate_hz * 1000)
        return (ticks - 1) * rate_millihz // (self._config.tick_hz * 1000) + 1 if ticks else 0

    def report(self, run: RunContext) -> Report:
        frames = run.recorder.album.shown()
        if not frames:
            return Report()
        from hil.run.report.pictures import frames_pictures

        classes = Classes() if self._frames is None else self._frames.classes
        chirps = {name: radar.seen for name, radar in self._radars().items()}
        return Report(frames_pictures(run.out, frames, classes, chirps))

    def _radars(self) -> Mapping[str, Radar]:
        return {} if self._slots is None else self._slots.radars


def radar_counts(radar: Radar) -> dict[str, Any]:
    """Return the section `radar` of a sensor in run.json."""
    counts = radar.counts
    return {
        "pixels": counts.pixels,
        "pixels_dropped": dict(counts.pixels_dropped),
        "echoes": counts.echoes,
        "echoes_dropped": counts.echoes_dropped,
        "dropped_bound": counts.dropped_bound,
        "terms": counts.terms,
        "shared_pictures": counts.shared,
    } | ({"ghosts": counts.ghosts, "rays": counts.rays} if counts.rays else {})


def radar_rows(radars: Mapping[str, Radar]) -> list[dict[str, Any]]:
    """Return rows for the list of what was skipped."""
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
            saved = f"{counts.shared} of {counts.frames} pictures"
            why = "read from the picture that its camera has just rendered"
            rows.append({"what": f"{name}: pictures", "why": why, "saved": saved})
    return rows


def make(bench: Bench) -> Part:
    return SensorsPart(bench.config)
