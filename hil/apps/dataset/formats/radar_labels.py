"""Labels of a radar frame as a CSV file: one row per object in the radar's pattern and range.

instance, class id, class      as in the pictures and in COCO; surfaces without extent, such as ground, have no row
range, nearest [m]             mean over the object's echoes, weighted by their powers; its nearest echo
radial speed [m/s]             + receding, the radar's own motion included; not folded into the unambiguous speeds
azimuth, elevation [rad]       of the mean direction in R (x forward, y left, z up): to the left, upwards
power [counts^2], [dBm]        expected; behind the receiver's filters, and at the antenna's port before them

A radar with bounces has two more columns, and rows for ghosts under the instance of the true object:

path                           direct, or where it goes by a mirror: out, back, both ways
mirror                         instance of the mirror; empty for direct paths
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence

from hil.apps.dataset.formats.labels import Catalogue
from sim.radar.ghost_objects import GhostEcho
from sim.radar.object_echoes import ObjectEcho

FOLDER = "labels"
HEADER = (
    "instance [],class id [],class,range [m],nearest [m],radial speed [m s^-1],azimuth [rad],elevation [rad],"
    "power [count^2],power [dBm]"
)
GHOST_HEADER = ",path,mirror []"
DIRECT = "direct"


def radar_labels_csv(
    objects: Sequence[ObjectEcho], catalogue: Catalogue, ghosts: Sequence[GhostEcho] | None = None
) -> bytes:
    """Return the file of one frame; `objects`: those that are labelled, `ghosts` of a radar with bounces."""
    direct = "" if ghosts is None else f",{DIRECT},"
    rows = [(o, direct) for o in objects]
    for ghost in ghosts or ():
        if catalogue.labelled[ghost.echo.instance]:
            rows.append((ghost.echo, f",{ghost.path},{ghost.mirror}"))
    header = HEADER if ghosts is None else HEADER + GHOST_HEADER
    return "".join([header + "\n", *(_row(o, catalogue, path) for o, path in rows)]).encode()


def _row(o: ObjectEcho, catalogue: Catalogue, path: str) -> str:
    class_id = catalogue.class_of_instance[o.instance]
    name = catalogue.classes.name(class_id)
    return (
        f"{o.instance},{class_id},{name},{o.range_m:.4f},{o.nearest_m:.4f},{o.speed_mps:.4f},{o.azimuth_rad:.5f},"
        f"{o.elevation_rad:.5f},{o.power_counts2:.6g},{10.0 * math.log10(1e3 * o.power_w):.3f}{path}\n"
    )


def read_radar_labels(data: bytes) -> list[tuple[str, ObjectEcho]]:
    """Return class name and object of each row of a file of `radar_labels_csv`, without ghosts."""
    found = []
    for row in list(csv.reader(io.StringIO(data.decode())))[1:]:
        if row[10:] and row[10] != DIRECT:
            continue
        range_m, nearest_m, speed_mps, azimuth_rad, elevation_rad, power_counts2, power_dbm = map(float, row[3:10])
        power_w = 1e-3 * 10.0 ** (0.1 * power_dbm)
        place = (range_m, nearest_m, speed_mps, azimuth_rad, elevation_rad)
        found.append((row[2], ObjectEcho(int(row[0]), *place, power_counts2, power_w)))
    return found
