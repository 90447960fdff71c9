"""What a companion would get of a flight: frames of IMU, GPS and barometer rows and the newest LiDAR sweep.

The sensors are the bench's own, with their noise, and so is what a frame holds (`hil.companion.offline`).
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from hil.bench_suite.slam_flight import Flight
from hil.bench_suite.slam_village import Village
from hil.companion.offline import OfflineFrames
from hil.signals.time import NS_PER_S
from sim.sensors.catalog import make_sensor

if TYPE_CHECKING:
    from hil_companion.frame import Frame

_FRAME_HZ = 10
_IMU_HZ, _BARO_HZ, _GPS_HZ, _LIDAR_HZ = 250.0, 50.0, 10.0, 10.0


@dataclass(frozen=True)
class Noise:
    """How bad the sensors are."""

    gps_m: float = 1.5
    gps_drift_m: float = 0.0
    range_m: float = 0.015
    lidar: Mapping[str, Any] = field(default_factory=dict)  # parameters of the LiDAR besides
    imu: Mapping[str, Any] = field(default_factory=dict)
    seed: int = 1


def record(place: Village, flight: Flight, noise: Noise) -> list[Frame]:
    """The frames of a flight, without the topic truth."""
    common: dict[str, Any] = {"seed": noise.seed, "scene": place.scene, "step_ns": flight.tick_ns}
    gps = {
        "horizontal_noise_m": noise.gps_m, "vertical_noise_m": 1.5 * noise.gps_m,
        "horizontal_drift_m": noise.gps_drift_m, "vertical_drift_m": 1.5 * noise.gps_drift_m,
        "horizontal_speed_noise_mps": 0.1, "vertical_speed_noise_mps": 0.15, "fix_type": 3,
    }  # fmt: skip
    sensors = {
        "imu": make_sensor("imu", preset="icm20689", rate_hz=_IMU_HZ, overrides=noise.imu, **common),
        "gps": make_sensor("gps", preset="here_plus", rate_hz=_GPS_HZ, overrides=gps, **common),
        "baro": make_sensor("baro", preset="ms5611", rate_hz=_BARO_HZ, **common),
        "lidar": make_sensor(
            "lidar", preset="vlp16", rate_hz=_LIDAR_HZ, frames=place.frames,
            overrides={"range_noise_m": noise.range_m, "mount_m": (0.0, 0.0, 0.12)} | dict(noise.lidar), **common,
        ),
    }  # fmt: skip
    offline = OfflineFrames(sensors, tick_ns=flight.tick_ns, truth=False)
    every = NS_PER_S // _FRAME_HZ
    frames = []
    for truth in flight.truths:
        offline.add(truth)
        if truth.t_ns % every == 0:
            frames.append(offline.take(truth))
    return frames


def without_gps(frames: Sequence[Frame], from_s: float, until_s: float) -> list[Frame]:
    """The same frames with the GPS signal lost for a time, as `sim.sensors.gps` has it: it goes on, without a fix."""
    changed = []
    held: dict[str, float] = {}
    for frame in frames:
        new = copy.copy(frame)
        if "gps" in frame:
            gps = copy.copy(frame["gps"])
            values = {name: list(rows) for name, rows in gps.values.items()}
            for k, t_ns in enumerate(values["t_capture_ns"]):
                place = ("latitude_deg", "longitude_deg", "altitude_m")
                if not from_s <= t_ns * 1e-9 < until_s:
                    held = {name: values[name][k] for name in place}
                    continue
                lost = {"fix_type": 1, "satellites": 0, "v_W": (0.0, 0.0, 0.0)}
                lost |= {"horizontal_accuracy_m": 1000.0, "vertical_accuracy_m": 1000.0}
                for name, value in (lost | (held or dict.fromkeys(place, 0.0))).items():
                    values[name][k] = value
            gps.values = values
            new.samples = {**frame.samples, "gps": gps}
        changed.append(new)
    return changed
