"""Sample types: immutable values with capture time, arrival time and sequence number that flow between stages.

World frame W is ENU (east, north, up), body frame B is FLU (forward, left, up), SI units. Every field is annotated with
its unit and, where it has one, its frame ("B->W": rotates B into W); `SAMPLE_FIELDS` holds them as a table.

Samples are NamedTuples of plain floats: cheap to make 250 times a second, hashable and immutable. Frames
(`ImageSample`, `PointCloudSample`, `RadarSample`) hold numpy arrays instead, which are read-only and shared with no
other sample. Two frames are equal if all their bytes are equal.

To add a sample type, write a NamedTuple that begins with `seq`, `t_capture_ns` and `t_available_ns`, annotate every
field with its unit and frame, and add the type to `Sample` (one with arrays to `FrameSample` and `FRAME_SAMPLES`). A
sensor that delivers an existing type, such as `ScalarSample`, needs no change here (sim/sensors/sensor.py).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, NamedTuple, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from signals.channels import CHANNELS

Vec3 = tuple[float, float, float]
Quat = tuple[float, float, float, float]
Count = Annotated[int, "1"]
Ns = Annotated[int, "ns"]


class TruthState(NamedTuple):
    """True state of the vehicle at one tick. Sensors measure it; autopilots and companions never receive it."""

    tick: Count
    t_ns: Ns
    p_WB: Annotated[Vec3, "m", "W"]  # position of the body origin in W
    q_WB: Annotated[Quat, "1", "B->W"]  # attitude, w-x-y-z, rotates B into W, unit norm, w >= 0 not enforced
    v_WB_W: Annotated[Vec3, "m/s", "W"]  # velocity in W
    w_WB_B: Annotated[Vec3, "rad/s", "B"]  # angular velocity in B
    a_WB_W: Annotated[Vec3, "m/s2", "W"]  # acceleration of the body origin in W, averaged over the step just taken
    alpha_WB_B: Annotated[Vec3, "rad/s2", "B"]  # angular acceleration in B, averaged over the step just taken
    rotor_speed_radps: Annotated[tuple[float, ...], "rad/s", "rotor"]  # one per rotor, >= 0
    in_contact: Annotated[bool, "bool"]  # the vehicle touched something during the step just taken
    surface_rad: Annotated[tuple[float, ...], "rad", "surface"] = ()  # deflection of each control surface


class ImuSample(NamedTuple):
    """Inertial measurement in B (FLU). Accel is specific force: (0, 0, +9.81) at rest, level."""

    seq: Count
    t_capture_ns: Ns
    t_available_ns: Ns
    accel_mps2: Annotated[Vec3, "m/s2", "B"]
    gyro_radps: Annotated[Vec3, "rad/s", "B"]
    temperature_degc: Annotated[float, "degC"]


class MagSample(NamedTuple):
    """Magnetic field in B (FLU)."""

    seq: Count
    t_capture_ns: Ns
    t_available_ns: Ns
    field_tesla: Annotated[Vec3, "T", "B"]


class BaroSample(NamedTuple):
    """Static pressure, and the altitude of the standard atmosphere at this pressure."""

    seq: Count
    t_capture_ns: Ns
    t_available_ns: Ns
    pressure_pa: Annotated[float, "Pa"]
    pressure_altitude_m: Annotated[float, "m", "MSL"]
    temperature_degc: Annotated[float, "degC"]


class GpsSample(NamedTuple):
    """GNSS fix: geodetic position on WGS-84; velocity in east, north, up there (W's at the site)."""

    seq: Count
    t_capture_ns: Ns
    t_available_ns: Ns
    latitude_deg: Annotated[float, "deg", "WGS-84"]
    longitude_deg: Annotated[float, "deg", "WGS-84"]
    altitude_m: Annotated[float, "m", "MSL"]  # above mean sea level
    v_W: Annotated[Vec3, "m/s", "W"]
    horizontal_accuracy_m: Annotated[float, "m", "W"]  # 1 sigma
    vertical_accuracy_m: Annotated[float, "m", "W"]  # 1 sigma
    fix_type: Count  # MAVLink GPS_FIX_TYPE: 3 = 3-D fix
    satellites: Count


class SkySample(NamedTuple):
    """The sky as a GNSS receiver sees it, and the true error of its position by it: no receiver sends it so."""

    seq: Count
    t_capture_ns: Ns
    t_available_ns: Ns
    hdop: Annotated[float, "1"]  # 99.99: no solution, as are vdop and pdop then
    vdop: Annotated[float, "1"]
    pdop: Annotated[float, "1"]
    in_view: Count  # satellites above the elevation mask
    visible: Count  # of these, not behind a solid
    used: Count
    reflected: Count  # of those used, received by a reflection alone
    mean_cn0_dbhz: Annotated[float, "dB-Hz"]  # of those used; 0 without one
    jamming_db: Annotated[float, "dB"]  # greatest J/S of a transmitter for a satellite at the zenith; 0: none is on
    spoofed: Annotated[bool, "bool"]
    shift_W_m: Annotated[Vec3, "m", "W"]  # by reflections or a spoofer


class RangeSample(NamedTuple):
    """Distance along the sensor's axis."""

    seq: Count
    t_capture_ns: Ns
    t_available_ns: Ns
    distance_m: Annotated[float, "m", "B"]  # if `quality` is 0: the value that the device sends without a distance
    min_distance_m: Annotated[float, "m", "B"]
    max_distance_m: Annotated[float, "m", "B"]
    sigma_m: Annotated[float, "m", "B"]  # 1 sigma of the distance
    quality: Count  # 0: no valid distance, 100: best
    axis_B: Annotated[Vec3, "1", "B"]  # unit vector from the sensor; (0, 0, -1): it looks down


class FlowSample(NamedTuple):
    """Optical flow of a camera that looks down (-z of B), integrated since the previous sample.

    The flow is the rotation about x and y of B that alone would move the picture as rotation and translation together
    do: rates (w_x + v_y / d, w_y - v_x / d), d the distance to the ground. Subtracting the integrated gyro leaves the
    translation.
    """

    seq: Count
    t_capture_ns: Ns
    t_available_ns: Ns
    integration_ns: Ns
    flow_rad: Annotated[tuple[float, float], "rad", "B"]
    gyro_rad: Annotated[Vec3, "rad", "B"]  # of the built-in gyro, integrated over the same time
    quality: Count  # 0: no flow, 255: best
    distance_m: Annotated[float, "m", "B"]  # below 0: unknown
    temperature_degc: Annotated[float, "degC"]


class OdometrySample(NamedTuple):
    """Pose and velocity of the body origin that external vision estimates, in a level frame O of its own (z up)."""

    seq: Count
    t_capture_ns: Ns
    t_available_ns: Ns
    p_OB: Annotated[Vec3, "m", "O"]
    q_OB: Annotated[Quat, "1", "B->O"]  # w-x-y-z
    v_OB_B: Annotated[Vec3, "m/s", "B"]
    position_sigma_m: Annotated[float, "m", "O"]  # 1 sigma of each axis, as the estimator states it: without its drift
    attitude_sigma_rad: Annotated[float, "rad", "B"]
    velocity_sigma_mps: Annotated[float, "m/s", "B"]


class ImageSample(NamedTuple):
    """Picture of a camera: one array per channel, rows from the top, (height, width) or (height, width, 3).

    Camera frame C is the optical one: x right, y down, z along the view. Contents of the channels: `CHANNEL_UNITS`.
    """

    seq: Count
    t_capture_ns: Ns  # middle of the exposure of the middle row
    t_available_ns: Ns
    p_WC: Annotated[Vec3, "m", "W"]  # at t_capture
    q_WC: Annotated[Quat, "1", "C->W"]  # rotates C into W
    channels: Annotated[Mapping[str, NDArray[Any]], "CHANNEL_UNITS", "C"]  # read-only


class PointCloudSample(NamedTuple):
    """One sweep of a LiDAR: its returns in order of time. Frame L is the LiDAR's at t_capture."""

    seq: Count
    t_capture_ns: Ns
    t_available_ns: Ns
    p_WL: Annotated[Vec3, "m", "W"]  # at t_capture
    q_WL: Annotated[Quat, "1", "L->W"]  # rotates L into W
    points_L: Annotated[
        NDArray[np.float32], "m", "L"
    ]  # (n, 3): range times the direction of the beam in L at its firing
    range_m: Annotated[NDArray[np.float32], "m", "along the ray"]  # (n,)
    intensity: Annotated[NDArray[np.float32], "1"]  # (n,) 0 to 1
    ring: Annotated[NDArray[Any], "1"]  # (n,) uint8 or uint16: number of the laser
    time_offset_ns: Annotated[NDArray[np.int32], "ns"]  # (n,) of the firing, from t_capture
    segmentation: Annotated[NDArray[np.uint8], "class id"]  # (n,) class of the surface that was hit


class RadarSample(NamedTuple):
    """One frame of an FMCW radar: raw ADC data and the results of processing. Frame R is the radar's at t_capture.

    R has the axes of the body when the radar looks forward: x along the view, y left, z up. Contents of the channels:
    `RADAR_UNITS`.
    """

    seq: Count
    t_capture_ns: Ns  # middle of the frame
    t_available_ns: Ns
    p_WR: Annotated[Vec3, "m", "W"]  # at t_capture
    q_WR: Annotated[Quat, "1", "R->W"]  # rotates R into W
    channels: Annotated[Mapping[str, NDArray[Any]], "RADAR_UNITS", "R"]  # read-only


class FollowedSample(NamedTuple):
    """State of a real vehicle at this instant of its flight, which the simulated one flies again."""

    seq: Count
    t_capture_ns: Ns
    t_available_ns: Ns
    p_WB: Annotated[Vec3, "m", "W"]
    q_WB: Annotated[Quat, "1", "B->W"]
    v_WB_W: Annotated[Vec3, "m/s", "W"]
    w_WB_B: Annotated[Vec3, "rad/s", "B"]  # as measured; NaN without a gyro
    set_point_W: Annotated[Vec3, "m", "W"]  # where it was to be


class DifferentialPressureSample(NamedTuple):
    """Total pressure minus static pressure of a pitot-static tube."""

    seq: Count
    t_capture_ns: Ns
    t_available_ns: Ns
    differential_pressure_pa: Annotated[float, "Pa"]  # below 0: blown on from behind
    temperature_degc: Annotated[float, "degC"]  # of the sensor


class VaneSample(NamedTuple):
    """Angles of the flow that air-data vanes stand at."""

    seq: Count
    t_capture_ns: Ns
    t_available_ns: Ns
    angle_of_attack_rad: Annotated[float, "rad", "B"]  # above 0: the air comes from below
    sideslip_rad: Annotated[float, "rad", "B"]  # above 0: the air comes from the right


class AirSample(NamedTuple):
    """True motion of a vehicle through the air: no sensor measures it so."""

    seq: Count
    t_capture_ns: Ns
    t_available_ns: Ns
    airspeed_mps: Annotated[float, "m/s", "B"]
    angle_of_attack_rad: Annotated[float, "rad", "B"]
    sideslip_rad: Annotated[float, "rad", "B"]  # positive with the flow from the right


class ScalarSample(NamedTuple):
    """Single number of a sensor without a sample type of its own, such as a tachometer or a fuel gauge."""

    seq: Count
    t_capture_ns: Ns
    t_available_ns: Ns
    value: Annotated[float, "the kind's"]  # in the unit that the sensor's parameters state


class ActuatorFrame(NamedTuple):
    """Commands of the flight controller, latched for one tick."""

    tick: Count
    t_ns: Ns
    # 16 of them: those of the rotors, 0..1, then those of the vehicle's forces in order, -1..1 for a control surface.
    controls: Annotated[tuple[float, ...], "1", "rotor"]
    armed: Annotated[bool, "bool"]
    mode: Annotated[int, "bits"]  # MAVLink MAV_MODE bits as received


FrameSample = ImageSample | PointCloudSample | RadarSample
Sample = (
    ImuSample
    | MagSample
    | BaroSample
    | GpsSample
    | SkySample
    | RangeSample
    | FlowSample
    | OdometrySample
    | FollowedSample
    | DifferentialPressureSample
    | VaneSample
    | AirSample
    | ScalarSample
    | FrameSample
)
FRAME_SAMPLES = (ImageSample, PointCloudSample, RadarSample)


def arrays_of(sample: FrameSample) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield name and array of every array of a frame in the order of the digest: fields in order, channels sorted."""
    if isinstance(sample, ImageSample | RadarSample):
        for name in sorted(sample.channels):
            yield name, sample.channels[name]
        return
    for name, value in zip(sample._fields, sample, strict=True):
        if isinstance(value, np.ndarray):
            yield name, value


def same_frame(a: object, b: object) -> bool:
    """Return True if two frames are equal, arrays by their bytes: NaN equals NaN, 0.0 differs from -0.0."""
    if type(a) is not type(b) or not isinstance(a, FRAME_SAMPLES) or not isinstance(b, FRAME_SAMPLES):
        return False
    if tuple(a[:5]) != tuple(b[:5]):
        return False
    left, right = list(arrays_of(a)), list(arrays_of(b))
    return [name for name, _ in left] == [name for name, _ in right] and all(
        x.dtype == y.dtype and x.shape == y.shape and x.tobytes() == y.tobytes()
        for (_, x), (_, y) in zip(left, right, strict=True)
    )


for _frame_type in FRAME_SAMPLES:  # the comparison of tuples fails on arrays
    _frame_type.__eq__ = same_frame  # type: ignore[method-assign]
    _frame_type.__ne__ = lambda a, b: not same_frame(a, b)  # type: ignore[method-assign]

# Unit and frame of a pixel in each channel of an ImageSample.
CHANNEL_UNITS: dict[str, tuple[str, str]] = {name: (c.unit, c.frame) for name, c in CHANNELS.items()}

# Unit and frame of an element in each channel of a RadarSample.
RADAR_UNITS: dict[str, tuple[str, str]] = {
    "raw": ("ADC count", "-"),  # uint16 (receivers, chirps, samples)
    "range_doppler": ("ADC count2", "-"),  # float32 (chirps, samples / 2): rows by speed, zero in the middle
    "points": ("m, m/s, rad, dB", "R"),  # one record per detection
    "tracks": ("m, m/s", "R"),  # one record per track
}


def _units_and_frames(sample_type: Any) -> dict[str, tuple[str, str]]:
    """Return field -> (unit, frame), read from the annotations."""
    fields = {}
    for name, hint in get_type_hints(sample_type, include_extras=True).items():
        unit, *frame = hint.__metadata__
        fields[name] = (unit, frame[0] if frame else "-")
    return fields


# Every type that may flow between stages: field -> (unit, frame); frame "-" if none applies.
SAMPLE_FIELDS: dict[type, dict[str, tuple[str, str]]] = {
    sample_type: _units_and_frames(sample_type) for sample_type in (TruthState, *get_args(Sample), ActuatorFrame)
}
