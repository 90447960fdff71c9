"""Flights of the explorer without an autopilot: its own code, the bench's sensors, a vehicle that follows velocities.

A flight of a minute and a half takes a few seconds, so that many villages can be tried. The vehicle follows the
velocity wanted as a quadrotor with an autopilot does:

    a_wanted = (v_wanted - v) / tau, at most a_most;   a' = (a_wanted - a) / tau_tilt;   v' = a;   p' = v

and tilts as its acceleration asks for. Frames are those of a bench with the same sensors; nothing is timed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hil.companion.offline import Change, OfflineFrames
from hil.companion.started import use_client
from hil.config.schema import Goal
from hil.goal.judgement import GoalMeasurement, GoalResult
from hil.signals.rotation import conjugate, product
from hil.signals.samples import Quat, TruthState, Vec3
from hil.signals.time import NS_PER_S
from hil.signals.units import STANDARD_GRAVITY_MPS2
from sim.frame.mount import Mount
from sim.frame.source import FrameSource
from sim.physics.vehicle import Vehicle
from sim.scene.scene import Scene
from sim.sensors.catalog import make_sensor
from sim.sensors.lidar import Lidar

TICK_NS = 4_000_000
_TAU_S, _TAU_TILT_S, _MOST_MPS2 = 0.35, 0.12, 4.0
_TAU_UP_S, _MOST_UP_MPS2 = 0.3, 3.0
_YAW_GAIN_PER_S, _YAW_RATE_RADPS = 2.5, 1.5
_REST = (0.0, 0.0, 0.0)
START_Z_M = 0.23  # of an x500 on its feet
SENSORS: dict[str, dict[str, Any]] = {
    "imu": {"preset": "icm20689", "rate_hz": 250.0},
    "gps": {"preset": "m8n", "rate_hz": 10.0},
    "baro": {"preset": "ms5611", "rate_hz": 50.0},
    "lidar": {"preset": "vlp16", "rate_hz": 10.0, "mount_m": [0.0, 0.0, 0.12]},
}


@dataclass
class Follower:
    """The vehicle. Velocities in W; the ground holds it until it is asked to climb."""

    p: np.ndarray
    yaw: float = 0.0
    v: np.ndarray = field(default_factory=lambda: np.zeros(3))
    a: np.ndarray = field(default_factory=lambda: np.zeros(3))
    q: Quat = (1.0, 0.0, 0.0, 0.0)
    w: Vec3 = (0.0, 0.0, 0.0)

    def step(self, wanted_v: Sequence[float], wanted_yaw: float | None, dt_s: float) -> None:
        wanted = np.asarray(wanted_v, float)
        pull = (wanted - self.v) / np.array([_TAU_S, _TAU_S, _TAU_UP_S])
        level = math.hypot(pull[0], pull[1])
        if level > _MOST_MPS2:
            pull[:2] *= _MOST_MPS2 / level
        pull[2] = min(max(pull[2], -_MOST_UP_MPS2), _MOST_UP_MPS2)
        self.a = self.a + (pull - self.a) * (dt_s / _TAU_TILT_S)
        self.v = self.v + self.a * dt_s
        self.p = self.p + self.v * dt_s
        if wanted_yaw is not None:
            rate = _YAW_GAIN_PER_S * math.remainder(wanted_yaw - self.yaw, 2.0 * math.pi)
            self.yaw += min(max(rate, -_YAW_RATE_RADPS), _YAW_RATE_RADPS) * dt_s
        before, self.q = self.q, attitude(self.a, self.yaw)
        self.w = _rate(before, self.q, dt_s)

    def truth(self, tick: int) -> TruthState:
        def three(v: Any) -> Vec3:
            return (float(v[0]), float(v[1]), float(v[2]))

        t_ns = tick * TICK_NS
        motion = three(self.v), self.w, three(self.a), _REST
        return TruthState(tick, t_ns, three(self.p), self.q, *motion, (0.0,) * 4, False)


def attitude(a: np.ndarray, yaw: float) -> Quat:
    """With thrust along the specific force, looking along yaw."""
    z = np.array([a[0], a[1], a[2] + STANDARD_GRAVITY_MPS2])
    z /= np.linalg.norm(z)
    y = np.cross(z, (math.cos(yaw), math.sin(yaw), 0.0))
    y /= np.linalg.norm(y)
    R = np.stack([np.cross(y, z), y, z], axis=1)
    w = 0.5 * math.sqrt(max(1.0 + R[0, 0] + R[1, 1] + R[2, 2], 1e-12))
    if w > 1e-3:
        k = 0.25 / w
        return (w, float(R[2, 1] - R[1, 2]) * k, float(R[0, 2] - R[2, 0]) * k, float(R[1, 0] - R[0, 1]) * k)
    return (0.0, 0.0, math.cos(0.5 * math.pi + yaw), math.sin(0.5 * math.pi + yaw))  # looking back, nearly level


def _rate(before: Quat, after: Quat, dt_s: float) -> Vec3:
    """In the body: before times exp(w dt / 2) is after."""
    w, x, y, z = product(conjugate(before), after)
    k = (2.0 if w >= 0.0 else -2.0) / dt_s
    return (k * x, k * y, k * z)


@dataclass(frozen=True)
class Flown:
    """One flight: what it was worth, and frame by frame where the vehicle was and what was wanted (W)."""

    result: GoalResult
    t_s: np.ndarray
    p_W: np.ndarray
    wanted_W: np.ndarray
    explorer: Any


class ClosedLoop:
    """A vehicle, its sensors and the explorer in one scene. `step` is one tick, `fly` a flight.

    `localiser` is given the sensors' calibrations. `change` may alter a sample, or take it away (None); `watch` sees
    explorer, truth and desired state at every frame.
    """

    def __init__(
        self,
        scene: Scene,
        frames: FrameSource,
        vehicle: Vehicle,
        goal: Goal,
        localiser: Callable[[Mapping[str, Mapping[str, Any]]], Any],
        *,
        seed: int = 1,
        frame_hz: int = 20,
        flight: Mapping[str, Any] | None = None,
        sensors: Mapping[str, Mapping[str, Any]] | None = None,
        change: Change | None = None,
        watch: Callable[[Any, TruthState, Any], None] | None = None,
    ) -> None:
        use_client()
        from hil_companion.explore.explorer import Explorer
        from hil_companion.explore.settings import FlightSettings

        self._geometry: Any = frames.geometry
        made, told = _make(scene, frames, seed, {**SENSORS, **(sensors or {})})
        self._frames = OfflineFrames(made, tick_ns=TICK_NS, change=change)
        settings = FlightSettings(**{"height_m": goal.p_W[2], **(flight or {})})
        self.explorer = Explorer(settings, localiser(told), goal.p_W[:2], told.get("lidar"))
        self.measurement = GoalMeasurement(goal, vehicle)
        self.vehicle = Follower(np.array([0.0, 0.0, START_Z_M]))
        self._every = round(NS_PER_S / frame_hz / TICK_NS)
        self._watch = watch
        self._desired: Any = None
        self._tick = 0
        self._seen: list[tuple[float, Vec3, Vec3]] = []

    def fly(self, limit_s: float = 300.0) -> Flown:
        """Until the explorer is finished, or so long."""
        for _ in range(round(limit_s * NS_PER_S / TICK_NS)):
            self.step()
            if self.explorer.finished:
                break
        self.measurement.conclude(self._geometry)
        t_s, p_W, wanted_W = (np.array(column) for column in zip(*self._seen, strict=True))
        return Flown(self.measurement.result, t_s, p_W, wanted_W, self.explorer)

    def step(self) -> None:
        """One tick: the vehicle, its sensors, and a frame where one is due."""
        self._tick += 1
        desired = self._desired
        wanted_v, yaw = (_REST, None) if desired is None else (desired.v_W, desired.yaw_rad)
        self.vehicle.step(wanted_v, yaw, TICK_NS / NS_PER_S)
        truth = self.vehicle.truth(self._tick)
        self.measurement.add(truth)
        self._frames.add(truth)
        if self._tick % self._every:
            return
        self._desired = self.explorer.step(self._frames.take(truth))
        self.measurement.reported(self.explorer.report.as_map(), truth.t_ns)
        if self._watch is not None:
            self._watch(self.explorer, truth, self._desired)
        x, y, z = self._desired.v_W
        self._seen.append((truth.t_ns / NS_PER_S, truth.p_WB, (x, y, z)))


def _make(
    scene: Scene, frames: FrameSource, seed: int, sensors: Mapping[str, Mapping[str, Any]]
) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """Sensors, and their calibrations as clients are told them."""
    made: dict[str, Any] = {}
    told: dict[str, dict[str, Any]] = {}
    for name, values in sensors.items():
        rest = {key: value for key, value in values.items() if key not in ("preset", "rate_hz")}
        sensor: Any = make_sensor(
            name,
            preset=values["preset"],
            rate_hz=values["rate_hz"],
            seed=seed,
            scene=scene,
            step_ns=TICK_NS,
            overrides=rest,
            frames=frames,
        )
        made[name] = sensor
        mount = getattr(sensor, "mount", None)
        told[name] = {"kind": values["preset"], "rate_hz": values["rate_hz"]}
        if isinstance(mount, Mount):
            told[name] |= {"p_BC": list(mount.p_BC), "q_BC": list(mount.q_BC)}
        if isinstance(sensor, Lidar):
            told[name] |= {"elevation_deg": list(sensor.ring_elevations_deg)}
    return made, told
