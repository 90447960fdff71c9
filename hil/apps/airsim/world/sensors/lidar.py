"""LiDAR: one turn at the instant of the sample (sim.sensors.lidar)."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.apps.airsim.settings import sensors as kinds
from hil.apps.airsim.world.sensors.sensor import Measured
from signals.frames import frd_from_flu
from signals.noise import NoiseStream
from signals.rotation import matrix_of
from signals.samples import Quat, TruthState, Vec3
from sim.frame.source import SharedFrames
from sim.scene.scene import Scene
from sim.sensors.catalog import make_sensor
from sim.sensors.sensor import Installation


class Cloud(NamedTuple):
    """Turn of a LiDAR."""

    p_WL: Vec3
    q_WL: Quat  # FLU -> ENU
    points_L: NDArray[np.float32]  # (n, 3) forward, left, up
    instances: NDArray[np.uint16]  # (n,) indices of `names`
    names: tuple[str, ...]  # of the objects and vehicles at the time of the sample


class Lidar:
    """Cloud of points."""

    latency_s = 0.0

    def __init__(self, name: str, settings: kinds.Lidar, measured: Measured) -> None:
        self.rate_hz = settings.rate_hz
        self._settings, self._measured = settings, measured
        self._stream = measured.stream(name)
        self._frames: SharedFrames | None = None
        self._scene: Scene | None = None
        self._sensor: Any = None  # made for `_frames` and `_scene`

    def sample(self, seq: int, truth: TruthState) -> Cloud:
        settings, frames = self._settings, self._measured.seen_at(truth.t_ns)
        scene = self._measured.scene()
        if frames is not self._frames or scene is not self._scene:
            installation = Installation(
                self._stream,
                rate_hz=settings.rate_hz,
                seed=1,
                scene=scene,
                step_ns=self._measured.tick_ns,
                frames=frames,
            )
            self._sensor = make_sensor(installation, kind="lidar", overrides=_parameters(settings, scene))
            self._frames, self._scene = frames, scene
        sample = self._sensor.sample(truth, seq)
        points, instances = in_view(sample.points_L, self._sensor.instances(), settings)
        if settings.noise_m:
            points = with_range_noise(points, f"{self._stream}.range", seq, settings)
        return Cloud(sample.p_WL, sample.q_WL, points, instances, frames.world.instance_names)


def _parameters(settings: kinds.Lidar, scene: Scene) -> dict[str, Any]:
    """Return parameters of sim.sensors.lidar: one turn per sample, all rays at once.

    In clear air all surfaces are seen up to the range, as in AirSim; in haze, rain and snow it is that of 10 %.
    """
    n, (low, high) = settings.channels, settings.vertical_fov_deg
    step = (high - low) / (n - 1) if n > 1 else 0.0
    elevation_deg = [math.remainder(high - step * i, 360.0) for i in range(n)]
    behind = [abs(e) > 90.0 for e in elevation_deg]  # the beam points over the top, to the other side
    roll, pitch, yaw = settings.rotation_deg
    return {
        "pattern": {
            "kind": "spinning",
            "elevation_deg": [
                math.copysign(180.0, e) - e if over else e for e, over in zip(elevation_deg, behind, strict=True)
            ],
            "azimuth_offset_deg": [180.0 if over else 0.0 for over in behind] if any(behind) else [],
            "firing_ns": 0,
            "columns": _columns(settings),
        },
        "min_range_m": 0.0,
        "max_range_m": settings.range_m,
        "range_at_10_percent_m": settings.range_m if scene.extinction_per_m > 0.0 else None,
        "range_noise_m": 0.0,  # `with_range_noise`
        "range_resolution_m": 1e-6,
        "rolling": False,
        "subsweeps": 1,
        "mount_m": frd_from_flu(settings.position_m),
        "mount_rpy_deg": (roll, -pitch, -yaw),
    }


def _columns(settings: kinds.Lidar) -> int:
    """Return the number of firings of a channel per turn."""
    return max(1, round(settings.points_per_second / settings.rate_hz / settings.channels))


def in_view(
    points_L: NDArray[np.float32], instances: NDArray[np.uint16], settings: kinds.Lidar
) -> tuple[NDArray[np.float32], NDArray[np.uint16]]:
    """Return the points of beams between two azimuths, clockwise from ahead. Equal azimuths are a whole turn, as in
    AirSim. The azimuth is that of the beam's column, so it does not depend on the range or the machine.
    """
    begin, end = settings.horizontal_fov_deg
    width = (end - begin) % 360.0
    if width == 0.0 or width >= 359.0:
        return points_L, instances
    count = _columns(settings)
    column = np.rint(np.arctan2(-points_L[:, 1], points_L[:, 0]) * (count / (2.0 * np.pi)) + 0.5 * count)
    azimuth = column.astype(np.float64) * 360.0 / count - 180.0
    inside = (azimuth - begin) % 360.0 <= width
    return points_L[inside], instances[inside]


def with_range_noise(points_L: NDArray[np.float32], name: str, seq: int, settings: kinds.Lidar) -> NDArray[np.float32]:
    """Return the points with noise along their rays, of the deviation that Cosys-AirSim gives a distance r:

    sigma (1 + (r / range) (scale - 1))
    """
    if not len(points_L):
        return points_L
    points = points_L.astype(np.float64)
    normals = NoiseStream(1, name, lanes=-(-len(points) // 256)).normal_block(seq).ravel()[: len(points)]
    r_m = np.sqrt(points[:, 0] ** 2 + points[:, 1] ** 2 + points[:, 2] ** 2)
    sigma_m = settings.noise_m * (1.0 + r_m / settings.range_m * (settings.noise_scale - 1.0))
    scale = np.maximum(1.0 + sigma_m * normals / np.maximum(r_m, 1e-6), 0.0)
    return (points * scale[:, None]).astype(np.float32)


def ned_points(points_L: NDArray[np.float32], p_N: Vec3, q_WL: Quat) -> NDArray[np.float32]:
    """Return points of a LiDAR in NED from an origin, as (n, 3); `p_N`: the LiDAR in that frame."""
    x, y, z = points_L.reshape(-1, 3).astype(np.float64).T
    # Sums are written out: the order of additions in a matrix product depends on the machine.
    R = matrix_of(q_WL)
    east, north, up = (R[i] * x + R[i + 1] * y + R[i + 2] * z for i in (0, 3, 6))
    return np.stack([north + p_N[0], east + p_N[1], p_N[2] - up], axis=1).astype(np.float32)
