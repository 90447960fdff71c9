"""The flight of a VTOL: as `plane_flight`, with the limits of hover, of flight and of the transitions between them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from hil.config import Bench
from hil.config.fixed_wing_facts import turn_radius_m
from hil.config.missions.path import Leg
from hil.config.missions.regimes import leads_to_wings, on_wings
from hil.run.part import Part, RunContext
from hil.run.parts.judges.plane_flight import PlaneFlightPart
from hil.run.verdict.flyable_path import stops_of
from hil.run.verdict.plane_flight import PlaneMeasurement, Stall, judge_by
from hil.run.verdict.tail import Tail
from hil.run.verdict.verdict import Verdict
from hil.run.verdict.vtol_flight import Rotors, VtolMeasurement, flown_items
from signals.mission import MissionItem
from signals.samples import Vec3
from sim.physics import vtol
from sim.physics.fixed_wing import Airframe
from sim.physics.vehicle import Vehicle


class VtolFlightPart(PlaneFlightPart):
    name = "vtol_flight"

    def _measurement(self, legs: Sequence[Leg], items: Sequence[MissionItem], run: RunContext) -> PlaneMeasurement:
        facts, physics, params = self._facts, run.physics, self._config.autopilot.all_params
        vehicle = run.bench.vehicle

        def wind_at() -> Vec3:
            return physics.wind_W_mps

        return VtolMeasurement(
            legs,
            stops_of(legs, flown_items(items, params)),
            (self._config.plane_limits, self._config.limits),
            Tail(facts.least_mps, wind_at) if vehicle.stands == "on_tail" else rotors_of(vehicle),
            wings={
                item.seq
                for item, wings in zip(items, on_wings(items, params), strict=True)
                if wings or leads_to_wings(item, params)
            },
            radius_m=turn_radius_m(facts.cruise_mps),
            stall=Stall(facts.stall_mps, Airframe(vehicle, run.bench.scene.site).stall_alpha_rad),
            wind_at=wind_at,
        )

    def _judged(self) -> Verdict:
        config = self._config
        own = dict(config.vtol_limits) | {
            "hover_cross_track_m": config.limits.max_cross_track_m,
            "final_error_m": config.limits.final_error_m,
        }
        limits = dict(config.limits) | dict(config.plane_limits) | own
        return judge_by(self._measured, limits, outcome=self._outcome)

    def run_keys(self) -> dict[str, Any]:
        measured = self._measured
        reached, waypoints = measured.counts
        keys: dict[str, Any] = {"completed": measured.completed, "waypoints": waypoints, "reached": reached}
        return {
            "mission": {**keys, **measured.values(), "landed": measured.landed, "file": self._config.mission},
        }


def rotors_of(vehicle: Vehicle) -> Rotors:
    """Return what tells from a VTOL's rotors and tilts what carries it."""
    lifters, pushers = vtol.lifters(vehicle), vtol.pushers(vehicle)
    full = [c.max_speed_radps for c in vehicle.constants_of_rotors]
    speeds = vehicle.hover_speeds_radps()
    turned_by = {rotor: k for k, tilt in enumerate(vehicle.tilts) for rotor in tilt.rotors}
    return Rotors(
        lifters,
        pushers,
        [speeds[i] for i in lifters],
        [full[i] for i in pushers],
        ahead_rad=[tilt.ahead_rad(vehicle.rotors) for tilt in vehicle.tilts],
        tilt_of=[turned_by.get(i) for i in lifters],
    )


def make(bench: Bench) -> Part:
    return VtolFlightPart(bench)
