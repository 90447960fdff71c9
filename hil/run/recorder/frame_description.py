"""Description of a sensor with a mount in a recording: mount, projection of a camera, chirps of a radar."""

from __future__ import annotations

from dataclasses import dataclass

from signals.samples import Quat, Vec3


@dataclass(frozen=True)
class Projection:
    """Projection of a camera in the terms of sensor_msgs/CameraInfo; pixel centres have integer coordinates."""

    width: int
    height: int
    distortion_model: str
    d: tuple[float, ...]
    k: tuple[float, ...]  # 3 x 3
    p: tuple[float, ...]  # 3 x 4


@dataclass(frozen=True)
class Sweep:
    """Chirps of a radar in the terms of hil_msgs/RadarFrame."""

    center_frequency_hz: float
    bandwidth_hz: float
    sample_rate_hz: float
    repetition_s: float


@dataclass(frozen=True)
class FrameDescription:
    """Description of one sensor. C is its frame, for a camera the optical one."""

    frame_id: str
    p_BC: Vec3 = (0.0, 0.0, 0.0)
    q_BC: Quat = (1.0, 0.0, 0.0, 0.0)
    projection: Projection | None = None  # None unless it is a camera
    sweep: Sweep | None = None  # None unless it is a radar
    sweep_ns: int = 0  # duration of a LiDAR's sweep, which ends at the capture; 0: all rays fire at once
