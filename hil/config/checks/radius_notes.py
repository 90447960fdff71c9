"""Notes on waypoints that an autopilot may take as reached before it has flown there."""

from __future__ import annotations

import math

from hil.config.bench import Bench
from hil.config.fixed_wing_facts import fixed_wing_facts, turn_radius_m
from hil.config.missions.path import SAME_M, WINGS_REACH_M, named_radius_m, waypoint_legs
from hil.config.missions.regimes import on_wings
from sim.physics.fixed_wing import is_plane
from sim.physics.vtol import is_vtol


def radius_notes(bench: Bench) -> list[str]:
    """Describe the first waypoint with a radius above the one within which it counts, and the first inside its own.

    Wings pass a waypoint by within the usual reach of theirs: one that counts within no more than that is not told of.
    """
    if bench.mission is None:
        return []
    wings_at = _wings_at(bench)
    usual_on_wings_m = _usual_on_wings_m(bench) if any(wings_at) else 0.0
    wide: dict[int, str] = {}  # by item: a jump repeats it
    near: dict[int, str] = {}
    for leg in waypoint_legs(bench.legs):
        named_m, counts_m = named_radius_m(bench.mission.items[leg.seq]), leg.acceptance_radius_m
        radius_m = counts_m if named_m is None else named_m
        length_m = math.dist(leg.start_W[:2], leg.end_W[:2])
        if length_m <= SAME_M or (wings_at[leg.seq] and counts_m <= usual_on_wings_m):
            continue
        if length_m <= counts_m and math.dist(leg.start_W, leg.end_W) <= counts_m:
            text = f"lies {length_m:.2g} m from the place before, within its acceptance radius of {radius_m:g} m"
            near.setdefault(leg.seq, text)
        elif named_m is not None and named_m > counts_m:
            radius = f"has an acceptance radius of {named_m:g} m, more than half of the {length_m:.1f} m to it"
            wide.setdefault(leg.seq, f"{radius} (it counts within {counts_m:.3g} m)")
    notes = []
    for found in (wide, near):
        if found:
            first, more = bench.mission.first_of(found)
            notes.append(f"{first}: an autopilot may pass it by{more}")
    return notes


def _wings_at(bench: Bench) -> list[bool]:
    """Return for every item of the mission whether the vehicle flies there on its wings."""
    assert bench.mission is not None
    if is_vtol(bench.vehicle):
        return on_wings(bench.mission.items, bench.config.autopilot.all_params)
    return [is_plane(bench.vehicle)] * len(bench.mission.items)


def _usual_on_wings_m(bench: Bench) -> float:
    """Return the radius within which every waypoint flown to on wings counts."""
    return turn_radius_m(fixed_wing_facts(bench.vehicle, bench.scene.site).cruise_mps) + WINGS_REACH_M
