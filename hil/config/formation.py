"""Places in a formation, and missions shifted to them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from hil.config.bench import site_of
from hil.config.group_schema import Formation
from hil.config.missions.mission import POSITION_FRAMES, Mission
from hil.config.missions.places import LAND_COMMANDS, MAY_BE_OPEN, PLACE_COMMANDS
from signals.geodesy import LocalFrame
from signals.mission import MissionItem
from signals.samples import Vec3
from sim.scene.scene import Scene


def formation_offsets(formation: Formation, names: Sequence[str]) -> dict[str, Vec3]:
    """Return the place of each vehicle relative to the first [m in W].

    In the axes of the formation, x forward and y to the left, with spacing s and the vehicle's number i from 0:

        wedge   (-r s, +-r s) with r = ceil(i / 2), odd numbers on the left
        line    (0, -i s)
        column  (-i s, 0)
        grid    (-(i // n) s, -(i % n) s) with n = ceil(sqrt(number of vehicles))
    """
    c, s = math.cos(math.radians(formation.heading_deg)), math.sin(math.radians(formation.heading_deg))
    edge = math.ceil(math.sqrt(len(names)))
    offsets: dict[str, Vec3] = {}
    for i, name in enumerate(names):
        if name in formation.offsets_m:
            offsets[name] = formation.offsets_m[name]
            continue
        row = (i + 1) // 2
        back, right = {
            "wedge": (row, row if i % 2 == 0 else -row),
            "line": (0, i),
            "column": (i, 0),
            "grid": (i // edge, i % edge),
        }[formation.shape]
        x, y = -back * formation.spacing_m, -right * formation.spacing_m
        # Rounded to micrometres: the last bits of sin and cos depend on the C library.
        offsets[name] = (round(c * x - s * y, 6), round(s * x + c * y, 6), 0.0)
    return offsets


def shifted_mission(mission: Mission, offset_W_m: Vec3, scene: Scene) -> Mission:
    """Return the mission with every place shifted by an offset in W [m]; landings stay on the ground."""
    if offset_W_m == (0.0, 0.0, 0.0):
        return mission
    site = site_of(scene)
    frame = LocalFrame(site)

    def shifted(item: MissionItem) -> MissionItem:
        if item.command not in PLACE_COMMANDS or item.frame not in POSITION_FRAMES:
            return item
        height_m = item.alt_m if item.command in LAND_COMMANDS else item.alt_m + offset_W_m[2]
        if item.command in MAY_BE_OPEN and item.lat_degE7 == 0 and item.lon_degE7 == 0:
            return item._replace(alt_m=height_m)
        x, y, z = frame.enu_from_geodetic(item.lat_degE7 * 1e-7, item.lon_degE7 * 1e-7, site.altitude_m)
        place_W = (x + offset_W_m[0], y + offset_W_m[1], z)
        latitude_deg, longitude_deg, _ = frame.geodetic_from_enu(place_W)
        return item._replace(lat_degE7=round(latitude_deg * 1e7), lon_degE7=round(longitude_deg * 1e7), alt_m=height_m)

    return replace(mission, items=tuple(shifted(item) for item in mission.items))
