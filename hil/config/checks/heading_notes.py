"""Notes on headings of waypoints that take longer than the way: an autopilot that waits for them leaves its path."""

from __future__ import annotations

import math

from hil.config.bench import Bench
from hil.config.missions.mission import CHANGE_SPEED, WAYPOINT
from hil.config.missions.path import waypoint_legs
from sim.physics.fixed_wing import is_plane

_TURN_RATE_DEGPS = 60.0  # PX4's default of MPC_YAWRAUTO_MAX
_SPEED_MPS = 5.0  # PX4's default of MPC_XY_CRUISE, until the mission commands a speed


def heading_notes(bench: Bench) -> list[str]:
    """Describe the first waypoint to which the vehicle flies in less time than the turn of its nose takes."""
    autopilot, mission = bench.config.autopilot, bench.mission
    wait = autopilot.profile.heading_wait
    if not wait or mission is None or is_plane(bench.vehicle) or wait in autopilot.all_params:
        return []
    speeds_mps, speed_mps = [], _SPEED_MPS  # by item
    for item in mission.items:
        if item.command == CHANGE_SPEED and item.param2 > 0.0:
            speed_mps = item.param2
        speeds_mps.append(speed_mps)
    late: dict[int, str] = {}  # by item: a jump repeats it
    before_deg = math.nan
    for leg in waypoint_legs(bench.legs):
        item = mission.items[leg.seq]
        heading_deg = item.param4 if item.command == WAYPOINT else math.nan
        turn_deg = abs(math.remainder(heading_deg - before_deg, 360.0))
        length_m = math.dist(leg.start_W, leg.end_W)
        before_deg = heading_deg
        if turn_deg / _TURN_RATE_DEGPS > length_m / speeds_mps[leg.seq]:  # false without one of the headings
            late.setdefault(leg.seq, f"turns the nose by {turn_deg:.0f} degrees on {length_m:.1f} m")
    if not late:
        return []
    first, more = mission.first_of(late)
    started = autopilot.profile.is_program and autopilot.start
    remedy = f"--set autopilot.params.{wait}=5 lets it fly on" if started else f"set its {wait} to 5"
    waits = f"{autopilot.profile.firmware.name} waits for the heading, moving on, and leaves its path"
    return [f"{first}: {waits}{more} ({remedy})"]
