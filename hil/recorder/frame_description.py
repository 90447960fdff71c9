"""What a recording says of a camera, LiDAR or radar: where it sits, how a camera projects, what a radar sends."""

from __future__ import annotations

from dataclasses import dataclass

from hil.signals.samples import Quat, Vec3


@dataclass(frozen=True)
class Projection:
    """Of a camera, as sensor_msgs/CameraInfo has it (pixel centres at whole numbers)."""

    width: int
    height: int
    distortion_model: str
    d: tuple[float, ...]
    k: tuple[float, ...]  # 3 x 3
    p: tuple[float, ...]  # 3 x 4


@dataclass(frozen=True)
class Sweep:
    """Of a radar: its chirps, as hil_msgs/RadarFrame has them."""

    center_frequency_hz: float
    bandwidth_hz: float
    sample_rate_hz: float
    repetition_s: float


@dataclass(frozen=True)
class FrameDescription:
    """One frame sensor. C is its frame: optical for a camera."""

    frame_id: str
    p_BC: Vec3 = (0.0, 0.0, 0.0)
    q_BC: Quat = (1.0, 0.0, 0.0, 0.0)
    projection: Projection | None = None  # None: no camera
    sweep: Sweep | None = None  # None: no radar
