"""What a companion would get of a flight: frames of IMU, GPS and barometer rows and the newest LiDAR sweep.

The sensors are the bench's own, with their noise, and so is what a frame holds (`hil.companion.bundle`).
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from hil.bench_suite.slam_flight import Flight
from hil.bench_suite.slam_village import Village
from hil.companion.bundle import Collector
from hil.companion.started import use_client
from hil.signals.samples import Sample, TruthState
from hil.signals.time import NS_PER_S
from sim.sensors.catalog import make_sensor
from sim.sensors.sensor import Sensor

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


class _Frames:
    """Frames as a client gets them: sensors sampled along a true motion, released when they are available.

    `add` every tick of `tick_ns`, in order; `take` when a frame is due.
    """

    def __init__(self, sensors: Mapping[str, Sensor], tick_ns: int) -> None:
        self._sensors, self._tick_ns = sensors, tick_ns
        self._topics = tuple(sensors)
        self._collector = Collector(self._topics)
        self._seq = dict.fromkeys(sensors, 0)
        self._waiting: list[tuple[int, str, Sample]] = []
        self._number = 0

    def add(self, truth: TruthState) -> None:
        """Sample what is due; release what has left its sensor."""
        for name, sensor in self._sensors.items():
            period_ns = sensor.period_ns
            if truth.t_ns // period_ns == (truth.t_ns - self._tick_ns) // period_ns:
                continue
            sample = sensor.sample(truth, self._seq[name])
            self._seq[name] += 1
            self._waiting.append((sample.t_available_ns, name, sample))
        due = sorted((w for w in self._waiting if w[0] <= truth.t_ns), key=lambda w: w[:2])
        if due:
            self._waiting = [w for w in self._waiting if w[0] > truth.t_ns]
            self._collector.add([(name, sample) for _, name, sample in due])

    def take(self, truth: TruthState) -> Frame:
        """What came since the frame before, as the client's library makes it of what comes over the wire."""
        use_client()
        from hil_companion.frame import Frame as ClientFrame
        from hil_companion.frame import Sample as ClientSample

        bundle = self._collector.take(self._number, truth)
        self._number += 1
        samples = {
            s.topic: ClientSample(s.topic, s.seq, s.t_capture_ns, s.t_available_ns, dict(s.values), dict(s.arrays))
            for s in bundle.frame(self._topics).samples
        }
        header = {"frame": bundle.number, "tick": bundle.tick, "t_ns": bundle.t_ns, "t_sent_ns": 0, "dropped": 0}
        return ClientFrame(header, samples, in_ring=False, t_received_ns=0)


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
    offline = _Frames(sensors, flight.tick_ns)
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
