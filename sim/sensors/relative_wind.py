"""Velocity of a point of the vehicle through the air.

    u_B = R_WB^T (v_W - wind_W) + w_B x r_B

The wind is that at the vehicle: steady wind, turbulence, gusts and other vehicles' downwash (`Installation.wind_at`).
The air that the vehicle's own propellers and wings move is not part of it.
"""

from __future__ import annotations

from collections.abc import Callable

from signals._kernel import rotate_into_body
from signals.rotation import cross, minus
from signals.samples import TruthState, Vec3
from sim.sensors.sensor import Installation


def wind_source(installation: Installation) -> Callable[[], Vec3]:
    """Return the function that gives the wind at the vehicle [m/s, W]; the scene's steady wind if nothing else does."""
    if installation.wind_at is not None:
        return installation.wind_at
    steady_W = installation.scene.wind_W_mps
    return lambda: steady_W


def airspeed_B_mps(truth: TruthState, wind_W_mps: Vec3, point_m: Vec3) -> Vec3:
    """Return the velocity through the air of a point of the body, in B."""
    x, y, z = rotate_into_body(truth.q_WB, minus(truth.v_WB_W, wind_W_mps))
    dx, dy, dz = cross(truth.w_WB_B, point_m)
    return (x + dx, y + dy, z + dz)
