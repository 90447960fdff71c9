"""Radars of other vehicles of a run, as a radar meets their transmissions (interference.py).

Each radar with `interference` announces itself to the others, which share the run's geometry. The way to another radar
is straight, and free if no surface is on it up to the sphere around the other vehicle. A radar does not disturb those
of its own vehicle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signals._kernel import rotate_into_body
from signals.rotation import minus, norm
from signals.samples import TruthState, Vec3
from signals.time import NS_PER_S
from sim._kernels import Vicinity
from sim.frame.camera_pose import CameraPose
from sim.frame.geometry import FrameGeometry
from sim.frame.mount import Mount
from sim.radar.interference import Interfered, Path, Transmission
from sim.scene.scene_map import actor_pose

_REST: Vec3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class _Announced:
    """A radar of a vehicle, which is an actor of the world."""

    actor: int
    optical: Mount
    transmission: Transmission


class OtherRadars:
    """Transmissions of all other vehicles' radars in one radar's frames."""

    def __init__(self, geometry: FrameGeometry, name: str, optical: Mount, own: Transmission) -> None:
        """`name`: of the sensor. One made anew takes the place of the one before."""
        self._geometry = geometry
        self._all: dict[tuple[int, str], _Announced] = geometry.prepared.setdefault(OtherRadars, {})
        self._interfered = Interfered(own.chirp, own.antenna, own.receiver, own.clock)
        if geometry.left_out >= 0:
            self._all[geometry.left_out, name] = _Announced(geometry.left_out, optical, own)

    def add(self, pose: CameraPose, t_ns: int, signal: NDArray[np.float64]) -> None:
        """Add the transmissions to the frame of `t_ns`, taken from `pose`."""
        for _, other in sorted(self._all.items(), key=lambda item: item[0]):
            if other.actor == self._geometry.left_out:
                continue
            path = self._path(pose, other, t_ns)
            if path is not None:
                self._interfered.add(other.transmission, path, t_ns / NS_PER_S, signal)

    def _path(self, pose: CameraPose, other: _Announced, t_ns: int) -> Path | None:
        """Return the way to another radar; None if something is on it."""
        actor = self._geometry.world.map.actors[other.actor]
        p, q, v, w = actor_pose(actor, t_ns)
        if not np.all(np.isfinite(p[0])):
            return None
        q_WB, w_W = tuple(q[0].tolist()), tuple(w[0].tolist())
        p_WB, v_W, w_B = tuple(p[0].tolist()), tuple(v[0].tolist()), rotate_into_body(q_WB, w_W)
        state = TruthState(0, t_ns, p_WB, q_WB, v_W, w_B, _REST, _REST, (), False)
        there = other.optical.pose(state)
        way = minus(there.p_WC, pose.p_WC)
        range_m = norm(way)
        if not range_m > 0.01:
            return None
        d_W = (way[0] / range_m, way[1] / range_m, way[2] / range_m)
        _, radius_m = actor.bound(t_ns)
        if self._reach_m(pose.p_WC, d_W, range_m) < range_m - radius_m:
            return None
        speed_mps = sum((a - b) * d for a, b, d in zip(there.v_WC_W, pose.v_WC_W, d_W, strict=True))
        return Path(range_m, speed_mps, pose.in_radar_frame(d_W), there.in_radar_frame((-d_W[0], -d_W[1], -d_W[2])))

    def _reach_m(self, p_W: Vec3, d_W: Vec3, limit_m: float) -> float:
        self._geometry.pose_within(Vicinity(p_W, p_W, limit_m))
        reach_m, geom = np.empty(1), np.empty(1, np.int32)
        self._geometry.caster.cast(np.array([p_W]), np.array([d_W]), 0.0, limit_m, reach_m, geom)
        return float(reach_m[0])
