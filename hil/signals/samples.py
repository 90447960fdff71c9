"""What travels between stages: immutable samples with capture time, arrival time and sequence number.

World frame W is ENU (east, north, up), body frame B is FLU (forward, left, up), SI units. `SAMPLE_FIELDS` states
unit and frame of every field; `tests/unit/test_samples.py` checks that none is missing.

Samples are NamedTuples of plain floats: cheap to make 250 times a second, hashable, and impossible to alias. Frames
(`ImageSample`, `PointCloudSample`, `RadarSample`) carry numpy arrays instead: each sample owns its arrays, shares them
with no other and gives them out read-only. Two frames are equal if all their bytes are.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Vec3 = tuple[float, float, float]
Quat = tuple[float, float, float, float]


class TruthState(NamedTuple):
    """State of the vehicle at one tick, without error. Only the recorder and reports may look at it."""

    tick: int
    t_ns: int
    p_WB: Vec3  # position of the body origin in W [m]
    q_WB: Quat  # attitude, w-x-y-z, rotates B into W, unit norm, w >= 0 not enforced
    v_WB_W: Vec3  # velocity in W [m/s]
    w_WB_B: Vec3  # angular velocity in B [rad/s]
    a_WB_W: Vec3  # acceleration of the body origin in W [m/s2], averaged over the step just taken
    alpha_WB_B: Vec3  # angular acceleration in B [rad/s2], averaged over the step just taken
    rotor_speed_radps: tuple[float, ...]  # one per rotor, >= 0
    in_contact: bool  # something touched during the step just taken


class ImuSample(NamedTuple):
    """Inertial measurement in B (FLU). Accel is specific force: (0, 0, +9.81) at rest, level."""

    seq: int
    t_capture_ns: int
    t_available_ns: int
    accel_mps2: Vec3
    gyro_radps: Vec3
    temperature_degc: float


class MagSample(NamedTuple):
    """Magnetic field in B (FLU)."""

    seq: int
    t_capture_ns: int
    t_available_ns: int
    field_tesla: Vec3


class BaroSample(NamedTuple):
    """Static pressure; the altitude is that of the standard atmosphere at this pressure."""

    seq: int
    t_capture_ns: int
    t_available_ns: int
    pressure_pa: float
    pressure_altitude_m: float
    temperature_degc: float


class GpsSample(NamedTuple):
    """GNSS fix: geodetic position on WGS-84, velocity in W (ENU)."""

    seq: int
    t_capture_ns: int
    t_available_ns: int
    latitude_deg: float
    longitude_deg: float
    altitude_m: float  # above mean sea level
    v_W: Vec3  # [m/s]
    horizontal_accuracy_m: float  # 1 sigma
    vertical_accuracy_m: float  # 1 sigma
    fix_type: int  # MAVLink GPS_FIX_TYPE: 3 = 3-D fix
    satellites: int


class RangeSample(NamedTuple):
    """Distance along the sensor's axis, which points down (-z of B)."""

    seq: int
    t_capture_ns: int
    t_available_ns: int
    distance_m: float  # where `quality` is 0: what the device sends when it has no distance
    min_distance_m: float
    max_distance_m: float
    sigma_m: float  # 1 sigma of the distance
    quality: int  # 0: no valid distance, 100: best


class FlowSample(NamedTuple):
    """Optical flow of a camera that looks down (-z of B), integrated since the sample before.

    The flow is the turn about x and y of B that would move the picture in the same way: rates minus translation,
    (w_x + v_y / d, w_y - v_x / d). Subtracting the integrated gyro leaves the translation.
    """

    seq: int
    t_capture_ns: int
    t_available_ns: int
    integration_ns: int
    flow_rad: tuple[float, float]
    gyro_rad: Vec3  # its own gyro, integrated over the same time
    quality: int  # 0: no flow, 255: best
    distance_m: float  # below 0: not known
    temperature_degc: float


class ImageSample(NamedTuple):
    """What a camera saw: one picture per channel, rows from the top, (height, width) or (height, width, 3).

    Camera frame C is the optical one: x right, y down, z along the view. What each channel holds: `CHANNEL_UNITS`.
    """

    seq: int
    t_capture_ns: int  # middle of the exposure, of the middle row
    t_available_ns: int
    p_WC: Vec3  # at t_capture
    q_WC: Quat  # rotates C into W
    channels: Mapping[str, NDArray[Any]]  # read-only

    def __eq__(self, other: object) -> bool:
        return same_frame(self, other)

    def __ne__(self, other: object) -> bool:
        return not same_frame(self, other)


class PointCloudSample(NamedTuple):
    """One sweep of a LiDAR: the returns in the order in which they came. Frame L is the LiDAR's at t_capture."""

    seq: int
    t_capture_ns: int
    t_available_ns: int
    p_WL: Vec3  # at t_capture
    q_WL: Quat  # rotates L into W
    points_L: NDArray[np.float32]  # (n, 3) [m]: range times the direction of its beam in L, each at its own time
    range_m: NDArray[np.float32]  # (n,)
    intensity: NDArray[np.float32]  # (n,) 0 to 1
    ring: NDArray[Any]  # (n,) uint8 or uint16: which laser
    time_offset_ns: NDArray[np.int32]  # (n,) of the firing, from t_capture
    segmentation: NDArray[np.uint8]  # (n,) class of what was hit

    def __eq__(self, other: object) -> bool:
        return same_frame(self, other)

    def __ne__(self, other: object) -> bool:
        return not same_frame(self, other)


class RadarSample(NamedTuple):
    """One frame of an FMCW radar: what its ADC gave, and what was made of it. Frame R is the radar's at t_capture.

    R has the axes of the body when the radar looks forward: x along the view, y left, z up. What each channel holds:
    `RADAR_UNITS`.
    """

    seq: int
    t_capture_ns: int  # middle of the frame
    t_available_ns: int
    p_WR: Vec3  # at t_capture
    q_WR: Quat  # rotates R into W
    channels: Mapping[str, NDArray[Any]]  # read-only

    def __eq__(self, other: object) -> bool:
        return same_frame(self, other)

    def __ne__(self, other: object) -> bool:
        return not same_frame(self, other)


class ActuatorFrame(NamedTuple):
    """Commands of the flight controller, latched for one tick."""

    tick: int
    t_ns: int
    controls: tuple[float, ...]  # normalised 0..1 for motors, 16 of them, in the autopilot's order
    armed: bool
    mode: int  # MAVLink MAV_MODE bits as received


FrameSample = ImageSample | PointCloudSample | RadarSample
Sample = ImuSample | MagSample | BaroSample | GpsSample | RangeSample | FlowSample | FrameSample
FRAME_SAMPLES = (ImageSample, PointCloudSample, RadarSample)


def arrays_of(sample: FrameSample) -> Iterator[tuple[str, NDArray[Any]]]:
    """Every array of a frame by name, in the order that its digest has: that of the fields, channels sorted."""
    if isinstance(sample, ImageSample | RadarSample):
        for name in sorted(sample.channels):
            yield name, sample.channels[name]
        return
    for name, value in zip(sample._fields, sample, strict=True):
        if isinstance(value, np.ndarray):
            yield name, value


def same_frame(a: object, b: object) -> bool:
    """Whether two frames are equal, arrays by their bytes: a NaN equals the same NaN, and 0.0 is not -0.0."""
    if type(a) is not type(b) or not isinstance(a, FRAME_SAMPLES) or not isinstance(b, FRAME_SAMPLES):
        return False
    if tuple(a[:5]) != tuple(b[:5]):
        return False
    left, right = list(arrays_of(a)), list(arrays_of(b))
    return [name for name, _ in left] == [name for name, _ in right] and all(
        x.dtype == y.dtype and x.shape == y.shape and x.tobytes() == y.tobytes()
        for (_, x), (_, y) in zip(left, right, strict=True)
    )


# Channels of an ImageSample: unit and frame of what a pixel holds.
CHANNEL_UNITS: dict[str, tuple[str, str]] = {
    "rgb": ("sRGB, 0 to 255", "-"),
    "depth": ("m", "z of C"),  # inf: nothing there
    "range": ("m", "along the ray"),  # inf: nothing there
    "segmentation": ("class id", "-"),  # 0: none
    "instance": ("instance id", "-"),  # 0: nothing
    "geom": ("geom id", "-"),  # -1: nothing
    "normal": ("1", "C"),  # unit vector, towards the camera
    "radial_velocity": ("m/s", "along the ray"),  # positive: going away
    "material": ("surface id", "-"),
}

# Channels of a RadarSample: unit and frame of what an element holds.
RADAR_UNITS: dict[str, tuple[str, str]] = {
    "raw": ("ADC count", "-"),  # uint16 (receivers, chirps, samples)
    "range_doppler": ("ADC count2", "-"),  # float32 (chirps, samples / 2): rows by speed, zero in the middle
    "points": ("m, m/s, rad, dB", "R"),  # one record a detection
    "tracks": ("m, m/s", "R"),  # one record a track
}

# field -> (unit, frame). Frame "-" where none applies.
_STAMP = {"seq": ("1", "-"), "t_capture_ns": ("ns", "-"), "t_available_ns": ("ns", "-")}
SAMPLE_FIELDS: dict[type, dict[str, tuple[str, str]]] = {
    TruthState: {
        "tick": ("1", "-"),
        "t_ns": ("ns", "-"),
        "p_WB": ("m", "W"),
        "q_WB": ("1", "B->W"),
        "v_WB_W": ("m/s", "W"),
        "w_WB_B": ("rad/s", "B"),
        "a_WB_W": ("m/s2", "W"),
        "alpha_WB_B": ("rad/s2", "B"),
        "rotor_speed_radps": ("rad/s", "rotor"),
        "in_contact": ("bool", "-"),
    },
    ImuSample: _STAMP | {"accel_mps2": ("m/s2", "B"), "gyro_radps": ("rad/s", "B"), "temperature_degc": ("degC", "-")},
    MagSample: _STAMP | {"field_tesla": ("T", "B")},
    BaroSample: _STAMP
    | {"pressure_pa": ("Pa", "-"), "pressure_altitude_m": ("m", "MSL"), "temperature_degc": ("degC", "-")},
    GpsSample: _STAMP
    | {
        "latitude_deg": ("deg", "WGS-84"),
        "longitude_deg": ("deg", "WGS-84"),
        "altitude_m": ("m", "MSL"),
        "v_W": ("m/s", "W"),
        "horizontal_accuracy_m": ("m", "W"),
        "vertical_accuracy_m": ("m", "W"),
        "fix_type": ("1", "-"),
        "satellites": ("1", "-"),
    },
    RangeSample: _STAMP
    | {
        "distance_m": ("m", "B"),
        "min_distance_m": ("m", "B"),
        "max_distance_m": ("m", "B"),
        "sigma_m": ("m", "B"),
        "quality": ("1", "-"),
    },
    FlowSample: _STAMP
    | {
        "integration_ns": ("ns", "-"),
        "flow_rad": ("rad", "B"),
        "gyro_rad": ("rad", "B"),
        "quality": ("1", "-"),
        "distance_m": ("m", "B"),
        "temperature_degc": ("degC", "-"),
    },
    ImageSample: _STAMP | {"p_WC": ("m", "W"), "q_WC": ("1", "C->W"), "channels": ("CHANNEL_UNITS", "C")},
    PointCloudSample: _STAMP
    | {
        "p_WL": ("m", "W"),
        "q_WL": ("1", "L->W"),
        "points_L": ("m", "L"),
        "range_m": ("m", "along the ray"),
        "intensity": ("1", "-"),
        "ring": ("1", "-"),
        "time_offset_ns": ("ns", "-"),
        "segmentation": ("class id", "-"),
    },
    RadarSample: _STAMP | {"p_WR": ("m", "W"), "q_WR": ("1", "R->W"), "channels": ("RADAR_UNITS", "R")},
    ActuatorFrame: {
        "tick": ("1", "-"),
        "t_ns": ("ns", "-"),
        "controls": ("1", "rotor"),
        "armed": ("bool", "-"),
        "mode": ("bits", "-"),
    },
}
