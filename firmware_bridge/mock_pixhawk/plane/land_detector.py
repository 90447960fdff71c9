"""Land detector of a plane, as PX4's fixed-wing one: on the ground once slow in every way for LNDFW_TRIG_TIME.

Slow: over ground below LNDFW_VEL_XY_MAX, vertically below LNDFW_VEL_Z_MAX, through the air below LNDFW_AIRSPD_MAX (PX4,
FixedwingLandDetector). In a wind above the last a plane at rest is never found on the ground, by PX4 neither: `blown`.
Not taken from PX4: the acceleration of LNDFW_XYACC_MAX and the rotation, which low speeds for 2 s imply here.
"""

from __future__ import annotations

from math import sqrt

from firmware_bridge.mock_pixhawk.parameters.params import ParamTable
from signals.time import US_PER_S

_SPEED_TC_S = 0.5
_LEAVES_ABOVE_M = 1.0  # height above the last place of rest, or the speeds below, end a landing


class PlaneLandDetector:
    """Landed from boot on; leaves the ground with airspeed and speed over ground, or height."""

    def __init__(self, params: ParamTable) -> None:
        self._params = params
        self.landed = True
        self._slow_since_us: int | None = None
        self._blown_since_us: int | None = None
        self.blown = False  # slow over ground for twice the time, and only the airspeed speaks against a landing
        self._rest_d_m = 0.0
        self._speed = self._sink = 0.0
        self._last_us: int | None = None

    def at_rest(self, d_m: float) -> None:
        """Disarmed: on the ground by definition."""
        self.landed, self._slow_since_us, self._rest_d_m = True, None, d_m
        self._blown_since_us, self.blown = None, False

    def step(
        self, now_us: int, velocity_NED: tuple[float, float, float], d_m: float, airspeed_mps: float, *, moves: bool
    ) -> bool:
        """Take the motion. `moves`: the engine runs or a launch was seen; without that a vehicle stays landed."""
        n, e, d = velocity_NED
        dt = 0.02 if self._last_us is None else min(1e-6 * (now_us - self._last_us), 0.1)
        self._last_us = now_us
        gain = dt / (dt + _SPEED_TC_S)
        self._speed += (sqrt(n * n + e * e) - self._speed) * gain
        self._sink += (abs(d) - self._sink) * gain
        p = self._params
        slow = self._speed < p["LNDFW_VEL_XY_MAX"] and self._sink < p["LNDFW_VEL_Z_MAX"]
        if self.landed or not slow or airspeed_mps < p["LNDFW_AIRSPD_MAX"]:
            self._blown_since_us = None
        elif self._blown_since_us is None:
            self._blown_since_us = now_us
        blown_us = 0 if self._blown_since_us is None else now_us - self._blown_since_us
        self.blown = blown_us > int(2.0 * p["LNDFW_TRIG_TIME"] * US_PER_S)
        slow = slow and airspeed_mps < p["LNDFW_AIRSPD_MAX"]
        if self.landed:
            if not moves:
                self._rest_d_m = d_m
            fast = self._speed > p["LNDFW_VEL_XY_MAX"] and airspeed_mps > p["LNDFW_AIRSPD_MAX"]
            if moves and (fast or d_m < self._rest_d_m - _LEAVES_ABOVE_M):
                self.landed, self._slow_since_us = False, None
            return self.landed
        if not slow:
            self._slow_since_us = None
        elif self._slow_since_us is None:
            self._slow_since_us = now_us
        elif now_us - self._slow_since_us >= int(p["LNDFW_TRIG_TIME"] * US_PER_S):
            self.landed = True
            self._rest_d_m = d_m
        return self.landed
