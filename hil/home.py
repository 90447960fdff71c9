"""Where on Earth the vehicle starts, and where an autopilot that started there has the points of the world W."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from firmware_bridge.ground_station.projections import GeodeticFromW, Place, ardupilot_sitl_world
from hil.signals.geodesy import LocalFrame
from hil.signals.rotation import yaw_of
from sim.scene.scene import Site

State = NDArray[np.float64]  # p_W [m], q_WB (w, x, y, z), and what else of the vehicle


def home_of(site: Site, state: State) -> tuple[float, float, float, float]:
    """Latitude and longitude [deg], altitude [m MSL], heading [deg from north] of a vehicle in this state."""
    x, y, z, *q_WB = state[:7].tolist()
    latitude, longitude, altitude = LocalFrame(site).geodetic_from_enu((x, y, z))
    yaw_deg = math.degrees(yaw_of(q_WB))
    return latitude, longitude, altitude, (90.0 - yaw_deg) % 360.0


def geodetic_from_W(autopilot_kind: str, site: Site, state: State) -> GeodeticFromW:
    """Where on Earth the autopilot has a point of the world, once it has been flown there from this state."""
    if autopilot_kind != "ardupilot_sitl":
        return LocalFrame(site).geodetic_from_enu
    x, y, z = state[:3].tolist()
    latitude, longitude, altitude, _ = home_of(site, state)
    return ardupilot_sitl_world(Place(latitude, longitude, altitude), (x, y, z))
