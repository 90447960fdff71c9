"""Sensors of one vehicle with AirSim's error models; a sample is computed when a client asks for it.

Sample k of a sensor of rate F is valid from k / F on: two questions within 1 / F have the same answer, with the time
stamp of the sample. Barometer, magnetometer and GPS measure the state at k / F, whenever they are asked; distance
sensors and LiDARs measure at the first question, because the scene is at hand for the present tick only. The noise of
sample k depends on the vehicle, the sensor's name and k alone, so it does not matter which samples were asked for. A
latency gives barometer, magnetometer and GPS the state and the time stamp of so long ago.

    IMU          white noise and a bias that walks, AirSim's random walk and bias stability; sim.sensors.imu
    barometer    p = p_ISA(h) (1 + d) + n,   d first-order with sigma and tau, 0 at the start
    GPS          position and velocity without noise; eph and epv fall exponentially
    magnetometer s R^T B + b + n,   B of WMM2025, b drawn once from +-NoiseBias for each axis
    distance     along the sensor's x axis to the static scene, + n; the greatest distance where nothing is
    LiDAR        one turn at the instant of the sample; sim.sensors.lidar
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.apps.airsim.settings import sensors as kinds
from hil.apps.airsim.world.ned import body_from_W
from signals._kernel import det_exp, det_pow, rotate_into_world
from signals.frames import frd_from_flu
from signals.noise import NoiseStream
from signals.rotation import matrix_of, product
from signals.samples import Quat, TruthState, Vec3
from signals.time import NS_PER_S
from signals.units import RAD_PER_DEG, STANDARD_GRAVITY_MPS2
from sim.frame.mount import quaternion_of_rpy
from sim.frame.source import SharedFrames
from sim.scene.atmosphere import LOWEST_M, SEA_LEVEL_PA, TOP_M, geopotential_m, pressure_pa
from sim.scene.scene import Scene, Site
from sim.sensors.catalog import make_sensor
from sim.sensors.drift import Drift
from sim.sensors.ground_range import Rays
from sim.sensors.magnetometer import magnetic_field_W_tesla
from sim.sensors.sensor import Installation

_GAUSS_PER_TESLA = 1e4
_QNH_HPA = 1013.25
_IMU_HZ = 250.0
_FIX_3D, _FIX_2D, _NO_FIX = 3, 2, 0


class Mounting:
    """Place of a sensor on its vehicle, given as AirSim does: forward, right, down [m], and roll, pitch, yaw [deg]."""

    def __init__(self, position_m: Vec3, rotation_deg: Vec3) -> None:
        self.position_F = position_m
        self.q_FS = quaternion_of_rpy(rotation_deg)  # sensor FRD -> body FRD
        self._p_B = frd_from_flu(position_m)
        w, x, y, z = self.q_FS
        self._q_BS: Quat = (w, x, -y, -z)  # sensor FLU -> body FLU

    def pose_W(self, truth: TruthState) -> tuple[Vec3, Quat]:
        """Return position and attitude (FLU -> ENU) of the sensor."""
        dx, dy, dz = rotate_into_world(truth.q_WB, self._p_B)
        x, y, z = truth.p_WB
        return (x + dx, y + dy, z + dz), product(truth.q_WB, self._q_BS)


class GpsFix(NamedTuple):
    """Measurement of a GPS."""

    truth: TruthState  # of `latency` ago
    eph_m: float
    epv_m: float
    fix_type: int


class Cloud(NamedTuple):
    """Turn of a LiDAR."""

    p_WL: Vec3
    q_WL: Quat  # FLU -> ENU
    points_L: NDArray[np.float32]  # (n, 3) forward, left, up
    instances: NDArray[np.uint16]  # (n,) indices of `names`
    names: tuple[str, ...]  # of the objects and vehicles at the time of the sample


class SensorSuite:
    """Sensors of one vehicle by name."""

    def __init__(
        self, vehicle: str, settings: dict[str, kinds.Sensor], scene: Scene, site: Site, *, rays: Rays, tick_ns: int
    ) -> None:
        """`site`: the place of the origin of the vehicle's positions, see `local`."""
        self.settings = settings
        self._vehicle, self._scene, self._rays, self._tick_ns = vehicle, scene, rays, tick_ns
        self._site = site
        self._made: dict[str, Any] = {}
        self._last: dict[str, tuple[int, int, Any]] = {}  # number, time and value of the last sample
        self._placed_ns = -1
        self._mounting: dict[str, Mounting] = {}

    def forget(self, t_ns: int) -> None:
        """Forget the samples so far: the vehicle was put elsewhere at `t_ns`, so the next questions get new ones."""
        self._last.clear()
        self._placed_ns = t_ns
        for name, sensor in self.settings.items():
            if isinstance(sensor, kinds.Imu):
                self._made.pop(name, None)  # it integrates from one attitude to the next

    def find(self, kind: type, name: str) -> str | None:
        """Return the name of an enabled sensor of a kind; "" is the first one. None: there is none."""
        names = [key for key, sensor in self.settings.items() if isinstance(sensor, kind) and sensor.enabled]
        if name == "":
            return names[0] if names else None
        return name if name in names else None

    def mounting(self, name: str) -> Mounting:
        """Return the place of a distance sensor or LiDAR."""
        if name not in self._mounting:
            settings: Any = self.settings[name]
            self._mounting[name] = Mounting(settings.position_m, settings.rotation_deg)
        return self._mounting[name]

    def _due(self, name: str, rate_hz: float, t_ns: int) -> int | None:
        """Return the number of the sample that is valid now, None if it was taken already."""
        seq = int(t_ns * rate_hz // NS_PER_S)
        known = self._last.get(name)
        return None if known is not None and known[0] == seq else seq

    def taken_ns(self, name: str) -> int:
        """Return the time of the last sample of a sensor that was asked."""
        return self._last[name][1]

    def _state(self, seq: int, rate_hz: float, truth: TruthState, history: Sequence[TruthState]) -> TruthState:
        """Return the state at the first tick of sample `seq`; after the vehicle was put elsewhere, one from then on."""
        found = truth
        for state in reversed(history):
            if state.t_ns <= self._placed_ns or int(state.t_ns * rate_hz // NS_PER_S) < seq:
                break
            found = state
        return found

    @staticmethod
    def _ago(latency_s: float, state: TruthState, history: Sequence[TruthState]) -> TruthState:
        """Return the state `latency_s` before `state`, or the oldest one."""
        then_ns = state.t_ns - round(latency_s * NS_PER_S)
        return next((each for each in reversed(history) if each.t_ns <= then_ns), history[0])

    def _noise(self, name: str, lanes: int) -> NoiseStream:
        if name not in self._made:
            self._made[name] = NoiseStream(1, f"{self._vehicle}.{name}", lanes=lanes)
        stream: NoiseStream = self._made[name]
        return stream

    def imu(self, name: str, truth: TruthState) -> tuple[Vec3, Vec3]:
        """Return specific force [m/s2] and rate [rad/s] along the body's axes (FRD)."""
        seq = self._due(name, _IMU_HZ, truth.t_ns)
        if seq is not None:
            if name not in self._made:
                settings = self.settings[name]
                assert isinstance(settings, kinds.Imu)
                installation = Installation(
                    f"{self._vehicle}.{name}", rate_hz=_IMU_HZ, seed=1, scene=self._scene, step_ns=self._tick_ns
                )
                self._made[name] = make_sensor(installation, kind="imu", overrides=_imu(settings))
            sample = self._made[name].sample(truth, seq)
            self._last[name] = (seq, truth.t_ns, (frd_from_flu(sample.accel_mps2), frd_from_flu(sample.gyro_radps)))
        found: tuple[Vec3, Vec3] = self._last[name][2]
        return found

    def barometer(
        self, name: str, truth: TruthState, history: Sequence[TruthState], altitude_of: Callable[[Vec3], float]
    ) -> tuple[float, float, float]:
        """Return altitude [m], pressure [Pa] and QNH [hPa]; `altitude_of`: the true altitude of a position."""
        settings = self.settings[name]
        assert isinstance(settings, kinds.Barometer)
        seq = self._due(name, settings.rate_hz, truth.t_ns)
        if seq is not None:
            drift = self._made.get(f"{name}.drift")
            if drift is None:
                phi = det_exp(-1.0 / (settings.rate_hz * settings.pressure_factor_tau_s))
                step = settings.pressure_factor_sigma * sqrt(1.0 - phi * phi)
                drift = Drift(1, f"{self._vehicle}.{name}.drift", lanes=1, start=0.0, phi=phi, step=step)
                self._made[f"{name}.drift"] = drift
            truth = self._ago(settings.latency_s, self._state(seq, settings.rate_hz, truth, history), history)
            altitude_m = altitude_of(truth.p_WB)
            true_pa = pressure_pa(min(max(geopotential_m(altitude_m), LOWEST_M), TOP_M))
            noise = self._noise(name, 1).normal(seq)[0]
            pressure = true_pa * (1.0 + drift.at(seq)[0]) + settings.noise_pa * noise
            # AirSim's altitude of a pressure, that of the US standard atmosphere in feet.
            altitude = (1.0 - det_pow(pressure / SEA_LEVEL_PA, 0.190284)) * 145366.45 * 0.3048
            self._last[name] = (seq, truth.t_ns, (altitude, pressure, _QNH_HPA))
        found: tuple[float, float, float] = self._last[name][2]
        return found

    def magnetometer(self, name: str, truth: TruthState, history: Sequence[TruthState]) -> Vec3:
        """Return the field along the body's axes (FRD) [Gauss]."""
        settings = self.settings[name]
        assert isinstance(settings, kinds.Magnetometer)
        seq = self._due(name, settings.rate_hz, truth.t_ns)
        if seq is not None:
            if f"{name}.field" not in self._made:
                self._made[f"{name}.field"] = magnetic_field_W_tesla(self._site)
            truth = self._ago(settings.latency_s, self._state(seq, settings.rate_hz, truth, history), history)
            field = body_from_W(truth.q_WB, self._made[f"{name}.field"])
            noise = self._noise(name, 3).normal(seq)
            bias = NoiseStream(1, f"{self._vehicle}.{name}.bias", lanes=3).uniform_block(0).ravel()[:3].tolist()
            x, y, z = (
                settings.scale_factor * _GAUSS_PER_TESLA * b
                + settings.bias_gauss * (2.0 * u - 1.0)
                + settings.noise_gauss * n
                for b, u, n in zip(field, bias, noise, strict=True)
            )
            self._last[name] = (seq, truth.t_ns, (x, y, z))
        found: Vec3 = self._last[name][2]
        return found

    def gps(self, name: str, history: Sequence[TruthState]) -> GpsFix:
        """Return the fix; `history`: the true states up to now, the present one last."""
        settings = self.settings[name]
        assert isinstance(settings, kinds.Gps)
        t_ns = history[-1].t_ns
        seq = self._due(name, settings.rate_hz, t_ns)
        if seq is not None:
            state = self._state(seq, settings.rate_hz, history[-1], history)
            t_ns, truth = state.t_ns, self._ago(settings.latency_s, state, history)
            eph, epv = (
                final + (first - final) * det_exp(-max(0.0, truth.t_ns / NS_PER_S) / max(tau, 1e-6))
                for first, final, tau in (
                    (settings.eph_initial_m, settings.eph_final_m, settings.eph_time_constant_s),
                    (settings.epv_initial_m, settings.epv_final_m, settings.epv_time_constant_s),
                )
            )
            fix = _FIX_3D if eph <= settings.eph_min_3d_m else _FIX_2D if eph <= settings.eph_min_2d_m else _NO_FIX
            if t_ns < round(settings.startup_s * NS_PER_S):
                fix = _NO_FIX
            self._last[name] = (seq, truth.t_ns, GpsFix(truth, eph, epv, fix))
        found: GpsFix = self._last[name][2]
        return found

    def distance(self, name: str, truth: TruthState) -> float:
        """Return the distance [m] along the sensor's x axis."""
        settings = self.settings[name]
        assert isinstance(settings, kinds.Distance)
        seq = self._due(name, settings.rate_hz, truth.t_ns)
        if seq is not None:
            origin_W, q_WS = self.mounting(name).pose_W(truth)
            hit_m = self._rays.ray_distance(origin_W, rotate_into_world(q_WS, (1.0, 0.0, 0.0)))
            distance = settings.max_m if hit_m < 0.0 else min(hit_m, settings.max_m)
            distance += settings.noise_m * self._noise(name, 1).normal(seq)[0]  # beyond the limits too, as in AirSim
            self._last[name] = (seq, truth.t_ns, distance)
        found: float = self._last[name][2]
        return found

    def lidar(self, name: str, truth: TruthState, frames: SharedFrames) -> Cloud:
        """Return the cloud; `frames`: the geometry at the present tick."""
        settings = self.settings[name]
        assert isinstance(settings, kinds.Lidar)
        seq = self._due(name, settings.rate_hz, truth.t_ns)
        made = self._made.get(name)
        if made is None or made[0] is not frames:
            installation = Installation(
                f"{self._vehicle}.{name}",
                rate_hz=settings.rate_hz,
                seed=1,
                scene=self._scene,
                step_ns=self._tick_ns,
                frames=frames,
            )
            made = self._made[name] = (frames, make_sensor(installation, kind="lidar", overrides=_lidar(settings)))
        if seq is not None:
            sensor: Any = made[1]
            sample = sensor.sample(truth, seq)
            p_WL, q_WS = self.mounting(name).pose_W(truth)
            points, instances = in_view(sample.points_L, sensor.instances(), settings)
            if settings.noise_m:
                points = with_range_noise(points, f"{self._vehicle}.{name}.range", seq, settings)
            self._last[name] = (
                seq,
                truth.t_ns,
                Cloud(p_WL, q_WS, points, instances, frames.geometry.world.instance_names),
            )
        found: Cloud = self._last[name][2]
        return found


def _imu(settings: kinds.Imu) -> dict[str, Any]:
    """Return parameters of sim.sensors.imu for AirSim's figures."""
    noisy = 1.0 if settings.noisy else 0.0
    degps = RAD_PER_DEG
    return {
        "accel_noise_mps2_per_rthz": noisy * settings.velocity_random_walk_mg * 1e-3 * STANDARD_GRAVITY_MPS2,
        "gyro_noise_radps_per_rthz": noisy * settings.angular_random_walk_deg_per_sqrt_h * degps / 60.0,
        "accel_walk_mps3_per_rthz": noisy
        * settings.accel_bias_ug
        * 1e-6
        * STANDARD_GRAVITY_MPS2
        / sqrt(settings.accel_bias_tau_s),
        "gyro_walk_radps2_per_rthz": noisy
        * settings.gyro_bias_deg_per_h
        * degps
        / 3600.0
        / sqrt(settings.gyro_bias_tau_s),
        "accel_turn_on_bias_mps2": 0.0,
        "gyro_turn_on_bias_radps": 0.0,
        "accel_range_mps2": 10_000.0,
        "gyro_range_radps": 1_000.0,
        "accel_bits": 32,
        "gyro_bits": 32,
        "temperature_degc": 25.0,
        "temperature_noise_degc": 0.0,
    }


def _lidar(settings: kinds.Lidar) -> dict[str, Any]:
    """Return parameters of sim.sensors.lidar: one turn per sample, all rays at once."""
    n, (low, high) = settings.channels, settings.vertical_fov_deg
    step = (high - low) / (n - 1) if n > 1 else 0.0
    roll, pitch, yaw = settings.rotation_deg
    return {
        "pattern": {
            "kind": "spinning",
            "elevation_deg": [high - step * i for i in range(n)],
            "firing_ns": 0,
            "columns": _columns(settings),
        },
        "min_range_m": 0.0,
        "max_range_m": settings.range_m,
        "range_noise_m": 0.0,  # `with_range_noise`
        "range_resolution_m": 1e-6,
        "rolling": False,
        "subsweeps": 1,
        "mount_m": frd_from_flu(settings.position_m),
        "mount_rpy_deg": (roll, -pitch, -yaw),
    }


def _columns(settings: kinds.Lidar) -> int:
    """Return the number of firings of a channel per turn."""
    return max(1, round(settings.points_per_second / settings.rate_hz / settings.channels))


def in_view(
    points_L: NDArray[np.float32], instances: NDArray[np.uint16], settings: kinds.Lidar
) -> tuple[NDArray[np.float32], NDArray[np.uint16]]:
    """Return the points of beams between two azimuths, clockwise from ahead. Equal azimuths are a whole turn, as in
    AirSim. The azimuth is that of the beam's column, so it does not depend on the range or the machine.
    """
    begin, end = settings.horizontal_fov_deg
    if end - begin >= 359.0 or (end - begin) % 360.0 == 0.0:
        return points_L, instances
    count = _columns(settings)
    column = np.rint(np.arctan2(-points_L[:, 1], points_L[:, 0]) * (count / (2.0 * np.pi)) + 0.5 * count)
    azimuth = column.astype(np.float64) * 360.0 / count - 180.0
    inside = (azimuth - begin) % 360.0 <= (end - begin) % 360.0
    return points_L[inside], instances[inside]


def with_range_noise(points_L: NDArray[np.float32], name: str, seq: int, settings: kinds.Lidar) -> NDArray[np.float32]:
    """Return the points with noise along their rays, of the deviation that Cosys-AirSim gives a distance r:

    sigma (1 + (r / range) (scale - 1))
    """
    if not len(points_L):
        return points_L
    points = points_L.astype(np.float64)
    normals = NoiseStream(1, name, lanes=-(-len(points) // 256)).normal_block(seq).ravel()[: len(points)]
    r_m = np.sqrt(points[:, 0] ** 2 + points[:, 1] ** 2 + points[:, 2] ** 2)
    sigma_m = settings.noise_m * (1.0 + r_m / settings.range_m * (settings.noise_scale - 1.0))
    scale = np.maximum(1.0 + sigma_m * normals / np.maximum(r_m, 1e-6), 0.0)
    return (points * scale[:, None]).astype(np.float32)


def ned_points(points_L: NDArray[np.float32], p_N: Vec3, q_WL: Quat) -> NDArray[np.float32]:
    """Return points of a LiDAR in NED from an origin, as (n, 3); `p_N`: the LiDAR in that frame."""
    x, y, z = points_L.reshape(-1, 3).astype(np.float64).T
    # Sums are written out: the order of additions in a matrix product depends on the machine.
    R = matrix_of(q_WL)
    east, north, up = (R[i] * x + R[i + 1] * y + R[i + 2] * z for i in (0, 3, 6))
    return np.stack([north + p_N[0], east + p_N[1], p_N[2] - up], axis=1).astype(np.float32)
