"""Ports of a bench as observations: spaces made from the types of their samples, and the newest samples as arrays.

    truth, imu, gps ...   the numbers of the sample in the order of its fields, without sequence number and time stamps
    CAMERA/CHANNEL        (height, width, components); no surface in depth and range: the camera's far_m
    LIDAR                 (points, 6): x, y, z in L [m], intensity, ring, time offset [s]; unused rows at the end are 0
    RADAR/raw             (receivers, chirps, samples), RADAR/range_doppler (chirps, samples / 2)
    RADAR/points, tracks  (max_points or max_tracks, fields); unused rows at the end are 0

A value is the one that has arrived by the time of the observation, with the latency of its sensor; before the first it
is 0. Only the sensors of observed ports are made, with the observed channels alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from gymnasium.spaces import Box
from numpy.lib.recfunctions import structured_to_unstructured
from numpy.typing import NDArray

from hil.config import Bench, SensorConfig
from hil.run.loop.scheduler import ReleaseQueue
from hil.run.recorder.frame_description import FrameDescription
from hil.run.sensors.frame_stages import TRUTH, available_ports, description, make_frames, output_ports
from hil.run.sensors.simulated_sensors import SimulatedSensors
from signals.channels import CHANNELS
from signals.documents.validate import nearest
from signals.errors import ConfigError, Problem
from signals.samples import SAMPLE_FIELDS, GpsSample, ImageSample, PointCloudSample, RadarSample, TruthState, Vec3
from signals.time import NS_PER_S
from sim.frame.source import SharedFrames
from sim.physics.vehicle import Vehicle
from sim.radar.processing.points import POINT_DTYPE
from sim.radar.processing.tracker import TRACK_DTYPE
from sim.randomize.settings import Randomize
from sim.sensors.catalog import KINDS
from sim.sensors.faults import FaultySensor
from sim.sensors.sensor import Sensor

# Greatest size of a value in each unit; values are clipped to it, so that every observation lies in its space.
_MOST = {
    "m": 1e5, "m/s": 1e3, "rad/s": 1e5, "m/s2": 1e6, "rad/s2": 1e9, "rad": 1e3, "deg": 360.0, "T": 1.0, "Pa": 2e5,
    "degC": 1e3, "ns": 1e11, "1": 1e5, "bool": 1.0,
}  # fmt: skip
_MOST_OTHER = 1e12
_LIDAR_COLUMNS = 6
_STAMPS = 3  # seq, t_capture_ns, t_available_ns
_TRUTH_STAMPS = 2  # tick, t_ns

Array = NDArray[Any]


class _Port:
    """One observed port: its space, and the array of a sample."""

    def __init__(self, space: Box, convert: Callable[[Any], Array]) -> None:
        self.space = space
        self.value: Array = np.zeros(space.shape, space.dtype)
        self.convert = convert


class Ports:
    """Observed ports of one vehicle. Raises ConfigError for names that are not ports of the bench."""

    def __init__(
        self,
        bench: Bench,
        names: Sequence[str],
        frames: SharedFrames | None = None,
        *,
        wind_at: Callable[[], Vec3] | None = None,
    ) -> None:
        """`frames`: the geometry that this vehicle sees among others; None: that of the bench's scene, if needed.

        `wind_at` returns the wind at the vehicle [m/s, W]; None: it is the scene's steady wind.
        """
        config = bench.config
        known = available_ports(config)
        if unknown := [name for name in names if name not in known]:
            raise ConfigError(
                [Problem("ports", f"{n!r} is not a port of the bench", nearest(n, known)) for n in unknown]
            )
        self._bench, self._wind_at = bench, wind_at
        self._of_sensor: dict[str, dict[str, str]] = {}  # sensor -> channel ("" if it has none) -> port
        for name, sensor in config.sensors.items():
            ports = [port.name for port in output_ports(name, sensor) if port.name in names]
            if ports:
                self._of_sensor[name] = {port.removeprefix(name).removeprefix("/"): port for port in ports}
        self._settings = {name: config.sensors[name] for name in self._of_sensor}
        self._frames = frames
        if frames is None and self.need_frames(bench, names):
            self._frames = make_frames(bench)
        self._tick_millihz = config.tick_hz * 1000
        self._rates = {name: round(sensor.rate_hz * 1000) for name, sensor in self._settings.items()}
        # Cameras come before the radars that read their pictures.
        self._order = sorted(
            self._settings, key=lambda n: getattr(self._settings[n].parameters, "frame", None) is not None
        )
        self._sensors: dict[str, Sensor] = {}
        self._sample: dict[str, Callable[[TruthState, int], Any]] = {}
        self._seq: dict[str, int] = {}
        self._queue = ReleaseQueue()
        self._make(config.seed)
        self._ports = {name: self._port(name, bench.vehicle) for name in names}
        self._zeros = {name: port.value for name, port in self._ports.items()}
        self._truth = self._ports.get(TRUTH)
        self._listener: Callable[[str, Any], None] | None = None
        self._is_new = False
        self._first: list[tuple[str, Any]] = []  # samples that had arrived at the start of the episode
        self._ticks = dict.fromkeys(self._order, 0)  # next tick at which each sensor is due

    def describe(self, take: Callable[[str, FrameDescription], None]) -> None:
        """Give the mount and projection of every observed camera, LiDAR and radar to a recorder."""
        for name in self._order:
            if KINDS[self._settings[name].kind].needs_frames:
                take(name, description(name, self._sensors[name]))

    @staticmethod
    def need_frames(bench: Bench, names: Sequence[str]) -> bool:
        """Return True if a sensor of these ports needs the world's geometry."""
        sensors = bench.config.sensors
        observed = {name.partition("/")[0] for name in names}
        return any(
            KINDS[sensor.kind].needs_geometry(sensor.parameters) for name, sensor in sensors.items() if name in observed
        )

    @property
    def spaces(self) -> dict[str, Box]:
        """Space of each port."""
        return {name: port.space for name, port in self._ports.items()}

    def begin(self, seed: int, truth: TruthState, noise: Randomize | None = None) -> None:
        """Begin an episode: sensors with the noise of a seed, which take their first samples now.

        `noise`: the section of a bench that draws the size of their noise.
        """
        self.close()
        self._make(seed, noise)
        for name, port in self._ports.items():
            port.value = self._zeros[name]
        self._ticks = dict.fromkeys(self._order, truth.tick)
        self._first.clear()
        self._listener, self._is_new = None, True
        self.sample(truth)
        self._is_new = False

    def listen(self, take: Callable[[str, Any], None]) -> None:
        """Give every sample of this episode that arrives, or has arrived, to `take`."""
        for name, sample in self._first:
            take(name, sample)
        self._listener = take

    def next_tick(self, tick: int) -> int:
        """Return the next tick after `tick` at which `sample` has something to do."""
        return max(tick + 1, min(self._ticks.values(), default=1 << 62))

    def sample(self, truth: TruthState) -> None:
        """Take the samples that are due, and those that have arrived."""
        tick = truth.tick
        for name in self._order:
            if self._ticks[name] <= tick:
                seq = self._seq[name]
                self._seq[name] = seq + 1
                rate, per = self._rates[name], self._tick_millihz
                self._ticks[name] = -(-(tick * rate // per + 1) * per // rate)
                sample = self._sample[name](truth, seq)
                if sample is not None:  # a fault may drop it
                    self._queue.push(name, sample)
        for name, sample in self._queue.release(truth.t_ns):
            if self._listener is not None:
                self._listener(name, sample)
            elif self._is_new:
                self._first.append((name, sample))
            for part, port_name in self._of_sensor[name].items():
                port = self._ports[port_name]
                port.value = port.convert(sample.channels[part] if part else sample)  # type: ignore[union-attr]

    def read(self, truth: TruthState) -> dict[str, Array]:
        """Return the present value of every port, in arrays of their own."""
        if self._truth is not None:
            self._truth.value = self._truth.convert(truth)
        return {name: port.value.copy() for name, port in self._ports.items()}

    def value(self, name: str) -> Array:
        """Return the present value of a port, to be read only."""
        return self._ports[name].value

    def close(self) -> None:
        """Release renderers."""
        if self._frames is not None:
            self._frames.close()

    def _make(self, seed: int, noise: Randomize | None = None) -> None:
        changed: dict[str, Any] = {"seed": seed} if noise is None else {"seed": seed, "randomize": noise}
        config = self._bench.config.model_copy(update=changed)
        bench = replace(self._bench, config=config)
        simulated = SimulatedSensors(bench, self._settings, self._frames, wind_at=self._wind_at)
        self._seq = dict.fromkeys(self._order, 0)
        self._queue = ReleaseQueue()
        for name in self._order:
            kind = KINDS[self._settings[name].kind]
            parts = {} if kind.parts is None else {kind.parts: tuple(self._of_sensor[name])}
            sensor = self._sensors[name] = simulated.make(name, parts)
            faults = [fault for fault in config.faults.sensors if fault.sensor == name]
            self._sample[name] = FaultySensor(sensor, faults).sample if faults else sensor.sample

    def _port(self, name: str, vehicle: Vehicle) -> _Port:
        if name == TRUTH:
            return _numbers(TruthState, _TRUTH_STAMPS, vehicle)
        sensor_name, _, part = name.partition("/")
        sensor, settings = self._sensors[sensor_name], self._settings[sensor_name]
        sample_type = KINDS[settings.kind].sample_type
        if sample_type is ImageSample:
            return _picture(part, settings.parameters)
        if sample_type is PointCloudSample:
            return _cloud(settings, sensor.period_ns)
        if sample_type is RadarSample:
            return _radar(part, settings.parameters)
        return _numbers(sample_type, _STAMPS, vehicle)


_WIDTHS = {"q_WB": 4, "flow_rad": 2}
_VECTORS = frozenset(
    (
        "p_WB",
        "v_WB_W",
        "w_WB_B",
        "a_WB_W",
        "alpha_WB_B",
        "accel_mps2",
        "gyro_radps",
        "field_tesla",
        "v_W",
        "gyro_rad",
        "axis_B",
    )
)


def field_widths(sample_type: type, rotors: int, surfaces: int = 0) -> dict[str, int]:
    """Return the number of values of each field of a sample without arrays."""
    widths = {}
    of_vehicle = {"rotor_speed_radps": rotors, "surface_rad": surfaces}
    for name in list(SAMPLE_FIELDS[sample_type])[_TRUTH_STAMPS if sample_type is TruthState else _STAMPS :]:
        widths[name] = of_vehicle[name] if name in of_vehicle else 3 if name in _VECTORS else _WIDTHS.get(name, 1)
    return widths


def _numbers(sample_type: type, stamps: int, vehicle: Vehicle) -> _Port:
    units = SAMPLE_FIELDS[sample_type]
    widths = field_widths(sample_type, len(vehicle.rotors), len(vehicle.servos))
    dtype = np.float64 if sample_type is GpsSample else np.float32  # 1e-5 degrees are a metre
    most = np.concatenate([np.full(n, _MOST.get(units[name][0], _MOST_OTHER)) for name, n in widths.items()])
    most = most.astype(dtype)

    def convert(sample: Any) -> Array:
        values: list[float] = []
        for value in sample[stamps:]:
            if isinstance(value, tuple):
                values += value
            else:
                values.append(value)
        array = np.array(values, dtype)
        return np.clip(array, -most, most, out=array)

    return _Port(Box(-most, most, dtype=dtype), convert)


def _picture(channel: str, parameters: Any) -> _Port:
    kind = CHANNELS[channel]
    height, width = parameters.model().height, parameters.model().width
    shape = (height, width, kind.components)
    if np.issubdtype(np.dtype(kind.dtype), np.integer):
        least = min(int(kind.nothing or 0), 0)
        return _Port(Box(least, np.iinfo(kind.dtype).max, shape, kind.dtype), lambda array: array.reshape(shape))  # type: ignore[arg-type]
    far_m = float(np.float32(parameters.far_m))
    low, high = {"distance": (0.0, far_m), "direction": (-1.0, 1.0)}.get(kind.look, (-1e3, 1e3))
    return _Port(Box(low, high, shape, np.float32), lambda array: np.clip(array, low, high).reshape(shape))


def _cloud(settings: SensorConfig, period_ns: int) -> _Port:
    points = settings.parameters.pattern.points(period_ns)
    most = np.float32(_MOST["m"])

    def convert(sample: PointCloudSample) -> Array:
        array = np.zeros((points, _LIDAR_COLUMNS), np.float32)
        count = len(sample.range_m)
        array[:count, :3] = sample.points_L
        array[:count, 3] = sample.intensity
        array[:count, 4] = sample.ring
        array[:count, 5] = sample.time_offset_ns * (1.0 / NS_PER_S)
        return array

    return _Port(Box(-most, most, (points, _LIDAR_COLUMNS), np.float32), convert)


def _radar(channel: str, parameters: Any) -> _Port:
    if channel == "raw":
        return _Port(Box(0, 65535, parameters.raw_shape, np.uint16), lambda array: array)
    if channel == "range_doppler":
        high = float(np.float32(1e18))
        return _Port(
            Box(0.0, high, parameters.map_shape, np.float32), lambda array: np.clip(array, 0.0, high, dtype=np.float32)
        )
    dtype = POINT_DTYPE if channel == "points" else TRACK_DTYPE
    processing = parameters.processing
    rows = processing.max_points if channel == "points" else processing.max_tracks
    columns = structured_to_unstructured(np.zeros(0, dtype)).shape[1]
    most = np.float32(_MOST_OTHER)

    def convert(records: Array) -> Array:
        array = np.zeros((rows, columns), np.float32)
        array[: len(records)] = structured_to_unstructured(records, np.float32)[:rows]
        return np.clip(array, -most, most, out=array)

    return _Port(Box(-most, most, (rows, columns), np.float32), convert)
