"""What a companion would get of a flight: frames of IMU, GPS and barometer rows and the newest LiDAR sweep.

The sensors are the bench's own, with their noise; a frame holds what had left its sensor since the frame before, as
`hil.companion.bundle` has it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from hil.bench_suite.slam_flight import Flight
from hil.bench_suite.slam_village import Village
from hil.signals.samples import PointCloudSample
from hil.signals.time import NS_PER_S
from sim.sensors.catalog import make_sensor

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


@dataclass
class RecordedSample:
    """One topic of a frame."""

    topic: str
    seq: int
    t_capture_ns: int
    t_available_ns: int
    values: dict[str, Any]
    arrays: dict[str, Any]

    def __getitem__(self, name: str) -> Any:
        return self.arrays[name] if name in self.arrays else self.values[name]

    def __contains__(self, name: object) -> bool:
        return name in self.arrays or name in self.values


class RecordedFrame(dict[str, RecordedSample]):
    """Samples by topic, at a time."""

    def __init__(self, t_ns: int) -> None:
        super().__init__()
        self.t_ns = t_ns


def record(place: Village, flight: Flight, noise: Noise) -> list[RecordedFrame]:
    """The frames of a flight. Poses of the sweeps are left out: nobody may look at them."""
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
    waiting: dict[str, list[Any]] = {name: [] for name in sensors}
    frames = []
    every = NS_PER_S // _FRAME_HZ
    seq = dict.fromkeys(sensors, 0)
    for truth in flight.truths:
        for name, sensor in sensors.items():
            if truth.t_ns % sensor.period_ns == 0:
                waiting[name].append(sensor.sample(truth, seq[name]))
                seq[name] += 1
        if truth.t_ns % every == 0:
            frame = RecordedFrame(truth.t_ns)
            for name, samples in waiting.items():
                there = [s for s in samples if s.t_available_ns <= truth.t_ns]
                if there:
                    frame[name] = _stacked(name, there)
                    waiting[name] = samples[len(there) :]
            frames.append(frame)
    return frames


def _stacked(name: str, samples: list[Any]) -> RecordedSample:
    last = samples[-1]
    stamps = (name, last.seq, last.t_capture_ns, last.t_available_ns)
    if isinstance(last, PointCloudSample):
        arrays = {k: getattr(last, k) for k in ("points_L", "range_m", "intensity", "ring", "time_offset_ns")}
        return RecordedSample(*stamps, {}, arrays)
    return RecordedSample(*stamps, {k: [getattr(s, k) for s in samples] for k in last._fields}, {})


def without_gps(frames: Sequence[RecordedFrame], from_s: float, until_s: float) -> list[RecordedFrame]:
    """The same frames with the GPS signal lost for a time, as `sim.sensors.gps` has it: it goes on, without a fix."""
    changed = []
    held: dict[str, float] = {}
    for frame in frames:
        new = RecordedFrame(frame.t_ns)
        new.update(frame)
        if "gps" in frame:
            gps = frame["gps"]
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
            new["gps"] = RecordedSample("gps", gps.seq, gps.t_capture_ns, gps.t_available_ns, values, {})
        changed.append(new)
    return changed
