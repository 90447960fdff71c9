"""The flight of a plane: its planned path, how well it was flown, and the limits of the section `plane_limits`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hil.config import Bench
from hil.config.fixed_wing_facts import fixed_wing_facts, turn_radius_m
from hil.config.missions.path import LegKind, plan_points, planned_path
from hil.run.part import Part, RunContext
from hil.run.report.page import Report
from hil.run.verdict.flyable_path import stops_of
from hil.run.verdict.plane_flight import PlaneMeasurement, judge_plane
from hil.run.verdict.plane_track import PlaneTrack
from hil.run.verdict.runway_rolls import RunwayRolls
from hil.run.verdict.verdict import Verdict
from signals.samples import TruthState


class PlaneFlightPart(Part):
    name = "plane_flight"

    def __init__(self, bench: Bench) -> None:
        self._bench, self._config, self._outcome = bench, bench.config, bench.outcome
        self._facts = facts = fixed_wing_facts(bench.vehicle, bench.scene.site)
        self._measured = PlaneMeasurement(
            (), (), bench.config.plane_limits, radius_m=1.0, stall_mps=facts.stall_mps, wind_at=lambda: (0.0, 0.0, 0.0)
        )
        self._track = PlaneTrack(facts.stall_mps, bench.config.tick_ns, lambda: (0.0, 0.0, 0.0))

    def open(self, run: RunContext) -> None:
        mission = run.bench.mission
        if mission is not None:
            x, y, z = run.physics.state[:3].tolist()
            run.legs = planned_path(mission, run.bench.scene, home_W=(x, y, z))
        run.route = plan_points(run.legs)
        facts, physics = self._facts, run.physics
        runway = run.bench.scene.runway if facts.wheels else None
        rolls = None
        if runway is not None:
            x, y, z = run.physics.state[:3].tolist()
            end = run.legs[-1] if run.legs else None
            lands = end is not None and end.kind is LegKind.DESCENT and runway.contains(end.end_W)
            rolls = RunwayRolls(runway, start_W=(x, y, z), lands=lands)
        self._measured = PlaneMeasurement(
            run.legs,
            stops_of(run.legs, mission.items) if mission is not None else [],
            self._config.plane_limits,
            radius_m=turn_radius_m(facts.cruise_mps),
            stall_mps=facts.stall_mps,
            wind_at=lambda: physics.wind_W_mps,
            rolls=rolls,
        )
        self._track = PlaneTrack(facts.stall_mps, self._config.tick_ns, lambda: physics.wind_W_mps)

    def observers(self) -> list[Callable[[TruthState], None]]:
        return [self._measured.add, self._track.add]

    def waypoints(self) -> tuple[int, int]:
        return self._measured.counts

    def verdict(self) -> Verdict:
        return judge_plane(self._measured, self._config.plane_limits, outcome=self._outcome)

    def run_keys(self) -> dict[str, Any]:
        measured = self._measured
        reached, waypoints = measured.counts
        values = measured.values()
        keys: dict[str, Any] = {"completed": measured.completed, "waypoints": waypoints, "reached": reached}
        keys |= {"max_cross_track_m": values.pop("max_cross_track_m"), "final_error_m": values.pop("final_error_m")}
        keys |= {**values, "landing_speed_mps": values["touchdown_sink_mps"], "landed_tilt_deg": None}
        return {"mission": {**keys, "landed": measured.landed, "file": self._config.mission}}

    def report(self, run: RunContext) -> Report:
        from hil.run.report.pictures import flight_pictures, plane_pictures

        title = f"{run.bench.scene.name} on rig {self._config.rig}, seed {self._config.seed}"
        pictures = flight_pictures(run.out, run.recorder.track.arrays(), run.route, title)
        names = [surface.name for surface in self._bench.vehicle.surfaces]
        return Report(pictures + plane_pictures(run.out, self._track.arrays(), names))


def make(bench: Bench) -> Part:
    return PlaneFlightPart(bench)
