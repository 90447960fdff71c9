"""The sky of a run's GNSS receivers: events, topic, run.json and pictures; in runs with `sky` of a gps."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from hil.config import Bench
from hil.run.part import Part, RunContext
from hil.run.report.page import Report
from signals.samples import SkySample
from signals.time import NS_PER_S
from sim.gnss.receiver import SatelliteView, SkyFix
from sim.sensors.gps import Gps

_KINDS = {1: "no fix", 2: "2-D", 3: "3-D", 4: "DGPS", 5: "RTK float", 6: "RTK fixed"}
_MOST_SAMPLES = 500_000  # of a receiver; of a longer flight the first


class SkyMoment(NamedTuple):
    """Satellites above the mask at one instant."""

    t_s: float
    views: tuple[SatelliteView, ...]


class SkyCourse:
    """Course of one receiver: its fixes, and the satellites at the instant with the fewest."""

    def __init__(self, gps: Gps) -> None:
        self.gps = gps
        self.t_s: list[float] = []
        self.rows: list[tuple[float, ...]] = []  # kind, satellites, in view, visible, reflected, hdop, spoofed
        self.poorest: SkyMoment | None = None
        self.first: SkyMoment | None = None
        self._last: SkyFix | None = None
        self._fewest = 1 << 30

    def take(self, t_ns: int) -> tuple[SkyFix, SkyFix | None] | None:
        """Take the fix of a tick. Returns it and the one before; None if there is no new one."""
        fix, before = self.gps.sky_fix, self._last
        if fix is None or fix is before:
            return None
        self._last = fix
        receiver = self.gps.receiver
        assert receiver is not None
        moment = SkyMoment(t_ns / NS_PER_S, receiver.views)
        if self.first is None:
            self.first = moment
        if fix.satellites < self._fewest:
            self._fewest, self.poorest = fix.satellites, moment
        if len(self.t_s) < _MOST_SAMPLES:
            self.t_s.append(moment.t_s)
            self.rows.append(
                (fix.fix_type, fix.satellites, fix.in_view, fix.visible, fix.reflected, fix.hdop, fix.spoofed)
            )
        return fix, before


class GnssPart(Part):
    name = "gnss"

    def __init__(self) -> None:
        self._run: RunContext | None = None
        self._courses: dict[str, SkyCourse] = {}
        self._seq: dict[str, int] = {}

    def begin(self, run: RunContext) -> None:
        self._run = run
        self._courses = {name: SkyCourse(gps) for name, gps in run.sensors.receivers.items()}
        self._seq = dict.fromkeys(self._courses, 0)

    def after_tick(self, tick: int) -> None:
        run = self._run
        assert run is not None
        for name, course in self._courses.items():
            t_ns = (tick - 1) * run.bench.config.tick_ns  # of the tick that has passed
            taken = course.take(t_ns)
            if taken is None:
                continue
            fix, before = taken
            seq = self._seq[name]
            self._seq[name] = seq + 1
            run.recorder.sample(
                f"{name}/sky",
                SkySample(
                    seq,
                    t_ns,
                    t_ns,
                    fix.hdop,
                    fix.vdop,
                    fix.pdop,
                    fix.in_view,
                    fix.visible,
                    fix.satellites if fix.fix_type > 1 else 0,
                    fix.reflected,
                    fix.mean_cn0_dbhz,
                    fix.jamming_db,
                    fix.spoofed,
                    fix.shift_m,
                ),
            )
            if before is None or before.fix_type != fix.fix_type:
                kind = _KINDS.get(fix.fix_type, f"fix type {fix.fix_type}")
                run.event("gnss", f"{name}: {kind}, {fix.satellites} satellites", t_ns)
            if fix.spoofed != (before is not None and before.spoofed):
                run.event("gnss", f"{name}: {'held' if fix.spoofed else 'released'} by a spoofer", t_ns)

    def run_keys(self) -> dict[str, Any]:
        return {"gnss": {name: self._keys(course) for name, course in self._courses.items()}}

    def _keys(self, course: SkyCourse) -> dict[str, Any]:
        receiver = course.gps.receiver
        assert receiver is not None
        if not course.rows:
            return {"samples": 0}
        rows = np.array(course.rows, np.float64)
        kinds, counts = np.unique(rows[:, 0].astype(int), return_counts=True)
        solved = rows[rows[:, 0] > 1]
        return {
            "samples": len(rows),
            "fixes": {_KINDS.get(int(kind), str(kind)): int(n) for kind, n in zip(kinds, counts, strict=True)},
            "satellites": {"min": int(rows[:, 1].min()), "p50": float(np.median(rows[:, 1]))},
            "visible": {"min": int(rows[:, 3].min()), "in_view_p50": float(np.median(rows[:, 2]))},
            "reflected_max": int(rows[:, 4].max()),
            "hdop": {"p50": round(float(np.median(solved[:, 5])), 3), "max": round(float(solved[:, 5].max()), 3)}
            if len(solved)
            else None,
            "spoofed": int(rows[:, 6].sum()),
            "faces": receiver.faces,
            "rays": receiver.listener.paths.rays,
        }

    def skipped(self, ticks: int) -> list[dict[str, Any]]:  # noqa: ARG002 (counted by the receivers)
        rows = []
        for name, course in self._courses.items():
            assert course.gps.receiver is not None
            listener = course.gps.receiver.listener
            if listener.clear:
                why = "nothing of the scene above the elevation mask"
                saved = f"{listener.clear} of {listener.samples} samples"
                rows.append({"what": f"{name}: rays to satellites", "why": why, "saved": saved})
        return rows

    def report(self, run: RunContext) -> Report:
        drawn = {name: course for name, course in self._courses.items() if course.rows}
        if not drawn:
            return Report()
        from hil.run.report.gnss_pictures import gnss_pictures

        return Report(gnss_pictures(run.out, drawn))


def make(bench: Bench) -> Part:  # noqa: ARG001
    return GnssPart()
