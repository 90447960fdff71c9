"""The flight core's state vector, by name.

`FlightCore.state` is a float64 view laid out by `STATE_FIELDS`. One copy into a list per guidance step or burst of
telemetry is cheaper than reading the array element by element.
"""

from __future__ import annotations

from functools import cache
from math import floor
from pathlib import Path

from firmware_bridge import _native
from firmware_bridge.mock_pixhawk.vehicle import Vehicle
from signals._kernel import det_atan2
from signals.units import RAD_PER_DEG

_F: dict[str, tuple[int, int]] = dict(_native.STATE_FIELDS)


def _span(name: str) -> slice:
    offset, size = _F[name]
    return slice(offset, offset + size)


_P, _V, _Q, _W, _EULER, _ORIGIN = (_span(name) for name in ("p_NF", "v_NF_N", "q_NF", "w_NF_F", "euler", "origin"))
_STD_P, _RATIOS = _span("std_p"), _span("test_ratios")
_ATTITUDE_OK, _POSITION_OK, _LANDED = _F["attitude_ok"][0], _F["position_ok"][0], _F["landed"][0]
_QX, _QY = _F["q_NF"][0] + 1, _F["q_NF"][0] + 2
_YAW = _F["euler"][0] + 2


class Estimate:
    """Copy of the estimator's state: NED/FRD, SI. Call `refresh` before reading."""

    def __init__(self, core: _native.FlightCore, vehicle: Vehicle) -> None:
        self._core = core
        self._view = core.state
        self._vehicle = vehicle
        self._state: list[float] = self._view.tolist()
        self._copied_at_us = -1
        self.overwritten = False  # by HIL_STATE_QUATERNION: the estimate is invalid

    def refresh(self, now_us: int) -> None:
        """Copy the state, once per `now_us`."""
        if self._copied_at_us != now_us:
            self._copied_at_us = now_us
            self._state = self._view.tolist()

    def publish(self, now_us: int) -> None:
        """Copy the state and write the vehicle's position, velocity, heading, tilt and land detector from it."""
        self.refresh(now_us)
        s, v = self._state, self._vehicle
        v.pos_n, v.pos_e, v.pos_d = s[_P]
        v.v_n, v.v_e, v.v_d = s[_V]
        v.yaw = s[_YAW]
        # Cosine of the tilt: body z against the vertical.
        v.tilt_cos = 1.0 - 2.0 * (s[_QX] * s[_QX] + s[_QY] * s[_QY])
        landed = s[_LANDED] != 0.0
        if landed and not v.landed:
            v.landed_since_us = now_us
        v.landed = landed

    @property
    def attitude_ok(self) -> bool:
        return self._state[_ATTITUDE_OK] != 0.0 and not self.overwritten

    @property
    def position_ok(self) -> bool:
        return self._state[_POSITION_OK] != 0.0 and not self.overwritten

    @property
    def has_origin(self) -> bool:
        return self._state[_ORIGIN.start] == self._state[_ORIGIN.start]

    @property
    def origin_alt_m(self) -> float:
        return self._state[_ORIGIN.start + 2]

    @property
    def p_NF(self) -> list[float]:
        return self._state[_P]

    @property
    def v_NF_N(self) -> list[float]:
        return self._state[_V]

    @property
    def q_NF(self) -> list[float]:
        return self._state[_Q]

    @property
    def w_NF_F(self) -> list[float]:
        return self._state[_W]

    @property
    def euler(self) -> list[float]:
        return self._state[_EULER]

    @property
    def test_ratios(self) -> list[float]:
        """Test ratios of GPS position, GPS velocity, baro, mag: above 1 the sample was rejected."""
        return self._state[_RATIOS]

    @property
    def accuracy_m(self) -> tuple[float, float]:
        """Standard deviation of the position, horizontal (the larger axis) and vertical."""
        n, e, d = self._state[_STD_P]
        return max(n, e), d

    def ned(self, lat_deg: float, lon_deg: float, alt_m: float) -> tuple[float, float, float]:
        """Return the local position (n, e, d) [m] of a geodetic one. Only with an origin."""
        return self._core.geodetic_to_ned(lat_deg, lon_deg, alt_m)

    def geodetic(self, n_m: float, e_m: float, d_m: float) -> tuple[float, float, float]:
        """Return latitude, longitude [deg] and altitude [m] of a local position. Only with an origin."""
        return self._core.ned_to_geodetic(n_m, e_m, d_m)


_STEP_DEG = 5


@cache
def _horizontal_field() -> list[list[list[int]]]:
    """Return the north and east components [10 nT] by latitude, component and longitude."""
    text = Path(__file__).with_name("horizontal_field.txt").read_text(encoding="utf-8")
    lines = [[int(word) for word in line.split()] for line in text.splitlines() if not line.startswith("#")]
    return [[north, east] for north, east in zip(lines[::2], lines[1::2], strict=True)]


def declination_deg(lat_deg: float, lon_deg: float) -> float:
    """Return the angle from true to magnetic north, east positive.

    PX4's `geo_mag_declination` interpolates the angle, between 60 degrees south and 60 north. Here the components of
    the horizontal field are interpolated, which are smooth up to the magnetic poles: within 0.3 degrees of the World
    Magnetic Model where the horizontal field is above 10 uT, 0.6 degrees down to 6 uT, 1.5 degrees down to 2 uT.
    """
    table = _horizontal_field()
    y, x = (lat_deg + 90.0) / _STEP_DEG, (lon_deg + 180.0) / _STEP_DEG
    row, column = min(max(floor(y), 0), len(table) - 2), min(max(floor(x), 0), len(table[0][0]) - 2)
    v, u = y - row, x - column

    def component(which: int) -> float:
        south, north = table[row][which], table[row + 1][which]
        return (south[column] * (1.0 - u) + south[column + 1] * u) * (1.0 - v) + (
            north[column] * (1.0 - u) + north[column + 1] * u
        ) * v

    return det_atan2(component(1), component(0)) / RAD_PER_DEG
