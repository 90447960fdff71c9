"""Checks that a vehicle can fly its mission from where it starts: a plane's take-off, slope and legs, a copter's items.

Take-off roll of a plane, from rest to the airspeed V at which its controller raises the nose, and the way that it goes
in the second in which it rises: s = V^2 / (2 a) + V * 1 s, with the mean acceleration a = (T - D / 2) / m - c g of full
thrust T at V / 2, half of the drag D of cruise, and c the rolling resistance of its wheels, or the friction of its
belly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from firmware_bridge.autopilots.installation import FixedWing
from firmware_bridge.autopilots.px4.wing_parameters import LAUNCH_MPS2, ROTATION
from hil.config.airframe_facts import airframe_facts
from hil.config.bench import Bench
from hil.config.checks.short_legs import short_legs
from hil.config.checks.still_checks import still_problems
from hil.config.checks.vtol_checks import VTOL_WORDS, vtol_mission_problems
from hil.config.fixed_wing_facts import fixed_wing_facts, turn_radius_m
from hil.config.missions.mission import Mission
from hil.config.missions.path import Leg, LegKind
from hil.config.missions.places import LAND_COMMANDS, PLACE_COMMANDS, TAKEOFF_COMMANDS
from hil.config.schema import BenchConfig
from signals.documents.validate import Located, at
from signals.errors import Problem
from signals.units import STANDARD_GRAVITY_MPS2
from sim.physics.fixed_wing import Airframe, is_plane
from sim.physics.launch import Launch
from sim.physics.vehicle import Vehicle
from sim.physics.vtol import is_vtol
from sim.scene.scene import Scene

_ROTATION_S = 1.0  # RWTO_ROT_TIME of PX4
_LONGEST_SLIDE_M = 30.0  # of a belly: beyond, the nose digs in sooner or later
_CATAPULT = "start: {launch: {kind: catapult, length_m: 4, speed_mps: 16}}"
_STEEPEST_DEG = 10.0  # of an approach
_VTOL = frozenset((84, 85))


def flight_problems(bench: Bench, settings: Located) -> list[Problem]:
    """Report a mission that the vehicle cannot fly, and a start from which a plane cannot take off."""
    config, vehicle, mission, scene = bench.config, bench.vehicle, bench.mission, bench.scene
    if mission is None:
        return []
    if is_vtol(vehicle):
        problems = vtol_mission_problems(bench, mission)
    elif not is_plane(vehicle):
        problems = _copter_problems(config, vehicle, mission) or still_problems(bench, mission)
    else:
        facts = fixed_wing_facts(vehicle, scene.site)
        problems = _start_problems(config, vehicle, facts, scene, settings)
        problems += _plane_mission_problems(bench.legs, facts, mission)
    return problems or _refused_items(bench, mission)


def _refused_items(bench: Bench, mission: Mission) -> list[Problem]:
    """Report items that the autopilot is known to refuse, if the mission is uploaded to it."""
    if bench.config.flown_by_set_points or bench.config.vehicles:  # of several vehicles each is checked by itself
        return []
    autopilot = bench.config.autopilot
    facts = airframe_facts(bench.vehicle, bench.scene.site, bench.config.physics.effects)
    misfits = autopilot.profile.item_misfits(facts, mission.items)
    return [
        mission.problem(seq, f"is refused by the autopilot {autopilot.kind!r}: {reason}", hint)
        for seq, (reason, hint) in misfits.items()
    ]


def _copter_problems(config: BenchConfig, vehicle: Vehicle, mission: Mission) -> list[Problem]:
    """Report items that an autopilot flies with planes or VTOLs alone."""
    profile = config.autopilot.profile
    what = f"and the vehicle {config.vehicle!r} is a multirotor"
    if vehicle.has_wings:
        what = f"and the vehicle {config.vehicle!r} has no pusher: a rotor with the axis [1, 0, 0]"
    found = []
    for item in mission.items:
        name = VTOL_WORDS.get(item.command) or PLACE_COMMANDS.get(item.command, f"{item.command}")
        if item.command in profile.plane_items:
            kinds, hint = "planes", "leave it out, or choose a plane: --set vehicle=skywalker_x8"
        elif item.command in profile.vtol_items:
            kinds, hint = "VTOLs", "leave it out, or choose a VTOL: --set vehicle=quadplane"
        else:
            continue
        found.append(mission.problem(item.seq, f"({name}) is flown by {kinds} alone, {what}", hint))
    return found


def _start_problems(
    config: BenchConfig, vehicle: Vehicle, facts: FixedWing, scene: Scene, settings: Located
) -> list[Problem]:
    launch = config.start.launch
    if launch is not None:
        return _launch_problems(config, launch, vehicle, settings)
    g = STANDARD_GRAVITY_MPS2
    airframe = Airframe(vehicle, scene.site)
    weight = vehicle.mass_kg * g
    V = ROTATION * facts.stall_mps
    drag = facts.idle_sink_mps / facts.cruise_mps * weight
    resistance = vehicle.rolling_resistance if facts.wheels else scene.ground_friction
    a = (airframe.thrust_range_n(0.5 * V)[1] - 0.5 * drag) / vehicle.mass_kg - resistance * g
    if not facts.wheels:
        most, held = airframe.thrust_range_n(0.1)[1], scene.ground_friction * weight
        slide = V * V / (2.0 * a) if a > 0.0 else math.inf
        if most > held:
            if slide <= _LONGEST_SLIDE_M:
                return []
            far = f"for {slide:.0f} m" if a > 0.0 else "without end"
            message = (
                f"leaves the plane {vehicle.name!r}, which has no wheels, to slide on its belly {far} before it flies "
                f"at {V:.1f} m/s: friction takes {held:.1f} N ({scene.ground_friction:g} of its weight) of {most:.1f} N"
            )
            return [at(settings, ("start",), message, _CATAPULT)]
        message = (
            f"leaves the plane {vehicle.name!r} lying on its belly: its {most:.1f} N of thrust do not overcome the "
            f"friction of {held:.1f} N ({scene.ground_friction:g} of its weight)"
        )
        return [at(settings, ("start",), message, _CATAPULT)]
    if a <= 0.0:
        message = (
            f"leaves the plane {vehicle.name!r} on its wheels: drag and rolling resistance ({resistance:g} of its "
            f"weight) take all its thrust below its rotation speed of {V:.1f} m/s"
        )
        return [at(settings, ("start",), message, "raise the thrust, or launch it")]
    roll = V * V / (2.0 * a) + V * _ROTATION_S
    runway = scene.runway
    if runway is None:
        message = (
            f"has no runway for the take-off roll of about {roll:.0f} m, to {V:.1f} m/s, of the plane {vehicle.name!r}"
        )
        return [at(settings, ("scene",), message, "--scene airstrip, or start: {launch: {kind: catapult, ...}}")]
    along, right, _ = runway.place_of(config.start.p_W)
    heading = math.radians(90.0 - runway.heading_deg)
    ahead = math.cos(math.radians(config.start.yaw_deg) - heading)
    left = runway.length_m - along if ahead > 0.0 else along
    if abs(ahead) < 0.9 or abs(right) > 0.5 * runway.width_m:
        message = f"is not on the runway of the scene along its heading of {runway.heading_deg:g} deg"
        return [at(settings, ("start",), message, "start: {p_W: [0, 0, 0], yaw_deg: 0} is on that of airstrip")]
    if left < roll:
        message = f"leaves {left:.0f} m of runway, and the take-off roll of {vehicle.name!r} needs about {roll:.0f} m"
        return [at(settings, ("start",), message, "start nearer to the threshold")]
    return []


def _launch_problems(config: BenchConfig, launch: Launch, vehicle: Vehicle, settings: Located) -> list[Problem]:
    """Report a launch into the ground, or that launch detection would not see: too weak, or not before the engine."""
    length = launch.pull(vehicle.mass_kg)[2]
    end = launch.height_m + length * math.sin(math.radians(launch.elevation_deg))
    if min(end, launch.height_m) < vehicle.standing_height_m:
        message = (
            f"leads from {launch.height_m:g} to {end:.2f} m over the ground, and {vehicle.name!r} needs "
            f"{vehicle.standing_height_m:.2f} m to be clear of it"
        )
        return [at(settings, ("start", "launch"), message, "raise height_m or elevation_deg")]
    params = config.autopilot.all_params
    if not params.get("FW_LAUN_DETCN_ON"):
        return []
    if launch.at_s is None:
        message = (
            f"is released by the engine at throttle {launch.throttle:g}, and with FW_LAUN_DETCN_ON the engine waits "
            "for the launch"
        )
        hint = f"start: {{launch: {{kind: {launch.kind}, at_s: 12, ...}}}}"
        return [at(settings, ("start", "launch"), message, hint)]
    most = launch.pull(vehicle.mass_kg)[0] / vehicle.mass_kg
    least = params.get("FW_LAUN_AC_THLD", LAUNCH_MPS2)
    if most > least:
        return []
    message = f"pulls with {most:.1f} m/s2 at most, and FW_LAUN_AC_THLD takes {least:g} m/s2 for a launch"
    return [at(settings, ("start", "launch"), message, "launch faster or over a shorter way, or lower FW_LAUN_AC_THLD")]


def _plane_mission_problems(legs: Sequence[Leg], facts: FixedWing, mission: Mission) -> list[Problem]:
    problems: list[Problem] = []

    def report(seq: int, message: str, hint: str) -> None:
        problems.append(mission.problem(seq, message, hint))

    for item in mission.items:
        if item.command in _VTOL:
            report(item.seq, f"is for a VTOL, and {facts.name!r} is a plane", "use NAV_TAKEOFF and NAV_LAND")
    places = [item for item in mission.items if item.command in PLACE_COMMANDS]
    if places and places[0].command not in TAKEOFF_COMMANDS:
        report(places[0].seq, "comes first, and a plane on the ground needs a take-off", "begin with NAV_TAKEOFF")
    radius = turn_radius_m(facts.cruise_mps)
    for where, seq in short_legs(legs, radius):
        report(seq, where, "spread the waypoints")
    problems += _landing_problems(legs, mission, radius)
    if problems:  # one word on what kind of mission this is
        first = problems[0]
        problems[0] = Problem(first.where, f"{first.message}; the vehicle {facts.name!r} is a plane", first.hint)
    return problems


def _landing_problems(legs: Sequence[Leg], mission: Mission, radius: float) -> list[Problem]:
    """Report a landing without room for an approach."""
    found = []
    for i, leg in enumerate(legs):
        if leg.kind is not LegKind.DESCENT or mission.items[leg.seq].command not in LAND_COMMANDS:
            continue
        height = leg.start_W[2] - leg.end_W[2]
        approach = legs[i - 1] if i and legs[i - 1].kind is LegKind.APPROACH else None
        length = 0.0 if approach is None else math.dist(approach.start_W[:2], approach.end_W[:2])
        slope = math.degrees(math.atan2(height, max(length, 1e-9)))
        if slope > _STEEPEST_DEG or length < 2.0 * radius:
            least = max(height / math.tan(math.radians(_STEEPEST_DEG)), 2.0 * radius)
            message = (
                f"(landing) lies {length:.0f} m from the waypoint before and {height:.0f} m below it: a plane needs "
                f"{least:.0f} m or more"
            )
            hint = "put a waypoint low and far out on the line of the landing"
            found.append(mission.problem(leg.seq, message, hint))
    return found
