"""Interface of every sensor, and its installation in a run.

A sensor is a class with the attributes of `Sensor`, made from an `Installation` and its parameters. To add a kind,
write the class, a pydantic model of its parameters and `KIND = Kind(...)` in a file of this folder; to add a device of
a kind, write a file in preset_files/.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Protocol

from pydantic import Field

from signals.documents.validate import StrictModel
from signals.samples import FRAME_SAMPLES, PointCloudSample, Sample, TruthState, Vec3
from signals.time import NS_PER_S, period_ns_from_hz
from sim.frame.shared_picture import SharedPicture
from sim.frame.source import SharedFrames
from sim.physics.vehicle import Vehicle
from sim.scene.scene import Scene

_Offset = Annotated[float, Field(ge=-10.0, le=10.0)]
Position = tuple[_Offset, _Offset, _Offset]  # of a sensor, from the body origin, in B [m]
Angle = Annotated[float, Field(ge=-360.0, le=360.0)]
Attitude = tuple[Angle, Angle, Angle]  # of a sensor: roll, pitch, yaw [deg], as in sim/frame/mount.py


@dataclass(frozen=True)
class Installation:
    """Installation of a sensor in a run."""

    name: str  # also selects the noise stream
    rate_hz: float
    seed: int
    scene: Scene
    step_ns: int  # the physics tick
    frames: SharedFrames | None = None  # the world's geometry, for cameras, LiDARs and radars
    shared: SharedPicture | None = None  # of a camera whose pictures other sensors read, and of those sensors
    shaken_by: Vehicle | None = None  # whose rotors make an IMU vibrate; None: nothing vibrates
    wind_at: Callable[[], Vec3] | None = (
        None  # wind at the vehicle at this tick [m/s, W]; None: the scene's steady wind
    )

    @property
    def period_ns(self) -> int:
        """Nominal time between two samples. Raises ValueError for a rate that is not above 0."""
        return period_ns_from_hz(self.rate_hz)

    def geometry_for(self, what: str) -> SharedFrames:
        """Return `frames`, without which `what` cannot be made. Raises ValueError."""
        if self.frames is None:
            raise ValueError(f"sensor '{self.name}': {what} needs the world's geometry (frames)")
        return self.frames


class InstalledSensor:
    """Base of the sensors: the attributes of a `Sensor`."""

    def __init__(self, installation: Installation, latency_s: float, resolution: Mapping[str, float]) -> None:
        self.name = installation.name
        self.period_ns = installation.period_ns
        self.latency_ns = round(latency_s * NS_PER_S)
        self.resolution = resolution
        self.deviations: Mapping[str, float] = {}  # of the noise of a sample by field, 1 sigma, rounding included


def check_order(low: tuple[str, float], high: tuple[str, float]) -> None:
    """Raise ValueError unless the second of two parameters (name, value) is above the first."""
    if not high[1] > low[1]:
        raise ValueError(f"{high[0]} {high[1]:g} must be above {low[0]} {low[1]:g}")


@dataclass(frozen=True)
class Kind:
    """Kind of sensor: its class and the model of its parameters."""

    sensor: Any  # callable (Installation, parameters) -> Sensor
    parameters: type[StrictModel]
    parts: str | None = None  # name of the parameter that lists the channels of a sample; each is a port
    casts: Callable[[Any], bool] | None = None  # parameters -> whether a sensor without frames casts rays in the scene

    @property
    def sample_type(self) -> type:
        """Type of its samples."""
        kind: type = self.sensor.sample_type
        return kind

    @property
    def needs_frames(self) -> bool:
        """True if its samples are frames; each such sensor needs the world's geometry."""
        return self.sample_type in FRAME_SAMPLES

    @property
    def sweeps(self) -> bool:
        """True if a sample spans the whole time since the one before: its points are measured one after the other."""
        return self.sample_type is PointCloudSample

    def needs_geometry(self, parameters: Any) -> bool:
        """Return True if a sensor with these parameters needs the world's geometry (`Installation.frames`)."""
        return self.needs_frames or (self.casts is not None and self.casts(parameters))


class Sensor(Protocol):
    """Source of samples of the true state.

    The noise of sample `seq` is a function of the seed, the sensor's name and `seq` alone. Sensors that integrate
    (vibration phases, optical flow) also depend on the truths of earlier samples.
    """

    name: str
    sample_type: type
    period_ns: int
    latency_ns: int
    resolution: Mapping[str, float]  # step of the output word by field, in the field's unit

    def sample(self, truth: TruthState, seq: int) -> Sample:
        """Return sample `seq`, captured at `truth.t_ns` and available `latency_ns` later."""
        ...
