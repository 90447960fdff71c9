"""Table of the topics of every sample type, with message types and the sample field of each message field.

The world frame is "world" (ENU), the vehicle's "base_link" (FLU), as in ROS REP 103, so values are neither rotated nor
scaled: every double in the file is the double of the sample. If no ROS message has a field for a value (pressure
altitude, GPS accuracy), a small message of this project is written in addition to the standard one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signals.samples import (
    ActuatorFrame,
    BaroSample,
    FlowSample,
    GpsSample,
    ImuSample,
    MagSample,
    RangeSample,
    ScalarSample,
    TruthState,
)
from signals.time import NS_PER_S

Columns = dict[str, NDArray[Any]]

WORLD = "world"
BODY = "base_link"
_NO_FIX, _FIX = -1, 0
_FIX_3D = 3  # MAVLink GPS_FIX_TYPE from which the position counts


@dataclass(frozen=True)
class Topic:
    """One topic of one sample type. `suffix` follows the name of the port.

    `columns` maps a field of the message to a column of the sample, `lengths` a sequence of the message to its column.
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

SAMPLE_TOPICS: dict[type, tuple[Topic, ...]] = {
    ImuSample: (
        Topic(
            "",
            "sensor_msgs/Imu",
            BODY,
            {"angular_velocity": "gyro_radps", "linear_acceleration": "accel_mps2"},
            values={"orientation_covariance": _UNKNOWN_ORIENTATION},
        ),
        Topic("/temperature", "sensor_msgs/Temperature", BODY, {"temperature": "temperature_degc"}),
    ),
    MagSample: (Topic("", "sensor_msgs/MagneticField", BODY, {"magnetic_field": "field_tesla"}),),
    BaroSample: (
        Topic("", "sensor_msgs/FluidPressure", BODY, {"fluid_pressure": "pressure_pa"}),
        Topic("/temperature", "sensor_msgs/Temperature", BODY, {"temperature": "temperature_degc"}),
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
    RangeSample: (
        Topic(
            "",
            "hil_msgs/Range",
            BODY,
            {name: name for name in ("distance_m", "min_distance_m", "max_distance_m", "sigma_m", "quality")},
        ),
    ),
    ScalarSample: (Topic("", "hil_msgs/Scalar", BODY, {"value": "value"}),),
    FlowSample: (
        Topic(
            "",
            "hil_msgs/OpticalFlow",
            BODY,
            {name: name for name in ("integration_ns", "flow_rad", "gyro_rad", "distance_m", "quality")},
        ),
        Topic("/temperature", "sensor_msgs/Temperature", BODY, {"temperature": "temperature_degc"}),
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
    columns: Columns = {name: np.array(values) for name, values in zip(names, zip(*rows, strict=True), strict=True)}
    if kind is TruthState:
        columns["q_WB_xyzw"] = columns["q_WB"][:, [1, 2, 3, 0]]
    elif kind is GpsSample:
        covariance = np.zeros((len(rows), 9))
        covariance[:, 0] = covariance[:, 4] = np.square(columns["horizontal_accuracy_m"])
        covariance[:, 8] = np.square(columns["vertical_accuracy_m"])
        columns["position_covariance_m2"] = covariance
        columns["status"] = np.where(columns["fix_type"] >= _FIX_3D, _FIX, _NO_FIX)
    if kind is TruthState or kind is ActuatorFrame:
        columns["seq"] = columns["tick"]
        columns["stamp_ns"] = columns["available_ns"] = columns["t_ns"] + later_ns
    else:
        columns["stamp_ns"] = columns["t_capture_ns"] + later_ns
        columns["available_ns"] = columns["t_available_ns"] + later_ns
    columns["stamp_s"], columns["stamp_rest_ns"] = np.divmod(columns["stamp_ns"], NS_PER_S)
    return columns
