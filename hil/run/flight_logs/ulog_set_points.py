"""Set-points and wind of a ULog.

    trajectory_setpoint              position, velocity and acceleration beside it (feed-forwards) and yaw with its rate
                                     of the flight mode, from 1.14 on as arrays, before as x, y, z, vx, vy, vz
    vehicle_local_position_setpoint  where that is missing: what the position controller makes of it. Its velocities
                                     contain that controller's own correction, so they count only without a position,
                                     and its accelerations never
    wind, wind_estimate              the estimator's wind

A jump of the estimator's origin moves set-points as it moves the position: `moved_N` [m] over `moved_s` is how far the
position's jumps have moved it so far.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.run.flight_logs.columns_of_time import series_of
from hil.run.flight_logs.flight_log import Series
from hil.run.flight_logs.set_points import Columns, Rows, SetPoints, set_points_of

Topics = Callable[[str], dict[str, NDArray[Any]] | None]

_US = 1e-6
_NED = ("x", "y", "z")
TOPICS = ("trajectory_setpoint", "vehicle_local_position_setpoint", "wind", "wind_estimate", "vehicle_status")
# vehicle_status.vehicle_type
_OTHER_VEHICLES = {2: "a fixed-wing aircraft", 3: "a rover", 4: "an airship"}


def ulog_set_points(topics: Topics, moved_s: Rows, moved_N: Rows) -> SetPoints | None:
    """Return the set-points of a log; None if it has none."""
    for name in TOPICS[:2]:
        data = topics(name)
        if data is None:
            continue
        t_s = data["timestamp"].astype(np.float64) * _US
        p_N = _three(data, "position") if "position[0]" in data else _columns(data, _NED)
        v_N = _three(data, "velocity") if "velocity[0]" in data else _columns(data, [f"v{axis}" for axis in _NED])
        if p_N is None or v_N is None:
            continue
        a_N = _three(data, "acceleration")
        if a_N is None or name == TOPICS[1]:
            a_N = np.full_like(p_N, np.nan)
        if name == TOPICS[1]:
            v_N = np.where(np.isfinite(p_N), np.nan, v_N)
        if len(moved_s):
            p_N = p_N - moved_N[np.clip(np.searchsorted(moved_s, t_s, "right") - 1, 0, None)]
        yaw_rad, rate_radps = (
            data[column].astype(np.float64) if column in data else np.full(len(t_s), np.nan)
            for column in ("yaw", "yawspeed")
        )
        found = set_points_of(name, Columns(t_s, p_N, v_N, a_N, yaw_rad, rate_radps), ned=True)
        if found is not None:
            return found
    return None


def ulog_wind(topics: Topics) -> Series | None:
    """Return the estimated velocity of the air, east and north [m/s]; None if the log has none."""
    for name in TOPICS[2:4]:
        data = topics(name)
        wind = None if data is None else _columns(data, ("windspeed_east", "windspeed_north"))
        if data is not None and wind is not None and np.any(wind):
            return series_of(data["timestamp"].astype(np.float64) * _US, wind)
    return None


def ulog_other_vehicle(topics: Topics) -> str:
    """Return what made the log if it was no multirotor, else an empty text."""
    data = topics("vehicle_status")
    if data is None or "vehicle_type" not in data:
        return ""
    return _OTHER_VEHICLES.get(int(np.median(data["vehicle_type"])), "")


def _three(data: dict[str, NDArray[Any]], name: str) -> Rows | None:
    return _columns(data, [f"{name}[{i}]" for i in range(3)])


def _columns(data: dict[str, NDArray[Any]], names: Any) -> Rows | None:
    if any(name not in data for name in names):
        return None
    return np.stack([data[name].astype(np.float64) for name in names], axis=1)
