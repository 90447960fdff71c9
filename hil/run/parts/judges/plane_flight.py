"""The flight of a plane: its planned path, how well it was flown, and the limits of the section `plane_limits`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from hil.config import Bench
from hil.config.fixed_wing_facts import fixed_wing_facts, turn_radius_m
from hil.config.missions.path import Leg, LegKind, plan_points, planned_path
from hil.run.part import Part, RunContext
from hil.run.parts.links.failsafe import cause_of
from hil.run.recorder.recorder import Tap
from hil.run.report.page import Report
from hil.run.verdict.air_data import air_data
from hil.run.verdict.flyable_path import stops_of
from hil.run.verdict.plane_flight import PlaneMeasurement, Stall, judge_plane
from hil.run.verdict.plane_track import PlaneTrack
from hil.run.verdict.runway_rolls import RunwayRolls
from hil.run.verdict.tail import nose_is_lowered
from hil.run.verdict.verdict import Verdict
from signals.mission import MissionItem
from signals.samples import AirSample, TruthState, Vec3
from signals.time import NS_PER_S
from sim.physics.fixed_wing import Airframe

AIR_PORT = "truth/air"
_AIR_HZ = 50


class PlaneFlightPart(Part):
    name = "plane_flight"
    _run: RunContext | None = None  # from `open` on

    def __init__(self, bench: Bench) -> None:
        self._bench, self._config, self._outcome = bench, bench.config, bench.outcome
        self._air_stride = max(1, NS_PER_S // _AIR_HZ // bench.config.tick_ns)
        self._facts = facts = fixed_wing_facts(bench.vehicle, bench.scene.site)
        self._measured = PlaneMeasurement(
            (),
            (),
            bench.config.plane_limits,
            radius_m=1.0,
            stall=Stall(facts.stall_mps),
            wind_at=lambda: (0.0, 0.0, 0.0),
        )
        self._wind_at: Callable[[], Vec3] = lambda: (0.0, 0.0, 0.0)  # until `open`
        self._track = PlaneTrack(
            facts.stall_mps,
            bench.vehicle.servos,
            bench.config.tick_ns,
            wind_at=lambda: self._wind_at(),
            commands=self._commands,
            level=nose_is_lowered if bench.vehicle.stands == "on_tail" else lambda _: True,
        )

    def open(self, run: RunContext) -> None:
        mission = run.bench.mission
        if mission is not None:
            x, y, z = run.physics.state[:3].tolist()
            run.legs = planned_path(mission, run.bench.scene, home_W=(x, y, z))
        run.route = plan_points(run.legs)
        physics = run.physics
        self._run, self._wind_at = run, lambda: physics.wind_W_mps
        legs: Sequence[Leg] = run.legs
        if self._config.flown_by_set_points:  # companions are given places alone
            legs = [leg._replace(wait_s=0.0) for leg in legs if leg.kind is not LegKind.DESCENT or leg is legs[-1]]
        self._measured = self._measurement(legs, () if mission is None else mission.items, run)

    def _measurement(self, legs: Sequence[Leg], items: Sequence[MissionItem], run: RunContext) -> PlaneMeasurement:
        facts, physics = self._facts, run.physics
        runway = run.bench.scene.runway if facts.wheels else None
        rolls = None
        if runway is not None:
            x, y, z = physics.state[:3].tolist()
            end = legs[-1] if legs else None
            lands = end is not None and end.kind is LegKind.DESCENT and runway.contains(end.end_W)
            rolls = RunwayRolls(runway, start_W=(x, y, z), lands=lands)
        return PlaneMeasurement(
            legs,
            stops_of(legs, items),
            self._config.plane_limits,
            radius_m=turn_radius_m(facts.cruise_mps),
            stall=Stall(facts.stall_mps, Airframe(run.bench.vehicle, run.bench.scene.site).stall_alpha_rad),
            launched=self._config.start.launch is not None,
            wind_at=lambda: physics.wind_W_mps,
            rolls=rolls,
        )

    def observers(self) -> list[Callable[[TruthState], None]]:
        return [self._measured.add, self._track.add, self._record_air]

    def tap(self) -> Tap:
        return self._track

    def _commands(self) -> list[float]:
        assert self._run is not None
        controls, commands = self._run.scheduler.actuators.controls, self._bench.vehicle.commands
        names = {servo.name for servo in self._bench.vehicle.servos}
        return [u for u, command in zip(controls, commands, strict=False) if command.name in names]

    def _record_air(self, truth: TruthState) -> None:
        if truth.tick % self._air_stride == 0 and self._run is not None:
            seq, t_ns = truth.tick // self._air_stride, truth.t_ns
            sample = AirSample(seq, t_ns, t_ns, *air_data(truth, self._wind_at()))
            self._run.recorder.sample(AIR_PORT, sample)

    def waypoints(self) -> tuple[int, int]:
        return self._measured.counts

    def verdict(self) -> Verdict:
        verdict, run = self._judged(), self._run
        cause = cause_of(run.now_ns(), run.recorder.events) if verdict.reasons and run is not None else ""
        return replace(verdict, reasons=(*verdict.reasons, cause)) if cause else verdict

    def _judged(self) -> Verdict:
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
        names = [servo.name for servo in self._bench.vehicle.servos]
        return Report(pictures + plane_pictures(run.out, self._track.arrays(), names))


def make(bench: Bench) -> Part:
    return PlaneFlightPart(bench)
