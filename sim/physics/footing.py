"""Pose in which a vehicle stands on its feet on ground that is not level.

The ground under each foot is found by a ray from above. With its heights h_i above the start at the places (x_i, y_i)
of the feet, the plane h = a + b x + c y of least squares has the normal n = (-b, -c, 1) / |(-b, -c, 1)|: the vehicle
stands along n, with the heading it has on level ground, raised until no foot is inside the ground.

It stays there while its weight points between its feet and friction holds it. For a slope s towards the edge where it
is least stable, tan(s) <= d / h and tan(s) <= friction, with d from below the centre of mass to that edge of the feet,
and h the height of the centre of mass over them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from signals.rotation import applied, matrix_of, norm, product
from signals.samples import Quat, Vec3
from sim.physics.flight_start import FlightStart
from sim.physics.vehicle import Vehicle

INSIDE_M = 0.02  # greatest depth of a start, or of a sphere that stands, in the ground
OVER_GROUND_M = 0.05  # greatest height of a start, or of the feet, over the ground
LEVEL_M = 0.002  # ground whose heights under the feet differ less from the start's is level
FEET_M = 0.03  # spheres within this height of the lowest are feet
_RISE_M = 0.05  # most that a foot is lifted out of uneven ground
_LIFTS = 4


@dataclass(frozen=True)
class Footing:
    """A vehicle at rest on the ground."""

    p_WB: Vec3
    q_WB: Quat
    slope_rad: float  # of the plane under the feet; 0 on level ground


def find_footing(model: mujoco.MjModel, data: mujoco.MjData, vehicle: Vehicle, start: FlightStart) -> Footing:
    """Return how the vehicle stands at a start. `data` is changed: its positions are those of the footing."""
    x, y, z = start.ground_W
    q_level = vehicle.standing_quat(start.yaw_rad)
    level = Footing((x, y, z + vehicle.standing_height_m), q_level, 0.0)
    _set_pose(model, data, level)
    if vehicle.rolls or start.launch is not None:
        return level  # wheels have a plane of their own
    heights = _heights_under_feet(model, data, vehicle, start, q_level)
    if len(heights) < 3 or max(abs(h) for _, _, h in heights) <= LEVEL_M:
        return level
    a, b, c = _plane(heights)
    if not -OVER_GROUND_M <= a <= INSIDE_M:
        return level  # the start is not on this ground
    n = (-b, -c, 1.0)
    length = norm(n)
    n = (n[0] / length, n[1] / length, n[2] / length)
    half_cos = math.sqrt(0.5 * (1.0 + n[2]))  # of the shortest turn from z to n, about (-n_y, n_x, 0)
    turn = (half_cos, -0.5 * n[1] / half_cos, 0.5 * n[0] / half_cos, 0.0)
    height_m = vehicle.standing_height_m
    p_WB = (x + height_m * n[0], y + height_m * n[1], z + a + height_m * n[2])
    q_WB = product(turn, q_level)
    slope_rad = math.acos(min(n[2], 1.0))
    standing = Footing(p_WB, q_WB, slope_rad)
    lifted_m = 0.0
    for _ in range(_LIFTS):
        _set_pose(model, data, standing)
        mujoco.mj_collision(model, data)
        deep_m = -min((float(contact.dist) for contact in data.contact), default=0.0) / n[2]
        if deep_m <= 0.0 or lifted_m + deep_m > _RISE_M:
            break
        lifted_m += deep_m
        standing = Footing((p_WB[0], p_WB[1], p_WB[2] + lifted_m), q_WB, slope_rad)
    return standing


def steepest_slope(vehicle: Vehicle, friction: float) -> tuple[float, str]:
    """Return the steepest slope on which the vehicle stays, and what it does beyond: "slides" or "tips over".

    `friction`: of the ground.
    """
    corners = _hull([(x, y) for x, y, _ in _feet_from_origin(vehicle, vehicle.standing_quat(0.0))])
    edges = zip(corners, [*corners[1:], corners[0]], strict=True)
    inner_m = min(((ax * by - ay * bx) / math.hypot(bx - ax, by - ay) for (ax, ay), (bx, by) in edges), default=0.0)
    grip = min((foot.friction_on(friction) for foot in vehicle.feet), default=friction)
    tips_rad, slides_rad = math.atan2(max(inner_m, 0.0), vehicle.lying_height_m), math.atan(grip)
    return (slides_rad, "slides") if slides_rad < tips_rad else (tips_rad, "tips over")


def _feet_from_origin(vehicle: Vehicle, q_WB: Quat) -> list[Vec3]:
    """Return the lowest points of the feet from the body origin, in W, of the vehicle that stands level with `q_WB`."""
    lowest_m = -vehicle.lying_height_m
    R_WB = matrix_of(q_WB)
    places = [(*applied(R_WB, sphere.position_m)[:2], sphere) for sphere in vehicle.contact_spheres]
    low = [(x, y, vehicle.upward(sphere.position_m) - sphere.radius_m) for x, y, sphere in places]
    return [place for place in low if place[2] < lowest_m + FEET_M]


def _heights_under_feet(
    model: mujoco.MjModel, data: mujoco.MjData, vehicle: Vehicle, start: FlightStart, q_WB: Quat
) -> list[Vec3]:
    """Return places of the feet from the start's, and the height of the ground above its z there; none without ground.

    Rays begin as high over the start as the vehicle is wide, so that no roof above it counts.
    """
    x, y, z = start.ground_W
    body, reach_m = int(model.jnt_bodyid[0]), 2.0 * vehicle.bounding_radius_m
    geom, down = np.full((1, 1), -1, dtype=np.int32), np.array([[0.0], [0.0], [-1.0]])
    found = []
    for dx, dy, _ in _feet_from_origin(vehicle, q_WB):
        above = np.array([[x + dx], [y + dy], [z + reach_m]])
        distance_m = mujoco.mj_ray(model, data, above, down, None, 1, body, geom)
        if 0.0 <= distance_m <= 2.0 * reach_m:
            found.append((dx, dy, reach_m - distance_m))
    return found


def _plane(points: Sequence[Vec3]) -> Vec3:
    """Return a, b and c of the plane h = a + b x + c y of least squares through three points or more."""
    n = len(points)
    mx, my, mh = (sum(point[i] for point in points) / n for i in range(3))
    xx = sum((x - mx) ** 2 for x, _, _ in points)
    xy = sum((x - mx) * (y - my) for x, y, _ in points)
    yy = sum((y - my) ** 2 for _, y, _ in points)
    xh = sum((x - mx) * (h - mh) for x, _, h in points)
    yh = sum((y - my) * (h - mh) for _, y, h in points)
    det = xx * yy - xy * xy
    if det <= 1e-9 * (xx + yy) ** 2:  # feet on one line
        return mh, 0.0, 0.0
    b, c = (xh * yy - yh * xy) / det, (yh * xx - xh * xy) / det
    return mh - b * mx - c * my, b, c


def _hull(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the corners of the convex hull, counter-clockwise (Andrew's monotone chain)."""
    ordered = sorted(set(points))
    chains = []
    for way in (ordered, ordered[::-1]):
        chain: list[tuple[float, float]] = []
        for p in way:
            while len(chain) > 1 and _turns_right(chain[-2], chain[-1], p):
                chain.pop()
            chain.append(p)
        chains += chain[:-1]
    return chains


def _turns_right(a: tuple[float, float], b: tuple[float, float], p: tuple[float, float]) -> bool:
    return (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) <= 0.0


def _set_pose(model: mujoco.MjModel, data: mujoco.MjData, footing: Footing) -> None:
    data.qpos[:] = (*footing.p_WB, *footing.q_WB)
    mujoco.mj_kinematics(model, data)
