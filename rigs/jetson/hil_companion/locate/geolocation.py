"""Boxes to places: range from depth or from the ground, then from the camera's estimated pose into the world."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Sequence

import numpy as np

from hil_companion.explore.inertial import Moment
from hil_companion.explore.rotation import matrix_of
from hil_companion.locate.camera import Camera
from hil_companion.locate.ranging import depth_in, ground_range, radar_speed, shows_feet

# Of a place, besides the vehicle's own: what box, lens and attitude leave open [m, and share of the range].
_DEPTH_SIGMA, _GROUND_SIGMA = (0.25, 0.025), (0.5, 0.06)


@dataclass(frozen=True)
class RadarView:
    """Points of a radar, and where it sits on the vehicle."""

    points: Any
    p_BR: np.ndarray
    R_BR: np.ndarray


class Geolocation:
    """For one camera. `ground_z_m`: height of the ground, where there is no depth."""

    def __init__(self, camera: Camera, *, ground_z_m: float) -> None:
        self.camera = camera
        self._ground_z_m = ground_z_m

    def place(
        self, boxes: Sequence[Any], pose: Moment | None, depth_m: np.ndarray | None, radar: RadarView | None
    ) -> list[Any]:
        """The same detections with range, speed and place, as far as these can be known."""
        return [self._placed(box, pose, depth_m, radar) for box in boxes]

    def sigma_m(self, range_m: float, own_sigma_m: float, *, by_depth: bool) -> float:
        """Of a place, horizontally, an axis."""
        fixed_m, share = _DEPTH_SIGMA if by_depth else _GROUND_SIGMA
        return float(np.hypot(fixed_m + share * range_m, own_sigma_m))

    def _placed(self, box: Any, pose: Moment | None, depth_m: np.ndarray | None, radar: RadarView | None) -> Any:
        camera = self.camera
        x0, y0, x1, y1 = box.box_px
        middle, foot = (0.5 * (x0 + x1), 0.5 * (y0 + y1)), (0.5 * (x0 + x1), y1)
        rays = camera.rays_C([middle, (x0, y0), (x1, y0), (x0, y1), (x1, y1), foot])
        R_WC = p_WC = None
        if pose is not None:
            R_WB = matrix_of(pose.q)
            R_WC, p_WC = R_WB @ camera.R_BC, np.array(pose.p) + R_WB @ camera.p_BC
        range_m, ray = None, rays[0]
        if depth_m is not None:
            z_m = depth_in(depth_m, box.box_px)
            range_m = None if z_m is None else z_m * float(np.linalg.norm(ray))
        elif R_WC is not None and p_WC is not None and shows_feet(box.box_px, camera.size_px[1]):
            ray = rays[5]
            range_m = ground_range(p_WC, R_WC, ray, self._ground_z_m)
        p_W = None
        if range_m is not None and R_WC is not None and p_WC is not None:
            x, y, z = (p_WC + R_WC @ (ray / np.linalg.norm(ray)) * range_m).tolist()
            p_W = (x, y, z)
        speed = None
        if radar is not None:
            speed = radar_speed(radar.points, radar.p_BR, radar.R_BR, camera.p_BC, camera.R_BC, rays[:5], range_m)
        return replace(box, range_m=range_m, radial_speed_mps=speed, p_W=p_W)
