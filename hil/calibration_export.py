"""Calibration of a run's cameras as files of other programs, in the run's folder `calibration/`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hil.signals.errors import RecordingError
from hil.signals.rotation import matrix_of
from hil.signals.samples import Quat, Vec3
from sim.frame.calibration_text import camera_info_yaml, euroc_yaml, opencv_yaml
from sim.frame.camera_model import CameraModel

FOLDER = "calibration"


def write_calibration(out: Path, name: str, sensor: Any, *, rate_hz: float) -> list[Path]:
    """Write NAME.camera_info.yaml (ROS), NAME.opencv.yaml and NAME.sensor.yaml (EuRoC); nothing for other sensors.

    Raises RecordingError where a file cannot be written.
    """
    camera = getattr(sensor, "model", None)
    if not isinstance(camera, CameraModel):
        return []
    T_BS = transform(sensor.mount.p_BC, sensor.mount.q_BC)
    texts = {
        f"{name}.camera_info.yaml": camera_info_yaml(camera, name),
        f"{name}.opencv.yaml": opencv_yaml(camera),
        f"{name}.sensor.yaml": euroc_yaml(camera, rate_hz=rate_hz, T_BS=T_BS),
    }
    folder = out / FOLDER
    try:
        folder.mkdir(exist_ok=True)
        for file, text in texts.items():
            (folder / file).write_text(text, encoding="utf-8")
    except OSError as error:
        raise RecordingError(f"{folder}: the calibration cannot be written ({error.strerror or error})") from error
    return [folder / file for file in texts]


def transform(p: Vec3, q: Quat) -> Sequence[float]:
    """4 x 4, row by row."""
    R = matrix_of(q)
    return (*R[0:3], p[0], *R[3:6], p[1], *R[6:9], p[2], 0.0, 0.0, 0.0, 1.0)
