"""Checks that a mission leads anywhere: a vehicle that only arms and hops would fly one at its start."""

from __future__ import annotations

import math

from hil.config.bench import Bench
from hil.config.missions.mission import Mission
from hil.config.missions.path import LegKind
from signals.errors import Problem

_NEAR_M = 0.3  # height over its start from which a vehicle counts as in the air (AIRBORNE_M of hil/run/verdict)


def still_problems(bench: Bench, mission: Mission) -> list[Problem]:
    """Report a mission of which no place lies farther from the start than a vehicle hops."""
    legs, home_W = bench.legs, bench.config.start.p_W
    if not legs or any(leg.kind is LegKind.ENDLESS or math.dist(leg.end_W, home_W) > _NEAR_M for leg in legs):
        return []
    text = "and what follows lie at the start, on the ground: nothing would have to be flown"
    hint = "begin with a take-off, and give waypoints heights above home"
    return [mission.problem(legs[0].seq, text, hint)]
