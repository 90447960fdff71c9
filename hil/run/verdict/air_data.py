"""Airspeed and angles of the flow at a vehicle, from its true state and the wind."""

from __future__ import annotations

import math
from typing import NamedTuple

from signals._kernel import rotate_into_body
from signals.samples import TruthState, Vec3


class AirData(NamedTuple):
    """True airspeed; angle of attack in the plane of symmetry; sideslip, positive with the flow from the right."""

    airspeed_mps: float
    attack_rad: float
    sideslip_rad: float


def air_data(truth: TruthState, wind_W_mps: Vec3) -> AirData:
    """Return the air data of a state; the angles are 0 without a flow."""
    (vx, vy, vz), (wx, wy, wz) = truth.v_WB_W, wind_W_mps
    x, y, z = rotate_into_body(truth.q_WB, (vx - wx, vy - wy, vz - wz))
    airspeed = math.sqrt(x * x + y * y + z * z)
    sine = -y / airspeed if airspeed > 0.0 else 0.0
    return AirData(airspeed, math.atan2(-z, x), math.asin(max(-1.0, min(1.0, sine))))
