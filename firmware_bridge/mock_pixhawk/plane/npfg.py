"""Lateral guidance on paths with curvature, in wind: PX4's NPFG without its adaption of the period.

T. Stastny, R. Siegwart, "On flying backwards: preventing run-away of small, low-speed, fixed-wing UAVs in strong
winds", IROS 2019 (arXiv:1908.01381), in the form that PX4 flies from 1.13 on (parameters NPFG_*). North and east only,
z down: `cross` of two vectors is positive where the second lies to the right of the first.

    look-ahead angle   theta = pi/2 (1 - min(|e| / b, 1))^2         e: distance right of the path, b = T zeta V_ground
    bearing            l = -sign(e) cos(theta) n + sin(theta) t     t: tangent of the path, n: to its right
    air velocity       v_ref: of size V_air, so that v_ref + wind lies along l
    acceleration       a = p (v_air x v_ref) / V_air + sin^2(theta) V_air s r,      p = 4 pi zeta / T

r is the rate at which the path's frame turns under the vehicle, kappa V_parallel / (1 - kappa e), and s the ground
speed along the path over the part of the airspeed that lies along it.

Without wind and near a line: e'' = -p e' - (2 pi / T)^2 e, an oscillator of period T and damping zeta. On a circle of
radius R with e = 0: a = V^2 / R, the acceleration of the circle itself.
"""

from __future__ import annotations

from math import pi, sqrt
from typing import NamedTuple

from firmware_bridge.mock_pixhawk import elementary as el

_LEAST_SPEED_MPS = 1.0
_LEAST_SHRINK = 0.1  # of 1 - kappa e, near the centre of a circle


class PathPoint(NamedTuple):
    """The nearest point of a path: unit tangent, distance of the vehicle to its right, curvature (right positive)."""

    t_n: float
    t_e: float
    right_m: float
    curvature_per_m: float


def track_error_bound_m(ground_speed_mps: float, period_s: float, damping: float) -> float:
    """Return the distance from which a path is approached at a right angle."""
    time_s = period_s * damping
    if ground_speed_mps > 1.0:
        return ground_speed_mps * time_s
    return 0.5 * time_s * (ground_speed_mps * ground_speed_mps + 1.0)


def lateral_acceleration_mps2(
    path: PathPoint,
    *,
    ground_mps: tuple[float, float],
    wind_mps: tuple[float, float],
    period_s: float,
    damping: float,
) -> float:
    """Return the acceleration to the right, at a right angle to the air velocity.

    `ground_mps` and `wind_mps`: north and east of the velocity over ground and of the wind.
    """
    g_n, g_e = ground_mps
    w_n, w_e = wind_mps
    a_n, a_e = g_n - w_n, g_e - w_e
    ground_speed, airspeed = sqrt(g_n * g_n + g_e * g_e), sqrt(a_n * a_n + a_e * a_e)
    if airspeed < _LEAST_SPEED_MPS:
        return 0.0
    t_n, t_e, error, curvature = path
    share = min(abs(error) / track_error_bound_m(ground_speed, period_s, damping), 1.0)
    look_ahead = 0.5 * pi * (1.0 - share) * (1.0 - share)
    along, across = el.sin(look_ahead), el.cos(look_ahead)
    side = -across if error > 0.0 else across
    l_n, l_e = along * t_n - side * t_e, along * t_e + side * t_n  # n = (-t_e, t_n)
    ref_n, ref_e = _air_velocity_for(l_n, l_e, w_n, w_e, airspeed)

    gain = 4.0 * pi * damping / period_s
    dot, cross = a_n * ref_n + a_e * ref_e, a_n * ref_e - a_e * ref_n
    turn = gain * cross / airspeed
    if dot < 0.0:
        turn = gain * airspeed if cross >= 0.0 else -gain * airspeed
    parallel = max(g_n * t_n + g_e * t_e, 0.0)
    frame_rate = curvature * parallel / max(1.0 - curvature * error, _LEAST_SHRINK)
    wind_along, wind_across = w_n * t_n + w_e * t_e, w_n * t_e - w_e * t_n
    air_along = sqrt(max(airspeed * airspeed - wind_across * wind_across, _LEAST_SPEED_MPS * _LEAST_SPEED_MPS))
    return turn + along * along * airspeed * max(1.0 + wind_along / air_along, 0.0) * frame_rate


def _air_velocity_for(l_n: float, l_e: float, w_n: float, w_e: float, airspeed: float) -> tuple[float, float]:
    """Return the air velocity of this size that keeps the ground velocity on the bearing (wind triangle).

    In a cross wind above the airspeed no air velocity does: the one straight against the cross wind is returned.
    """
    across = w_n * l_e - w_e * l_n
    if abs(across) >= airspeed:
        size = airspeed if across > 0.0 else -airspeed
        return -l_e * size, l_n * size
    along = sqrt(airspeed * airspeed - across * across)
    return along * l_n - across * l_e, across * l_n + along * l_e
