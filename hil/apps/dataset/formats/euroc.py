"""The ASL layout of the EuRoC data set: mav0/SENSOR/{sensor.yaml, data.csv, data/<t_ns>.ENDING}.

    imu0                          t, angular rate, specific force, in the sensor's frame S
    cam0, depth0, ...             t, name of the file in data/
    state_groundtruth_estimate0   t, p_RS_R, q_RS (w-x-y-z), v_RS_R, gyro bias, accelerometer bias
    gps0                          t, geodetic position, velocity, accuracies and fix (not part of EuRoC)

R is the world (east, north, up). In the ground truth S is the body (forward, left, up; origin at the centre of mass),
elsewhere S is the sensor; T_BS maps points from S to the body. As in EuRoC, a CSV's first line names its columns, times
are whole nanoseconds and quaternions begin with w. Numbers have enough digits to read back the same value.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

from signals.errors import RecordingError
from signals.samples import Vec3
from sim.frame.calibration_text import euroc_yaml
from sim.frame.camera_model import CameraModel

ROOT = "mav0"
IDENTITY = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)

_XYZ = "xyz"


def _columns(name: str, unit: str, axes: str = _XYZ) -> list[str]:
    return [f"{name}_{axis} [{unit}]" for axis in axes]


_T = "#timestamp [ns]"
FILE_HEADER = f"{_T},filename"
IMU_HEADER = ",".join([_T, *_columns("w_RS_S", "rad s^-1"), *_columns("a_RS_S", "m s^-2")])
TRUTH_HEADER = ",".join(
    [
        "#timestamp",
        *_columns("p_RS_R", "m"),
        *_columns("q_RS", "", "wxyz"),
        *_columns("v_RS_R", "m s^-1"),
        *_columns("b_w_RS_S", "rad s^-1"),
        *_columns("b_a_RS_S", "m s^-2"),
    ]
)
GPS_HEADER = ",".join(
    [
        _T,
        *("latitude [deg]", "longitude [deg]", "altitude [m]", *_columns("v_RS_R", "m s^-1")),
        *("horizontal_accuracy [m]", "vertical_accuracy [m]", "fix_type []", "satellites []"),
    ]
)
_NO_BIAS: Vec3 = (0.0, 0.0, 0.0)


# Columns of a table after the time: names in `columns_of` (recorder/mcap/topics.py), or constant values.
TableColumns = tuple[str | tuple[float, ...], ...]

IMU_COLUMNS: TableColumns = ("gyro_radps", "accel_mps2")
TRUTH_COLUMNS: TableColumns = ("p_WB", "q_WB", "v_WB_W", _NO_BIAS, _NO_BIAS)
GPS_COLUMNS: TableColumns = (
    *("latitude_deg", "longitude_deg", "altitude_m", "v_W"),
    *("horizontal_accuracy_m", "vertical_accuracy_m", "fix_type", "satellites"),
)


def sensor_yaml(
    sensor_type: str, *, comment: str, T_BS: Sequence[float], rate_hz: float, more: Mapping[str, object] | None = None
) -> str:
    """Return the sensor.yaml of a sensor without pictures (see `picture_yaml`).

    `T_BS` is the 4 x 4 transform from sensor to body, row by row; `more` holds further keys, such as noise densities.
    Raises RecordingError if T_BS has another size.
    """
    if len(T_BS) != 16:
        raise RecordingError(f"{sensor_type}: T_BS has 16 numbers, row by row, not {len(T_BS)}")
    return "\n".join(
        [
            f"sensor_type: {sensor_type}",
            f"comment: {json.dumps(comment)}",
            "T_BS:",
            "  cols: 4",
            "  rows: 4",
            f"  data: [{', '.join(repr(float(x)) for x in T_BS)}]",
            f"rate_hz: {float(rate_hz)!r}",
            *(f"{key}: {_value(value)}" for key, value in (more or {}).items()),
            "",
        ]
    )


def picture_yaml(
    camera: CameraModel,
    sensor_type: str = "camera",
    *,
    comment: str,
    T_BS: Sequence[float],
    rate_hz: float,
    more: Mapping[str, object] | None = None,
) -> str:
    """Return the sensor.yaml of a camera, or of another channel of the same lens, such as depth.

    `T_BS` is the 4 x 4 transform from camera to body, row by row; `more` holds further keys, such as the depth step.
    """
    text = euroc_yaml(camera, rate_hz=rate_hz, T_BS=T_BS, comment=json.dumps(comment))
    text = text.replace("sensor_type: camera\n", f"sensor_type: {sensor_type}\n", 1)
    return text + "".join(f"{key}: {_value(value)}\n" for key, value in (more or {}).items())


def _value(value: object) -> str:
    """Return a YAML value. JSON is valid YAML, except for numbers such as 1e-05: YAML 1.1 requires a point in them."""
    if isinstance(value, float):
        text = repr(value)
        return text.replace("e", ".0e") if "e" in text and "." not in text else text
    return json.dumps(value)
