"""State of the vehicle that the parts of the autopilot share. Each field is written by one part."""

from __future__ import annotations

from typing import NamedTuple

from firmware_bridge.mock_pixhawk.modes import Mode


class Home(NamedTuple):
    """Position at which the vehicle was armed. n, e, d in the estimator's local frame, NED."""

    lat_deg: float
    lon_deg: float
    alt_m: float  # above mean sea level
    n_m: float
    e_m: float
    d_m: float


class ManualControl(NamedTuple):
    """Sticks of MANUAL_CONTROL, -1..1; throttle 0..1."""

    t_us: int
    pitch: float
    roll: float
    throttle: float
    yaw: float


class Vehicle:
    """State of the vehicle as the autopilot sees it. Lengths in m NED from the estimator's origin, angles in rad."""

    __slots__ = (
        "airborne",
        "armed",
        "armed_at_us",
        "battery_remaining",
        "failsafe",
        "home",
        "landed",
        "landed_since_us",
        "manual",
        "mode",
        "now_us",
        "pos_d",
        "pos_e",
        "pos_n",
        "ready",
        "terminated",
        "tilt_cos",
        "v_d",
        "v_e",
        "v_n",
        "yaw",
    )

    def __init__(self) -> None:
        self.now_us = 0  # clock: HIL_SENSOR.time_usec of the last step; in HITL the board's own
        self.armed = False
        self.armed_at_us = 0
        self.mode = Mode.LOITER
        self.landed = True  # land detector
        self.landed_since_us = 0
        self.airborne = False  # has left the ground since it was armed
        self.terminated = False
        self.failsafe = False  # a failsafe has taken over
        self.ready = False  # pre-flight checks pass
        self.home: Home | None = None
        self.manual: ManualControl | None = None
        self.battery_remaining = 1.0
        self.pos_n = self.pos_e = self.pos_d = 0.0
        self.v_n = self.v_e = self.v_d = 0.0
        self.yaw = 0.0
        self.tilt_cos = 1.0
