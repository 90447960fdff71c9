"""The kinds of sensors there are: class, parameters, and what it delivers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from hil.signals.documents.validate import StrictModel
from hil.signals.samples import FRAME_SAMPLES
from sim.sensors.barometer import Barometer, BarometerParameters
from sim.sensors.camera import Camera
from sim.sensors.camera_parameters import CameraParameters
from sim.sensors.gps import Gps, GpsParameters
from sim.sensors.imu import Imu, ImuParameters
from sim.sensors.lidar import Lidar
from sim.sensors.lidar_parameters import LidarParameters
from sim.sensors.magnetometer import Magnetometer, MagnetometerParameters
from sim.sensors.optical_flow import OpticalFlow, OpticalFlowParameters
from sim.sensors.radar import Radar
from sim.sensors.radar_parameters import RadarParameters
from sim.sensors.range_finder import RangeFinder, RangeFinderParameters


@dataclass(frozen=True)
class Kind:
    """One kind of sensor: its class and the model of its parameters."""

    sensor: Any  # callable (Installation, parameters) -> Sensor
    parameters: type[StrictModel]
    parts: str | None = None  # the parameter that lists what a sample holds; each of it is a port of its own

    @property
    def sample_type(self) -> type:
        """What its samples are."""
        kind: type = self.sensor.sample_type
        return kind

    @property
    def needs_frames(self) -> bool:
        """Whether it looks at the world's geometry (`Installation.frames`)."""
        return self.sample_type in FRAME_SAMPLES


KINDS: dict[str, Kind] = {
    "imu": Kind(Imu, ImuParameters),
    "barometer": Kind(Barometer, BarometerParameters),
    "magnetometer": Kind(Magnetometer, MagnetometerParameters),
    "gps": Kind(Gps, GpsParameters),
    "range_finder": Kind(RangeFinder, RangeFinderParameters),
    "optical_flow": Kind(OpticalFlow, OpticalFlowParameters),
    "camera": Kind(Camera, CameraParameters, parts="channels"),
    "lidar": Kind(Lidar, LidarParameters),
    "radar": Kind(Radar, RadarParameters, parts="outputs"),
}
