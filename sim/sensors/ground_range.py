"""Distance from a sensor on the vehicle straight down its axis to the ground or a box."""

from __future__ import annotations

from hil.signals.samples import TruthState, Vec3
from sim._kernels import BoxScene
from sim.scene.scene import Scene
from sim.sensors.rotation import rotate_into_world


class GroundRange:
    """The scene's ground plane and boxes, seen along -z of B from `mount_m` in B.

    One ray: the beam's width, the surface's slope within it and the vehicle's own legs are not modelled.
    """

    def __init__(self, scene: Scene, mount_m: Vec3) -> None:
        self._scene = BoxScene(
            [(*box.center_m, 0.5 * box.size_m[0], 0.5 * box.size_m[1], 0.5 * box.size_m[2]) for box in scene.boxes]
        )
        self._mount_m = mount_m
        self._at_origin = not any(mount_m)

    def distance_m(self, truth: TruthState) -> float:
        """True distance [m]; -1 if the ray meets nothing (it points above the horizon)."""
        origin_W = truth.p_WB
        if not self._at_origin:
            dx, dy, dz = rotate_into_world(truth.q_WB, self._mount_m)
            origin_W = (origin_W[0] + dx, origin_W[1] + dy, origin_W[2] + dz)
        return self._scene.ray_distance(origin_W, rotate_into_world(truth.q_WB, (0.0, 0.0, -1.0)))
