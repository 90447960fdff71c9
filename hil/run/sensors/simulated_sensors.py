"""Makes the simulated sensors of a bench; a camera shares its pictures with the radars that read them.

Also writes the calibrations of the cameras, in the formats of other programs, into the run's folder `calibration/`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hil.config import Bench, SensorConfig
from hil.config.sensors.radar_checks import radars, view_of
from signals.errors import file_errors
from signals.rotation import matrix_of
from signals.samples import Quat, Vec3
from signals.time import is_due
from sim.frame.calibration_text import camera_info_yaml, euroc_yaml, opencv_yaml
from sim.frame.camera_model import CameraModel
from sim.frame.source import SharedFrames
from sim.sensors.catalog import make_sensor
from sim.sensors.radar import Radar
from sim.sensors.sensor import Installation

CALIBRATION_FOLDER = "calibration"


class SimulatedSensors:
    """Makes sensors of one bench that share one source of frames."""

    def __init__(
        self,
        bench: Bench,
        names: Collection[str],
        frames: SharedFrames | None,
        *,
        wind_at: Callable[[], Vec3] | None = None,
    ) -> None:
        """`names`: sensors that will be made. `frames`: the world's geometry, None if none of them needs it.

        `wind_at` returns the wind at the vehicle [m/s, W]; None: it is the scene's steady wind.
        """
        self._bench, self._frames, self._wind_at = bench, frames, wind_at
        sensors = bench.config.sensors
        wanted = {name: sensors[name] for name in sensors if name in names}
        cameras = {p.frame for p in radars(wanted).values() if p.frame is not None}
        self._shared = {name: view_of(sensors[name]) for name in sorted(cameras)}

    def make(
        self, name: str, parts: Mapping[str, Any] | None = None, *, labelled: NDArray[np.bool_] | None = None
    ) -> Any:
        """Return the sensor of that name. `parts`: parameters that replace the bench's own, such as fewer channels.

        With `labelled`, (65536,) True for the instances to find, a radar also finds the objects of its frames
        (`Radar.objects`).
        Raises the errors of `sim.sensors.catalog.make_sensor`.
        """
        config = self._bench.config
        settings = config.sensors[name]
        sensor = make_sensor(
            Installation(
                name,
                rate_hz=settings.rate_hz,
                seed=config.noise_seed,
                scene=self._bench.scene,
                step_ns=config.tick_ns,
                frames=self._frames,
                shared=self._shared.get(getattr(settings.parameters, "frame", None) or name),
                shaken_by=self._bench.vehicle if config.vibration == "estimated" else None,
                wind_at=self._wind_at,
            ),
            kind=settings.kind,
            overrides=self._bench.sensor_parameters(name).model_dump() | dict(parts or {}),
        )
        if isinstance(sensor, Radar):
            if labelled is not None:
                sensor.label_objects(labelled)
            sensor.view.add_reader(sensor.channels, partial(is_due, **tick_rates(settings, config.tick_hz)))
        return sensor


def tick_rates(sensor: SensorConfig, tick_hz: int) -> dict[str, int]:
    """Return sensor rate and tick rate [mHz], as arguments of `is_due` and `RateAccumulator`."""
    return {"event_millihz": round(sensor.rate_hz * 1000), "tick_millihz": tick_hz * 1000}


def write_calibration(out: Path, name: str, sensor: Any, *, rate_hz: float) -> list[Path]:
    """Write NAME.camera_info.yaml (ROS), NAME.opencv.yaml and NAME.sensor.yaml (EuRoC) and return their paths.

    For a sensor without a camera model nothing is written. Raises RecordingError if a file cannot be written.
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
    folder = out / CALIBRATION_FOLDER
    with file_errors(folder, "the calibration cannot be written"):
        folder.mkdir(exist_ok=True)
        for file, text in texts.items():
            (folder / file).write_text(text, encoding="utf-8")
    return [folder / file for file in texts]


def transform(p: Vec3, q: Quat) -> Sequence[float]:
    """Return the homogeneous transform of position and rotation, 4 x 4, row by row."""
    R = matrix_of(q)
    return (*R[0:3], p[0], *R[3:6], p[1], *R[6:9], p[2], 0.0, 0.0, 0.0, 1.0)
