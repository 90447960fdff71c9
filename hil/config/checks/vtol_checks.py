"""Checks that a VTOL can fly its mission: the height of its transitions, its legs on the wings, loiters in hover."""

from __future__ import annotations

from hil.config.bench import Bench
from hil.config.checks.short_legs import short_legs
from hil.config.fixed_wing_facts import fixed_wing_facts, turn_radius_m
from hil.config.missions.mission import Mission
from hil.config.missions.places import PLACE_COMMANDS
from hil.config.missions.regimes import TO_HOVER, TO_WINGS, TRANSITION, leads_to_wings, on_wings
from signals.errors import Problem

VTOL_WORDS = {84: "VTOL take-off", 85: "VTOL landing", 3000: "transition"}
_CIRCLES = frozenset((18, 31))  # loiters that only wings fly
_LEAST_M = 10.0  # height of a transition over the start: four times what one loses in gusty wind of 5 m/s
_LEAST_KEY = "VT_FW_MIN_ALT"


def vtol_mission_problems(bench: Bench, mission: Mission) -> list[Problem]:
    """Report transitions too near to the ground, and items that the present regime does not fly."""
    config, vehicle = bench.config, bench.vehicle
    problems: list[Problem] = []
    params = config.autopilot.all_params
    least = max(_LEAST_M, float(params.get(_LEAST_KEY, 0.0)))
    height_of = {leg.seq: leg.end_W[2] - config.start.p_W[2] for leg in bench.legs}
    height = 0.0

    def report(seq: int, message: str, hint: str) -> None:
        problems.append(mission.problem(seq, message, hint))

    wings_at = on_wings(mission.items, params)
    for item, wings in zip(mission.items, wings_at, strict=True):
        height = height_of.get(item.seq, height)
        name = VTOL_WORDS.get(item.command) or PLACE_COMMANDS.get(item.command, "")
        if item.command == TRANSITION and item.param1 not in (TO_HOVER, TO_WINGS):
            report(item.seq, f"({name}) leads to state {item.param1:g}", "take 3, hover, or 4, flight on the wings")
        elif leads_to_wings(item, params) and not wings and height < least:
            message = f"({name}) begins a transition at {height:g} m over the start, and one needs {least:g} m"
            report(item.seq, message, "climb higher before it")
        elif item.command in _CIRCLES and not wings:
            message = f"({name}) is a circle, flown on the wings, and the vehicle {vehicle.name!r} hovers there"
            report(item.seq, message, "put a transition (DO_VTOL_TRANSITION, param 1: 4) before it, or a loiter time")
    flown = [leg for leg in bench.legs if wings_at[leg.seq]]
    radius = turn_radius_m(fixed_wing_facts(vehicle, bench.scene.site).cruise_mps)
    for where, seq in short_legs(flown, radius):
        report(seq, f"{where}, and is flown on the wings", "spread the waypoints, or fly them in hover")
    return problems
