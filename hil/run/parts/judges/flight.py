"""The flight itself: its planned path, how well it was flown, and the limits of the section `limits`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from hil.config import Bench
from hil.config.missions.path import Leg, plan_points, planned_path
from hil.run.part import Part, RunContext
from hil.run.report.page import Report
from hil.run.verdict.flight import FlightMeasurement, judge
from hil.run.verdict.verdict import Verdict
from signals.samples import TruthState

_MISSION_KEYS = (
    "completed", "waypoints", "reached", "max_cross_track_m", "final_error_m", "altitude_error_m", "landing_speed_mps",
    "landed_tilt_deg", "landed",
)  # fmt: skip


class FlightPart(Part):
    name = "flight"

    def __init__(self, bench: Bench) -> None:
        self._config = bench.config
        self._outcome = bench.outcome
        self._measured = FlightMeasurement(())

    def open(self, run: RunContext) -> None:
        if run.bench.mission is not None:
            x, y, z = run.physics.state[:3].tolist()
            run.legs = planned_path(run.bench.mission, run.bench.scene, home_W=(x, y, z))
        run.route = plan_points(run.legs)
        # Companions are given places alone.
        whole = not self._config.flown_by_set_points
        script = run.bench.script
        legs: Sequence[Leg] = run.legs
        by_hand = self._config.manual.device is not None
        if by_hand or (script is not None and script.changes_speeds):
            legs = [leg._replace(speed_mps=0.0) for leg in legs]
        self._measured = FlightMeasurement(legs, self._config.limits, whole=whole)

    def observers(self) -> list[Callable[[TruthState], None]]:
        return [self._measured.add]

    def waypoints(self) -> tuple[int, int]:
        return self._measured.counts

    def verdict(self) -> Verdict:
        return judge(self._measured.result(), self._config.limits, outcome=self._outcome)

    def run_keys(self) -> dict[str, Any]:
        measured = self._measured.result()
        return {
            "mission": {name: getattr(measured, name) for name in _MISSION_KEYS} | {"file": self._config.mission},
        }

    def report(self, run: RunContext) -> Report:
        from hil.run.report.pictures import flight_pictures

        return Report(flight_pictures(run.out, run.recorder.track.arrays(), run.route, _title(run)))


def _title(run: RunContext) -> str:
    config = run.bench.config
    return f"{run.bench.scene.name} on rig {config.rig}, seed {config.seed}"


def make(bench: Bench) -> Part:
    return FlightPart(bench)
