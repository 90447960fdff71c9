"""Calibration files of a camera for other programs: ROS camera_info, OpenCV FileStorage, EuRoC sensor.yaml.

All three formats put pixel centres at whole numbers, so cx and cy are half a pixel less than in `CameraModel`.
"""

from __future__ import annotations

from collections.abc import Sequence

from sim.frame.camera_model import CameraModel
from sim.frame.distortion import KannalaBrandt

_IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def distortion_name(camera: CameraModel) -> str:
    """Return the name of the distortion model in sensor_msgs/CameraInfo; without distortion: plumb_bob, with zeros."""
    return "plumb_bob" if camera.distortion is None else camera.distortion.ros_name


def coefficients(camera: CameraModel) -> tuple[float, ...]:
    """Return the distortion coefficients in the order of sensor_msgs/CameraInfo."""
    return (0.0,) * 5 if camera.distortion is None else camera.distortion.coefficients


def projection_matrix(camera: CameraModel) -> tuple[float, ...]:
    """Return P of sensor_msgs/CameraInfo, 3 x 4: the rectified picture keeps the camera's focal lengths."""
    k = camera.opencv_matrix
    return (*k[0:3], 0.0, *k[3:6], 0.0, *k[6:9], 0.0)


def camera_info_yaml(camera: CameraModel, name: str) -> str:
    """Return the file that ROS's camera_info_manager and camera_calibration_parsers load."""
    d = coefficients(camera)
    return "\n".join(
        [
            f"image_width: {camera.width}",
            f"image_height: {camera.height}",
            f"camera_name: {name}",
            *_matrix("camera_matrix", 3, 3, camera.opencv_matrix),
            f"distortion_model: {distortion_name(camera)}",
            *_matrix("distortion_coefficients", 1, len(d), d),
            *_matrix("rectification_matrix", 3, 3, _IDENTITY),
            *_matrix("projection_matrix", 3, 4, projection_matrix(camera)),
            "",
        ]
    )


def opencv_yaml(camera: CameraModel) -> str:
    """Return the file that cv2.FileStorage reads, with the names of OpenCV's calibration sample."""
    d = coefficients(camera)
    return "\n".join(
        [
            "%YAML:1.0",
            "---",
            f"image_width: {camera.width}",
            f"image_height: {camera.height}",
            f"fisheye_model: {int(isinstance(camera.distortion, KannalaBrandt))}",
            *_opencv_matrix("camera_matrix", 3, 3, camera.opencv_matrix),
            *_opencv_matrix("distortion_coefficients", len(d), 1, d),
            "",
        ]
    )


def euroc_yaml(camera: CameraModel, *, rate_hz: float, T_BS: Sequence[float], comment: str = "") -> str:
    """Return sensor.yaml of an ASL (EuRoC) data set. `T_BS`: 4 x 4, camera to body, row by row.

    EuRoC has two distortion models; this bench adds ROS's rational_polynomial as a third.
    """
    k, d = camera.opencv_matrix, coefficients(camera)
    names = {"plumb_bob": "radial-tangential", "equidistant": "equidistant"}
    kept = d[:4] if distortion_name(camera) == "plumb_bob" and not any(d[4:]) else d
    return "\n".join(
        [
            "sensor_type: camera",
            f"comment: {comment or 'simulated camera'}",
            "T_BS:",
            "  cols: 4",
            "  rows: 4",
            f"  data: {_list(T_BS)}",
            f"rate_hz: {rate_hz!r}",
            f"resolution: [{camera.width}, {camera.height}]",
            "camera_model: pinhole",
            f"intrinsics: {_list((k[0], k[4], k[2], k[5]))} # fu, fv, cu, cv",
            f"distortion_model: {names.get(distortion_name(camera), distortion_name(camera))}",
            f"distortion_coefficients: {_list(kept)}",
            "",
        ]
    )


def _list(values: Sequence[float]) -> str:
    """Return the shortest text that reads back to the same doubles."""
    return "[" + ", ".join(repr(float(v)) for v in values) + "]"


def _matrix(name: str, rows: int, columns: int, values: Sequence[float]) -> list[str]:
    return [f"{name}:", f"  rows: {rows}", f"  cols: {columns}", f"  data: {_list(values)}"]


def _opencv_matrix(name: str, rows: int, columns: int, values: Sequence[float]) -> list[str]:
    head = [f"{name}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {columns}", "   dt: d"]
    return [*head, f"   data: {_list(values)}"]
