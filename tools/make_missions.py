"""Writes the missions of `rigs/missions`: `PYTHONPATH=. python tools/make_missions.py` from the repository's root.

The files are what counts; this only saves counting metres in degrees. A test holds the two together.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from hil.missions.mission import CHANGE_SPEED, LAND, RETURN, TAKEOFF, WAYPOINT
from hil.signals.geodesy import LocalFrame
from sim.scene.scene import Site

SITE = Site(latitude_deg=47.397742, longitude_deg=8.545594, altitude_m=488.0)
FOLDER = Path("rigs/missions")
FRAME_MISSION, FRAME_RELATIVE = 2, 3


def place(east_m: float, north_m: float, height_m: float) -> list[float]:
    """Latitude, longitude [deg, 1e-7] and height above home [m]."""
    latitude, longitude, _ = LocalFrame(SITE).geodetic_from_enu((east_m, north_m, 0.0))
    return [round(latitude, 7), round(longitude, 7), height_m]


def item(number: int, command: int, params: list[float | None], frame: int = FRAME_RELATIVE) -> dict[str, Any]:
    """One simple item as QGroundControl saves it."""
    entry: dict[str, Any] = {
        "autoContinue": True,
        "command": command,
        "doJumpId": number,
        "frame": frame,
        "params": params,
        "type": "SimpleItem",
    }
    if frame == FRAME_RELATIVE:
        entry |= {"AMSLAltAboveTerrain": None, "Altitude": params[6], "AltitudeMode": 1}
    return dict(sorted(entry.items()))


def speed(number: int, speed_mps: float) -> dict[str, Any]:
    """DO_CHANGE_SPEED: ground speed, throttle unchanged."""
    return item(number, CHANGE_SPEED, [1, speed_mps, -1, 0, 0, 0, 0], FRAME_MISSION)


def plan(items: list[dict[str, Any]], *, hover_speed_mps: float) -> str:
    """A complete plan file for a PX4 multicopter, keys sorted and indented as QGroundControl saves them."""
    content = {
        "fileType": "Plan",
        "geoFence": {"circles": [], "polygons": [], "version": 2},
        "groundStation": "QGroundControl",
        "mission": {
            "cruiseSpeed": 15,
            "firmwareType": 12,
            "globalPlanAltitudeMode": 1,
            "hoverSpeed": hover_speed_mps,
            "items": items,
            "plannedHomePosition": [SITE.latitude_deg, SITE.longitude_deg, SITE.altitude_m],
            "vehicleType": 2,
            "version": 2,
        },
        "rallyPoints": {"points": [], "version": 2},
        "version": 1,
    }
    return json.dumps(content, indent=4) + "\n"


def rectangle() -> str:
    """Four vertices, 40 m by 25 m, at 3 m/s and 10 m above home, back to the first, and 2 s over home."""
    corners = [(-20.0, 10.0), (20.0, 10.0), (20.0, 35.0), (-20.0, 35.0), (-20.0, 10.0)]
    items = [item(1, TAKEOFF, [0, 0, 0, None, *place(0, 0, 10)]), speed(2, 3)]
    items += [item(i, WAYPOINT, [0, 0, 0, None, *place(*xy, 10)]) for i, xy in enumerate(corners, start=3)]
    items.append(item(len(items) + 1, WAYPOINT, [2, 0, 0, None, *place(0, 0, 10)]))
    items.append(item(len(items) + 1, LAND, [0, 0, 0, None, *place(0, 0, 0)]))
    return plan(items, hover_speed_mps=3)


def survey() -> str:
    """Twenty waypoints: ten lines of 30 m, 6 m apart, up and down, at 3 m/s and 15 m, then return."""
    columns = [(10.0 + 6.0 * i, ends) for i in range(10) for ends in ((10.0, 40.0) if i % 2 == 0 else (40.0, 10.0))]
    items = [item(1, TAKEOFF, [0, 0, 0, None, *place(0, 0, 15)]), speed(2, 3)]
    items += [item(i, WAYPOINT, [0, 0, 0, None, *place(*xy, 15)]) for i, xy in enumerate(columns, start=3)]
    items.append(item(len(items) + 1, RETURN, [0, 0, 0, 0, 0, 0, 0], FRAME_MISSION))
    return plan(items, hover_speed_mps=4)


def people_search() -> str:
    """Four lines of 72 m, 20 m apart, up and down over the park, at 4 m/s and 12 m; landing at home."""
    lines = [(-36.0 if i % 2 == 0 else 36.0, 30.0 - 20.0 * i) for i in range(4)]
    ends = [(x, y) for start, y in lines for x in (start, -start)]
    items = [item(1, TAKEOFF, [0, 0, 0, None, *place(0, 0, 12)]), speed(2, 4)]
    items += [item(i, WAYPOINT, [0, 0, 0, None, *place(*xy, 12)]) for i, xy in enumerate([*ends, (0.0, 0.0)], start=3)]
    items.append(item(len(items) + 1, LAND, [0, 0, 0, None, *place(0, 0, 0)]))
    return plan(items, hover_speed_mps=4)


def square() -> str:
    """A square of 20 m at 8 m and 3 m/s, with home first as Mission Planner writes it."""
    home = (SITE.latitude_deg, SITE.longitude_deg, SITE.altitude_m)
    rows: list[tuple[int, int, tuple[float, ...], tuple[float, ...]]] = [(0, WAYPOINT, (0, 0, 0, 0), home)]
    rows.append((FRAME_RELATIVE, TAKEOFF, (0, 0, 0, 0), tuple(place(0, 0, 8))))
    rows.append((FRAME_MISSION, CHANGE_SPEED, (1, 3, -1, 0), (0.0, 0.0, 0.0)))
    for xy in ((0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (0.0, 20.0), (0.0, 0.0)):
        rows.append((FRAME_RELATIVE, WAYPOINT, (0, 0, 0, 0), tuple(place(*xy, 8))))
    rows.append((FRAME_RELATIVE, LAND, (0, 0, 0, 0), tuple(place(0, 0, 0))))
    lines = ["QGC WPL 110"]
    for index, (frame, command, params, spot) in enumerate(rows):
        numbers = [f"{value:.8f}" for value in params + spot[:2]] + [f"{spot[2]:.6f}"]
        lines.append("\t".join([str(index), str(int(index == 0)), str(frame), str(command), *numbers, "1"]))
    return "\n".join(lines) + "\n"


def files() -> dict[str, str]:
    """Text by file name."""
    plans = {"rectangle.plan": rectangle(), "survey.plan": survey(), "people_search.plan": people_search()}
    return plans | {"square.waypoints": square()}


if __name__ == "__main__":
    for name, text in files().items():
        (FOLDER / name).write_text(text, encoding="utf-8")
