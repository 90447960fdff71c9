"""What clients are told about the sensors whose data they get: lens, size and place on the vehicle."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from hil.config import BenchConfig
from hil.config.radar_checks import view_of
from sim.frame.calibration_text import coefficients, distortion_name, projection_matrix
from sim.frame.mount import Mount
from sim.sensors.camera_parameters import CameraParameters
from sim.sensors.lidar_parameters import LidarParameters
from sim.sensors.radar_parameters import RadarParameters


def calibrations(config: BenchConfig, sensors: Iterable[str]) -> dict[str, dict[str, Any]]:
    """By sensor: kind, rate_hz, p_BC [m] and q_BC of its frame in B; of cameras the pinhole model; of LiDARs the
    elevation of each ring, none where a ring has none of its own."""
    found = {}
    for name in sensors:
        sensor = config.sensors[name]
        told: dict[str, Any] = {"kind": sensor.kind, "rate_hz": sensor.rate_hz}
        p = sensor.parameters
        if isinstance(p, CameraParameters):
            told |= _camera(view_of(sensor).camera) | _place(p.mount_m, p.mount_rpy_deg, optical=True)
        elif isinstance(p, RadarParameters):
            view = p.view() if p.frame is None else view_of(config.sensors[p.frame])
            told |= _place(view.mount_m, view.mount_rpy_deg, optical=False) | {"chirp": p.chirp.model_dump(mode="json")}
        elif hasattr(p, "mount_m") and hasattr(p, "mount_rpy_deg"):
            told |= _place(p.mount_m, p.mount_rpy_deg, optical=False)
            if isinstance(p, LidarParameters):
                told |= {"elevation_deg": list(p.pattern.ring_elevations_deg)}
        found[name] = told
    return found


def _camera(camera: Any) -> dict[str, Any]:
    return {
        "width": camera.width,
        "height": camera.height,
        "camera_matrix": [float(x) for x in camera.opencv_matrix],
        "projection_matrix": [float(x) for x in projection_matrix(camera)],
        "distortion": distortion_name(camera),
        "coefficients": [float(x) for x in coefficients(camera)],
    }


def _place(mount_m: Any, mount_rpy_deg: Any, *, optical: bool) -> dict[str, Any]:
    mount = Mount(mount_m, mount_rpy_deg, optical=optical)
    return {"p_BC": list(mount.p_BC), "q_BC": list(mount.q_BC)}
