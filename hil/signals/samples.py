"""What travels between stages: immutable samples with capture time, arrival time and sequence number.

World frame W is ENU (east, north, up), body frame B is FLU (forward, left, up), SI units. `SAMPLE_FIELDS` states
unit and frame of every field; `tests/unit/test_samples.py` checks that none is missing.

Samples are NamedTuples of plain floats: cheap to make 250 times a second, hashable, and impossible to alias.
"""

from __future__ import annotations

from typing import NamedTuple

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


class ActuatorFrame(NamedTuple):
    """Commands of the flight controller, latched for one tick."""

    tick: int
    t_ns: int
    controls: tuple[float, ...]  # normalised 0..1 for motors, 16 of them, in the autopilot's order
    armed: bool
    mode: int  # MAVLink MAV_MODE bits as received


Sample = ImuSample | MagSample | BaroSample | GpsSample | RangeSample | FlowSample

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
    ActuatorFrame: {
        "tick": ("1", "-"),
        "t_ns": ("ns", "-"),
        "controls": ("1", "rotor"),
        "armed": ("bool", "-"),
        "mode": ("bits", "-"),
    },
}
