"""Table of the topics of every sample type, with message types and the sample field of each message field.

The world frame is "world" (ENU), the vehicle's "base_link" (FLU), as in ROS REP 103, so values are neither rotated nor
scaled: every double in the file is the double of the sample. If no ROS message has a field for a value (pressure
altitude, GPS accuracy), a small message of this project is written in addition to the standard one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals._kernel import rotate_into_body, sample_columns
from signals.samples import (
    ActuatorFrame,
    AirSample,
    BaroSample,
    DifferentialPressureSample,
    FlowSample,
    FollowedSample,
    GpsSample,
    ImuSample,
    MagSample,
    OdometrySample,
    RangeSample,
    ScalarSample,
    SkySample,
    TruthState,
    VaneSample,
)
from signals.time import NS_PER_S
from sim.physics.battery import BatteryState

Columns = dict[str, NDArray[Any]]

WORLD, MAP = "world", "map"  # common to all vehicles
ODOM, BODY = "odom", "base_link"  # of each vehicle (REP 105)
OWN = ""  # the frame of the sensor itself, named as its port
_NO_FIX, _FIX = -1, 0
_UNKNOWN_RATE = 1e6  # variance of rates that an odometry does not give
_FIX_3D = 3  # MAVLink GPS_FIX_TYPE from which the position counts


@dataclass(frozen=True)
class Topic:
    """One topic of one sample type. `suffix` follows the name of the port.

    `columns` maps a field of the message to a column of the sample, `lengths` a sequence of the message to its column.
    `variances` maps a variance (or the diagonal of a 3 x 3 covariance) to the field of the sample whose noise it has.
    `every_s` decimates the topic to this period (None: every sample).
    """

    suffix: str
    type_name: str
    frame: str
    columns: Mapping[str, str]
    lengths: Mapping[str, str] = field(default_factory=dict)
    values: Mapping[str, Any] = field(default_factory=dict)
    header: str = "header"
    child_frame: str = ""
    every_s: float | None = None
    variances: Mapping[str, str] = field(default_factory=dict)
    needs: str = ""  # a column; where it is empty in the first sample, there is no such topic


_MATRIX = "covariance"  # end of the name of a field with 3 x 3 numbers


def with_variances(topics: Sequence[Topic], deviations: Mapping[str, float]) -> tuple[Topic, ...]:
    """Return topics with the variances of a sensor's noise. `deviations`: by field of the sample, 1 sigma."""

    def values(topic: Topic) -> dict[str, Any]:
        known = {path: deviations[name] ** 2 for path, name in topic.variances.items() if name in deviations}
        return {path: [v, 0, 0, 0, v, 0, 0, 0, v] if path.endswith(_MATRIX) else v for path, v in known.items()}

    return tuple(replace(topic, values={**topic.values, **values(topic)}) for topic in topics)


_UNKNOWN_ORIENTATION = [-1.0] + [0.0] * 8  # REP 145: this IMU estimates no attitude

TRUTH_TOPICS = (
    Topic(
        "truth/pose",
        "geometry_msgs/PoseStamped",
        WORLD,
        {"pose.position": "p_WB", "pose.orientation": "q_WB_xyzw"},
    ),
    Topic("truth/velocity", "geometry_msgs/Vector3Stamped", WORLD, {"vector": "v_WB_W"}),
    Topic("truth/angular_velocity", "geometry_msgs/Vector3Stamped", BODY, {"vector": "w_WB_B"}),
    Topic("truth/acceleration", "geometry_msgs/Vector3Stamped", WORLD, {"vector": "a_WB_W"}),
    Topic("truth/angular_acceleration", "geometry_msgs/Vector3Stamped", BODY, {"vector": "alpha_WB_B"}),
    Topic(
        "truth/rotors",
        "hil_msgs/RotorSpeeds",
        BODY,
        {"speed_radps": "rotor_speed_radps"},
        lengths={"speed_radps": "rotor_speed_radps"},
    ),
    Topic(
        "truth/surfaces",
        "hil_msgs/SurfaceAngles",
        BODY,
        {"angle_rad": "surface_rad"},
        lengths={"angle_rad": "surface_rad"},
        needs="surface_rad",
    ),
    Topic("truth/contact", "hil_msgs/Contact", BODY, {"in_contact": "in_contact"}),
    Topic(
        "tf",
        "tf2_msgs/TFMessage",
        WORLD,
        {"transforms[0].transform.translation": "p_WB", "transforms[0].transform.rotation": "q_WB_xyzw"},
        header="transforms[0].header",
        child_frame=BODY,
        every_s=0.04,
    ),
)

# Sent only while a run flies: a recording has these values in the topics above.
_EXACT = 1e-9  # variance of a truth: filters invert covariances, and 0 means unknown to some
_EXACT_6X6 = [_EXACT if i % 7 == 0 else 0.0 for i in range(36)]
_ODOMETRY = Topic(
    "truth/odometry",
    "nav_msgs/Odometry",
    WORLD,
    {
        "pose.pose.position": "p_WB",
        "pose.pose.orientation": "q_WB_xyzw",
        "twist.twist.linear": "v_WB_B",
        "twist.twist.angular": "w_WB_B",
    },
    values={"pose.covariance": _EXACT_6X6, "twist.covariance": _EXACT_6X6},
    child_frame=BODY,
)


def live_truth_topics(tf: str = WORLD) -> tuple[Topic, ...]:
    """Return the topics of the truth while a run flies. `tf`: the parent of `base_link` there (`Ros2.tf`).

    "world" as in the recording; "map" and "odom": the frame `odom` of REP 105, with `/odom`; "none": no transform.
    """
    if tf == WORLD:
        return (_ODOMETRY, *TRUTH_TOPICS)
    others = tuple(topic for topic in TRUTH_TOPICS if topic.suffix != "tf")
    if tf == "none":
        return (_ODOMETRY, *others)
    (transform,) = (topic for topic in TRUTH_TOPICS if topic.suffix == "tf")
    return (_ODOMETRY, replace(_ODOMETRY, suffix="odom", frame=ODOM), *others, replace(transform, frame=ODOM))


_NAN = float("nan")
_DISCHARGING, _GOOD, _LIPO = 2, 1, 3
BATTERY_TOPIC = Topic(
    "battery",
    "sensor_msgs/BatteryState",
    BODY,
    {"voltage": "voltage_v", "current": "drawn_a", "percentage": "charge", "temperature": "degc"},
    lengths={"cell_voltage": "none", "cell_temperature": "none"},
    values={
        "charge": _NAN,
        "capacity": _NAN,
        "design_capacity": _NAN,
        "power_supply_status": _DISCHARGING,
        "power_supply_health": _GOOD,
        "power_supply_technology": _LIPO,
        "present": True,
    },
    every_s=0.2,
)

_TEMPERATURE = Topic(
    "/temperature",
    "sensor_msgs/Temperature",
    BODY,
    {"temperature": "temperature_degc"},
    variances={"variance": "temperature_degc"},
)

SAMPLE_TOPICS: dict[type, tuple[Topic, ...]] = {
    ImuSample: (
        Topic(
            "",
            "sensor_msgs/Imu",
            BODY,
            {"angular_velocity": "gyro_radps", "linear_acceleration": "accel_mps2"},
            values={"orientation_covariance": _UNKNOWN_ORIENTATION},
            variances={"angular_velocity_covariance": "gyro_radps", "linear_acceleration_covariance": "accel_mps2"},
        ),
        _TEMPERATURE,
    ),
    MagSample: (
        Topic(
            "",
            "sensor_msgs/MagneticField",
            BODY,
            {"magnetic_field": "field_tesla"},
            variances={"magnetic_field_covariance": "field_tesla"},
        ),
    ),
    BaroSample: (
        Topic(
            "",
            "sensor_msgs/FluidPressure",
            BODY,
            {"fluid_pressure": "pressure_pa"},
            variances={"variance": "pressure_pa"},
        ),
        _TEMPERATURE,
        Topic("/altitude", "hil_msgs/PressureAltitude", BODY, {"altitude_m": "pressure_altitude_m"}),
    ),
    GpsSample: (
        Topic(
            "",
            "sensor_msgs/NavSatFix",
            BODY,
            {
                "status.status": "status",
                "latitude": "latitude_deg",
                "longitude": "longitude_deg",
                "altitude": "altitude_m",
                "position_covariance": "position_covariance_m2",
            },
            values={"status.service": 1, "position_covariance_type": 2},
        ),
        Topic("/velocity", "geometry_msgs/Vector3Stamped", WORLD, {"vector": "v_W"}),
        Topic(
            "/quality",
            "hil_msgs/GpsQuality",
            BODY,
            {name: name for name in ("horizontal_accuracy_m", "vertical_accuracy_m", "fix_type", "satellites")},
        ),
    ),
    SkySample: (
        Topic(
            "",
            "hil_msgs/GnssSky",
            BODY,
            {"shift": "shift_W_m"} | {name: name for name in SkySample._fields[3:-1]},
        ),
    ),
    RangeSample: (
        Topic(
            "",
            "hil_msgs/Range",
            BODY,
            {"axis": "axis_B"}
            | {name: name for name in ("distance_m", "min_distance_m", "max_distance_m", "sigma_m", "quality")},
        ),
        Topic(
            "/range",
            "sensor_msgs/Range",
            OWN,  # its x axis is the beam
            {"min_range": "min_distance_m", "max_range": "max_distance_m", "range": "range_m", "variance": "variance"},
            values={"radiation_type": 1},
        ),
    ),
    FollowedSample: (
        Topic("/pose", "geometry_msgs/PoseStamped", WORLD, {"pose.position": "p_WB", "pose.orientation": "q_WB_xyzw"}),
        Topic("/velocity", "geometry_msgs/Vector3Stamped", WORLD, {"vector": "v_WB_W"}),
        Topic("/angular_velocity", "geometry_msgs/Vector3Stamped", BODY, {"vector": "w_WB_B"}),
        Topic("/set_point", "geometry_msgs/Vector3Stamped", WORLD, {"vector": "set_point_W"}),
    ),
    DifferentialPressureSample: (
        Topic(
            "",
            "hil_msgs/DifferentialPressure",
            BODY,
            {"differential_pressure_pa": "differential_pressure_pa"},
        ),
        _TEMPERATURE,
    ),
    VaneSample: (
        Topic("", "hil_msgs/AirVane", BODY, {name: name for name in ("angle_of_attack_rad", "sideslip_rad")}),
    ),
    AirSample: (
        Topic(
            "",
            "hil_msgs/AirData",
            BODY,
            {name: name for name in ("airspeed_mps", "angle_of_attack_rad", "sideslip_rad")},
        ),
    ),
    ScalarSample: (Topic("", "hil_msgs/Scalar", BODY, {"value": "value"}),),
    OdometrySample: (
        Topic(
            "",
            "nav_msgs/Odometry",
            OWN,
            {
                "pose.pose.position": "p_OB",
                "pose.pose.orientation": "q_OB_xyzw",
                "pose.covariance": "pose_covariance",
                "twist.twist.linear": "v_OB_B",
                "twist.covariance": "twist_covariance",
            },
            child_frame=BODY,
        ),
    ),
    FlowSample: (
        Topic(
            "",
            "hil_msgs/OpticalFlow",
            BODY,
            {name: name for name in ("integration_ns", "flow_rad", "gyro_rad", "distance_m", "quality")},
        ),
        _TEMPERATURE,
    ),
}

ACTUATOR_TOPICS = (
    Topic(
        "actuators",
        "hil_msgs/ActuatorControls",
        BODY,
        {"controls": "controls", "armed": "armed", "mode": "mode"},
        lengths={"controls": "controls"},
    ),
)


def columns_of(kind: type, rows: list[Any], later_ns: int = 0) -> Columns:
    """Return samples as columns: one array per field, and the derived columns that the topics above need.

    `later_ns` is added to the derived columns that are times.
    """
    names = kind._fields  # type: ignore[attr-defined]
    columns: Columns = {
        name: np.array([row[i] for row in rows]) if column is None else column
        for i, (name, column) in enumerate(zip(names, sample_columns(rows), strict=True))
    }
    if kind in (TruthState, FollowedSample):  # many rows, which numpy turns faster
        columns["q_WB_xyzw"] = columns["q_WB"][:, [1, 2, 3, 0]]
    else:
        derived = {name: value for (of, name), value in _DERIVED.items() if of is kind}
        columns |= {name: np.array([value(row) for row in rows]) for name, value in derived.items()}
    if kind is TruthState or kind is ActuatorFrame:
        columns["seq"] = columns["tick"]
        columns["stamp_ns"] = columns["available_ns"] = columns["t_ns"] + later_ns
    else:
        columns["stamp_ns"] = columns["t_capture_ns"] + later_ns
        columns["available_ns"] = columns["t_available_ns"] + later_ns
    columns["stamp_s"], columns["stamp_rest_ns"] = np.divmod(columns["stamp_ns"], NS_PER_S)
    return columns


def _covariance_m2(gps: GpsSample) -> tuple[float, ...]:
    h, v = gps.horizontal_accuracy_m, gps.vertical_accuracy_m
    return (h * h, 0.0, 0.0, 0.0, h * h, 0.0, 0.0, 0.0, v * v)


def _diagonal(*variances: float) -> tuple[float, ...]:
    """Return a 6 x 6 covariance with the same variance for three axes each."""
    return tuple(variances[i // 21] if i % 7 == 0 else 0.0 for i in range(36))


def _pose_covariance(odometry: OdometrySample) -> tuple[float, ...]:
    return _diagonal(odometry.position_sigma_m**2, odometry.attitude_sigma_rad**2)


def _twist_covariance(odometry: OdometrySample) -> tuple[float, ...]:
    return _diagonal(odometry.velocity_sigma_mps**2, _UNKNOWN_RATE)


def _xyzw(truth: TruthState | FollowedSample) -> tuple[float, float, float, float]:
    w, x, y, z = truth.q_WB
    return x, y, z, w


# Derived columns of one sample, as plain numbers: by type of sample and column.
_DERIVED: dict[tuple[type, str], Callable[[Any], Any]] = {
    (TruthState, "q_WB_xyzw"): _xyzw,
    (FollowedSample, "q_WB_xyzw"): _xyzw,
    (TruthState, "v_WB_B"): lambda truth: rotate_into_body(truth.q_WB, truth.v_WB_W),
    (GpsSample, "position_covariance_m2"): _covariance_m2,
    (GpsSample, "status"): lambda gps: _FIX if gps.fix_type >= _FIX_3D else _NO_FIX,
    (OdometrySample, "q_OB_xyzw"): lambda odometry: (*odometry.q_OB[1:], odometry.q_OB[0]),
    (OdometrySample, "pose_covariance"): _pose_covariance,
    (OdometrySample, "twist_covariance"): _twist_covariance,
    (RangeSample, "range_m"): lambda sample: sample.distance_m if sample.quality > 0 else math.inf,
    (RangeSample, "variance"): lambda sample: sample.sigma_m * sample.sigma_m,
    (BatteryState, "drawn_a"): lambda battery: -battery.current_a,  # negative while discharging
    (BatteryState, "degc"): lambda battery: _NAN if battery.temperature_degc is None else battery.temperature_degc,
    (BatteryState, "none"): lambda battery: (),  # noqa: ARG005
}


def value_of(kind: type, column: str) -> Callable[[Any], Any]:
    """Return the function that reads one column from one sample of a type."""
    return _DERIVED.get((kind, column)) or attrgetter(column)
