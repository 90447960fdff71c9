"""Simulated recordings for `hil bench slam`: generated villages, and a companion's frames of a flight through one.

Frames hold IMU, GPS and barometer rows and the newest LiDAR sweep, as `hil.run.companion.bundle` makes them, sampled by
the bench's own sensors with noise. The true obstacles at a height come from `true_slice`, as in verdicts on
flights to a goal.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hil.config.companion.clients import make_client_importable
from hil.run.companion.bundle import Collector
from hil.run.verdict.true_slice import true_slice
from lab.slam.flight import Flight
from signals.samples import Sample, TruthState
from signals.time import NS_PER_S
from sim.frame.source import SharedFrames
from sim.scene.map_section import GeneratedMap
from sim.scene.scene import Scene, load_scene
from sim.sensors.catalog import make_sensor
from sim.sensors.sensor import Installation, Sensor
from sim.world_loader import load_world

if TYPE_CHECKING:
    from hil_companion.frame import Frame

_FRAME_HZ = 10
_IMU_HZ, _BARO_HZ, _GPS_HZ, _LIDAR_HZ = 250.0, 50.0, 10.0, 10.0
Float64 = NDArray[np.float64]
Mask = NDArray[np.bool_]

AREA_MIN_M, AREA_MAX_M = -40.0, 110.0  # of x and of y
_CELL_M = 0.1
_PATH_CELL_M = 0.5


@dataclass(frozen=True)
class Village:
    """A generated village: scene, World and geometry."""

    scene: Scene
    world: Any
    renderer: SharedFrames


def make_village(seed: int, **parameters: Any) -> Village:
    """Generate a training village; `parameters` are those of the generator, such as `walkers`."""
    scene = load_scene("training_village")
    section = GeneratedMap.model_validate({"generator": "training_village", "seed": seed} | parameters)
    scene = scene.model_copy(update={"map": section})
    world = load_world(scene)
    return Village(scene, world, SharedFrames(world))


def true_surfaces(village: Village, low_m: float, high_m: float) -> Mask:
    """Return True for cells that contain a surface between two heights; rows are y, columns x, from AREA_MIN_M on."""
    area_W = (AREA_MIN_M, AREA_MIN_M, AREA_MAX_M, AREA_MAX_M)
    return true_slice(village.renderer.geometry, low_m=low_m, high_m=high_m, area_W=area_W, cell_m=_CELL_M).occupied


def distance_m(points_xy: Float64, mask: Mask, cell_m: float = _CELL_M) -> Float64:
    """Return the distances [m] of points (n, 2) from the nearest cell of a mask, to half a cell."""
    distances_m = cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * cell_m
    cells = np.clip(((points_xy - AREA_MIN_M) / cell_m).astype(int), 0, len(mask) - 1)
    return np.asarray(distances_m[cells[:, 1], cells[:, 0]], float)


def path_through(blocked: Mask, start: tuple[float, float], goal: tuple[float, float], clear_m: float) -> Float64:
    """Return a path (n, 2) [m] at least `clear_m` away from blocked cells, and farther where the detour is small.

    Raises ValueError if there is none.
    """
    make_client_importable()
    from hil_companion.explore.planning.astar import search

    skip = round(_PATH_CELL_M / _CELL_M)
    distances_m = cv2.distanceTransform((~blocked).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * _CELL_M
    coarse_m = distances_m[skip // 2 :: skip, skip // 2 :: skip]
    cost = np.where(coarse_m < clear_m, np.inf, 1.0 + 4.0 * np.clip((clear_m + 3.0 - coarse_m) / 3.0, 0.0, 1.0) ** 2)
    begin, end = (
        (int((y - AREA_MIN_M) / _PATH_CELL_M), int((x - AREA_MIN_M) / _PATH_CELL_M)) for x, y in (start, goal)
    )
    result = search(cost, begin, end)
    if result is None:
        raise ValueError(f"no path from {start} to {goal} keeps a distance of {clear_m} m")
    cells = np.array(result[0], float)[:, ::-1]
    xy = AREA_MIN_M + (cells + 0.5) * _PATH_CELL_M
    xy[0], xy[-1] = start, goal
    return np.asarray(xy)


@dataclass(frozen=True)
class Noise:
    """Errors of the sensors; `lidar` and `imu` hold further parameters of these sensors."""

    gps_m: float = 1.5
    gps_drift_m: float = 0.0
    range_m: float = 0.015
    lidar: Mapping[str, Any] = field(default_factory=dict)
    imu: Mapping[str, Any] = field(default_factory=dict)
    seed: int = 1


class _FrameCollector:
    """Frames as a client receives them: sensors sample the true states, and samples are released when available.

    Call `add` at every tick of `tick_ns`, in order, and `take` when a frame is due.
    """

    def __init__(self, sensors: Mapping[str, Sensor], tick_ns: int) -> None:
        self._sensors, self._tick_ns = sensors, tick_ns
        self._topics = tuple(sensors)
        self._collector = Collector(self._topics)
        self._seq = dict.fromkeys(sensors, 0)
        self._waiting: list[tuple[int, str, Sample]] = []
        self._number = 0

    def add(self, truth: TruthState) -> None:
        """Take the due samples and release those that are available now."""
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
        """Return the samples released since the last frame, as the client's library decodes them."""
        make_client_importable()
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


def record(village: Village, flight: Flight, noise: Noise) -> list[Frame]:
    """Return the frames of a flight, without the topic `truth`."""
    common: dict[str, Any] = {"seed": noise.seed, "scene": village.scene, "step_ns": flight.tick_ns}
    gps = {
        "horizontal_noise_m": noise.gps_m, "vertical_noise_m": 1.5 * noise.gps_m,
        "horizontal_drift_m": noise.gps_drift_m, "vertical_drift_m": 1.5 * noise.gps_drift_m,
        "horizontal_speed_noise_mps": 0.1, "vertical_speed_noise_mps": 0.15, "fix_type": 3,
    }  # fmt: skip
    sensors = {
        "imu": make_sensor(Installation("imu", rate_hz=_IMU_HZ, **common), preset="icm20689", overrides=noise.imu),
        "gps": make_sensor(Installation("gps", rate_hz=_GPS_HZ, **common), preset="here_plus", overrides=gps),
        "baro": make_sensor(Installation("baro", rate_hz=_BARO_HZ, **common), preset="ms5611"),
        "lidar": make_sensor(
            Installation("lidar", rate_hz=_LIDAR_HZ, frames=village.renderer, **common), preset="vlp16",
            overrides={"range_noise_m": noise.range_m, "mount_m": (0.0, 0.0, 0.12)} | dict(noise.lidar),
        ),
    }  # fmt: skip
    collector = _FrameCollector(sensors, flight.tick_ns)
    frame_period_ns = NS_PER_S // _FRAME_HZ
    frames = []
    for truth in flight.truths:
        collector.add(truth)
        if truth.t_ns % frame_period_ns == 0:
            frames.append(collector.take(truth))
    return frames


def without_gps(frames: Sequence[Frame], from_s: float, until_s: float) -> list[Frame]:
    """Return a copy of the frames in which the GPS has no fix between two times; its samples continue."""
    changed = []
    last_position: dict[str, float] = {}
    for frame in frames:
        without_fix = copy.copy(frame)
        if "gps" in frame:
            gps = copy.copy(frame["gps"])
            values = {name: list(rows) for name, rows in gps.values.items()}
            for k, t_ns in enumerate(values["t_capture_ns"]):
                position_keys = ("latitude_deg", "longitude_deg", "altitude_m")
                if not from_s <= t_ns * 1e-9 < until_s:
                    last_position = {name: values[name][k] for name in position_keys}
                    continue
                lost = {"fix_type": 1, "satellites": 0, "v_W": (0.0, 0.0, 0.0)}
                lost |= {"horizontal_accuracy_m": 1000.0, "vertical_accuracy_m": 1000.0}
                for name, value in (lost | (last_position or dict.fromkeys(position_keys, 0.0))).items():
                    values[name][k] = value
            gps.values = values
            without_fix.samples = {**frame.samples, "gps": gps}
        changed.append(without_fix)
    return changed
