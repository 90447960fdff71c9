"""Notes on sensors that a mount far from the vehicle puts into the ground or a building wherever the mission leads."""

from __future__ import annotations

import math

from hil.config.bench import Bench
from hil.config.missions.path import planned_path, waypoint_legs
from signals.rotation import norm
from sim.physics.enclosed_points import EnclosedPoints

_NEAR_M = 1.0  # nearer mounts are those of real vehicles, and their sensors are where the vehicle is free


def mount_notes(bench: Bench) -> list[str]:
    """Describe the sensors that would be inside something solid at every waypoint of the mission."""
    mounts = {name: getattr(sensor.parameters, "mount_m", None) for name, sensor in bench.config.sensors.items()}
    far = {name: mount_m for name, mount_m in mounts.items() if mount_m is not None and norm(mount_m) > _NEAR_M}
    if not far or bench.mission is None:
        return []
    points = EnclosedPoints(bench.scene, bench.vehicle)
    legs = waypoint_legs(planned_path(bench.mission, bench.scene, home_W=bench.config.start.p_W))
    notes = []
    for name, (ahead_m, left_m, up_m) in far.items():
        found = []
        for leg in legs:
            (x0, y0, _), (x, y, z) = leg.start_W, leg.end_W
            course = math.atan2(y - y0, x - x0)
            c, s = math.cos(course), math.sin(course)
            found.append(points.around((x + c * ahead_m - s * left_m, y + s * ahead_m + c * left_m, z + up_m)))
        if found and all(found):
            notes.append(f"sensors.{name}.mount_m: puts it inside {found[0]} at every waypoint")
    return notes
